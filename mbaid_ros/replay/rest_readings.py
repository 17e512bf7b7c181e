"""The readings of a robot at rest in a bag, in the order of their stamps, as an estimator reads them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbaid_ros.bags import BagReader
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array, log
from mbaid_ros.core.samples import BaseStream, JointStream, SensorNoise, Stamps
from mbaid_ros.core.sensors.base import AttachedFrame
from mbaid_ros.core.sensors.levels import TYPICAL
from mbaid_ros.core.sensors.outliers import JOINT_OUTLIER, Outliers, joint_channels
from mbaid_ros.core.sensors.turns import Turns
from mbaid_ros.messages.fields import PoseReader, source_of, stamp_of, stamps_of
from mbaid_ros.messages.odometry import OdometryReader
from mbaid_ros.replay.inputs import Inputs

FEWEST = 50  # messages
SHORTEST = 5.0  # s of rest: in less, a cubic takes the slow part of the noise for motion
_NEAR = 200_000_000  # ns between readings that are compared for outliers


@dataclass(frozen=True)
class Recording:
    """The readings in a bag."""

    joints: tuple[str, ...]
    # joint_time, base_time: (n,), (m,) s, stamps since the first one of the joints
    joint_time: Array
    base_time: Array
    joint_channels: dict[str, Array]  # by name, (n, k) each; (n, 0) where nothing was measured
    base_channels: dict[str, Array]  # by name, (m, 3) each; orientations as rotation vectors from the first one

    def between(self, begin: float, end: float) -> Recording:
        """Return the readings from a time to another, s."""
        joints, bases = ((begin <= time) & (time <= end) for time in (self.joint_time, self.base_time))
        return replace(
            self,
            joint_time=self.joint_time[joints],
            base_time=self.base_time[bases],
            joint_channels={name: values[joints] for name, values in self.joint_channels.items()},
            base_channels={name: values[bases] for name, values in self.base_channels.items()},
        )


def read_recording(bag: str, joint_states: str, base: str, between: tuple[float, float]) -> tuple[Recording, list[str]]:
    """Return the readings in a bag between two times, s from its first message, and warnings about it.

    `base` names the topic of Odometry or poses; empty is /odom or else /pose.
    """
    with BagReader(bag, *between) as recording:
        joint_states, odom = Inputs(joint_states, base).topics(recording)[:2]
        joints = [message for _, message, _ in recording.read([joint_states])]
        located = [message for _, message, _ in recording.read([odom])]
        poses = PoseReader('', '')
        bases = [pose for each in located for pose in ([each] if source_of(each) == 'odom' else poses.read(each))]
        warnings = list(dict.fromkeys(recording.warnings))
    for topic, messages in ((joint_states, joints), (odom, bases)):
        if len(messages) < FEWEST:
            raise DataError('; '.join([f"bag '{bag}' has fewer than {FEWEST} messages of '{topic}'", *warnings]))
    where, base_where = (f"topic '{topic}' of bag '{bag}'" for topic in (joint_states, odom))
    begin = stamp_of(joints[0])
    names, stream, lines = _joint_stream(joints, where)
    stream_of_base, others = _base_stream(bases, base_where)
    warnings += [f"bag '{bag}': {line}" for line in (*lines, *others)]
    found = Recording(
        joints=names,
        joint_time=1e-9 * (stream.stamp - begin),
        base_time=1e-9 * (stream_of_base.stamp - begin),
        joint_channels={'joint_position': stream.position, 'joint_velocity': stream.velocity},
        base_channels={
            'base_position': stream_of_base.position,
            'base_orientation': log(stream_of_base.rotation[0].T @ stream_of_base.rotation),
            'base_linear_velocity': stream_of_base.linear_velocity,
            'base_angular_velocity': stream_of_base.angular_velocity,
        },
    )
    return found, warnings


def _joint_stream(joints: Sequence[Any], where: str) -> tuple[tuple[str, ...], JointStream, list[str]]:
    """Return names and readings of the joints, without turns and outliers, and notes on omitted readings."""
    names, stamps = _names(joints, where), _stamps(joints, where)
    position: Array = np.array([joint.position for joint in joints], dtype=float)
    velocity: Array = np.array([joint.velocity for joint in joints], dtype=float)
    if not position.shape[1]:
        return names, JointStream(stamps, position, velocity), []
    if not velocity.shape[1]:
        velocity = np.full_like(position, np.nan)
    known = np.sum(np.isfinite(position), axis=0) >= FEWEST
    lines = [f'{name} has no position in most messages (NaN)' for name in np.array(names)[~known]]
    position, velocity = position[:, known], velocity[:, known]
    usable = np.all(np.isfinite(position), axis=1)
    stream = JointStream(stamps[usable], position[usable], velocity[usable])
    if len(stream.stamp):
        stream.position[:] -= 2.0 * np.pi * Turns(stream.position.shape[1]).counted(stream)
    gate = Outliers[JointStream](_NEAR, joint_channels(float(TYPICAL[0])), JOINT_OUTLIER)
    stream = gate.push(stream) or stream[:0]
    lines += [f'{count} messages not used: {cause}' for cause, count in gate.dropped.items() if count]
    return tuple(np.array(names)[known].tolist()), stream, lines


def _base_stream(bases: Sequence[Any], where: str) -> tuple[BaseStream, list[str]]:
    """Return the readings of the base as an estimator reads them, without outliers, and notes on omitted readings."""
    _stamps(bases, where)
    frame = AttachedFrame(np.eye(3), np.zeros(3))
    reader = OdometryReader({}, frame, (), 'inertial', SensorNoise(*TYPICAL.tolist()))
    stream, dropped = reader.read(bases)
    if stream is not None:
        gate = Outliers[BaseStream](_NEAR)
        stream = gate.push(stream)
        dropped += gate.dropped
    lines = [f'{count} messages not used: {cause}' for cause, count in sorted(dropped.items())]
    if stream is None or len(stream.stamp) < FEWEST:
        raise DataError('; '.join([f'{where} has fewer than {FEWEST} poses that can be used', *lines]))
    return stream, lines


def _names(joints: Sequence[Any], topic: str) -> tuple[str, ...]:
    """Return the names of the joints, which must be the same in each message, as the numbers of readings."""
    names = tuple(joints[0].name)
    for joint in joints:
        if tuple(joint.name) != names:
            raise DataError(f'messages on {topic} name other joints; accepted: the same in each')
        positions, velocities = len(joint.position), len(joint.velocity)
        if not {positions, velocities} <= {0, len(names)}:
            raise DataError(
                f'a message on {topic} has {len(names)} names, {positions} positions and {velocities} velocities; '
                'accepted: as many as names, or none'
            )
    return names


def _stamps(messages: Sequence[Any], topic: str) -> Stamps:
    """Return the stamps of messages, ns; refuse stamps that go back or were never filled in."""
    stamps = stamps_of(messages)
    back = np.flatnonzero(np.diff(stamps) < 0)
    if back.size:
        before, after = 1e-9 * stamps[back[0] : back[0] + 2]
        raise DataError(
            f'a message on {topic} is stamped {after:.3f} s, after one of {before:.3f} s; accepted: stamps that do not '
            'go back'
        )
    lasting = 1e-9 * float(stamps[-1] - stamps[0])
    if lasting < SHORTEST:
        raise DataError(
            f'messages on {topic} last {lasting:.2g} s by their stamps; accepted: {SHORTEST:g} s with the joints braked'
        )
    return stamps
