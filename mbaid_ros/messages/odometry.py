"""Odometry messages to arrays."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from functools import lru_cache
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from mbaid_ros.cdr import OdometryLayout
from mbaid_ros.core.geometry import Array, Flags, rotate, rotation_from_quaternion
from mbaid_ros.core.samples import BaseStream, SensorNoise, Stamps
from mbaid_ros.core.sensors.base import AttachedFrame, UsableCovariance, usable_covariance
from mbaid_ros.messages.fields import (
    BAD_QUATERNION,
    LOST_TRACKING,
    NOT_FINITE,
    NOT_REAL,
    POSE_COVARIANCE,
    TWIST_COVARIANCE,
    WRONG_CHILD_FRAME,
    BasePoseShape,
    OdometryShape,
    number_of,
    odometry_shape,
)

_LARGEST_POSITION = 1e12  # m: beyond the planets
_LARGEST_VELOCITY = 1e6  # m/s, rad/s
_QUATERNION_TOLERANCE = 0.1
_REMEMBERED = 5  # frames
_FIELDS = {'position of the base': slice(0, 3), 'orientation of the base': slice(3, 7)}  # columns of an Odometry

_Shape = OdometryShape | OdometryLayout | BasePoseShape
_Columns = tuple[Stamps, Array, Array, Array]


class OdometryReader:
    """Reads Odometry messages: pose of a frame on the base in the odometry frame, twist in the declared frame.

    Parameters
    ----------
    attached : the accepted child frames, by name: those of the links of the base
    marker : pose on the base of a child frame that is no link of the robot; None refuses such frames
    links : names of all links of the robot
    twist_frame : 'child' (the ROS convention) or 'inertial'
    noise : standard deviations for messages without a usable covariance

    Attributes
    ----------
    replaced : number of messages whose covariance was unusable
    frame, frames : frame_id of the latest message, and the first few of all
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
        self.frames: list[str] = []
        self.replaced: Counter[str] = Counter()
        self.not_finite: Counter[str] = Counter()  # messages with a NaN or infinite value, by field
        self._tracked = False  # whether a pose has been read that is not the placeholder of a lost one

    def read(self, messages: Sequence[Any]) -> tuple[BaseStream | None, Counter[str]]:
        """Return the measurements, and dropped messages by cause; a missing twist is NaN, packets may be together."""
        dropped: Counter[str] = Counter()
        read = [(group.places, *self._measured(group, dropped)) for group in self._accepted(messages, dropped)]
        parts = [(places[good], stream) for places, good, stream in read if np.any(good)]
        if len(parts) < 2:
            return parts[0][1] if parts else None, +dropped
        places, streams = zip(*parts, strict=True)
        return BaseStream.concatenate(list(streams))[np.argsort(np.concatenate(places))], +dropped

    def _measured(self, group: _Group, dropped: Counter[str]) -> tuple[Flags, BaseStream]:
        """Return which messages of a frame are usable, and the base link's measurements; the others are counted."""
        stamp, numbers, pose, twist = group.columns
        good = self._usable(numbers, dropped)
        pose, of_pose, wrong_pose = self._covariances(pose, self._pose_default)
        twist, of_twist, wrong_twist = self._covariances(twist, self._twist_default)
        for cause, wrong in ((POSE_COVARIANCE, wrong_pose), (TWIST_COVARIANCE, wrong_twist)):
            self.replaced[cause] += int(np.sum(wrong & good))
        declared = np.concatenate((of_pose, of_twist), axis=1)
        if not np.all(good):
            stamp, numbers, pose, twist = stamp[good], numbers[good], pose[good], twist[good]
            declared = declared[good]
        stream = self._stream(stamp, numbers, pose, twist, declared)
        return good, stream if group.frame.is_base else group.frame.to_base(stream)

    def _accepted(self, messages: Sequence[Any], dropped: Counter[str]) -> list[_Group]:
        """Return the messages of frames on the base, by their shapes; the others are counted."""
        alike: dict[_Shape, list[Any]] = {}
        places: dict[_Shape, list[range]] = {}
        begin = 0
        for shape, group in groupby(messages, key=odometry_shape):
            run = list(group)
            end = begin + number_of(run)
            alike.setdefault(shape, []).extend(run)
            places.setdefault(shape, []).append(range(begin, end))
            begin = end
        accepted: list[_Group] = []
        for shape in sorted(places, key=lambda shape: places[shape][-1].stop):  # so that the last remains
            frame = self._frame(shape.child_frame_id)
            if frame is None:
                self.other_child_frame = shape.child_frame_id
                dropped[WRONG_CHILD_FRAME] += sum(map(len, places[shape]))
            else:
                self.frame = shape.frame_id
                self._remember(shape.frame_id.lstrip('/'))
                accepted.append(_Group(frame, np.concatenate(places[shape]), shape.columns(alike[shape])))
        return accepted

    def _remember(self, frame: str) -> None:
        if frame not in self.frames and len(self.frames) < _REMEMBERED:
            self.frames.append(frame)

    def _frame(self, name: str) -> AttachedFrame | None:
        """Return where the frame of that name is on the base, None if that is not known."""
        name = name.lstrip('/')
        return self._attached.get(name) or (self._marker if name not in self._links else None)

    def _usable(self, numbers: Array, dropped: Counter[str]) -> Flags:
        """Return which messages have a pose; the others are counted.

        A tracker that has lost the base publishes zeros, with a quaternion of zeros or the identity.
        """
        finite = np.all(np.isfinite(numbers[:, :7]), axis=1)
        for field, columns in _FIELDS.items():
            lacking = int(np.sum(~np.all(np.isfinite(numbers[:, columns]), axis=1)))
            self.not_finite.update({field: lacking} if lacking else {})
        empty = ~np.any(numbers[:, 3:7], axis=1)
        placeholder = empty | ~np.any(numbers[:, :6], axis=1)
        tracked = self._tracked | np.logical_or.accumulate(finite & ~placeholder)
        self._tracked = bool(tracked[-1])
        lost = finite & (empty | (placeholder & tracked))
        dropped[LOST_TRACKING] += int(np.sum(lost))
        finite_pose = finite & ~lost
        with np.errstate(over='ignore', invalid='ignore'):
            length = np.sqrt(np.sum(numbers[:, 3:7] ** 2, axis=1))
            unit = np.abs(length - 1.0) < _QUATERNION_TOLERANCE
            real = np.all(np.abs(numbers[:, :3]) < _LARGEST_POSITION, axis=1)
        dropped[NOT_FINITE] += int(np.sum(~finite))
        dropped[BAD_QUATERNION] += int(np.sum(finite_pose & ~unit))
        dropped[NOT_REAL] += int(np.sum(finite_pose & unit & ~real))
        return np.asarray(finite_pose & unit & real)

    def _stream(self, stamp: Stamps, numbers: Array, pose: Array, twist: Array, declared: Flags) -> BaseStream:
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
        return BaseStream(stamp, numbers[:, :3], rotation, linear, angular, pose, twist, declared)

    def _covariances(self, rows: Array, default: Array) -> tuple[Array, Flags, Flags]:
        """Return (N, 6, 6) covariances, of which blocks they are the messages', (N, 2), and which messages' are none.

        They are the messages' (N, 36), or the default where they are not set or not usable.
        """
        # Publishers mostly repeat one covariance: check each distinct one once.
        if np.all(rows == rows[0]):
            distinct, which = rows[:1], np.zeros(len(rows), dtype=np.intp)
        else:
            distinct, inverse = np.unique(rows, axis=0, return_inverse=True)
            which = inverse.ravel()
        checked = [_checked(row.tobytes(), default.tobytes()) for row in distinct]
        matrices, own, wrong = (np.array(each)[which] for each in zip(*checked, strict=True))
        return matrices, own, wrong


@lru_cache(maxsize=64)
def _checked(given: bytes, default: bytes) -> UsableCovariance:
    """Return the covariance to use where one is given."""
    return usable_covariance(np.frombuffer(given).reshape(6, 6), np.frombuffer(default).reshape(6, 6))


class _Group(NamedTuple):
    """Messages of the same frames: where the child frame is, their places among all messages, their numbers."""

    frame: AttachedFrame
    places: npt.NDArray[np.intp]
    columns: _Columns
