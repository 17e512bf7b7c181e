"""Motions of joints, as messages and files have them."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.joint_trajectory import JointTrajectory


def trajectory_of(message: Any) -> JointTrajectory:
    """Return what a trajectory_msgs/JointTrajectory says; efforts are not used.

    Raises
    ------
    DataError
        It is no motion.
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
