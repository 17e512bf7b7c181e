"""From the messages of one run to streams of measurements: read, merged, in the order of their stamps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from mbaid_ros.config.estimator import ConvergenceConfig, EstimatorConfig
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.identifier import Estimator, Identifier
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.reporting import Reporting
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.samples import BaseStream, ImuStream, JointStream
from mbaid_ros.core.sensors.base import AttachedFrame, measured_orientation
from mbaid_ros.core.sensors.external_momentum import StoredMomentum, Thrust
from mbaid_ros.core.sensors.imu import DeadReckoning, Gyro
from mbaid_ros.core.sensors.joints import JointMerge
from mbaid_ros.core.sensors.levels import FoundNoise
from mbaid_ros.core.sensors.streams import Reorder
from mbaid_ros.messages import ImuReader, JointReader, OdometryReader
from mbaid_ros.session.environment import falling_frame, suspecting, uncertain_thrusters
from mbaid_ros.session.frames import imu_link, imu_reader
from mbaid_ros.session.methods import capture_of, make_estimator, make_reporting, set_thresholds
from mbaid_ros.session.posterior import doubting_exactness
from mbaid_ros.session.queue import PART, MessageQueue, Schedule
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
        self.merge = JointMerge(
            turning, round(config.maximum_gap * 1e9), limit, beside, config.noise.declared.joint_position
        )
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


MakeEstimator = Callable[..., Estimator]
# Nothing that is known of leads to these. A node in a robot's graph has to go on even so, and to say it.
UNSOLVABLE = (np.linalg.LinAlgError, FloatingPointError)


class Segment:
    """What a session works with until it starts again: what reads its messages, and its method.

    Parameters
    ----------
    config : EstimatorConfig
    robot : whose knowledge of itself begins anew, too
    make : what makes the method; None for the one that the parameters name

    Attributes
    ----------
    intake : what the messages are read with
    thrust : what commanded thrust has brought
    identifier : from what is measured to estimates

    Raises
    ------
    ModelError, ParameterError
        The robot, the target link or a combination of parameters cannot be used.
    """

    def __init__(self, config: EstimatorConfig, robot: Robot, make: MakeEstimator | None) -> None:
        self._config = config
        self._robot = robot
        self._judged: list[Reporting] = []
        self._schedule = Schedule(config.window)
        self.intake = Intake(config, robot)
        model, described = robot.model, robot.described
        method = partial(make or partial(make_estimator, judge=self._judge), config)
        self._capture = capture_of(config, described, robot.known, method)
        robot.begin(self._capture)
        self.thrust = Thrust(model, round(config.thrust.hold * 1e9), uncertain_thrusters(config.thrust, model))
        noise = config.noise
        self.identifier = Identifier(
            self._capture or method(described, robot.known),
            config.window,
            config.maximum_gap,
            config.twist_frame,
            self.thrust,
            FoundNoise(noise.declared, described.model.joints, noise.undeclared, estimate=noise.estimate),
            falling=falling_frame(config.orbit, model),
            gyro=gyro_of(config, model),
        )

    @property
    def dropped(self) -> Counter[str]:
        """What has not been used, by cause."""
        return self.intake.dropped + self.identifier.dropped + self.thrust.dropped

    def work(self, messages: Mapping[str, Sequence[Any]]) -> list[Estimate]:
        """Work through messages, by topic, and return the estimates they lead to.

        Raises
        ------
        LinAlgError, FloatingPointError
            The equations could not be solved.
        """
        streams = self.intake.streams(messages)
        self.thrust.odometry_frame = self.intake.odometry_reader.frame
        estimates = self.identifier.push(*streams)
        joints_there_are = self._robot.model.joint_names  # also those that follow others
        others = [name for name in self.intake.joint_reader.others if name not in joints_there_are]
        return doubting_exactness(suspecting(estimates, others), self._config)

    def is_time(self, name: str, stamp: int, inbox: MessageQueue) -> bool:
        """Tell whether to work after a message on a topic: a part of a window has gathered, or one may be complete.

        Parameters
        ----------
        name : of the topic
        stamp : ns, of the message
        inbox : where it waits
        """
        waiting, intake = inbox.waiting, self.intake
        if sum(waiting.values()) >= PART:
            return True
        end = self.identifier.end_of_window
        both = waiting[JOINTS] > 0 and waiting[IMU if intake.alone else ODOMETRY] > 0
        if end is None or (both and self._schedule.is_due(stamp, end)):
            return both
        return stamp >= end and intake.completes(end, name, inbox.newest)

    def closing(self, newest: int | None) -> int | None:
        """Return the end (ns) of the window whose last messages are coming, None where there is none.

        Parameters
        ----------
        newest : ns, stamp of the joints; None before the first
        """
        end = self.identifier.end_of_window
        return end if end is not None and newest is not None and self._schedule.is_closing(newest, end) else None

    def judge_by(self, convergence: ConvergenceConfig) -> None:
        """Judge estimates by other thresholds, from the next window on."""
        self._config = replace(self._config, convergence=convergence)
        for reporting in self._judged:
            set_thresholds(reporting, convergence)

    def captured(self, newest: int | None) -> str:
        """Take it that the body has just been captured, and return when that was, in a sentence.

        Parameters
        ----------
        newest : ns, stamp of the latest message; None before the first

        Raises
        ------
        DataError
            It did not begin before a capture, has had it, or has no samples yet.
        """
        capture = self._capture
        if capture is None:
            raise DataError(
                'this run began after the capture; accepted: a capture in one that begins with capture.phase: '
                'pre_capture'
            )
        if newest is None or not self.identifier.used:
            raise DataError('there are no samples yet; accepted: a capture after the first')
        time, before = (newest - self.identifier.origin) * 1e-9, capture.time
        if before is None:
            capture.time = time
            return f'captured {time:.3f} s after the first sample'
        if not time > before:
            raise DataError(f'the capture was told before, at {before:.6g} s; accepted: a later one, or reset')
        capture.move(time)
        return (
            f'captured {time:.3f} s after the first sample, not {before:.3f} s: what was learnt since then is forgotten'
        )

    def _judge(self, _config: EstimatorConfig, kernel: MomentumKernel) -> Reporting:
        # By what counts now: a capture makes its method from the parameters of the segment's begin.
        self._judged.append(make_reporting(self._config, kernel))
        return self._judged[-1]
