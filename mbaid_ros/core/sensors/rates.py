"""Velocities derived from positions.

Missing velocities are derivatives of a polynomial fitted to a window's positions. Their noise follows from that of the
positions; the samples carry it as that of single samples whose mean is as noisy. The error of a polynomial's derivative
is no white noise: it tilts from one end of the window to the other far more than its mean shows, so the samples carry
that ratio, too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.polynomial import legendre

from mbaid_ros.core.geometry import Array, cross, log
from mbaid_ros.core.samples import Samples

# Fourth degree: rates to third order in time; the remainder is far below the noise for motions slower than the window.
_DEGREE = 4
# Condition number of a fit, beyond which its stamps lie too close together, and a lower degree serves.
_WORST_CONDITION = 1e4
FEWEST = 2  # samples that a rate can be taken from


@dataclass(frozen=True)
class PolynomialFit:
    """A polynomial fitted to N instants, for any number of signals."""

    # values, slopes: (N, d + 1) the polynomials and their derivatives (1/s) at the instants
    values: Array
    slopes: Array
    solve: Array  # (d + 1, N) from measurements to coefficients
    mean_gain: float  # variance of the mean slope over that of one measurement, 1/s^2
    tilt: float  # variance of the slope's trend, at the root mean square of the instants, over that of its mean

    def smooth(self, measured: Array) -> tuple[Array, Array]:
        """Return values and derivatives of (N, k) signals."""
        coefficients = self.solve @ measured
        return self.values @ coefficients, self.slopes @ coefficients


def polynomial_fit(time: Array) -> PolynomialFit:
    """Return the fit for N >= 2 instants (s, increasing): of degree 4, or of as much as they determine."""
    for degree in range(min(_DEGREE, len(time) - 1), 1, -1):
        local, condition = _fitted(time, degree)
        if condition < _WORST_CONDITION:
            return local
    return _fitted(time, 1)[0]


def _fitted(time: Array, degree: int) -> tuple[PolynomialFit, float]:
    """Return the fit of a degree to N instants, s, and its condition number."""
    half = 0.5 * (time[-1] - time[0])
    place = (time - time[0]) / half - 1.0
    values = legendre.legvander(place, degree)
    orthonormal, triangle = np.linalg.qr(values)
    slopes = values[:, :-1] @ _derivatives(degree) / half
    solve = np.linalg.solve(triangle, orthonormal.T)
    off = (place - np.mean(place))[:, None]
    trend = off / np.sqrt(np.mean(off**2))  # independent errors have as large a trend as a mean
    mean, tilt = (float(np.sum((np.mean(part, axis=0) @ solve) ** 2)) for part in (slopes, trend * slopes))
    return PolynomialFit(values, slopes, solve, mean, tilt / mean), float(np.linalg.cond(triangle))


@cache
def _derivatives(degree: int) -> Array:
    """Return the coefficients (d, d + 1) of the derivatives of the first d + 1 Legendre polynomials."""
    return np.asarray(legendre.legder(np.eye(degree + 1)))


def with_rates(window: Samples) -> Samples:
    """Return a window of at least two samples with every velocity, incomplete ones derived from the positions."""
    joints, base = window.missing_rates
    if not joints and not base:
        return window
    local = polynomial_fit(window.time)
    if joints:
        window = _joint_rates(window, local)
    return _base_rates(window, local) if base else window


def _joint_rates(window: Samples, local: PolynomialFit) -> Samples:
    absent = ~np.all(np.isfinite(window.joint_velocity), axis=0)
    # About a mid-window position: differences of large angles would lose digits.
    middle = window.joint_position[len(window) // 2]
    slopes = local.smooth(window.joint_position - middle)[1]
    gain = np.where(absent, len(window) * local.mean_gain, np.nan)  # single samples whose mean is as noisy as the slope
    tilt = window.rate_tilt.copy()
    tilt[:, : len(absent)][:, absent] = local.tilt
    return replace(
        window,
        joint_velocity=np.where(absent, slopes, window.joint_velocity),
        joint_rate_gain=np.broadcast_to(gain, slopes.shape),
        rate_tilt=tilt,
    )


def _base_rates(window: Samples, local: PolynomialFit) -> Samples:
    linear = np.all(np.isfinite(window.base_linear_velocity))
    angular = np.all(np.isfinite(window.base_angular_velocity))
    velocity, rate = _base_slopes(window.base_position, window.base_rotation, local)
    to_base = np.zeros((len(window), 6, 6))
    to_base[:, :3, :3] = to_base[:, 3:, 3:] = np.swapaxes(window.base_rotation, -1, -2)
    derived = len(window) * local.mean_gain * (to_base @ window.pose_covariance @ np.swapaxes(to_base, -1, -2))
    covariance, tilt = window.twist_covariance.copy(), window.rate_tilt.copy()
    for block, measured in ((slice(0, 3), linear), (slice(3, 6), angular)):
        if not measured:
            covariance[:, block] = covariance[..., block] = 0.0
            covariance[:, block, block] = derived[:, block, block]
            tilt[:, -6:][:, block] = local.tilt
    return replace(
        window,
        base_linear_velocity=window.base_linear_velocity if linear else velocity,
        base_angular_velocity=window.base_angular_velocity if angular else rate,
        twist_covariance=covariance if linear or angular else derived,
        rate_tilt=tilt,
    )


def _base_slopes(position: Array, rotation: Array, local: PolynomialFit) -> tuple[Array, Array]:
    """Return linear and angular velocities (N, 3) m/s, rad/s, odometry axes, by the poses of a window.

    Parameters
    ----------
    position, rotation : (N, 3) m, (N, 3, 3)
    local : the fit to their instants
    """
    middle = len(position) // 2
    velocity = local.smooth(position - position[middle])[1]
    turn, slope = local.smooth(log(rotation @ rotation[middle].T))
    # R = Exp(turn) R_mid turns at w = J_l(turn) turn', with the left Jacobian of the rotation group.
    angle = np.sqrt(np.sum(turn**2, axis=-1, keepdims=True))
    second = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    third = np.where(angle > 1e-3, (1.0 - np.sinc(angle / np.pi)) / np.maximum(angle, 1e-3) ** 2, 1.0 / 6.0)
    bend = cross(turn, slope)
    return velocity, slope + second * bend + third * cross(turn, bend)
