"""Evidence about a model: innovations, and numbers beside their prior once data have been seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, Integers

SENSORS = ('base_orientation', 'base_position', 'base_angular_velocity', 'base_linear_velocity', 'imu')


@dataclass(frozen=True, eq=False)
class Innovations:
    """Sums over the windows of a run, of each of the m numbers that may be measured.

    These are k of the pose, angular ones first, k of the twist, and those that a gyro measures.
    """

    angular: int  # how many of the k are angular: three, or one in a plane
    # sums, counts: (2, m) of the normalised innovations squared, and of the products of those of neighbouring windows
    sums: Array
    counts: Array
    previous: Array  # (m,) those of the last window; NaN if not measured

    @staticmethod
    def none(poses: int) -> Innovations:
        """Return the sums before the first window, of k = 6 pose measurements, or 3 in a plane."""
        angular = 3 if poses > 3 else 1
        nothing = np.zeros((2, 2 * poses + angular))
        return Innovations(angular, nothing, nothing, np.full(nothing.shape[1], np.nan))

    def after(self, normalised: Array, places: Integers) -> Innovations:
        """Return the sums with a window's normalised innovations (w,), which are of the numbers at some places."""
        latest = np.full(len(self.previous), np.nan)
        latest[places] = normalised
        products = np.array((latest, self.previous)) * latest
        known = np.isfinite(products)
        return Innovations(self.angular, self.sums + np.where(known, products, 0.0), self.counts + known, latest)

    @cached_property
    def _of_sensors(self) -> tuple[Array, Array]:
        """Sums and counts, (2, 5) each, in the order of SENSORS."""
        poses = (len(self.previous) - self.angular) // 2
        ends = (0, self.angular, poses, poses + self.angular, 2 * poses)
        sums, counts = np.add.reduceat(np.array((self.sums, self.counts)), ends, axis=2)
        return sums, counts

    @property
    def count(self) -> Array:
        """How many innovations of each sensor there were, (5,)."""
        return self._of_sensors[1][0]

    @property
    def pairs(self) -> Array:
        """How many pairs of neighbouring windows' innovations of each sensor there were, (5,)."""
        return self._of_sensors[1][1]

    @cached_property
    def ratio(self) -> Array:
        """Mean normalised innovation squared of each sensor, (5,): 1 for noise as declared; NaN without any."""
        return np.where(self.count > 0.0, self._of_sensors[0][0] / np.maximum(self.count, 1.0), np.nan)

    @cached_property
    def ratio_significance(self) -> Array:
        """By how many of its standard deviations, sqrt(2 / n), each ratio exceeds 1, (5,)."""
        return (self.ratio - 1.0) * np.sqrt(0.5 * self.count)

    @cached_property
    def correlation(self) -> Array:
        """Covariance of neighbouring windows' innovations in units of the declared noise, (5,); NaN without any.

        0 where the noise is white. Innovations far below the declared noise do not matter.
        """
        return np.where(self.pairs > 0.0, self._of_sensors[0][1] / np.maximum(self.pairs, 1.0), np.nan)

    @cached_property
    def correlation_significance(self) -> Array:
        """How many of its standard deviations, the ratio over sqrt(n), each of these is, (5,)."""
        return self.correlation / np.maximum(self.ratio, 1.0) * np.sqrt(self.pairs)


