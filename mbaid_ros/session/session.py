"""A run of the estimator: messages in, estimates out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.sensors.external_momentum import EXACT_THRUST, LATE_THRUST, SHARED_THRUST
from mbaid_ros.core.sensors.synchroniser import Synchroniser
from mbaid_ros.core.trajectory.posterior import Continuation, Posterior
from mbaid_ros.estimate_messages import Frames
from mbaid_ros.messages.fields import number_of, stamp_of, vector_of, wrench_of
from mbaid_ros.session.continuation import read_continuation
from mbaid_ros.session.intake import IMU, JOINTS, ODOMETRY, BaseSource, MessageQueue
from mbaid_ros.session.model_summary import ModelSummary, summarise
from mbaid_ros.session.robot import Robot
from mbaid_ros.session.segment import MakeEstimator, Segment

IMU_NOT_ASKED_FOR = 'an IMU is published but not used: set imu.noise_density'

# No known data lead to these. A node in a robot's graph has to report them and go on all the same.
UNSOLVABLE = (np.linalg.LinAlgError, FloatingPointError)

_RESTARTS_KEPT = 20


class Session:
    """Everything between the first message and the last estimate.

    Raises ModelError, ParameterError: The robot, the target link or a combination of parameters cannot be used.

    Parameters
    ----------
    urdf : text of the robot description
    make : makes the method of each segment, of the parameters, the robot's kernel and, from a calibration, the nominal
        model (None without one); `make_estimator` where not given
    before : the run that this one continues; where not given, that in the file that the parameters name

    Attributes
    ----------
    config : its windows are as long as this robot needs
    robot : as it is known by now
    restarts : the latest reasons for which it has started again by itself since the last `reset`
    restarted : how often
    base_source : of the messages that locate the base
    intake : readers of the segment's messages
    thrust : commanded thrust since the segment began
    queue : of messages that wait to be processed
    """

    def __init__(
        self,
        config: EstimatorConfig,
        urdf: str,
        make: MakeEstimator | None = None,
        before: Continuation | None = None,
    ) -> None:
        self.robot = Robot(config, urdf)
        self.config = replace(config, window=self.robot.window)
        self._make = make
        self._before = before or read_continuation(config, urdf)
        self.reset()

    def reset(self) -> None:
        """Forget everything and start again."""
        self._gyro = self.config.imu.noise_density > 0.0
        self.queue = MessageQueue((JOINTS, ODOMETRY, IMU) if self._gyro else (JOINTS, ODOMETRY))
        self.received: Counter[str] = Counter()
        robot = self.robot
        # Of poses without a name: that of the marker, a frame that is no link's.
        frame = '' if robot.marker is not None else self.config.frame_prefix + robot.model.base_link
        self.base_source = BaseSource(self.config.pose, frame, needed=not self.config.imu.alone)
        self.restarts: list[str] = []
        self.restarted = 0
        self._earlier: Counter[str] = Counter()  # dropped in earlier segments
        self._replaced_earlier: Counter[str] = Counter()
        self._used_earlier = 0
        self._ready: list[Estimate] = []
        self._begin()

    def _begin(self) -> None:
        """Begin a segment."""
        self._segment = Segment(self.config, self.robot, self._make, self._before)
        self.intake, self.thrust = self._segment.intake, self._segment.thrust
        if self.restarts:
            self._segment.identifier.add_note(self.restarts[-1])

    # Messages

    def add_joint_state(self, message: Any) -> bool:
        """Add a JointState, unread; return whether it is time for `process`."""
        return self._add(JOINTS, message)

    def add_odometry(self, message: Any) -> bool:
        """Add an Odometry, pose or transform, unread; return whether it is time for `process`."""
        due = [self._add(ODOMETRY, each) for each in self.base_source.accepted([message])]
        return any(due)

    def add_imu(self, message: Any) -> bool:
        """Add an Imu, unread; return whether it is time for `process`."""
        if not self._gyro:
            self._earlier[IMU_NOT_ASKED_FOR] += 1
            return False
        return self._add(IMU, message)

    def add_at_once(self, joint_states: Sequence[Any], odometry: Sequence[Any], imu: Sequence[Any] = ()) -> bool:
        """Add messages of these topics, each in order, if all are regular; else return False: add them one by one."""
        if not self.base_source.accepts(odometry):
            return False
        messages = {JOINTS: joint_states, ODOMETRY: self.base_source.accepted(odometry)}
        if self._gyro:
            messages[IMU] = imu
        added = self.queue.add_regular(messages)
        if added and not self._gyro and imu:
            self._earlier[IMU_NOT_ASKED_FOR] += len(imu)
        return added

    def add_thrust(self, message: Any) -> None:
        """Add a WrenchStamped of commanded thrust, which acts from its stamp on."""
        frame, stamp, wrench = wrench_of(message)
        frame = frame.removeprefix(self.config.frame_prefix)
        newest = self.queue.latest
        if self.thrust.affects_samples(frame, stamp, wrench, newest):
            # Earlier messages are processed without it, however the calls are spread.
            self._ready += self._process()
        self.thrust.add_command(frame, stamp, wrench, newest)
        for noted, text in ((self.thrust.late, LATE_THRUST), (self.thrust.exact, EXACT_THRUST)):
            if noted:
                self._segment.identifier.add_note(text)
        if self.thrust.shared:
            self.intake.faults.name('thrust', stamp, SHARED_THRUST.format(self.thrust.shared))

    def add_stored_momentum(self, message: Any) -> None:
        """Add a Vector3Stamped of the momentum that wheels or gyros store."""
        self.intake.stored_momentum.add_sample(*vector_of(message))

    def process(self) -> list[Estimate]:
        """Process the added messages and return the new estimates; how calls are spread makes no difference to them."""
        estimates = self._ready + self._process()
        self._ready = []
        return estimates

    def finish(self) -> list[Estimate]:
        """Return the estimates of windows that wait for later ones, after the last `process` of a recording."""
        return self._process(last=True)

    def run_slice(self) -> bool:
        """Run a slice of the background work; return whether some is left before the next window.

        Call it after the estimates of a window are published. When it runs makes no difference to the numbers.
        """
        try:
            return self._segment.identifier.estimator.tasks.run_slice()
        except UNSOLVABLE as error:
            self._start_again(_unsolved(error))
            return False

    def capture(self) -> str:
        """Take the body for captured at the latest stamp, and return when that was, in a sentence.

        A second call moves a capture that was announced too early: data since then are forgotten.

        Raises DataError: The run did not begin before a capture, has had it, or has no samples yet.
        """
        self._ready += self._process()
        return self._segment.captured(self.queue.latest)

    # State

    def model_summary(self) -> ModelSummary:
        """Return a summary of the robot description, with the joints that messages have named so far."""
        chosen = bool(self.config.target_link)
        heard = [name for name in self.intake.joint_reader.heard if name not in self.config.wheels.names]
        heard += self.config.flexible.joints if heard else ()
        return summarise(self.robot.model, self.robot.target_link, chosen=chosen, heard=heard)

    def posterior(self) -> Posterior | None:
        """Return the posterior of the run; None if its method has none, or none yet."""
        return self._segment.identifier.estimator.posterior()

    @property
    def frames(self) -> Frames:
        """The frames that its estimates are given in."""
        return Frames(self.robot.target_link, self.intake.odometry_reader.frame, self.config.frame_prefix)

    @property
    def closing(self) -> int | None:
        """End (ns) of the window whose last messages are coming, so that its estimate is the next thing to do."""
        return self._segment.closing(self.queue.newest[JOINTS])

    @property
    def synchroniser(self) -> Synchroniser:
        """The gates of the readings, and their synchronisation to common stamps."""
        return self._segment.identifier.synchroniser

    @property
    def used(self) -> int:
        """Number of samples that went into windows."""
        return self._used_earlier + self.collected

    @property
    def collected(self) -> int:
        """Number of samples since the segment began, with those of the open window."""
        return self._segment.identifier.used

    @property
    def dropped(self) -> Counter[str]:
        """Unused messages, by cause."""
        return self._earlier + self._segment.dropped + self.queue.dropped + self.base_source.dropped

    @property
    def replaced(self) -> Counter[str]:
        """Messages with an unusable part, which parameters replace, by cause."""
        return self._replaced_earlier + self.intake.odometry_reader.replaced

    def _add(self, name: str, message: Any) -> bool:
        stamp = stamp_of(message)
        jumped = self.queue.add(name, stamp, message)
        if jumped is None:
            return self._segment.is_due(name, stamp, self.queue)
        if jumped:
            self._ready += self._process(last=True)
            self._start_again(jumped)
        self.queue.confirm_jump(name, message)
        return True

    def _start_again(self, reason: str) -> None:
        """Begin a new segment."""
        self._earlier += self._segment.dropped
        self._replaced_earlier = self.replaced
        self._used_earlier += self.collected
        self.restarts = [*self.restarts[1 - _RESTARTS_KEPT :], f'{reason}; started again']
        self.restarted += 1
        self._begin()

    def _process(self, *, last: bool = False) -> list[Estimate]:
        messages = self.queue.take_all()
        self.received.update({name: number_of(each) for name, each in messages.items()})
        try:
            return self._segment.process(messages, last=last)
        except UNSOLVABLE as error:
            self._start_again(_unsolved(error))
            return []


def _unsolved(error: Exception) -> str:
    return f'the equations could not be solved ({error})'
