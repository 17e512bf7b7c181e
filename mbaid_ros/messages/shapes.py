"""What messages have in common, and their numbers as columns: of objects as of bytes.

A shape is what the messages that share it need looking at only once: names and lengths. `columns` returns the numbers
of many of them as arrays. The layouts of `mbaid_ros.cdr` are shapes of bytes; here are those of objects.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from mbaid_ros.cdr import JointStateLayout, OdometryLayout, Packet, Packets
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import Stamps
from mbaid_ros.messages.fields import numbers_of, stamps_of
from mbaid_ros.messages.poses import BasePose, BasePoseShape

_PACKED = (Packet, Packets)


class JointStateShape(NamedTuple):
    """What JointStates with the same names and numbers of values share.

    Attributes
    ----------
    names : of the joints
    positions, velocities : how many there are
    """

    names: tuple[str, ...]
    positions: int
    velocities: int

    def columns(self, messages: Sequence[Any]) -> tuple[Stamps, Array, Array]:
        """Return stamps (N,), ns, positions (N, p) and velocities (N, v) of N such messages."""
        position = np.array([message.position for message in messages], dtype=float)
        velocity = np.array([message.velocity for message in messages], dtype=float)
        return (
            stamps_of(messages),
            position.reshape(len(position), self.positions),
            velocity.reshape(len(velocity), self.velocities),
        )


class OdometryShape(NamedTuple):
    """What Odometry messages of the same frames share.

    Attributes
    ----------
    frame_id, child_frame_id : names of the frames
    """

    frame_id: str
    child_frame_id: str

    def columns(self, messages: Sequence[Any]) -> tuple[Stamps, Array, Array, Array]:
        """Return stamps (N,), ns, numbers (N, 13) and covariances (N, 36) of pose and twist of N such messages."""
        numbers = np.array([numbers_of(message) for message in messages])
        return stamps_of(messages), numbers, _covariances(messages, 'pose'), _covariances(messages, 'twist')


def joint_state_shape(message: Any) -> JointStateShape | JointStateLayout:
    """Return the shape of a JointState, or of packets together."""
    if isinstance(message, _PACKED):
        return message.layout
    return JointStateShape(tuple(message.name), len(message.position), len(message.velocity))


def odometry_shape(message: Any) -> OdometryShape | OdometryLayout | BasePoseShape:
    """Return the shape of an Odometry, of packets together, or of a pose in its place."""
    if isinstance(message, _PACKED):
        return message.layout
    if isinstance(message, BasePose):
        return BasePoseShape(message.frame_id, message.child_frame_id)
    return OdometryShape(message.header.frame_id, message.child_frame_id)


def positions_of(message: Any) -> dict[str, float]:
    """Return the finite positions in a JointState by their joints' names."""
    shape = joint_state_shape(message)
    values = shape.columns([message])[1][0]
    return {name: float(value) for name, value in zip(shape.names, values, strict=False) if math.isfinite(value)}


def _covariances(messages: Sequence[Any], part: str) -> Array:
    return np.array([getattr(message, part).covariance for message in messages], dtype=float).reshape(-1, 36)
