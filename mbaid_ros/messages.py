"""Messages to arrays, duck-typed: rclpy's and rosbags' messages alike, many at a time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from mbaid_ros.core.geometry import Array, Flags, rotate, rotation_from_quaternion
from mbaid_ros.core.intake.attached_frame import AttachedFrame
from mbaid_ros.core.intake.covariances import usable_covariance
from mbaid_ros.core.intake.joint_merge import Joints
from mbaid_ros.core.intake.reorder import join, take
from mbaid_ros.core.samples import BaseStream, JointStream, SensorNoise

JOINT_MISSING = 'joint missing'
LENGTH_MISMATCH = 'names and values differ in number'
NOT_FINITE = 'NaN or infinite value'
NAMED_TWICE = 'joint named twice'
TOO_MANY_NAMES = 'more than 10000 names'
NOT_REAL = 'value beyond anything real'
WRONG_CHILD_FRAME = 'child_frame_id is no frame on the base'
BAD_QUATERNION = 'orientation is not a unit quaternion'

_MOST_NAMES = 10_000
_LARGEST_JOINT = 1e6  # rad, m
_LARGEST_POSITION = 1e12  # m: beyond the planets
_LARGEST_VELOCITY = 1e6  # m/s, rad/s
_NOWHERE = np.zeros(0, dtype=np.intp)
_QUATERNION_TOLERANCE = 0.1


def stamp_of(message: Any) -> int:
    """Return a message's header stamp in ns."""
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def wrench_of(message: Any) -> tuple[str, int, Array]:
    """Return frame, stamp (ns) and (6,) force and torque (N, N m) of a WrenchStamped."""
    force, torque = message.wrench.force, message.wrench.torque
    values = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z], dtype=float)
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


class JointReader:
    """Reads JointState messages: joints by name, in any order, others ignored; all joints of the robot or some.

    Messages that hold some of the joints count until one has held all of them.
    """

    def __init__(self, joint_names: Sequence[str]) -> None:
        self._names = tuple(joint_names)
        self.all: Joints = tuple(range(len(self._names)))
        self._layouts: dict[tuple[str, ...], _Layout] = {}
        self._complete = False  # whether a message has held all joints
        self.unknown: tuple[str, ...] = ()  # names of the last message that lacked a joint
        self.missing: tuple[str, ...] = ()

    def read(self, messages: Sequence[Any]) -> tuple[dict[Joints, JointStream], Counter[str]]:
        """Return the measurements by the joints they are of, and how many messages were dropped for what.

        A velocity that is not given is NaN.
        """
        dropped: Counter[str] = Counter()
        runs: dict[Joints, list[_Run]] = {}
        for message in messages:
            layout = self._layout(message.name)
            cause = layout.refused or self._misfit(message, layout)
            if cause:
                dropped[cause] += 1
                continue
            earlier = runs.setdefault(layout.joints, [])
            if not earlier or earlier[-1][0] is not layout:
                earlier.append((layout, []))
            earlier[-1][1].append(message)
        streams = {}
        for joints, read in runs.items():
            stream = _finite_joints(read, dropped)
            if len(stream.stamp):
                streams[joints] = stream
        return streams, +dropped

    def _misfit(self, message: Any, layout: _Layout) -> str:
        """Return why a message cannot be used, empty if it can."""
        count = len(message.name)
        if len(message.position) != count or len(message.velocity) not in {0, count}:
            return LENGTH_MISMATCH
        if layout.joints == self.all:
            self._complete = True
        elif self._complete:
            return JOINT_MISSING
        return ''

    def _layout(self, names: Sequence[str]) -> _Layout:
        """Return which joints a message holds, and where."""
        if len(names) > _MOST_NAMES:
            return _Layout((), _NOWHERE, TOO_MANY_NAMES)
        key = tuple(names)
        known = self._layouts.get(key)
        if known is None:
            if len(self._layouts) > 64:
                self._layouts.clear()
            known = self._layouts[key] = self._laid_out(key)
        if len(known.joints) < len(self._names):
            self.unknown = key
            self.missing = tuple(name for name in self._names if name not in key)
        return known

    def _laid_out(self, names: tuple[str, ...]) -> _Layout:
        place = {name: index for index, name in enumerate(names)}
        joints = tuple(joint for joint, name in enumerate(self._names) if name in place)
        if any(names.count(self._names[joint]) > 1 for joint in joints):
            return _Layout(joints, _NOWHERE, NAMED_TWICE)
        refused = JOINT_MISSING if not joints and self._names else ''
        places = np.array([place[self._names[joint]] for joint in joints], dtype=np.intp)
        return _Layout(joints, places, refused, len(names))


