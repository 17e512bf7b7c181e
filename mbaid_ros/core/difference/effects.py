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
from numpy.polynomial import polynomial

from mbaid_ros.core.difference.errors_in_variables import Blocks
from mbaid_ros.core.difference.window_rows import mean_rows
from mbaid_ros.core.geometry import Array, skew
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.momentum import regressor
from mbaid_ros.core.samples import Samples

Axes = Literal['inertial', 'body']
Kind = Literal['inertial', 'body', 'delay']
_LATER = 1e-3  # s, for the rate by the joints' motion
_DEGREE = 3  # of the joint rates over a window
AXES: tuple[Axes, ...] = ('inertial', 'body')


class ConstantForce:
    """Adds up what a constant force and torque do to the momentum, from the measured poses.

    Their noise averages out in the integrals.

    Parameters
    ----------
    axes : that they are constant in: those of the base, on its origin; or inertial ones, at the run's origin
    origin : (3,) m, about which the angular momentum is taken, odometry frame

    Attributes
    ----------
    gain : (6, 6) C at the end of the last window
    """

    def __init__(self, axes: Axes, origin: Array) -> None:
        self._axes = axes
        self._origin = origin
        self._last: tuple[float, Array] | None = None  # time, (A; [p]x A), (2, 3, 3)
        self._integral: Array = np.zeros((2, 3, 3))

    @property
    def gain(self) -> Array:
        """C at the end of the last window, (6, 6)."""
        return _gain(self._integral)

    def columns(self, window: Samples) -> Array:
        """Take the next window and return its (6, 6) mean of -T C, where T refers (P, L) to the base's origin."""
        position = skew(window.base_position - self._origin)
        rate = np.zeros((len(window), 2, 3, 3))
        rate[:, 0] = np.eye(3)
        if self._axes == 'body':
            rate[:, 0], rate[:, 1] = window.base_rotation, position @ window.base_rotation
        time, before = self._last or (float(window.time[0]), rate[0])
        step = np.diff(window.time, prepend=time)[:, None, None, None]
        mean = 0.5 * (rate + np.concatenate((before[None], rate[:-1])))
        integral = self._integral + np.cumsum(step * mean, axis=0)
        self._last, self._integral = (float(window.time[-1]), rate[-1]), integral[-1]
        gain = _gain(integral)
        gain[:, 3:, :3] -= position @ integral[:, 0]
        return np.asarray(-np.mean(gain, axis=0))


def _gain(integral: Array) -> Array:
    """Return the (..., 6, 6) matrix of (..., 2, 3, 3) integrals."""
    gain = np.zeros((*integral.shape[:-3], 6, 6))
    gain[..., :3, :3] = gain[..., 3:, 3:] = integral[..., 0, :, :]
    gain[..., 3:, :3] = integral[..., 1, :, :]
    return gain


def with_joints_later(window: Samples, delay: float) -> Samples:
    """Return samples whose joints are those of `delay` s later: their rates' cubic polynomial says where they went."""
    time = window.time - np.mean(window.time)
    rates = polynomial.polyfit(time, window.joint_velocity, min(_DEGREE, len(time) - 1))
    angles = polynomial.polyint(rates)

    def gained(coefficients: Array) -> Array:
        return np.asarray(polynomial.polyval(time + delay, coefficients) - polynomial.polyval(time, coefficients)).T

    return replace(
        window,
        joint_position=window.joint_position + gained(angles),
        joint_velocity=window.joint_velocity + gained(rates),
    )


def delay_columns(kernel: MomentumKernel, windows: list[Samples], rows: Blocks) -> Array:
    """Return each window's mean rate of the momentum by the motion of the joints alone.

    Parameters
    ----------
    kernel : MomentumKernel
    windows : list of K Samples
    rows : of these windows

    Returns
    -------
    (K, 6, 11) array D: the rate is D (1, phi) for standard parameters phi of the target; zero of a single sample
    """
    known, regressors = mean_rows(kernel, [_later(window) for window in windows])
    moved = np.concatenate((known[..., None], regressors[..., :10]), axis=2)
    return np.asarray((moved - np.concatenate((rows.offset[..., None], rows.rows[..., :10]), axis=2)) / _LATER)


def _later(window: Samples) -> Samples:
    """Return a window with the joints where they are a little later."""
    if len(window) < 2:
        return window
    return with_joints_later(window, _LATER)


def body_columns(kernel: MomentumKernel, window: Samples, bodies: tuple[int, ...]) -> Array:
    """Return the window's mean momentum by the standard parameters of known bodies, (6, 10 b).

    Parameters
    ----------
    kernel : MomentumKernel
    window : Samples
    bodies : indices of b bodies
    """
    if not bodies:
        return np.zeros((6, 0))
    states = kernel.states(window)
    chosen = list(bodies)
    place = states.configuration
    rows = regressor(place.rotation[:, chosen], place.position[:, chosen], states.body_twist[:, chosen])
    return np.concatenate(np.mean(rows, axis=0), axis=1)
