"""JointState and Odometry messages as objects and as the bytes they travel in, for the tests of what reads either."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mbaid_ros.bags import deserialize, message_class, serialize
from mbaid_ros.cdr import JOINT_STATE_TYPE, ODOMETRY_TYPE
from mbaid_ros.core.geometry import Array


def header(stamp: int, frame: str = '') -> Any:
    second, nanosecond = divmod(stamp, 1_000_000_000)
    time = message_class('builtin_interfaces/msg/Time')(sec=second, nanosec=nanosecond)
    return message_class('std_msgs/msg/Header')(stamp=time, frame_id=frame)


def of(kind: str, values: Sequence[float] | Array) -> Any:
    """Return a message of geometry_msgs that holds numbers alone: a Point, a Quaternion, a Vector3."""
    return message_class(f'geometry_msgs/msg/{kind}')(*map(float, values))


def joint_state(
    names: Sequence[str], position: Any, velocity: Any, *, stamp: int = 1, effort: int = 0, frame: str = ''
) -> Any:
    numbers = (np.array(each, dtype=float) for each in (position, velocity, np.ones(effort)))
    return message_class(JOINT_STATE_TYPE)(header(stamp, frame), list(names), *numbers)


def odometry(
    numbers: Array, covariances: Array, *, stamp: int = 1, child: str = 'base_link', frame: str = 'odom'
) -> Any:
    """Return an Odometry of 13 numbers (position, orientation, linear and angular velocity) and two covariances."""
    parts = []
    for name, kinds, values, covariance in (
        ('Pose', ('Point', 'Quaternion'), np.split(numbers[:7], [3]), covariances[0]),
        ('Twist', ('Vector3', 'Vector3'), np.split(numbers[7:], [3]), covariances[1]),
    ):
        part = message_class(f'geometry_msgs/msg/{name}')(*map(of, kinds, values))
        parts.append(message_class(f'geometry_msgs/msg/{name}WithCovariance')(part, covariance.ravel()))
    return message_class(ODOMETRY_TYPE)(header(stamp, frame), child, *parts)


def as_bytes(message: Any) -> bytes:
    return serialize(message, message.__msgtype__)


def again(data: bytes, type_name: str) -> Any:
    """Return the object that bytes hold."""
    return deserialize(data, type_name)
