"""From the messages of one run to streams of measurements: read, merged, in the order of their stamps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.intake.attached_frame import AttachedFrame
from mbaid_ros.core.intake.dead_reckoning import DeadReckoning
from mbaid_ros.core.intake.gyro import Gyro
from mbaid_ros.core.intake.joint_merge import JointMerge
from mbaid_ros.core.intake.orientation_only import measured_orientation
from mbaid_ros.core.intake.reorder import Reorder
from mbaid_ros.core.intake.stored_momentum import StoredMomentum
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.samples import BaseStream, ImuStream, JointStream
from mbaid_ros.messages import ImuReader, JointReader, OdometryReader
from mbaid_ros.session.frames import imu_link, imu_reader
from mbaid_ros.session.robot import Robot

JOINTS, ODOMETRY, IMU = 'joint_states', 'odom', 'imu'


class Intake:
    """What one run reads its messages with, and what it holds back until their order is sure.

    Parameters
    ----------
    config : EstimatorConfig
    robot : as it is known when the run begins

    Attributes
    ----------
    joint_reader, odometry_reader, imu_reader : of messages
    merge : of joints that several publishers tell of
    stored_momentum : what a flight computer tells of it
    alone : whether nothing but an IMU tells how the base moves
    orientation_told : whether that has told an orientation that it is asked for

    Raises
    ------
    ParameterError
        A frame that the parameters name is not on the base.
    """

    def __init__(self, config: EstimatorConfig, robot: Robot) -> None:
        self._robot = robot
        self.joint_reader, self.odometry_reader = readers(config, robot)
        self.imu_reader: ImuReader = imu_reader(config, robot.model)
        self.stored_momentum = StoredMomentum(robot.model, config.wheels.momentum_frame)
        self.alone = config.imu.alone
        limit, beside = round(config.reorder_time * 1e9), robot.described.storage.count
        turning = ~np.array(robot.model.prismatic, dtype=bool)[robot.model.transmission.independent]
        turning = np.append(turning, np.zeros(beside, dtype=bool))
        self.merge = JointMerge(turning, round(config.maximum_gap * 1e9), limit, beside)
        self._reorder = Reorder[BaseStream](limit)
        self._reorder_imu = Reorder[ImuStream](limit)
        self._reckoning = DeadReckoning()
        self._orientation = config.imu.orientation
        self.orientation_told = False
        self._refused: Counter[str] = Counter()

    @property
    def dropped(self) -> Counter[str]:
        """What has not been used, by cause."""
        parts = (self.merge, self._reorder, self._reorder_imu, self.stored_momentum)
        return sum((part.dropped for part in parts), Counter(self._refused))

    def streams(
        self, messages: Mapping[str, Sequence[Any]]
    ) -> tuple[JointStream | None, BaseStream | None, ImuStream | None]:
        """Return what messages, by topic, have measured of all joints, base and gyro, as far as its order is sure."""
        joints, dropped_joints = self.joint_reader.read(messages[JOINTS])
        base, dropped_base = self.odometry_reader.read(messages[ODOMETRY])
        self._refused += dropped_joints + dropped_base
        imu = self._measured_by_imu(messages[IMU]) if IMU in messages else None
        if not self.alone:
            located = self._reorder.push(base)
        elif self._orientation:
            located = measured_orientation(imu)
            self.orientation_told |= located is not None
        else:
            located = self._reckoning.push(imu)
        told = self.stored_momentum.stream()
        if told is not None:
            every = range(len(self._robot.readings))
            joints[tuple(every[-told.position.shape[1] :])] = told
        merged = self.merge.push(joints)
        if merged is not None:
            merged = merged.divided(len(self._robot.model.independent_joints))
        return self._all_joints(merged), located, imu

    def completes(self, end: int, name: str, newest: Mapping[str, int | None]) -> bool:
        """Tell whether nothing that is still to come belongs to a window.

        It is complete with the first joints after it and odometry that is no earlier than these.

        Parameters
        ----------
        end : ns, of the window
        name : topic of the message that has just come
        newest : ns, stamps of each topic that is heard; None before the first
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

    def _measured_by_imu(self, messages: Sequence[Any]) -> ImuStream | None:
        measured, dropped = self.imu_reader.read(messages)
        self._refused += dropped
        return self._reorder_imu.push(measured)

    def _all_joints(self, measured: JointStream | None) -> JointStream | None:
        """Return measurements of all joints from those of the joints that follow no other."""
        moved = self._robot.model.transmission
        if measured is None or moved.direct:
            return measured
        position, velocity = moved.positions(measured.position), moved.rates(measured.velocity)
        return replace(measured, position=position, velocity=velocity)


def readers(config: EstimatorConfig, robot: Robot) -> tuple[JointReader, OdometryReader]:
    """Return readers of a run's messages as they are before the first."""
    links, prefix = robot.model.links, config.frame_prefix
    attached = {prefix + link.name: AttachedFrame(link.rotation, link.position) for link in links if link.body == 0}
    names = frozenset(prefix + link.name for link in links)
    odometry = OdometryReader(attached, robot.marker, names, config.twist_frame, config.noise.declared)
    return JointReader(robot.model.independent_joints, config.wheels.names), odometry


def gyro_of(config: EstimatorConfig, model: RobotModel) -> Gyro | None:
    """Return what integrates the angular velocity of an IMU; None where none is used."""
    if config.imu.noise_density == 0.0:
        return None
    on_base = imu_link(config, model) is None
    return Gyro(round(config.maximum_gap * 1e9), config.imu.range, on_base=on_base)
