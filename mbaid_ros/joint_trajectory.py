"""A motion of the joints as points in time, interpolated as ros2_control's controllers do."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import BPoly

from mbaid_ros.core.geometry import Array
from mbaid_ros.errors import DataError, listing


@dataclass(frozen=True, eq=False)
class JointTrajectory:
    """Points that some joints pass.

    Between two points a joint follows the quintic by position, velocity and acceleration at both, the cubic without
    accelerations, and a straight line without velocities. Before the first point and after the last one it rests there.

    Raises DataError: The points do not make a motion.
    """

    joints: tuple[str, ...]  # names of the k joints
    time: Array  # (K,) s since its begin, increasing
    position: Array  # (K, k) rad or m
    velocity: Array  # (K, k); or (0, 0) where not given
    acceleration: Array  # (K, k); or (0, 0) where not given

    def __post_init__(self) -> None:
        """Refuse arrays that are not a motion."""
        count, names = len(self.time), len(self.joints)
        if not count or not names:
            raise DataError(f'a joint trajectory has {count} points of {names} joints; accepted: at least one of both')
        if len(set(self.joints)) < names:
            raise DataError(f'a joint trajectory names a joint twice: {listing(self.joints)}')
        for name in ('position', 'velocity', 'acceleration'):
            shape = getattr(self, name).shape
            if shape != (count, names) and (name == 'position' or shape != (0, 0)):
                raise DataError(
                    f'a joint trajectory has {name} of shape {shape}; accepted: {count} points of {names} joints'
                )
            if not np.all(np.isfinite(getattr(self, name))):
                raise DataError(f'a joint trajectory has a {name} that is not finite')
        if not np.all(np.isfinite(self.time)) or self.time[0] < 0.0 or np.any(np.diff(self.time) <= 0.0):
            raise DataError('the points of a joint trajectory are not in order; accepted: times >= 0 that increase')

    @property
    def duration(self) -> float:
        """Until the last point, s."""
        return float(self.time[-1])

    def state_at(self, times: Array) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration, (..., k) each, at (...) s since the begin."""
        if len(self.time) == 1:
            position = np.broadcast_to(self.position[0], (*np.shape(times), len(self.joints))).copy()
            return position, np.zeros_like(position), np.zeros_like(position)
        inside = np.clip(times, self.time[0], self.time[-1])
        moving = (inside == times)[..., None]
        position, velocity, acceleration = (curve(inside) for curve in self._curves)
        return position, moving * velocity, moving * acceleration

    @cached_property
    def _curves(self) -> tuple[BPoly, BPoly, BPoly]:
        """Position, velocity and acceleration by the time since the begin."""
        from scipy.interpolate import BPoly  # noqa: PLC0415 - a tenth of a second that only motions need

        given = [self.position]
        if self.velocity.size:
            given += [self.velocity, self.acceleration] if self.acceleration.size else [self.velocity]
        position = BPoly.from_derivatives(self.time, np.stack(given, axis=1))
        return position, position.derivative(), position.derivative(2)


def trajectory_of(message: Any) -> JointTrajectory:
    """Return the motion in a trajectory_msgs/JointTrajectory, without efforts.

    Raises DataError: It is no motion.
    """
    joints, points = tuple(str(name) for name in message.joint_names), list(message.points)
    time = np.array([point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in points])
    parts = [_numbers(points, name, len(joints)) for name in ('positions', 'velocities', 'accelerations')]
    return JointTrajectory(joints, time, *parts)


def _numbers(points: list[Any], name: str, joints: int) -> Array:
    """Return (K, k) numbers of all points; (0, 0) where none has any."""
    values = [np.asarray(getattr(point, name), dtype=float) for point in points]
    if not any(each.size for each in values) and name != 'positions':
        return np.zeros((0, 0))
    wrong = [(place, each.size) for place, each in enumerate(values) if each.shape != (joints,)]
    if wrong:
        place, size = wrong[0]
        raise DataError(f'point {place} of a joint trajectory has {size} {name}; accepted: {joints}, one a joint')
    return np.array(values)
