"""The messages of one run: queued in the order of arrival, then read to streams of measurements."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mbaid_ros.cdr import Packets
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.sensors import ImuConfig, PoseConfig
from mbaid_ros.core.diagnosis.plain_faults import PlainFaults
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.samples import BaseStream, ImuStream, JointStream, SensorNoise
from mbaid_ros.core.sensors.base import AttachedFrame, measured_orientation
from mbaid_ros.core.sensors.external_momentum import StoredMomentum
from mbaid_ros.core.sensors.gyro import DeadReckoning, Gyro
from mbaid_ros.core.sensors.joints import JointMerge
from mbaid_ros.core.sensors.streams import OTHER_CLOCK, Gate, Reorder
from mbaid_ros.messages.fields import PoseReader, Source, source_of, stamps_of
from mbaid_ros.messages.imu import ImuReader
from mbaid_ros.messages.joints import JointReader
from mbaid_ros.messages.odometry import OdometryReader
from mbaid_ros.session.robot import Robot
from mbaid_ros.session.settings import imu_link, imu_reader

JOINTS, ODOMETRY, IMU = 'joint_states', 'odom', 'imu'
SPOKEN = {JOINTS: 'the joint states', ODOMETRY: 'the poses of the base', IMU: 'the IMU'}  # whatever their topics are

TIME_JUMP = 1.0  # s between consecutive stamps of a topic: no sensor pauses and resumes in its own past
REORDER_TIME = 0.05  # s, that messages wait for late ones at most: longer waits would delay every estimate
OTHER_SOURCE = 'the pose of the base comes from another source'


class MessageQueue:
    """Collects the messages of all topics, each in the order of arrival."""

    def __init__(self, topics: Collection[str]) -> None:
        self._threshold = round(TIME_JUMP * 1e9)
        self._gates = {name: Gate(self._threshold) for name in topics}
        self._epoch = 0
        self._dropped: Counter[str] = Counter()

    @property
    def dropped(self) -> Counter[str]:
        """Messages that were not taken, by cause."""
        return sum((gate.dropped for gate in self._gates.values()), Counter(self._dropped))

    @property
    def newest(self) -> dict[str, int | None]:
        """The latest stamp of each topic, ns; None before its first."""
        return {name: gate.newest for name, gate in self._gates.items()}

    @property
    def latest(self) -> int | None:
        """The latest stamp of all, ns; None before the first."""
        return max((gate.newest for gate in self._gates.values() if gate.newest is not None), default=None)

    @property
    def waiting(self) -> dict[str, int]:
        """Number of waiting messages of each topic; a packet of several counts as one."""
        return {name: len(gate.messages) for name, gate in self._gates.items()}

    def add(self, name: str, stamp: int, message: Any) -> str | None:
        """Add a message; where it confirms that stamps jumped back, return the reason to start again.

        The reason is empty if another topic jumped first. Messages from before the jump wait;
        `confirm_jump` adds those from after it.
        """
        gate = self._gates[name]
        behind = gate.epoch != self._epoch
        if behind and not self._takes(stamp):
            return None
        jump = gate.add(stamp, message)
        if jump:
            return self._jumped(name, jump)
        if behind and gate.messages and gate.messages[-1] is message:
            gate.epoch = self._epoch
        return None

    def confirm_jump(self, name: str, message: Any) -> None:
        """Add the messages that have shown a jump back, the last of which is `message`."""
        self._gates[name].confirm_jump(message)

    def add_regular(self, messages: Mapping[str, Sequence[Any]]) -> bool:
        """Add messages of all topics (lists or packets, as they came) if all stamps are regular; else return False."""
        stamps = {name: stamps_of(part) for name, part in messages.items()}
        gates = self._gates.items()
        if not all(gate.epoch == self._epoch and gate.all_pass(stamps[name]) for name, gate in gates):
            return False
        for name, gate in gates:
            part = messages[name]
            gate.add_regular(stamps[name], [part] if isinstance(part, Packets) else part)
        return True

    def take_all(self) -> dict[str, list[Any]]:
        """Return the waiting messages by topic, and empty the queue."""
        return {name: gate.pop_all() for name, gate in self._gates.items()}

    def _takes(self, stamp: int) -> bool:
        """Return whether to take a message of a topic that has not jumped back with another one."""
        jumped = [gate.newest for gate in self._gates.values() if gate.epoch == self._epoch and gate.newest is not None]
        if jumped and stamp > max(jumped) + self._threshold:
            self._dropped[OTHER_CLOCK] += 1
            return False
        return True

    def _jumped(self, name: str, amount: int) -> str:
        """Return why to start again; the second topic to jump back only follows the first."""
        gate = self._gates[name]
        if gate.epoch <= self._epoch:
            return ''
        self._epoch = gate.epoch
        back = f'the stamps of {SPOKEN[name]} jumped back by {amount * 1e-9:.6g} s'
        return f'{back} (a bag or simulation started again, a clock set)'


class BaseSource:
    """The messages that locate the base: of the source that comes first, or of the one that the parameters name.

    Attributes
    ----------
    kind, dropped : of the source, None before the first message; number of messages of other sources

    Parameters
    ----------
    frame : of poses without a name; empty for one that is no link's
    needed : whether any source is used
    """

    def __init__(self, config: PoseConfig, frame: str, *, needed: bool) -> None:
        self._poses = PoseReader(frame, config.tf_child_frame)
        self._needed = needed
        self.kind: Source | None = 'tf' if config.tf_child_frame else None
        self.dropped: Counter[str] = Counter()

    def poses(self, messages: Sequence[Any]) -> Sequence[Any]:
        """Return the messages of any source as Odometry or as poses."""
        if isinstance(messages, Packets):
            return messages
        each = ([message] if source_of(message) == 'odom' else self._poses.read(message) for message in messages)
        return [pose for poses in each for pose in poses]

    def accepts(self, messages: Sequence[Any]) -> bool:
        """Return whether messages are all of the source that is used."""
        return all(self._is_used(kind) for kind in _kinds(messages))

    def accepted(self, messages: Sequence[Any]) -> Sequence[Any]:
        """Return the messages of the used source as Odometry or as poses; the others are counted as dropped."""
        for kind in _kinds(messages):
            if self.kind is None and kind != 'tf':
                self.kind = kind
        if isinstance(messages, Packets):
            used: Sequence[Any] = messages if self._is_used('odom') else []
        else:
            used = [message for message in messages if self._is_used(source_of(message))]
        self.dropped[OTHER_SOURCE] += len(messages) - len(used)
        return self.poses(used)

    def _is_used(self, kind: Source) -> bool:
        return self._needed and (kind == self.kind or (self.kind is None and kind != 'tf'))


def _kinds(messages: Sequence[Any]) -> set[Source]:
    return {'odom'} if isinstance(messages, Packets) else {source_of(message) for message in messages}


class Intake:
    """The readers of a run's messages, and the measurements that wait until their order is sure.

    Raises ParameterError: The IMU cannot be on the frame that the parameters name.

    Attributes
    ----------
    joint_reader, odometry_reader, imu_reader, stored_momentum : of messages
    merge : of joints from several publishers
    faults : plain in the joint readings or the robot description
    alone, orientation_measured : whether an IMU alone measures the base's motion, and has measured an orientation
    """

    def __init__(self, config: EstimatorConfig, robot: Robot) -> None:
        self._robot = robot
        self.joint_reader = JointReader(robot.model.independent_joints, config.wheels.names, config.flexible.joints)
        prefix, declared = config.frame_prefix, config.noise.declared
        self.odometry_reader = _odometry_reader(robot.model, prefix, robot.marker, config.twist_frame, declared)
        self.imu_reader: ImuReader = imu_reader(
            config.imu, robot.model, config.target_link, prefix, declared.base_orientation
        )
        self.stored_momentum = StoredMomentum(robot.model, config.wheels.momentum_frame)
        self.alone = config.imu.alone
        limit, beside = round(REORDER_TIME * 1e9), robot.kernel.storage.count
        turning = ~np.array(robot.model.prismatic, dtype=bool)[robot.model.transmission.independent]
        turning = np.append(turning, np.zeros(beside, dtype=bool))
        self.merge = JointMerge(
            turning, round(config.maximum_gap * 1e9), limit, beside, config.noise.declared.joint_position
        )
        self.faults = PlainFaults(robot.model, config.noise.declared.joint_position)
        self._reorder = Reorder[BaseStream](limit)
        self._reorder_imu = Reorder[ImuStream](limit)
        self._reckoning = DeadReckoning()
        self._with_orientation = config.imu.orientation
        self.orientation_measured = False
        self._refused: Counter[str] = Counter()

    @property
    def dropped(self) -> Counter[str]:
        """Unused messages, by cause."""
        parts = (self.merge, self._reorder, self._reorder_imu, self.stored_momentum)
        return sum((part.dropped for part in parts), Counter(self._refused))

    def streams(
        self, messages: Mapping[str, Sequence[Any]]
    ) -> tuple[JointStream | None, BaseStream | None, ImuStream | None]:
        """Return the measurements of all joints, base and gyro in messages, by topic, as far as their order is sure."""
        joints, dropped_joints = self.joint_reader.read(messages[JOINTS])
        base, dropped_base = self.odometry_reader.read(messages[ODOMETRY])
        self._refused += dropped_joints + dropped_base
        self.faults.add(joints, base)
        imu = None
        if IMU in messages:
            measured, dropped = self.imu_reader.read(messages[IMU])
            self._refused += dropped
            imu = self._reorder_imu.push(measured)
        if not self.alone:
            located = self._reorder.push(base)
        elif self._with_orientation:
            located = measured_orientation(imu)
            self.orientation_measured |= located is not None
        else:
            located = self._reckoning.push(imu)
        stored = self.stored_momentum.stream()
        if stored is not None:
            every = range(len(self._robot.readings))
            joints[tuple(every[-stored.position.shape[1] :])] = stored
        merged = self.merge.push(joints)
        if merged is not None:
            merged = merged.without_stored_momentum(len(self._robot.model.independent_joints))
        return self._all_joints(merged), located, imu

    def completes(self, end: int, name: str, newest: Mapping[str, int | None]) -> bool:
        """Return whether no message still to come belongs to a window.

        The first joints after its `end` (ns) complete it, with odometry (and IMU) no earlier than these. `name` is the
        topic of the latest message, `newest` the latest stamp (ns) of each topic; None before the first.
        """
        joints, base = newest[JOINTS], newest[IMU if self.alone else ODOMETRY]
        if joints is None or base is None:
            return False
        joints -= self.merge.hold
        wanted = joints if name == JOINTS else end
        if IMU in newest and not self.alone:
            imu = newest[IMU]
            if imu is None or imu - self._reorder_imu.hold < wanted:
                return False
        hold = (self._reorder_imu if self.alone else self._reorder).hold
        return joints >= end and base - hold >= wanted

    def _all_joints(self, measured: JointStream | None) -> JointStream | None:
        """Return the measurements of all joints, those that mimic others too."""
        moved = self._robot.model.transmission
        if measured is None or moved.direct:
            return measured
        position, velocity = moved.positions(measured.position), moved.rates(measured.velocity)
        return replace(measured, position=position, velocity=velocity)


def _odometry_reader(
    model: RobotModel, prefix: str, marker: AttachedFrame | None, twist_frame: str, noise: SensorNoise
) -> OdometryReader:
    """Return the reader of poses and twists of the base, for the frames on it; `noise` is that of unmarked messages."""
    links = model.links
    attached = {prefix + link.name: AttachedFrame(link.rotation, link.position) for link in links if link.body == 0}
    names = frozenset(prefix + link.name for link in links)
    return OdometryReader(attached, marker, names, twist_frame, noise)


def make_gyro(
    config: ImuConfig, model: RobotModel, target_link: str, frame_prefix: str, maximum_gap: float
) -> Gyro | None:
    """Return the integrator of an IMU's angular velocity; None without an IMU.

    Parameters
    ----------
    target_link, frame_prefix : as of `imu_link`
    maximum_gap : s, longest interval that is interpolated
    """
    if config.noise_density == 0.0:
        return None
    on_base = imu_link(config, model, target_link, frame_prefix) is None
    return Gyro(round(maximum_gap * 1e9), config.range, on_base=on_base)
