"""Twists of the base that are not the rate of its poses: common mistakes of drivers.

Poses and twists are compared with each other alone, over whole windows: no robot, body or momentum is in it. Both are
means over the same samples, which the one being the rate of the other survives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.filter.window import Window
from mbaid_ros.core.geometry import Array, log, rotate, rotate_back, skew

_FEWEST = 8  # windows, of six numbers each: enough that a wrong reading is no accident
# Mean normalised square of the poses' steps less the twists', from which a twist is not the rate of the poses.
_CONTRADICTS = 4.0
_LEFT = 0.25  # of the contradiction, and of the motion: most that another convention may leave to be accepted
_MILLIMETRE = 1e-3  # m: a unit


@dataclass(frozen=True)
class _Motion:
    """How the base moved over W windows: rad and m, (angular, linear) in odometry axes."""

    step: Array  # (W, 6) by the poses
    read: Array  # (W, 6) as the twist is read
    arm: Array  # (W, 3, 3) share of a point away from the base's in the linear step, m, per metre in base axes
    middle: Array  # (W, 3, 3) rotation of the base in the middle of each
    noise: Array  # (W, 6) standard deviation of the difference between the two

    def misfit(self, meant: Array) -> float:
        """Return the mean normalised square of the steps less (W, 6)."""
        return float(np.mean(((self.step - meant) / self.noise) ** 2))

    def turned(self, turn: Callable[[Array, Array], Array]) -> Array:
        """Return (W, 6) of the twist with both parts turned, by a function of rotations and (W, 3) of it."""
        return np.concatenate([turn(self.middle, each) for each in np.split(self.read, 2, axis=1)], axis=1)


def twist_convention_error(windows: Sequence[Window]) -> str:
    """Return the convention that the twist follows instead of the rate of the poses, or empty."""
    parts = [_of_window(each) for each in windows if np.all(np.isfinite(each.knots.base_twist[_own(each)]))]
    parts = [part for part in parts if np.all(np.isfinite(part[0]))]
    if len(parts) < _FEWEST:
        return ''
    motion = _Motion(*(np.stack(each) for each in zip(*parts, strict=True)))
    contradiction = motion.misfit(motion.read)
    if contradiction < _CONTRADICTS:
        return ''
    if not np.any(motion.read):
        return 'the twist of the odometry is zero while its poses move: publish NaN where it is not measured'
    left, text = min((motion.misfit(meant), text) for text, meant in _meanings(motion))
    return text if left < _LEFT * min(contradiction, motion.misfit(np.zeros(6))) else ''


def _own(window: Window) -> slice:
    """Return the knots at and between the ends of a window's own intervals."""
    return slice(window.inside.start, window.inside.stop + 1)


def _trapezoid(values: Array) -> Array:
    """Return the integral along the first axis, at unit steps: SciPy's takes a third of a second to import."""
    return np.asarray(np.sum((values[1:] + values[:-1]) / 2.0, axis=0))


def _of_window(window: Window) -> tuple[Array, Array, Array, Array, Array]:
    """Return the fields of `_Motion` for one window."""
    knots, own, noise = window.knots, _own(window), window.noise
    rotation, position, twist = knots.base_rotation[own], knots.base_position[own], knots.base_twist[own]
    turn = log(rotation[-1] @ rotation[0].T)
    read = window.spacing * _trapezoid(twist)
    arm = window.spacing * _trapezoid(skew(twist[:, 3:]) @ rotation)
    # Errors that stay for a while are no smaller in the mean of a knot.
    share = 1.0 if noise.correlation_time > 0.0 else (len(rotation) - 1) / noise.samples
    variance = 2.0 * share * np.diag(noise.pose) + window.length**2 / noise.samples * np.diag(noise.twist)
    spread = np.sqrt(np.repeat(np.max(variance.reshape(2, 3), axis=1), 3))  # in any axes
    middle = rotation[len(rotation) // 2]
    return np.concatenate((turn, position[-1] - position[0])), np.roll(read, 3), arm, middle, spread


def _meanings(motion: _Motion) -> Iterator[tuple[str, Array]]:
    """Yield the conventions of the twist, and the steps (W, 6) that each implies."""
    what = 'the twist of the odometry'
    angular, linear = motion.read[:, :3], motion.read[:, 3:]
    yield (
        'the angular velocity of the odometry is in degrees a second: in ROS it is in rad/s',
        np.concatenate((np.deg2rad(angular), linear), axis=1),
    )
    yield (
        'the linear velocity of the odometry is in millimetres a second: in ROS it is in m/s',
        np.concatenate((angular, _MILLIMETRE * linear), axis=1),
    )
    yield f'{what} has the wrong sign', -motion.read
    yield f'{what} is in the axes of its header.frame_id: set twist_frame: inertial', motion.turned(rotate_back)
    yield f'{what} is in the axes of its child_frame_id: set twist_frame: child', motion.turned(rotate)
    point = _point(motion)
    place = ', '.join(f'{-1e3 * each:.0f}' for each in point)
    yield (
        f'{what} is that of a point ({place}) mm away from that of its poses, in base axes',
        np.concatenate((angular, linear + motion.arm @ point), axis=1),
    )
    turn = _turn(motion)
    about = log(turn)
    size = float(np.linalg.norm(about))
    axis = ', '.join(f'{each:.2f}' for each in about / max(size, 1e-12))
    yield (
        f'the axes of the twist are turned by {np.rad2deg(size):.0f} degrees about ({axis}) against those of the poses',
        motion.turned(lambda rotation, part: rotate(rotation, rotate_back(rotation, part) @ turn.T)),
    )


def _point(motion: _Motion) -> Array:
    """Return the point, (3,) m in base axes, that the poses are of as the twist's point sees it: v + w x R r."""
    weight = 1.0 / motion.noise[:, 3:, None]
    rows = (weight * motion.arm).reshape(-1, 3)
    values = (weight[..., 0] * (motion.step - motion.read)[:, 3:]).ravel()
    return np.asarray(np.linalg.lstsq(rows, values, rcond=1e-6)[0])


def _turn(motion: _Motion) -> Array:
    """Return the rotation, (3, 3), that takes the twist's numbers to the axes of the base (Wahba's problem)."""
    both = np.zeros((3, 3))
    for part in (slice(0, 3), slice(3, 6)):
        parts = (each[:, part] / motion.noise[:, part] for each in (motion.step, motion.read))
        step, read = (rotate_back(motion.middle, each) for each in parts)
        both += step.T @ read
    left, _, right = np.linalg.svd(both)
    return np.asarray(left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right)
