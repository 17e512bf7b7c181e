"""Joints that are stamped late were measured earlier: where they were at the stamps, and what that does to momentum.

Their motion since adds the rate of the momentum by it, times the delay.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.difference.window_rows import Counts, mean_of_each, starts_of, sum_of_each
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.rows import MomentumRows
from mbaid_ros.core.samples import Samples

_LATER = 1e-3  # s, for the rate by the joints' motion
_MOST = 8  # samples of a window that say this rate: what it is multiplied by is small
_DEGREE = 3  # of the joint rates over a window
_POWERS = np.arange(_DEGREE + 1)
_RESOLUTION = 1e-10  # part of the largest eigenvalue of its normal equations that counts


@dataclass(frozen=True)
class _Rates:
    """The joints' rates in K windows as polynomials of the time from a window's centre.

    Attributes
    ----------
    centre, scale : (K,) s, of the time, and what it is divided by
    coefficients : (K, 4, n) from the constant on; zero for a single sample, which does not tell where its joints go
    """

    centre: Array
    scale: Array
    coefficients: Array

    @classmethod
    def of(cls, samples: Samples, counts: Counts) -> _Rates:
        """Return what fits K windows' joint velocities best."""
        centre, last = mean_of_each(samples.time, counts), samples.time[np.cumsum(counts) - 1]
        scale = np.where(counts > 1, last - centre, 1.0)
        time = (samples.time - np.repeat(centre, counts)) / np.repeat(scale, counts)
        powers = np.vander(time, 2 * _DEGREE + 1, increasing=True)
        square = sum_of_each(powers, counts)[:, _POWERS[:, None] + _POWERS]
        moments = sum_of_each(powers[:, : _DEGREE + 1, None] * samples.joint_velocity[:, None], counts)
        # Fewer than four samples leave the smallest polynomial.
        fitted = np.linalg.pinv(square, rcond=_RESOLUTION, hermitian=True) @ moments
        return cls(centre, scale, fitted * (counts > 1)[:, None, None])

    def later(self, samples: Samples, counts: Counts, delay: float) -> Samples:
        """Return samples of the same windows whose joints are those of `delay` s later."""
        centre, scale = np.repeat(self.centre, counts), np.repeat(self.scale, counts)
        time = (samples.time - centre) / scale
        now, later = (np.vander(instants, _DEGREE + 2, increasing=True) for instants in (time, time + delay / scale))
        gained = later - now
        rates = np.repeat(self.coefficients, counts, axis=0)  # (N, 4, n)
        turned = ((scale[:, None] * gained[:, 1:] / (_POWERS + 1))[:, None] @ rates)[:, 0]
        return replace(
            samples,
            joint_position=samples.joint_position + turned,
            joint_velocity=samples.joint_velocity + (gained[:, None, :-1] @ rates)[:, 0],
        )


def with_joints_later(samples: Samples, counts: Counts, delay: float) -> Samples:
    """Return samples whose joints are those of `delay` s later: their rates' cubic polynomial says where they went.

    Parameters
    ----------
    samples : of K windows
    counts : (K,) how many each has; a single sample does not tell where its joints go, and stays
    delay : s
    """
    return _Rates.of(samples, counts).later(samples, counts, delay)


@dataclass(frozen=True)
class Moved:
    """Some samples of K windows, spread evenly over each, and the same with joints that have moved on a little.

    Attributes
    ----------
    places : (M,) of them among the samples
    counts : (K,) how many each window has
    later : M Samples
    """

    places: Counts
    counts: Counts
    later: Samples

    @classmethod
    def of(cls, samples: Samples, counts: Counts) -> Moved:
        """Return those of K windows."""
        places, fewer = _spread(counts)
        return cls(places, fewer, _Rates.of(samples, counts).later(samples[places], fewer, _LATER))

    def columns(self, rows: MomentumRows) -> Array:
        """Return each window's mean rate of the momentum by the motion of the joints alone.

        Parameters
        ----------
        rows : of the windows' samples, and after them of `later`; the target is the first unknown link

        Returns
        -------
        (K, 6, 11) array D: the rate is D (1, phi) for standard parameters phi of the target; zero of a single sample
        """
        count = rows.known.shape[-1] - len(self.places)
        known, target = self._rate(rows.known, count), self._rate(rows.regressors[0], count)
        return np.concatenate((known[..., None], target), axis=2)

    def _rate(self, values: Array, count: int) -> Array:
        """Return the (K, ...) mean rates of values (..., count + M) of the samples and of those that have moved on."""
        rate = (values[..., count:] - values[..., self.places]) / _LATER
        return np.moveaxis(np.add.reduceat(rate, starts_of(self.counts), axis=-1) / self.counts, -1, 0)


def _spread(counts: Counts) -> tuple[Counts, Counts]:
    """Return the places of samples that are spread evenly over each window, and how many those are, (K,)."""
    fewer = np.minimum(counts, _MOST)
    number = np.arange(fewer.sum()) - np.repeat(starts_of(fewer), fewer)
    within = np.rint((number + 0.5) * np.repeat(counts / fewer, fewer) - 0.5).astype(np.intp)
    return np.repeat(starts_of(counts), fewer) + within, fewer
