"""JointState messages to arrays: joints by name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from mbaid_ros.cdr import JointStateLayout
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.joint_trajectory import JointTrajectory
from mbaid_ros.core.samples import JointStream
from mbaid_ros.core.sensors.joints import Joints
from mbaid_ros.messages.fields import (
    JOINT_MISSING,
    LENGTH_MISMATCH,
    NAMED_TWICE,
    NOT_FINITE,
    NOT_REAL,
    TOO_MANY_NAMES,
    JointStateShape,
    joint_state_shape,
    number_of,
)

_MOST_NAMES = 10_000
_LARGEST_JOINT = 1e6  # rad, m
_LARGEST_VELOCITY = 1e6  # m/s, rad/s
_NOWHERE = np.zeros(0, dtype=np.intp)

_Shape = JointStateShape | JointStateLayout


class JointReader:
    """Reads JointState messages: joints by name, in any order, others ignored; all joints of the robot or some.

    Wheels, which are no joints of the robot, come after these: they need velocities, and their positions are read as
    zero.

    Parameters
    ----------
    joint_names, wheels : names
    passive : those of unreported joints; their values in messages are ignored, and they are read as zero
    """

    def __init__(self, joint_names: Sequence[str], wheels: Sequence[str] = (), passive: Sequence[str] = ()) -> None:
        self._names = (*joint_names, *wheels)
        self._first_wheel = len(joint_names)
        self._passive = tuple(place for place, name in enumerate(joint_names) if name in passive)
        self.all: Joints = tuple(range(len(self._names)))
        self._layouts: dict[tuple[str, ...], _Layout] = {}
        self.others: tuple[str, ...] = ()  # further names in the last message that was laid out
        self.unknown: tuple[str, ...] = ()  # names of the last message that lacked a joint
        self.missing: tuple[str, ...] = ()
        self.not_finite: Counter[str] = Counter()  # messages with a NaN or infinite value, by field and joint
        self.heard: dict[str, None] = {}  # every name that a message has had, in order; a bounded number

    def read(self, messages: Sequence[Any]) -> tuple[dict[Joints, JointStream], Counter[str]]:
        """Return the measurements by their joints, and the numbers of dropped messages by cause.

        A velocity that is not given is NaN. Packets may be together.
        """
        dropped: Counter[str] = Counter()
        runs: dict[Joints, list[_Run]] = {}
        for shape, group in groupby(messages, key=joint_state_shape):
            run = list(group)
            layout = self._layout(shape.names)
            cause = layout.refused or self._misfit(shape)
            if cause:
                dropped[cause] += number_of(run)
                continue
            earlier = runs.setdefault(layout.joints, [])
            if earlier and earlier[-1][1] == shape:
                earlier[-1][2].extend(run)
            else:
                earlier.append((layout, shape, run))
        streams = {}
        for joints, read in runs.items():
            wheels = [place for place, joint in enumerate(joints) if joint >= self._first_wheel]
            stream, lacking = _finite_joints(read, wheels, dropped)
            self.not_finite.update({self._field(joints[place]): count for place, count in lacking.items()})
            if len(stream.stamp):
                every, stream = self._with_passive(joints, stream)
                streams[every] = stream
        return streams, +dropped

    def _field(self, joint: int) -> str:
        return f'{"position" if joint < self._first_wheel else "velocity"} of {self._names[joint]}'

    def _with_passive(self, joints: Joints, stream: JointStream) -> tuple[Joints, JointStream]:
        """Return the measurements with passive joints at zero, where they are of joints at all."""
        if not self._passive or all(joint >= self._first_wheel for joint in joints):
            return joints, stream
        every = tuple(sorted((*joints, *self._passive)))
        held = [every.index(joint) for joint in joints]
        position, velocity = np.zeros((2, len(stream.stamp), len(every)))
        position[:, held], velocity[:, held] = stream.position, stream.velocity
        return every, JointStream(stream.stamp, position, velocity)

    @staticmethod
    def _misfit(shape: _Shape) -> str:
        """Return why messages of a shape cannot be used, empty if they can."""
        count = len(shape.names)
        if shape.positions != count or shape.velocities not in {0, count}:
            return LENGTH_MISMATCH
        return ''

    def _layout(self, key: tuple[str, ...]) -> _Layout:
        """Return which joints a message with certain names holds, and where."""
        if len(key) > _MOST_NAMES:
            return _Layout((), _NOWHERE, TOO_MANY_NAMES)
        known = self._layouts.get(key)
        if known is None:
            if len(self._layouts) > 64:
                self._layouts.clear()
            known = self._layouts[key] = self._laid_out(key)
            if len(self.heard) < _MOST_NAMES:
                self.heard.update(dict.fromkeys(key))
        if len(known.joints) < len(self._names) - len(self._passive):
            self.unknown = key
            reported = (name for place, name in enumerate(self._names) if place not in self._passive)
            self.missing = tuple(name for name in reported if name not in key)
        return known

    def _laid_out(self, names: tuple[str, ...]) -> _Layout:
        place = {name: index for index, name in enumerate(names)}
        joints = tuple(joint for joint, name in enumerate(self._names) if name in place and joint not in self._passive)
        if any(names.count(self._names[joint]) > 1 for joint in joints):
            return _Layout(joints, _NOWHERE, NAMED_TWICE)
        self.others = tuple(name for name in names if name not in self._names)
        refused = JOINT_MISSING if not joints and self._names else ''
        places = np.array([place[self._names[joint]] for joint in joints], dtype=np.intp)
        return _Layout(joints, places, refused)


class _Layout(NamedTuple):
    """Indices of the robot's joints in the model and in messages with certain names; why such messages are refused."""

    joints: Joints
    places: npt.NDArray[np.intp]
    refused: str

    def chosen(self, values: Array) -> Array:
        """Return the (N, k) values of the joints from those of N messages (N, c); NaN where c is 0."""
        return values[:, self.places] if values.shape[1] else np.full((len(values), len(self.places)), np.nan)


_Run = tuple[_Layout, _Shape, list[Any]]  # messages in a row that have the same shape


def _finite_joints(
    runs: Sequence[_Run], wheels: Sequence[int], dropped: Counter[str]
) -> tuple[JointStream, dict[int, int]]:
    """Return the contents of messages that have every position, and the speed of every wheel; others are counted.

    The second result is the number of messages that lack each of these, by its column.
    """
    parts = [(layout, *shape.columns(messages)) for layout, shape, messages in runs]
    stream = JointStream(
        np.concatenate([stamp for _, stamp, _, _ in parts]),
        np.concatenate([layout.chosen(position) for layout, _, position, _ in parts]),
        np.concatenate([layout.chosen(velocity) for layout, _, _, velocity in parts]),
    )
    stream.position[:, wheels] = 0.0
    known = np.isfinite(stream.position)
    known[:, wheels] = np.isfinite(stream.velocity[:, wheels])
    finite = np.all(known, axis=1)
    lacking = {place: int(count) for place, count in enumerate(np.sum(~known, axis=0).tolist()) if count}
    real = np.all(np.abs(stream.position) < _LARGEST_JOINT, axis=1)
    dropped[NOT_FINITE] += int(np.sum(~finite))
    dropped[NOT_REAL] += int(np.sum(finite & ~real))
    with np.errstate(invalid='ignore'):
        stream.velocity[~(np.abs(stream.velocity) < _LARGEST_VELOCITY)] = np.nan
    usable = finite & real
    return stream if np.all(usable) else stream[usable], lacking


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
