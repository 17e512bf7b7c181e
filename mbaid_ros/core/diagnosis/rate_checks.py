"""Whether twist and gyro are the rates of the poses, and which common mistake of a driver they are else.

Rates and poses are compared with each other alone, window by window: no robot, body or momentum is in it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from mbaid_ros.core.geometry import Array, log, rotate, rotate_back
from mbaid_ros.core.results.status import Reason, Severity
from mbaid_ros.core.samples import ArrayRecord, Samples

_FEWEST_SAMPLES = 5  # samples of a window
_FEWEST, _KEPT = 8, 80  # windows, of at least three numbers each: a wrong reading is no accident; and the latest ones
# Mean normalised square of the poses' steps less the rates', from which a rate is not that of the poses.
_CONTRADICTS = 4.0
_LEFT = 0.25  # of the contradiction, and of the motion: most that another convention may leave to be accepted
_FITTED = 2.0  # times as well as any other, that a convention with numbers of its own has to explain the data
_MILLIMETRE = 1e-3  # m: a unit
_OFF = 0.02  # part of the motion that a declared error of the gyro's scale or mount may make
_TURNED = 0.2  # rad, from which the axes of a gyro are others: no declared mount is as far off


@dataclass(frozen=True)
class Motion(ArrayRecord):
    """How the base turned (rad) and moved (m) over W windows, the k angular numbers first."""

    step: Array  # (W, k) by the poses
    read: Array  # (W, k) by the rates, as they are read
    noise: Array  # (W, k) standard deviation of the difference between the two
    # arm, middle: (W, 3, 3) share of a point away from the base's in the linear step, m, per metre in base axes; and
    # the rotation of the base in the middle of each window
    arm: Array
    middle: Array

    def misfit(self, meant: Array) -> float:
        """Return the mean normalised square of the steps less (W, k)."""
        return float((((self.step - meant) / self.noise) ** 2).sum()) / meant.size

    def turned(self, turn: Callable[[Array, Array], Array]) -> Array:
        """Return (W, 6) of the twist with both parts turned, by a function of rotations and (W, 3) of it."""
        return np.concatenate([turn(self.middle, each) for each in np.split(self.read, 2, axis=1)], axis=1)


Meanings = Iterator[tuple[float, str, Array]]  # times as well that it has to explain the data, in words, (W, k) steps


class RateCheck:
    """Follows windows, and finds the convention that a rate follows instead of that of the poses.

    Parameters
    ----------
    motion : that a window shows; None where it has no such rate
    error : the wrong convention that motions of a misfit show, in words, and its gain in log-likelihood; empty if none
    severity : of the reason
    """

    def __init__(
        self,
        motion: Callable[[Samples], Motion | None],
        error: Callable[[Motion, float], tuple[str, float]],
        severity: Severity = 'note',
    ) -> None:
        self._motion, self._error, self._severity = motion, error, severity
        self._seen: deque[Motion] = deque(maxlen=_KEPT)
        self._misfits: deque[float] = deque(maxlen=_KEPT)  # of each as it is read

    def add(self, window: Samples) -> None:
        """Add a window."""
        motion = self._motion(window) if len(window) >= _FEWEST_SAMPLES else None
        if motion is not None and np.isfinite(misfit := motion.misfit(motion.read)):
            self._seen.append(motion)
            self._misfits.append(misfit)

    def reason(self) -> Reason | None:
        """Return the contradiction that the latest windows show."""
        contradiction = sum(self._misfits) / max(len(self._seen), 1)
        if len(self._seen) < _FEWEST or contradiction < _CONTRADICTS:
            return None
        text, gain = self._error(Motion.concatenate(self._seen), contradiction)
        return Reason(text, self._severity, gain) if text else None

    def update(self, window: Samples) -> Reason | None:
        """Add a window, and return the contradiction that the latest ones show."""
        self.add(window)
        return self.reason()


def twist_check() -> RateCheck:
    """Return the check whether the base's twist is the rate of its poses."""
    return RateCheck(_twist_motion, lambda motion, misfit: _likeliest(motion, misfit, _twist_meanings(motion)))