class _Layout:
    """Where the joints of the robot stand in messages with certain names.

    Parameters
    ----------
    joints : their indices in the model
    places : their places in the message
    refused : why such messages cannot be used; empty: they can
    count : of the names
    """

    def __init__(self, joints: Joints, places: npt.NDArray[np.intp], refused: str, count: int = 0) -> None:
        self.joints = joints
        self.places = places
        self.refused = refused
        self._nothing = np.full(count, np.nan)

    def values(self, given: Sequence[Sequence[float]]) -> Array:
        """Return the (N, k) values of the joints from those of N messages; NaN where one has none."""
        return np.array([row if len(row) else self._nothing for row in given], dtype=float)[:, self.places]


_Run = tuple[_Layout, list[Any]]  # messages in a row that have the same names


def _finite_joints(runs: Sequence[_Run], dropped: Counter[str]) -> JointStream:
    """Return what messages hold that have every position; others are counted."""
    stream = JointStream(
        np.array([stamp_of(message) for _, run in runs for message in run], dtype=np.int64),
        np.concatenate([layout.values([message.position for message in run]) for layout, run in runs]),
        np.concatenate([layout.values([message.velocity for message in run]) for layout, run in runs]),
    )
    finite = np.all(np.isfinite(stream.position), axis=1)
    real = np.all(np.abs(stream.position) < _LARGEST_JOINT, axis=1)
    dropped[NOT_FINITE] += int(np.sum(~finite))
    dropped[NOT_REAL] += int(np.sum(finite & ~real))
    with np.errstate(invalid='ignore'):
        stream.velocity[~(np.abs(stream.velocity) < _LARGEST_VELOCITY)] = np.nan
    return stream if np.all(real) else take(stream, finite & real)


