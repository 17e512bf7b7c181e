"""What single messages hold: stamps, the numbers of an Odometry, a wrench."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mbaid_ros.cdr import Packet, Packets
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import Stamps
from mbaid_ros.messages.poses import BasePose


def stamp_of(message: Any) -> int:
    """Return a message's header stamp in ns."""
    if isinstance(message, Packet | BasePose):
        return message.stamp
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def stamps_of(messages: Sequence[Any]) -> Stamps:
    """Return the header stamps of N messages, (N,) ns."""
    if isinstance(messages, Packets):
        return messages.stamps
    return np.array([stamp_of(message) for message in messages], dtype=np.int64)


def number_of(messages: Sequence[Any]) -> int:
    """Return how many messages there are where some of what is counted may be packets that are together."""
    return sum(len(each) if isinstance(each, Packets) else 1 for each in messages)


def wrench_of(message: Any) -> tuple[str, int, Array]:
    """Return frame, stamp (ns) and (6,) force and torque (N, N m) of a WrenchStamped."""
    force, torque = message.wrench.force, message.wrench.torque
    values = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z], dtype=float)
    return message.header.frame_id.lstrip('/'), stamp_of(message), values


def vector_of(message: Any) -> tuple[str, int, Array]:
    """Return frame, stamp (ns) and (3,) numbers of a Vector3Stamped."""
    vector = message.vector
    values = np.array([vector.x, vector.y, vector.z], dtype=float)
    return message.header.frame_id.lstrip('/'), stamp_of(message), values


def numbers_of(message: Any) -> tuple[float, ...]:
    """Return position (3), orientation (4), linear and angular velocity (3 each) of an Odometry."""
    pose, twist = message.pose.pose, message.twist.twist
    position, orientation = pose.position, pose.orientation
    linear, angular = twist.linear, twist.angular
    return (
        *(position.x, position.y, position.z),
        *(orientation.x, orientation.y, orientation.z, orientation.w),
        *(linear.x, linear.y, linear.z),
        *(angular.x, angular.y, angular.z),
    )
