"""The run itself."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from mbaid_ros.config.estimator import ConvergenceConfig, EstimatorConfig
from mbaid_ros.config.plan import PlanConfig
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.sensors.external_momentum import EXACT_THRUST, LATE_THRUST
from mbaid_ros.core.trajectory.posterior import Posterior
from mbaid_ros.messages import number_of, stamp_of, vector_of, wrench_of
from mbaid_ros.session.base_source import BaseSource
from mbaid_ros.session.model_summary import Survey, survey
from mbaid_ros.session.queue import MessageQueue
from mbaid_ros.session.robot import Robot
from mbaid_ros.session.segment import IMU, JOINTS, ODOMETRY, UNSOLVABLE, MakeEstimator, Segment

IMU_NOT_ASKED_FOR = 'an IMU is heard, and nobody asks for it: set imu.noise_density'

_RESTARTS_KEPT = 20


class Session:
    """Everything between the first message and the last estimate.

    Parameters
    ----------
    config : EstimatorConfig
    urdf : str
        Text of the robot description.
    make : callable, optional
        What makes the method of each segment, of the parameters, the robot's kernel and, from a calibration, how well
        the robot is known (None without one); the method that the parameters name where not given.

    Attributes
    ----------
    robot : as it is known by now
    restarts : why it has started again by itself since the last `reset`; the latest of them
    restarted : how often
    base_source : what of the messages that may locate the base does
    intake : what the segment reads its messages with
    thrust : what commanded thrust has brought since the segment began
    inbox : what has come and waits to be worked through

    Raises
    ------
    ModelError, ParameterError
        The robot, the target link or a combination of parameters cannot be used.
    """

    def __init__(self, config: EstimatorConfig, urdf: str, make: MakeEstimator | None = None) -> None:
        self.config = config
        self._make = make
        self.robot = Robot(config, urdf)
        self.reset()

    def reset(self) -> None:
        """Forget everything and start again."""
        self._gyro = self.config.imu.noise_density > 0.0
        self.inbox = MessageQueue((JOINTS, ODOMETRY, IMU) if self._gyro else (JOINTS, ODOMETRY), self.config)
        self.received: Counter[str] = Counter()
        self.base_source = BaseSource(self.config, self.robot)
        self.restarts: list[str] = []
        self.restarted = 0
        self._earlier: Counter[str] = Counter()  # dropped in runs that are over
        self._replaced_earlier: Counter[str] = Counter()
        self._used = 0
        self._ready: list[Estimate] = []
        self._begin()

    def add_joint_state(self, message: Any) -> bool:
        """Take a JointState without looking into it; return whether it is time for `process`."""
        return self._add(JOINTS, message)

    def add_odometry(self, message: Any) -> bool:
        """Take an Odometry without looking into it, or what else locates the base: poses, transforms.

        Return whether it is time for `process`.
        """
        due = [self._add(ODOMETRY, each) for each in self.base_source.located([message])]
        return any(due)

    def add_imu(self, message: Any) -> bool:
        """Take an Imu without looking into it; return whether it is time for `process`."""
        if not self._gyro:
            self._earlier[IMU_NOT_ASKED_FOR] += 1
            return False
        return self._add(IMU, message)

    def add_at_once(self, joint_states: Sequence[Any], odometry: Sequence[Any], imu: Sequence[Any] = ()) -> bool:
        """Take messages of these topics, each in order, where nothing is to be decided about any of them.

        Return whether they have been taken; where not, they have to be added one by one as they came.
        """
        if not self.base_source.takes(odometry):
            return False
        messages = {JOINTS: joint_states, ODOMETRY: self.base_source.located(odometry)}
        if self._gyro:
            messages[IMU] = imu
        taken = self.inbox.take_at_once(messages)
        if taken and not self._gyro and imu:
            self._earlier[IMU_NOT_ASKED_FOR] += len(imu)
        return taken

    def add_thrust(self, message: Any) -> None:
        """Take a WrenchStamped of what is commanded, from its stamp on."""
        frame, stamp, wrench = wrench_of(message)
        frame = frame.removeprefix(self.config.frame_prefix)
        newest = self.inbox.latest
        if self.thrust.changes(frame, stamp, wrench, newest):
            # What came before it is worked through without it, however the calls are spread.
            self._ready += self._work()
        self.thrust.command(frame, stamp, wrench, newest)
        for told, text in ((self.thrust.late, LATE_THRUST), (self.thrust.exact, EXACT_THRUST)):
            if told:
                self._segment.identifier.note(text)

    def add_stored_momentum(self, message: Any) -> None:
        """Take a Vector3Stamped of what wheels or gyros store."""
        if not self.problem:
            self.intake.stored_momentum.take(*vector_of(message))

    def process(self) -> list[Estimate]:
        """Work through what has been added and return the new estimates.

        How the calls are spread makes no difference to the numbers.

        Raises
        ------
        DataError
            The stamps have jumped back, and the parameter time_jump says that this is an error.
        """
        estimates = self._ready + self._work()
        self._ready = []
        if self.problem and not estimates:
            raise DataError(self.problem)
        return estimates

    def survey(self) -> Survey:
        """Return what the run takes the robot for, with the joints that messages have named so far."""
        chosen = bool(self.config.target_link)
        heard = [name for name in self.intake.joint_reader.heard if name not in self.config.wheels.names]
        return survey(self.robot.model, self.robot.target_link, chosen=chosen, heard=heard)

    def work_off(self) -> bool:
        """Let the method do a part of what it has put off, when the estimates of a window have been told.

        Return whether some is left to do before the next window. When it is done makes no difference to the numbers.
        """
        try:
            return self._segment.identifier.work_off()
        except UNSOLVABLE as error:
            self._unsolved(error)
            return False

    def knowledge(self) -> Posterior | None:
        """Return what the run has come to know; None where its method does not tell, or not yet."""
        return self._segment.identifier.knowledge()

    @property
    def closing(self) -> int | None:
        """End of the window whose last messages are coming, so that its estimate is the next thing to do; ns."""
        return self._segment.closing(self.inbox.newest[JOINTS])

    @property
    def problem(self) -> str:
        """Why it takes no more messages until `reset`; empty while it does."""
        return self.inbox.problem

    @property
    def used(self) -> int:
        """Number of samples that went into the windows."""
        return self._used + self.taken

    @property
    def taken(self) -> int:
        """Number of samples since the segment began, with those of the window that is open."""
        return self._segment.identifier.used

    @property
    def dropped(self) -> Counter[str]:
        """Messages that were not used, by cause."""
        return self._earlier + self._segment.dropped + self.inbox.dropped + self.base_source.dropped

    @property
    def replaced(self) -> Counter[str]:
        """Messages that were used, but for something in them that the parameters stand in for, by cause."""
        return self._replaced_earlier + self.intake.odometry_reader.replaced

    def judge_by(self, convergence: ConvergenceConfig, plan: PlanConfig | None = None) -> None:
        """Judge estimates by other thresholds, from the next window on, and plan motions by other parameters."""
        self.config = replace(self.config, convergence=convergence, plan=plan or self.config.plan)
        self._segment.judge_by(convergence)

    def capture(self) -> str:
        """Take it that the body has just been captured, and return when that was, in a sentence.

        A second call moves a capture that was told too early: what has been learnt since then is forgotten.

        Raises
        ------
        DataError
            The run did not begin before a capture, has had it, or has no samples yet.
        """
        self._ready += self._work()
        return self._segment.captured(self.inbox.latest)

    def _begin(self) -> None:
        """Begin a segment."""
        self._segment = Segment(self.config, self.robot, self._make)
        self.intake, self.thrust = self._segment.intake, self._segment.thrust
        if self.restarts:
            self._segment.identifier.note(self.restarts[-1])

    def _add(self, name: str, message: Any) -> bool:
        stamp = stamp_of(message)
        jumped = self.inbox.take(name, stamp, message)
        if jumped is None:
            return bool(self.problem) or self._segment.is_time(name, stamp, self.inbox)
        if jumped:
            self._ready += self._work()
            self._start_again(jumped)
        self.inbox.settle(name, message)
        return True

    def _start_again(self, reason: str) -> None:
        """Give up what has been learnt, and go on with what comes."""
        self._earlier += self._segment.dropped
        self._replaced_earlier = self.replaced
        self._used += self.taken
        self.restarts = [*self.restarts[1 - _RESTARTS_KEPT :], f'{reason}; started again']
        self.restarted += 1
        self._begin()

    def _work(self) -> list[Estimate]:
        messages = self.inbox.take_all()
        self.received.update({name: number_of(each) for name, each in messages.items()})
        try:
            return self._segment.work(messages)
        except UNSOLVABLE as error:
            self._unsolved(error)
            return []

    def _unsolved(self, error: Exception) -> None:
        self._start_again(f'the equations could not be solved ({error})')
