"""Velocities derived from positions, and whether measured ones agree with them.

Missing velocities are derivatives of a polynomial fitted to a window's positions. Their noise follows from that of the
positions; the samples carry it as that of single samples whose mean is as noisy. The error of a polynomial's derivative
is no white noise: it tilts from one end of the window to the other far more than its mean shows, so the samples carry
that ratio, too.

Two checks compare a measured rate with the poses, without a model of the robot: is the twist in the declared frame, and
does the gyro turn as the base does?
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre

from mbaid_ros.core.geometry import Array, cross, log, rotate, rotate_back
from mbaid_ros.core.samples import ArrayRecord, Samples

# Fourth degree: rates to third order in time; the remainder is far below the noise for motions slower than the window.
_DEGREE = 4
# Condition number of a fit, beyond which its stamps lie too close together, and a lower degree serves.
_WORST_CONDITION = 1e4
FEWEST = 2  # samples that a rate can be taken from
_SIGNIFICANT = 6.0  # standard deviations, from which one reading of the twist is the right one: one in a billion
# Standard deviations of the twist's noise: a smaller difference of the readings correlates with it, and decides
# nothing.
_DISTINCT = 5.0
_FEWEST_SAMPLES = 6  # samples in a window, for a rate of its poses that is better than theirs
_ENOUGH = 12.0  # numbers that suffice: fewer do not show their noise
_NAMES = {'child': 'the child frame', 'inertial': 'the inertial frame'}
_FEWEST_WINDOWS = 6  # windows, of three numbers each: enough for a turn and a judgement of it
_TURNED = 0.2  # rad, from which the axes are others: no declared mount is as far off
# Part of the squared disagreement that another reading of the gyro may leave: right axes leave next to nothing.
_BETTER = 0.1
_SURE = 50.0  # log-likelihood by which another reading of the gyro has to be better: no accident in any number of runs
_OFF = 0.02  # part of the motion that a declared error of the gyro's scale or mount may make

Places = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Fit(ArrayRecord):
    """A polynomial fitted to N instants, for any number of signals; for many windows with leading axes."""

    # values, slopes: (..., N, d + 1) the polynomials and their derivatives (1/s) at the instants
    values: Array
    slopes: Array
    solve: Array  # (..., d + 1, N) from measurements to coefficients
    mean_gain: Array  # (...) variance of the mean slope over that of one measurement, 1/s^2
    tilt: Array  # (...) variance of the slope's trend, at the root mean square of the instants, over that of its mean

    def smooth(self, measured: Array) -> tuple[Array, Array]:
        """Return values and derivatives of (..., N, k) signals."""
        coefficients = self.solve @ measured
        return self.values @ coefficients, self.slopes @ coefficients


def fit(time: Array) -> Fit:
    """Return the fit for N >= 2 instants (s, increasing): of degree 4, or of as much as they determine."""
    return fits(time[None])[0][1][0]


def fits(time: Array) -> list[tuple[Places, Fit]]:
    """Return the fits of W windows of N >= 2 instants, (W, N) s: the windows of each degree, and their fits."""
    left: Places = np.arange(len(time))
    found = []
    for degree in range(min(_DEGREE, time.shape[1] - 1), 0, -1):
        local, condition = _fitted(time[left], degree)
        good = condition < (_WORST_CONDITION if degree > 1 else np.inf)
        if np.any(good):
            found.append((left[good], local[good]))
        left = left[~good]
        if not len(left):
            break
    return found


def _fitted(time: Array, degree: int) -> tuple[Fit, Array]:
    """Return the fits of a degree to W windows of N instants, (W, N) s, and their condition numbers, (W,)."""
    half = 0.5 * (time[:, -1:] - time[:, :1])
    place = (time - time[:, :1]) / half - 1.0
    values = legendre.legvander(place, degree)
    orthonormal, triangle = np.linalg.qr(values)
    slopes = values[..., :-1] @ _derivatives(degree) / half[..., None]
    solve = np.linalg.solve(triangle, np.swapaxes(orthonormal, -1, -2))
    off = (place - np.mean(place, axis=1, keepdims=True))[..., None]
    trend = off / np.sqrt(np.mean(off**2, axis=1, keepdims=True))  # independent errors have as large a trend as a mean
    mean, tilt = (
        np.sum((np.mean(part, axis=1, keepdims=True) @ solve) ** 2, axis=(1, 2)) for part in (slopes, trend * slopes)
    )
    return Fit(values, slopes, solve, mean, tilt / mean), np.linalg.cond(triangle)


@cache
def _derivatives(degree: int) -> Array:
    """Return the coefficients (d, d + 1) of the derivatives of the first d + 1 Legendre polynomials."""
    return np.asarray(legendre.legder(np.eye(degree + 1)))


def with_rates(window: Samples) -> Samples:
    """Return a window of at least two samples with every velocity, incomplete ones derived from the positions."""
    joints, base = window.missing_rates
    if not joints and not base:
        return window
    local = fit(window.time)
    if joints:
        window = _joint_rates(window, local)
    return _base_rates(window, local) if base else window


def _joint_rates(window: Samples, local: Fit) -> Samples:
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


def _base_rates(window: Samples, local: Fit) -> Samples:
    linear = np.all(np.isfinite(window.base_linear_velocity))
    angular = np.all(np.isfinite(window.base_angular_velocity))
    velocity, rate = base_slopes(window.base_position, window.base_rotation, local)
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


def base_slopes(position: Array, rotation: Array, local: Fit) -> tuple[Array, Array]:
    """Return linear and angular velocities (..., N, 3) m/s, rad/s, odometry axes, by the poses of windows.

    Parameters
    ----------
    position, rotation : (..., N, 3) m, (..., N, 3, 3)
    local : the fits to their instants
    """
    middle = position.shape[-2] // 2
    velocity = local.smooth(position - position[..., middle : middle + 1, :])[1]
    turn, slope = local.smooth(log(rotation @ np.swapaxes(rotation[..., middle : middle + 1, :, :], -1, -2)))
    # R = Exp(turn) R_mid turns at w = J_l(turn) turn', with the left Jacobian of the rotation group.
    angle = np.sqrt(np.sum(turn**2, axis=-1, keepdims=True))
    second = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    third = np.where(angle > 1e-3, (1.0 - np.sinc(angle / np.pi)) / np.maximum(angle, 1e-3) ** 2, 1.0 / 6.0)
    bend = cross(turn, slope)
    return velocity, slope + second * bend + third * cross(turn, bend)


class TwistFrame:
    """Tests whether the base's twist is given in the declared frame, 'child' or 'inertial'.

    In each window the poses yield a mean twist. The twist, read as declared, should agree; read in the other frame it
    differs by d. The share of d in the disagreement is 0 if the declaration holds and 1 if the other one does.
    Weighted least squares over all windows estimates it. Its standard deviation scales with the actual disagreement:
    noise that is declared too small supports neither. A window counts from the next one on, so that its evaluation can
    wait until its estimate is published.
    """

    def __init__(self, declared: str) -> None:
        self._declared = declared
        self._other = 'inertial' if declared == 'child' else 'child'
        self._sums = np.zeros(4).tolist()  # information, weighted share, squared disagreements, their number
        self._waiting: list[Samples] = []  # the last window, until it is evaluated

    def update(self, windows: Sequence[Samples]) -> list[tuple[str, float]]:
        """Add windows, with or without a twist; return `contradiction` and `gain` before each."""
        if not windows:
            return []
        results = self._evaluate([*self._waiting, *windows[:-1]])
        self._waiting = [windows[-1]]
        return results[-len(windows) :]

    def run_slice(self) -> None:
        """Evaluate the last window now, not when the next one comes."""
        if self._waiting:
            self._evaluate(self._waiting)
            self._waiting = []

    def _evaluate(self, windows: Sequence[Samples]) -> list[tuple[str, float]]:
        """Evaluate windows, those of one length together; return `contradiction` and `gain` before and after each."""
        terms = np.zeros((len(windows), 4))
        groups: dict[int, list[int]] = {}
        for place, window in enumerate(windows):
            if len(window) >= _FEWEST_SAMPLES and not window.missing_rates[1]:
                groups.setdefault(len(window), []).append(place)
        for places in groups.values():
            terms[places] = _disagreement([windows[place] for place in places], self._declared)
        results = [(self.contradiction, self.gain)]
        for row in terms.tolist():
            self._sums = [total + term for total, term in zip(self._sums, row, strict=True)]
            results.append((self.contradiction, self.gain))
        return results

    @property
    def share(self) -> tuple[float, float]:
        """Share of the other reading in the poses (0: none, 1: all), and its standard deviation."""
        information, weighted, squares, count = self._sums
        if information <= 0.0:
            return 0.0, np.inf
        share = weighted / information
        left = (squares - share * weighted) / max(count - 1.0, 1.0)
        return share, (max(left, 1.0) / information) ** 0.5

    @property
    def gain(self) -> float:
        """Log-likelihood by which the other reading is better."""
        return float(self._sums[1] - 0.5 * self._sums[0])

    @property
    def contradiction(self) -> str:
        """A sentence if the declared frame contradicts the data with at least six standard deviations, else empty."""
        share, deviation = self.share
        if self._sums[3] < _ENOUGH or share < 0.5 or share < _SIGNIFICANT * deviation or not np.isfinite(share):
            return ''
        return (
            f'the twist in the Odometry is not in {_NAMES[self._declared]} as declared: by the poses, it is in '
            f'{_NAMES[self._other]}; if so, set twist_frame: {self._other}'
        )


def _disagreement(windows: Sequence[Samples], declared: str) -> Array:
    """Return information, weighted share, weighted squared disagreements and their number of W windows, (W, 4)."""
    twist = np.stack(
        [np.concatenate((window.base_linear_velocity, window.base_angular_velocity), axis=1) for window in windows]
    )
    rotation, position = (
        np.stack([getattr(one, f'base_{name}') for one in windows]) for name in ('rotation', 'position')
    )
    turn = rotate_back if declared == 'child' else rotate  # the numbers, meant in the other frame, to odometry axes
    other = np.concatenate((turn(rotation, twist[..., :3]), turn(rotation, twist[..., 3:])), axis=-1)
    difference = np.mean(other - twist, axis=1)
    # The twist's noise, in any axes: its larger variance of the three.
    spread = _variances([window.twist_covariance for window in windows]).reshape(-1, 2, 3)
    own = np.repeat(np.max(spread, axis=2), 3, axis=1) / twist.shape[1]
    distinct = difference**2 > _DISTINCT**2 * 2.0 * own
    terms = np.zeros((len(windows), 4))
    used = np.flatnonzero(np.any(distinct, axis=1))
    if not len(used):
        return terms
    seen, gain = np.empty((len(used), 6)), np.empty((len(used), 1))
    for places, local in fits(np.stack([windows[place].time for place in used])):
        slopes = base_slopes(position[used[places]], rotation[used[places]], local)
        seen[places] = np.mean(np.concatenate(slopes, axis=-1), axis=1)
        gain[places, 0] = local.mean_gain
    slope = np.maximum(gain * _variances([windows[place].pose_covariance for place in used]), 1e-30)
    weight = np.where(distinct[used], 1.0 / (slope + own[used]), 0.0)
    disagreement, difference = seen - np.mean(twist[used], axis=1), difference[used]
    products = weight * difference**2, weight * difference * disagreement, weight * disagreement**2, distinct[used]
    terms[used] = np.stack([np.sum(each, axis=1) for each in products], axis=1)
    return terms


def _variances(covariances: Sequence[Array]) -> Array:
    """Return the (W, k) mean variances of W times (N, k, k) covariances."""
    return np.mean([np.diagonal(covariance, axis1=-2, axis2=-1) for covariance in covariances], axis=1)


class GyroFrame:
    """Tests whether the gyro turns as the poses do: in other units, or in other axes.

    Attributes
    ----------
    gain : log-likelihood by which the reading in `contradiction` is better
    """

    def __init__(self) -> None:
        self._count = 0
        self._sums: Array = np.zeros((6,))
        self._squares: Array = np.zeros((6, 6))
        self._variance = 0.0
        self.gain = 0.0
        self.contradiction = ''

    def update(self, window: Samples) -> str:
        """Add a window; return the contradiction so far as a sentence, empty if there is none."""
        if len(window) > 1 and window.gyro.shape[1] and not self.contradiction:
            length = float(window.time[-1] - window.time[0])
            turned = log(window.base_rotation[0].T @ window.base_rotation[-1])
            both = np.concatenate((turned, window.gyro[-1] - window.gyro[0])) / length
            ends = window.pose_covariance[[0, -1], 3:, 3:]
            if np.all(np.isfinite(both)) and np.all(np.isfinite(ends)):
                self._count += 1
                self._sums = self._sums + both
                self._squares = self._squares + np.outer(both, both)
                self._variance += float(np.trace(np.sum(ends, axis=0))) / 3.0 / length**2
                self.contradiction = self._judged() if self._count >= _FEWEST_WINDOWS else ''
        return self.contradiction

    def _judged(self) -> str:
        about_mean = self._squares - np.outer(self._sums, self._sums) / self._count
        of_poses, both, of_gyro = about_mean[:3, :3], about_mean[3:, :3], about_mean[3:, 3:]
        # Noise of the poses, and the part of the motion that a declared error of scale or mount may make.
        noise = self._variance / self._count + _OFF**2 * float(np.trace(of_poses)) / self._count

        def misfit(matrix: Array) -> float:
            left = of_gyro - matrix @ both.T - both @ matrix.T + matrix @ of_poses @ matrix.T
            return max(float(np.trace(left)), 0.0)

        left, _, right = np.linalg.svd(both)  # Wahba's problem
        turn = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
        degrees = 180.0 / np.pi
        found = {'': misfit(np.eye(3)), 'degrees': misfit(degrees * np.eye(3)) / degrees**2, 'turned': misfit(turn)}
        best = min(found, key=lambda name: found[name])
        self.gain = 0.5 * (found[''] - found[best]) / noise
        if found[best] > _BETTER * found[''] or self.gain < _SURE:
            return ''
        if best == 'degrees':
            return (
                'the angular velocity of the IMU is 57.3 times that of the poses: it is in degrees; accepted: rad/s, '
                'as in REP 103'
            )
        vector = log(turn.T)  # of the IMU, where its readings are turned back
        angle = float(np.linalg.norm(vector))
        if best != 'turned' or angle < _TURNED:
            return ''
        axis = ', '.join(f'{number:.2f}' for number in np.round(vector / angle, 2) + 0.0)
        return (
            f'the IMU is turned by {np.degrees(angle):.0f} degrees about ({axis}) relative to its frame: correct the '
            'frame in the robot description, or set imu.frame'
        )