# Of a standard deviation, which a cause is tried with: the likelihood is flat enough for steps of three.
_FACTORS = (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
# Times a standard deviation, among which the likeliest is looked for: finer than for causes, as intervals depend on
# it.
_SIZES = (1.25, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0)
# Of the prior's variance, which data have to take off a direction for it to be seen: quotients of less are rounding.
_SEEN = 0.01
# Standard deviations that a solution may move by: a bias of half of one costs a 95 % interval three of its
# hundredths. Of equations that are near linear it moves by some hundredths, where the mass is known to a seventh by
# up to .4, where products of unknowns lead by .5 to 1.2.
LARGEST_SHIFT = 0.5


class LikelyScale(NamedTuple):
    """How many times as far from zero as declared numbers are, the chance of more than once, the gain of likelihood."""

    factor: float
    chance: float
    gain: float


AS_DECLARED = LikelyScale(1.0, 0.0, 0.0)


class Distance(NamedTuple):
    """How far from zero the data see numbers: chi-square as declared, and if twice as far off; degrees of freedom."""

    square: float
    twice: float
    degrees: int


@dataclass(frozen=True, eq=False)
class PriorComparison:
    """Numbers of unit variance beforehand, in the directions that the data know independently.

    If the prior is right, the posterior mean m varies about zero with S = 1 - P, P the posterior covariance; if the
    numbers are k times as far off, with S + (k^2 - 1) S^2. With k times the standard deviation, prior information falls
    by D = 1 - 1/k^2, and the log-likelihood of the data grows by (trajectory.md, eq. 8)

        1/2 m^T (1/D - P)^-1 m  -  1/2 log|1 - D P|  -  n log k
    """

    # mean, variance, curved: (..., n) along these directions; any groups of as many numbers side by side
    mean: Array
    variance: Array
    curved: Flags

    @staticmethod
    def of(mean: Array, covariance: Array, moved: Array | None = None) -> PriorComparison:
        """Return numbers by their mean (..., n) and covariance (..., n, n).

        A direction is curved along which these have `moved` (d, ..., n), where windows were linearised elsewhere, by a
        good part of the deviation sqrt(1 - variance) that means have: the data observe it at second order only.
        """
        variance, directions = np.linalg.eigh(covariance)
        variance, back = np.clip(variance, 0.0, 1.0), np.swapaxes(directions, -1, -2)
        along = (back @ mean[..., None])[..., 0]
        shifts = np.zeros((0, *along.shape)) if moved is None else (back @ moved[..., None])[..., 0]
        return PriorComparison(along, variance, np.any(shifts**2 > LARGEST_SHIFT**2 * (1.0 - variance), axis=0))

    @property
    def distances(self) -> tuple[Array, Array, Array]:
        """The observed distance of each group from zero: (...) for each field of `Distance`."""
        seen = 1.0 - self.variance
        enough = (seen > _SEEN) & ~self.curved
        squares = np.where(enough, self.mean**2, 0.0) / np.where(enough, seen, 1.0)
        twice = squares / (1.0 + 3.0 * seen)
        return np.add.reduce(squares, axis=-1), np.add.reduce(twice, axis=-1), np.add.reduce(enough, axis=-1)

    def gain(self, most: float) -> tuple[Array, Array]:
        """Return the largest gains of log-likelihood (...), and the factors k up to `most` that do it."""
        return self._largest([factor for factor in _FACTORS if factor <= most])

    def likely_sizes(self, too_small: float | Array, doubt: float | Array) -> tuple[Array, Array, Array]:
        """Return the distance of each group from zero over the declared one: (...) for each field of `LikelyScale`.

        The root mean square of one and the likeliest factor, by the chance of either; numbers that the data
        do not observe leave it at one.

        Parameters
        ----------
        too_small : chance that they are declared too certain, before the data are asked; of all groups or (...) each
        doubt : chance afterwards up to which that counts for nothing
        """
        # Only a mean larger than the data expect can gain by a factor.
        larger = np.add.reduce(self.mean**2, axis=-1) > np.add.reduce(1.0 - self.variance, axis=-1)
        if not larger.any():
            nothing = np.zeros(larger.shape)
            return nothing + 1.0, nothing, nothing
        most, factor = self._largest(_SIZES)
        odds = too_small * np.exp(np.minimum(most, 100.0))
        chance = np.maximum(0.0, (odds / (1.0 - too_small + odds) - doubt) / (1.0 - doubt))
        chance = np.where(larger, chance, 0.0)
        return np.sqrt(1.0 + chance * (factor**2 - 1.0)), chance, np.where(larger, np.maximum(most, 0.0), 0.0)

    def _largest(self, factors: Sequence[float]) -> tuple[Array, Array]:
        k = np.array(factors)[:, None]
        less = 1.0 - k**-2
        mean, left = self.mean[..., None, :], 1.0 - less * self.variance[..., None, :]
        gains = 0.5 * np.add.reduce(less * mean**2 / left - np.log(left) - 2.0 * np.log(k), axis=-1)
        return np.asarray(gains.max(axis=-1)), k[gains.argmax(axis=-1), 0]
