"""What may act on the robot or be wrong with it beside its unknown body, as columns of the momentum equations.

A constant force F and torque T change the momentum about the run's origin by C (F, T), with

    C = [[ integral of A dt,        0                ],
         [ integral of [p]x A dt,   integral of A dt ]]

In base axes they act on the base link's origin at p, and A is the base's rotation. In inertial axes they act at the
run's origin, where the base was at first: A is the unit matrix, and p is zero. So does the weight on a tilted table: it
acts at the common centre of mass, which moves along it at most. An error of a known body's standard parameters adds its
own regressor to the equations. (What a delay of the joints' stamps adds stands in delay.py.)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from mbaid_ros.core.difference.window_rows import Counts, mean_of_each
from mbaid_ros.core.geometry import Array, skew
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.momentum import regressor
from mbaid_ros.core.samples import Samples

Axes = Literal['inertial', 'body']
Kind = Literal['inertial', 'body', 'delay']
AXES: tuple[Axes, ...] = ('inertial', 'body')


class ConstantForces:
    """Adds up what constant forces and torques do to the momentum, from the measured poses.

    Their noise averages out in the integrals.

    Parameters
    ----------
    axes : that each of f is constant in: those of the base, on its origin; or inertial ones, at the run's origin
    origin : (3,) m, about which the angular momentum is taken, odometry frame
    """

    def __init__(self, axes: Sequence[Axes], origin: Array) -> None:
        self._axes = axes
        self._origin = origin
        self._began: float | None = None  # s
        self._last: tuple[float, Array] | None = None  # s, (A; [p]x A) in base axes, (2, 3, 3)
        self._integral: Array = np.zeros((2, 3, 3))  # of that over time

    def columns(self, samples: Samples, counts: Counts) -> tuple[Array, Array]:
        """Take the next K windows' samples; return the means of -T C over each, and C at its end, both (K, f, 6, 6).

        T refers (P, L) to the base's origin; `counts` says how many samples each window has.
        """
        position = skew(samples.base_position - self._origin)
        integral = np.zeros((len(samples), len(self._axes), 2, 3, 3))
        for number, axes in enumerate(self._axes):
            integral[:, number] = self._in_base_axes(samples, position) if axes == 'body' else self._inertial(samples)
        at_end = _gain(integral[np.cumsum(counts) - 1])
        integral[:, :, 1] -= position[:, None] @ integral[:, :, 0]
        return -_gain(mean_of_each(integral, counts)), at_end

    def _inertial(self, samples: Samples) -> Array:
        """Return the integrals of (1; 0) until N samples, (N, 2, 3, 3)."""
        self._began = float(samples.time[0]) if self._began is None else self._began
        return (samples.time - self._began)[:, None, None, None] * np.stack((np.eye(3), np.zeros((3, 3))))

    def _in_base_axes(self, samples: Samples, position: Array) -> Array:
        """Return the integrals of (A; [p]x A) until N samples, (N, 2, 3, 3), for (N, 3, 3) [p]x."""
        rate = np.stack((samples.base_rotation, position @ samples.base_rotation), axis=1)
        time, before = self._last or (float(samples.time[0]), rate[0])
        step = np.diff(samples.time, prepend=time)[:, None, None, None]
        mean = 0.5 * (rate + np.concatenate((before[None], rate[:-1])))
        # On from the last sum: added up one by one, it is the same to the last bit however the windows come.
        integral = np.cumsum(np.concatenate((self._integral[None], step * mean)), axis=0)[1:]
        self._last, self._integral = (float(samples.time[-1]), rate[-1]), integral[-1]
        return integral


def _gain(integral: Array) -> Array:
    """Return the (..., 6, 6) matrix of (..., 2, 3, 3) integrals."""
    gain = np.zeros((*integral.shape[:-3], 6, 6))
    gain[..., :3, :3] = gain[..., 3:, 3:] = integral[..., 0, :, :]
    gain[..., 3:, :3] = integral[..., 1, :, :]
    return gain


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
