"""A segment of a session, from one start to the next."""

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
from mbaid_ros.core.intake.found_noise import FoundNoise
from mbaid_ros.core.intake.thrust import Thrust
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.reporting import Reporting
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.session.inbox import Inbox
from mbaid_ros.session.intake import IMU, JOINTS, ODOMETRY, Intake, gyro_of
from mbaid_ros.session.known import doubting_exactness
from mbaid_ros.session.methods import capture_of, make_estimator, make_reporting, set_thresholds
from mbaid_ros.session.robot import Robot
from mbaid_ros.session.schedule import PART, Schedule
from mbaid_ros.session.surroundings import falling_frame, suspecting, uncertain_thrusters

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

    def is_time(self, name: str, stamp: int, inbox: Inbox) -> bool:
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