class OdometryReader:
    """Reads Odometry messages: pose of a frame on the base in the odometry frame, twist in the declared frame.

    Parameters
    ----------
    attached : the child frames that are accepted, by name: those of the links of the base
    marker : where a frame that is no link of the robot is taken to be, None if it is refused
    links : names of all links of the robot
    twist_frame : 'child' (the ROS convention) or 'inertial'
    noise : standard deviations where a message carries no usable covariance
    """

    def __init__(
        self,
        attached: Mapping[str, AttachedFrame],
        marker: AttachedFrame | None,
        links: Collection[str],
        twist_frame: str,
        noise: SensorNoise,
    ) -> None:
        self._attached = attached
        self._marker = marker
        self._links = links
        self._inertial = twist_frame == 'inertial'
        self._pose_default = noise.pose_covariance()
        self._twist_default = noise.twist_covariance()
        self.other_child_frame = ''
        self.frame = ''
        self.default_covariances = 0  # messages whose covariance, or a part of it, came from the parameters

    def read(self, messages: Sequence[Any]) -> tuple[BaseStream | None, Counter[str]]:
        """Return the measurements and how many messages were dropped for what. A twist that is not given is NaN."""
        dropped: Counter[str] = Counter()
        accepted, frames = [], []
        for message in messages:
            frame = self._frame(message.child_frame_id)
            if frame is None:
                self.other_child_frame = message.child_frame_id
                dropped[WRONG_CHILD_FRAME] += 1
            else:
                accepted.append(message)
                frames.append(frame)
        if not accepted:
            return None, dropped
        self.frame = accepted[-1].header.frame_id
        stamp = np.array([stamp_of(message) for message in accepted], dtype=np.int64)
        numbers = np.array([numbers_of(message) for message in accepted])
        good = self._usable(numbers, dropped)
        if not np.any(good):
            return None, +dropped
        pose = self._covariances([message.pose.covariance for message in accepted], self._pose_default)[good]
        twist = self._covariances([message.twist.covariance for message in accepted], self._twist_default)[good]
        stream = self._stream(stamp[good], numbers[good], pose, twist)
        return _of_base(stream, [frame for frame, used in zip(frames, good, strict=True) if used]), +dropped

    def _frame(self, name: str) -> AttachedFrame | None:
        """Return where the frame of that name is on the base, None if that is not known."""
        name = name.lstrip('/')
        return self._attached.get(name) or (self._marker if name not in self._links else None)

    @staticmethod
    def _usable(numbers: Array, dropped: Counter[str]) -> Flags:
        """Return which messages have a pose; the others are counted."""
        finite = np.all(np.isfinite(numbers[:, :7]), axis=1)
        with np.errstate(over='ignore', invalid='ignore'):
            length = np.sqrt(np.sum(numbers[:, 3:7] ** 2, axis=1))
            unit = np.abs(length - 1.0) < _QUATERNION_TOLERANCE
            real = np.all(np.abs(numbers[:, :3]) < _LARGEST_POSITION, axis=1)
        dropped[NOT_FINITE] += int(np.sum(~finite))
        dropped[BAD_QUATERNION] += int(np.sum(finite & ~unit))
        dropped[NOT_REAL] += int(np.sum(finite & unit & ~real))
        return np.asarray(finite & unit & real)

    def _stream(self, stamp: npt.NDArray[np.int64], numbers: Array, pose: Array, twist: Array) -> BaseStream:
        rotation = rotation_from_quaternion(numbers[:, 3:7])
        linear, angular = numbers[:, 7:10], numbers[:, 10:13]
        with np.errstate(invalid='ignore'):
            linear, angular = (
                np.where(np.all(np.abs(part) < _LARGEST_VELOCITY, axis=1, keepdims=True), part, np.nan)
                for part in (linear, angular)
            )
        if self._inertial:
            both = np.zeros((len(stamp), 6, 6))
            both[:, :3, :3] = both[:, 3:, 3:] = np.swapaxes(rotation, -1, -2)
            twist = both @ twist @ np.swapaxes(both, -1, -2)
        else:
            linear, angular = rotate(rotation, linear), rotate(rotation, angular)
        return BaseStream(stamp, numbers[:, :3], rotation, linear, angular, pose, twist)

    def _covariances(self, given: Sequence[Any], default: Array) -> Array:
        """Return (N, 6, 6) covariances: the messages', or the default where they are not set or not usable."""
        rows = np.array(given, dtype=float).reshape(-1, 36)
        # Publishers mostly repeat one covariance: check each distinct one once.
        if np.all(rows == rows[0]):
            used, replaced = _checked(rows[0].tobytes(), default.tobytes())
            self.default_covariances += len(rows) * replaced
            return np.repeat(used[None], len(rows), axis=0)
        distinct, inverse = np.unique(rows, axis=0, return_inverse=True)
        checked = [_checked(row.tobytes(), default.tobytes()) for row in distinct]
        self.default_covariances += int(np.sum(np.array([replaced for _, replaced in checked])[inverse.ravel()]))
        return np.array([used for used, _ in checked])[inverse.ravel()]


@lru_cache(maxsize=64)
def _checked(given: bytes, default: bytes) -> tuple[Array, bool]:
    """Return the (6, 6) covariance to use where one is given, and whether that is another one."""
    matrix = np.frombuffer(given).reshape(6, 6)
    used = usable_covariance(matrix, np.frombuffer(default).reshape(6, 6))
    return used, not np.array_equal(used, matrix)


def _of_base(stream: BaseStream, frames: Sequence[AttachedFrame]) -> BaseStream:
    """Return the base link's measurements from those of frames on it, each message with its own."""
    parts = [
        (frame, [index for index, other in enumerate(frames) if other is frame]) for frame in dict.fromkeys(frames)
    ]
    if len(parts) == 1:
        frame = parts[0][0]
        return stream if frame.is_base else frame.to_base(stream)
    converted = [_of_base(take(stream, np.array(places)), [frame] * len(places)) for frame, places in parts]
    joined = converted[0]
    for part in converted[1:]:
        joined = join(joined, part)
    return take(joined, np.argsort(np.concatenate([places for _, places in parts]), kind='stable'))
