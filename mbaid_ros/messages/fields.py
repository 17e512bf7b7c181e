"""Single values of messages, poses that are no Odometry, and the columns of many messages of one shape.

Messages that share a shape, names and lengths, are looked into once. `columns` returns their numbers as arrays; the
layouts of `mbaid_ros.cdr` do the same for bytes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from mbaid_ros.cdr import JointStateLayout, OdometryLayout, Packets
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.parameters import PARAMETERS
from mbaid_ros.core.samples import Stamps

# Causes for which messages, or parts of them, are unusable.
JOINT_MISSING = 'joint missing'
LENGTH_MISMATCH = 'names and values differ in number'
NOT_FINITE = 'NaN or infinite value'
NAMED_TWICE = 'joint named twice'
TOO_MANY_NAMES = 'more than 10000 names'
NOT_REAL = 'value beyond anything real'
WRONG_CHILD_FRAME = 'child_frame_id is no frame on the base'
BAD_QUATERNION = 'orientation is not a unit quaternion'
LOST_TRACKING = 'tracking of the base lost, a pose of zeros'
POSE_COVARIANCE = 'covariance of the pose is none'
TWIST_COVARIANCE = 'covariance of the twist is none'

Source = Literal['odom', 'pose', 'tf']

_NO_TWIST = (np.nan,) * 6
_NOT_SET = np.zeros(36)


@dataclass(frozen=True)
class BasePose:
    """A pose of a frame on the base: stamp (ns), position and orientation (x, y, z, w), covariance (36,) or zeros."""

    stamp: int
    frame_id: str
    child_frame_id: str
    numbers: tuple[float, ...]
    covariance: Any


class BasePoseShape(NamedTuple):
    """The frames that several poses share."""

    frame_id: str
    child_frame_id: str

    def columns(self, messages: Sequence[BasePose]) -> tuple[Stamps, Array, Array, Array]:
        """Return stamps (N,), ns, numbers (N, 13) and covariances (N, 36) of pose and twist, as of Odometry."""
        numbers = np.array([(*message.numbers, *_NO_TWIST) for message in messages])
        covariances = np.array([message.covariance for message in messages], dtype=float).reshape(-1, 36)
        return np.array([message.stamp for message in messages]), numbers, covariances, np.zeros_like(covariances)


def source_of(message: Any) -> Source:
    """Return which kind of source a message that locates the base is from."""
    if isinstance(message, Packets) or hasattr(message, 'twist'):
        return 'odom'
    return 'tf' if hasattr(message, 'transforms') else 'pose'


class PoseReader:
    """Makes poses of the base of messages that are no Odometry.

    Parameters
    ----------
    frame : name of the frame on the base that a PoseStamped locates; a transform locates its child frame
    tf_child : child frame of the transform that locates the base, which has one parent in a tree
    """

    def __init__(self, frame: str, tf_child: str) -> None:
        self._frame = frame
        self._tf_child = tf_child.lstrip('/')

    def read(self, message: Any) -> Iterator[BasePose]:
        """Yield the poses of a PoseStamped, PoseWithCovarianceStamped, TransformStamped or TFMessage."""
        if hasattr(message, 'transforms'):
            for each in message.transforms:
                if each.child_frame_id.lstrip('/') == self._tf_child:
                    yield self._transform(each)
        elif hasattr(message, 'transform'):
            yield self._transform(message)
        else:
            pose, covariance = message.pose, _NOT_SET
            if hasattr(pose, 'pose'):
                pose, covariance = pose.pose, pose.covariance
            yield _pose(message, self._frame, pose.position, pose.orientation, covariance)

    def _transform(self, message: Any) -> BasePose:
        transform = message.transform
        return _pose(message, message.child_frame_id, transform.translation, transform.rotation, _NOT_SET)


def _pose(message: Any, frame: str, position: Any, turn: Any, covariance: Any) -> BasePose:
    numbers = (position.x, position.y, position.z, turn.x, turn.y, turn.z, turn.w)
    return BasePose(stamp_of(message), message.header.frame_id, frame, numbers, covariance)


def stamp_of(message: Any) -> int:
    """Return the header stamp of a message, ns."""
    if isinstance(message, Packets):  # one
        return int(message.stamps[0])
    if isinstance(message, BasePose):
        return message.stamp
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def stamps_of(messages: Sequence[Any]) -> Stamps:
    """Return the header stamps of N messages, (N,) ns."""
    if isinstance(messages, Packets):
        return messages.stamps
    return np.array([stamp_of(message) for message in messages], dtype=np.int64)


def number_of(messages: Sequence[Any]) -> int:
    """Return the number of messages, some of which may be packets of several."""
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


def parameters_of(message: Any) -> Array:
    """Return mass, centre of mass and inertia, (10,), of an InertiaEstimate; NaN where not identifiable."""
    inertia = message.inertia
    tensor = (getattr(inertia, name) for name in PARAMETERS[4:])
    values = np.array([inertia.m, inertia.com.x, inertia.com.y, inertia.com.z, *tensor], dtype=float)
    return np.where(np.asarray(message.identifiable, dtype=bool), values, np.nan)


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


class JointStateShape(NamedTuple):
    """The names of joints, and numbers of positions and velocities, that several JointStates share."""

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
    """The frames that several Odometry messages share."""

    frame_id: str
    child_frame_id: str

    def columns(self, messages: Sequence[Any]) -> tuple[Stamps, Array, Array, Array]:
        """Return stamps (N,), ns, numbers (N, 13) and covariances (N, 36) of pose and twist of N such messages."""
        numbers = np.array([numbers_of(message) for message in messages])
        return stamps_of(messages), numbers, _covariances(messages, 'pose'), _covariances(messages, 'twist')


def joint_state_shape(message: Any) -> JointStateShape | JointStateLayout:
    """Return the shape of a JointState, or of packets together."""
    if isinstance(message, Packets):
        return message.layout
    return JointStateShape(tuple(message.name), len(message.position), len(message.velocity))


def odometry_shape(message: Any) -> OdometryShape | OdometryLayout | BasePoseShape:
    """Return the shape of an Odometry, of packets together, or of a pose in its place."""
    if isinstance(message, Packets):
        return message.layout
    if isinstance(message, BasePose):
        return BasePoseShape(message.frame_id, message.child_frame_id)
    return OdometryShape(message.header.frame_id, message.child_frame_id)


def _covariances(messages: Sequence[Any], part: str) -> Array:
    return np.array([getattr(message, part).covariance for message in messages], dtype=float).reshape(-1, 36)
