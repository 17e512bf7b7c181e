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


def joint_state(
    names: Sequence[str], position: Array, velocity: Array, *, stamp: int = 1, effort: int = 0, frame: str = ''
) -> Any:
    return message_class(JOINT_STATE_TYPE)(header(stamp, frame), list(names), position, velocity, np.ones(effort))


def odometry(
    numbers: Array, covariances: Array, *, stamp: int = 1, child: str = 'base_link', frame: str = 'odom'
) -> Any:
    """Return an Odometry of 13 numbers (position, orientation, linear and angular velocity) and two covariances."""

    def kind(name: str) -> Any:
        return message_class(f'geometry_msgs/msg/{name}')

    place = kind('Pose')(kind('Point')(*numbers[:3]), kind('Quaternion')(*numbers[3:7]))
    motion = kind('Twist')(kind('Vector3')(*numbers[7:10]), kind('Vector3')(*numbers[10:]))
    return message_class(ODOMETRY_TYPE)(
        header(stamp, frame),
        child,
        kind('PoseWithCovariance')(place, covariances[0].ravel()),
        kind('TwistWithCovariance')(motion, covariances[1].ravel()),
    )


def as_bytes(message: Any) -> bytes:
    return serialize(message, message.__msgtype__)


def again(data: bytes, type_name: str) -> Any:
    """Return the object that bytes hold."""
    return deserialize(data, type_name)