def gyro_check() -> RateCheck:
    """Return the check whether the gyro turns as the poses do."""
    return RateCheck(_gyro_motion, _gyro_error, 'conflict')


def _likeliest(motion: Motion, contradiction: float, meanings: Meanings) -> tuple[str, float]:
    """Return the convention that explains motions of a misfit, and its gain; empty if none does."""
    _, left, text = min((factor * motion.misfit(meant), motion.misfit(meant), text) for factor, text, meant in meanings)
    if left > _LEFT * min(contradiction, motion.misfit(np.zeros(motion.step.shape))):
        return '', 0.0
    return text, 0.5 * (contradiction - left) * motion.step.size


def _ends(values: Array) -> Array:
    """Return the first and the last third of (N, ...) values, joined: noise hardly averages out better than so."""
    third = max(len(values) // 3, 1)
    return np.concatenate((values[:third], values[-third:]))


def _step(ends: Array) -> Array:
    """Return the mean of the second half of (2 k, ...) values less that of the first."""
    first, last = ends.reshape(2, len(ends) // 2, -1).sum(axis=1)
    return np.asarray((last - first) / (len(ends) // 2))


def _weights(time: Array) -> Array:
    """Return the weights (N,), s, with which a rate makes the step of its integral (trapezoid) between the ends."""
    half = 0.5 * np.diff(time) * _shares(len(time))
    return np.append(half, 0.0) + np.append(0.0, half)


@cache
def _shares(count: int) -> Array:
    """Return the part of the steps of N values (N - 1,) that each step between two of them is in."""
    place = np.arange(1, count)
    return np.asarray(np.minimum(np.minimum(place, place[::-1]) / max(count // 3, 1), 1.0))


def _spread(covariance: Array) -> Array:
    """Return the (6,) variances, angular ones first, in any axes: the largest mean one of each three."""
    variance = np.einsum('nii->i', covariance).reshape(2, 3) / len(covariance)
    return np.repeat(variance.max(axis=1)[::-1], 3)


_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])  # cyclic neighbours of the three axes


def _twist_motion(window: Samples) -> Motion | None:
    """Return the motion of the base, odometry axes, by poses and twists; None without a twist."""
    if window.missing_rates[1]:
        return None
    time, rotation, count = window.time, window.base_rotation, len(window)
    turned = log(_ends(rotation) @ rotation[0].T)
    step = _step(np.concatenate((turned, _ends(window.base_position)), axis=1))
    weights, length = _weights(time), float(time[-1] - time[0])
    angular = weights[:, None] * window.base_angular_velocity
    read = np.concatenate((angular.sum(axis=0), weights @ window.base_linear_velocity))
    products = (angular.T @ rotation.reshape(count, 9)).reshape(3, 3, 3)
    arm = products[_NEXT, _LAST] - products[_LAST, _NEXT]  # the integral of [w]x R
    # Of means over thirds; the twist's noise is that of a mean, too, by trapezoids of weights.
    variance = 6.0 / count * _spread(window.pose_covariance)
    variance += 5.0 / 9.0 * length**2 / count * _spread(window.twist_covariance)
    rows = step, read, np.sqrt(variance), arm, rotation[count // 2]
    return Motion(*(row[None] for row in rows))


def _twist_meanings(motion: Motion) -> Meanings:
    """Yield the conventions of the twist, and the steps (W, 6) that each implies."""
    what = 'the twist of the odometry'
    angular, linear = motion.read[:, :3], motion.read[:, 3:]
    if not np.any(motion.read):
        yield 0.0, f'{what} is zero while its poses move: publish NaN where it is not measured', motion.step
        return
    yield (
        1.0,
        'the angular velocity of the odometry is in degrees a second: in ROS it is in rad/s',
        np.concatenate((np.deg2rad(angular), linear), axis=1),
    )
    yield (
        1.0,
        'the linear velocity of the odometry is in millimetres a second: in ROS it is in m/s',
        np.concatenate((angular, _MILLIMETRE * linear), axis=1),
    )
    still = np.zeros_like(angular)
    for moves in ((angular, still), (still, linear)):  # poses that do not move show no unit
        yield 0.5, '', np.concatenate(moves, axis=1)
    yield 1.0, f'{what} has the wrong sign', -motion.read
    yield 1.0, f'{what} is in the axes of its header.frame_id: set twist_frame: inertial', motion.turned(rotate_back)
    yield 1.0, f'{what} is in the axes of its child_frame_id: set twist_frame: child', motion.turned(rotate)
    point = _point(motion)
    place = ', '.join(f'{-1e3 * each:.0f}' for each in point)
    yield (
        _FITTED,
        f'{what} is that of a point ({place}) mm away from that of its poses, in base axes',
        np.concatenate((angular, linear + motion.arm @ point), axis=1),
    )
    step, read, noise = (np.concatenate(np.split(each, 2, axis=1)) for each in (motion.step, motion.read, motion.noise))
    middle = np.concatenate((motion.middle, motion.middle))
    turn, about = _turn(rotate_back(middle, step), rotate_back(middle, read), noise)
    yield (
        _FITTED,
        f'the axes of the twist are turned by {about} against those of the poses',
        motion.turned(lambda rotation, part: rotate(rotation, rotate_back(rotation, part) @ turn.T)),
    )


def _point(motion: Motion) -> Array:
    """Return the point, (3,) m in base axes, that the poses are of as the twist's point sees it: v + w x R r."""
    weight = 1.0 / motion.noise[:, 3:, None]
    rows = (weight * motion.arm).reshape(-1, 3)
    values = (weight[..., 0] * (motion.step - motion.read)[:, 3:]).ravel()
    return np.asarray(np.linalg.lstsq(rows, values, rcond=1e-6)[0])


def _turn(step: Array, read: Array, noise: Array) -> tuple[Array, str]:
    """Return the rotation, (3, 3), that takes vectors (N, 3) read to the steps (Wahba's problem), and that in words."""
    left, _, right = np.linalg.svd((step / noise).T @ (read / noise))
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    about = log(turn)
    angle = float(np.linalg.norm(about))
    axis = ', '.join(f'{each:.2f}' for each in np.round(about / max(angle, 1e-12), 2) + 0.0)
    return turn, f'{np.degrees(angle):.0f} degrees about ({axis})'


def _gyro_motion(window: Samples) -> Motion | None:
    """Return how the base turned, in its axes at the start, by poses and gyro; None without a gyro."""
    if not window.gyro.shape[1]:
        return None
    rotation, count = window.base_rotation, len(window)
    step = _step(log(rotation[0].T @ _ends(rotation)))
    noise = np.sqrt(6.0 / count * _spread(window.pose_covariance)[:3])
    rows = step, _step(_ends(window.gyro)), noise, np.zeros((3, 3)), rotation[0]
    return Motion(*(row[None] for row in rows))


def _gyro_error(motion: Motion, contradiction: float) -> tuple[str, float]:
    """Return the units or axes that a gyro has instead of the poses', and the gain; a bias is none."""
    del contradiction  # a bias has its part in it
    step, read = (each - np.mean(each, axis=0) for each in (motion.step, motion.read))
    declared = _OFF * np.sqrt(np.mean(np.sum(step**2, axis=1)))
    motion = replace(motion, step=step, read=read, noise=np.hypot(motion.noise, declared))
    contradiction = motion.misfit(motion.read)
    return _likeliest(motion, contradiction, _gyro_meanings(motion)) if contradiction >= _CONTRADICTS else ('', 0.0)


def _gyro_meanings(motion: Motion) -> Meanings:
    """Yield the conventions of a gyro, and the steps (W, 3) that each implies."""
    text = 'the angular velocity of the IMU is 57.3 times that of the poses: it is in degrees; accepted: rad/s, as in'
    yield 1.0, f'{text} REP 103', np.deg2rad(motion.read)
    turn, about = _turn(motion.step, motion.read, motion.noise)
    if np.linalg.norm(log(turn)) > _TURNED:
        text = f'the IMU is turned by {about} relative to its frame: correct the frame in the robot description, or set'
        yield 1.0, f'{text} imu.frame', motion.read @ turn.T
