"""What may act on the robot or be wrong with it beside its unknown body, as columns of the momentum equations.

A constant force F and torque T change the momentum about the run's origin by C (F, T), with

    C = [[ integral of A dt,        0                ],
         [ integral of [p]x A dt,   integral of A dt ]]

In base axes they act on the base link's origin at p, and A is the base's rotation. In inertial axes they act at the
run's origin, where the base was at first: A is the unit matrix, and p is zero. So does the weight on a tilted table: it
acts at the common centre of mass, which moves along it at most. An error of a known body's standard parameters adds its
own regressor to the equations. Joints that are stamped late were measured earlier: their motion since adds the rate of
the momentum by it, times the delay.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from mbaid_ros.core.difference.errors_in_variables import Blocks
from mbaid_ros.core.difference.window_rows import Counts, mean_of_each, mean_rows, sum_of_each
from mbaid_ros.core.geometry import Array, skew
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.momentum import regressor
from mbaid_ros.core.samples import Samples

Axes = Literal['inertial', 'body']
Kind = Literal['inertial', 'body', 'delay']
_LATER = 1e-3  # s, for the rate by the joints' motion
_DEGREE = 3  # of the joint rates over a window
_RESOLUTION = 1e-10  # part of the largest eigenvalue of its normal equations that counts
AXES: tuple[Axes, ...] = ('inertial', 'body')


class ConstantForce:
    """Adds up what a constant force and torque do to the momentum, from the measured poses.

    Their noise averages out in the integrals.

    Parameters
    ----------
    axes : that they are constant in: those of the base, on its origin; or inertial ones, at the run's origin
    origin : (3,) m, about which the angular momentum is taken, odometry frame
    """

    def __init__(self, axes: Axes, origin: Array) -> None:
        self._axes = axes
        self._origin = origin
        self._last: tuple[float, Array] | None = None  # time, (A; [p]x A), (2, 3, 3)
        self._integral: Array = np.zeros((2, 3, 3))

    def columns(self, samples: Samples, counts: Counts) -> tuple[Array, Array]:
        """Take the next K windows' samples; return the means of -T C over each, and C at its end, both (K, 6, 6).

        T refers (P, L) to the base's origin; `counts` says how many samples each window has.
        """
        position = skew(samples.base_position - self._origin)
        rate = np.zeros((len(samples), 2, 3, 3))
        rate[:, 0] = np.eye(3)
        if self._axes == 'body':
            rate[:, 0], rate[:, 1] = samples.base_rotation, position @ samples.base_rotation
        time, before = self._last or (float(samples.time[0]), rate[0])
        step = np.diff(samples.time, prepend=time)[:, None, None, None]
        mean = 0.5 * (rate + np.concatenate((before[None], rate[:-1])))
        # On from the last sum: added up one by one, it is the same to the last bit however the windows come.
        integral = np.cumsum(np.concatenate((self._integral[None], step * mean)), axis=0)[1:]
        self._last, self._integral = (float(samples.time[-1]), rate[-1]), integral[-1]
        gain = _gain(integral)
        at_end = gain[np.cumsum(counts) - 1]
        gain[:, 3:, :3] -= position @ integral[:, 0]
        return -mean_of_each(gain, counts), at_end


def _gain(integral: Array) -> Array:
    """Return the (..., 6, 6) matrix of (..., 2, 3, 3) integrals."""
    gain = np.zeros((*integral.shape[:-3], 6, 6))
    gain[..., :3, :3] = gain[..., 3:, 3:] = integral[..., 0, :, :]
    gain[..., 3:, :3] = integral[..., 1, :, :]
    return gain


def with_joints_later(samples: Samples, counts: Counts, delay: float) -> Samples:
    """Return samples whose joints are those of `delay` s later: their rates' cubic polynomial says where they went.

    Parameters
    ----------
    samples : of K windows
    counts : (K,) how many each has; a single sample does not tell where its joints go, and stays
    delay : s
    """
    centre, last = mean_of_each(samples.time, counts), samples.time[np.cumsum(counts) - 1]
    scale = np.repeat(np.where(counts > 1, last - centre, 1.0), counts)
    time = (samples.time - np.repeat(centre, counts)) / scale
    now, later = (np.vander(instants, _DEGREE + 2, increasing=True) for instants in (time, time + delay / scale))
    powers, gained = now[:, :-1], later - now
    square = sum_of_each(powers[:, :, None] * powers[:, None], counts)
    moments = sum_of_each(powers[:, :, None] * samples.joint_velocity[:, None], counts)
    # Fewer than four samples leave the smallest polynomial.
    fitted = np.linalg.pinv(square, rcond=_RESOLUTION, hermitian=True) @ moments
    rates = np.repeat(fitted * (counts > 1)[:, None, None], counts, axis=0)  # (N, 4, n)
    turned = ((scale[:, None] * gained[:, 1:] / np.arange(1, _DEGREE + 2))[:, None] @ rates)[:, 0]
    return replace(
        samples,
        joint_position=samples.joint_position + turned,
        joint_velocity=samples.joint_velocity + (gained[:, None, :-1] @ rates)[:, 0],
    )


def delay_columns(kernel: MomentumKernel, samples: Samples, counts: Counts, rows: Blocks) -> Array:
    """Return each window's mean rate of the momentum by the motion of the joints alone.

    Parameters
    ----------
    kernel : MomentumKernel
    samples, counts : of K windows
    rows : of these windows

    Returns
    -------
    (K, 6, 11) array D: the rate is D (1, phi) for standard parameters phi of the target; zero of a single sample
    """
    known, regressors = mean_rows(kernel, with_joints_later(samples, counts, _LATER), counts)
    moved = np.concatenate((known[..., None], regressors[..., :10]), axis=2)
    return np.asarray((moved - np.concatenate((rows.offset[..., None], rows.rows[..., :10]), axis=2)) / _LATER)


def body_columns(kernel: MomentumKernel, samples: Samples, counts: Counts, bodies: tuple[int, ...]) -> Array:
    """Return the windows' mean momentum by the standard parameters of known bodies, (K, 6, 10 b).

    Parameters
    ----------
    kernel : MomentumKernel
    samples, counts : of K windows
    bodies : indices of b bodies
    """
    if not bodies:
        return np.zeros((len(counts), 6, 0))
    states = kernel.states(samples)
    chosen = list(bodies)
    place = states.configuration
    rows = regressor(place.rotation[:, chosen], place.position[:, chosen], states.body_twist[:, chosen])
    means = mean_of_each(rows, counts)  # (K, b, 6, 10)
    return np.concatenate(np.moveaxis(means, 1, 0), axis=2)
