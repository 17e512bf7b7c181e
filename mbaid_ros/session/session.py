"""One run of the estimator: messages queued in the order of arrival, read to streams, handed to the method."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.clocks import BAD_NANOSEC, LARGEST_BACKLOG, OTHER_CLOCK, Gate, Reorder
from mbaid_ros.core.contracts import Check, Instrument
from mbaid_ros.core.filter.posterior import Continuation, Posterior
from mbaid_ros.core.forces import EXACT_THRUST, LATE_THRUST, SHARED_THRUST, Thrust, uncertain_thrusters, wrench_of
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.gyro import IMU, DeadReckoning, GyroSensor, gyro_check
from mbaid_ros.core.joints.faults import JointRates
from mbaid_ros.core.joints.stream import JointMerge, JointReader
from mbaid_ros.core.noise import NoiseEstimator
from mbaid_ros.core.odometry.faults import HeldBase, SensorChecks, twist_check
from mbaid_ros.core.odometry.stream import BaseSource, measured_orientation, odometry_reader
from mbaid_ros.core.orbit import falling_frame
from mbaid_ros.core.outliers import Copies
from mbaid_ros.core.pipeline import Estimator, Identifier, PlainFaults, Synchroniser, WindowChecks
from mbaid_ros.core.poses import REFERENCE_GAP, PoseSensor, pose_check, reference
from mbaid_ros.core.repair import Conversion, Repair, joined
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.samples import BaseStream, Input, JointStream, Packets, number_of, stamp_of, stamps_of
from mbaid_ros.core.target import TargetTrack
from mbaid_ros.core.wheels import StoredMomentum, vector_of
from mbaid_ros.errors import DataError, ModelError, ParameterError, listing
from mbaid_ros.estimate_messages import Frames
from mbaid_ros.parameters import topic_of
from mbaid_ros.session.catalogue import EXACT_ROBOT, inputs, instruments
from mbaid_ros.session.continuation import read_continuation
from mbaid_ros.session.methods import make_capture, make_estimator
from mbaid_ros.session.model_summary import ModelSummary, summarise, unmoved_joints
from mbaid_ros.session.repairing import (
    LEFT_OUT,
    LONGEST,
    RepairPolicy,
    conversions,
    described,
    refuse_repair,
    repaired,
)
from mbaid_ros.session.robot import Robot, contradicted_mass

JOINTS, ODOMETRY = 'joint_states', 'odom'
SPOKEN = {JOINTS: 'the joint states', ODOMETRY: 'the poses of the base', IMU: 'the IMU'}  # whatever their topics are
_SLOW = 5_000_000_000  # ns, the same of named poses, which may come every two seconds
TIME_JUMP = 1.0  # s between consecutive stamps of a topic: no sensor pauses and resumes in its own past
REORDER_TIME = 0.05  # s, that messages wait for late ones at most: longer waits would delay every estimate
PART = 300  # messages processed at once while a window is open: each time costs as much as reading a hundred
_LEFT = (0.75, 0.5, 0.3, 0.05)  # parts of a window before its end, at which the waiting messages are processed
_CLOSING = 0.1  # of a window, before its end
MakeEstimator = Callable[..., Estimator]
Given = Callable[['Segment'], list[Estimate]]  # something that a run was given
IMU_NOT_ASKED_FOR = 'an IMU is published but not used: set imu.noise_density'
# No known data lead to these. A node in a robot's graph has to report them and go on all the same.
UNSOLVABLE = (np.linalg.LinAlgError, FloatingPointError)
_RESTARTS_KEPT = 20
_SILENCE = 2.0 * LONGEST  # s without an estimate, after which a run is not started again from its first messages
_NO_CAUSES = 'method {} names no causes of a contradiction: method trajectory does'
_NANOSEC = 'nanosec of the stamps of {} are 1e9 or more: they have to be below; the other stamps are wrong, too'


class MessageQueue:
    """Collects the messages of all topics, each in the order of arrival; those of slow ones may be far apart."""

    def __init__(self, topics: Collection[str], slow: Collection[str] = ()) -> None:
        self._threshold = round(TIME_JUMP * 1e9)
        self._gates = {name: Gate(self._threshold if name not in slow else _SLOW) for name in topics}
        self._epoch = 0

    @property
    def dropped(self) -> Counter[str]:
        """Messages that were not taken, by cause."""
        return sum((gate.dropped for gate in self._gates.values()), Counter())

    def dropped_by(self, cause: str) -> dict[str, int]:
        """Return how many messages of each topic were not taken by a cause."""
        return {name: gate.dropped[cause] for name, gate in self._gates.items()}

    @property
    def newest(self) -> dict[str, int | None]:
        """The latest stamp of each topic, ns; None before its first."""
        return {name: gate.newest for name, gate in self._gates.items()}

    def span(self, name: str) -> float:
        """Return the time that the stamps of a topic cover in all its runs, s; 0 without any."""
        return 1e-9 * self._gates[name].span

    def dropped_of(self, name: str) -> Counter[str]:
        """Return the messages of a topic that were not taken, by cause."""
        return self._gates[name].dropped

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
            gate.dropped[OTHER_CLOCK] += 1
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
        return not jumped or stamp <= max(jumped) + self._threshold

    def _jumped(self, name: str, amount: int) -> str:
        """Return why to start again; the second topic to jump back only follows the first."""
        gate = self._gates[name]
        if gate.epoch <= self._epoch:
            return ''
        self._epoch = gate.epoch
        back = f'the stamps of {SPOKEN.get(name, topic_of(name))} jumped back by {amount * 1e-9:.6g} s'
        return f'{back} (a bag or simulation started again, a clock set)'


class Intake:
    """The readers of a run's messages, and the measurements that wait until their order is sure.

    Readings are converted in order by `conversions`.

    Raises ParameterError: A gyro cannot be on the frame that the parameters name.

    Attributes
    ----------
    joint_reader, odometry_reader, stored_momentum : of messages
    instruments : named sensors, by the names of their parameters
    base_topic : of the messages that locate the base, in the queue
    merge : of joints from several publishers
    faults : plain in the joint readings or the robot description
    alone, orientation_measured : whether an IMU alone measures the base's motion, and has measured an orientation
    """

    def __init__(
        self,
        config: EstimatorConfig,
        robot: Robot,
        named: Mapping[str, Instrument],
        conversions: Sequence[Conversion] = (),
    ) -> None:
        self._robot, self.instruments, self._conversions = robot, named, conversions
        self.joint_reader = JointReader(robot.model.independent_joints, config.wheels.names, config.flexible.joints)
        prefix, declared = config.frame_prefix, config.noise.declared
        self.odometry_reader = odometry_reader(robot.model, prefix, robot.marker, config.twist_frame, declared)
        self.stored_momentum = StoredMomentum(robot.model, config.wheels.momentum_frame)
        self._has_stored_momentum = bool(config.wheels.momentum_frame)
        self.alone = config.imu.alone
        self._reference = reference(config.poses, robot.model, prefix)
        self.base_topic = IMU if self.alone else ODOMETRY if self._reference is None else self._reference.name
        limit, beside = round(REORDER_TIME * 1e9), robot.kernel.storage.count
        turning = ~np.array(robot.model.prismatic, dtype=bool)[robot.model.transmission.independent]
        turning = np.append(turning, np.zeros(beside, dtype=bool))
        self.merge = JointMerge(
            turning, round(config.maximum_gap * 1e9), limit, beside, config.noise.declared.joint_position
        )
        self.faults = PlainFaults(robot.model, config.noise.declared.joint_position)
        # Of joints by the kind of message.
        self._joint_copies: dict[tuple[int, ...], Copies[JointStream]] = {}
        self._pose_copies: Copies[BaseStream] = Copies(_poses, round(TIME_JUMP * 1e9))
        self._reorder = Reorder[BaseStream](limit)
        self._reorder_named = {name: Reorder[Any](limit) for name in named}
        self._named_copies = {name: Copies[Any](each.numbers, round(TIME_JUMP * 1e9)) for name, each in named.items()}
        self._reckoning = DeadReckoning()
        self._with_orientation = config.imu.orientation
        self.orientation_measured = False
        self._refused: Counter[str] = Counter()  # of joints
        self._refused_base: Counter[str] = Counter()
        self._unread: dict[str, Counter[str]] = {name: Counter() for name in named}

    @property
    def dropped(self) -> Counter[str]:
        """Unused messages, by cause, but for those that named sensors' followers drop."""
        return sum(
            (
                *(self.merge.dropped, self.stored_momentum.dropped, self.dropped_odometry),
                *(self._dropped_before(name) for name in self.instruments),
                *(copies.dropped for copies in self._joint_copies.values()),
            ),
            Counter(self._refused),
        )

    @property
    def dropped_odometry(self) -> Counter[str]:
        """Unused messages of the odometry, by cause."""
        return self._refused_base + self._pose_copies.dropped + self._reorder.dropped

    def dropped_of(self, name: str) -> Counter[str]:
        """Return the unused messages of a named sensor, by cause."""
        return +(self._dropped_before(name) + self.instruments[name].follower.dropped)

    def _dropped_before(self, name: str) -> Counter[str]:
        return self._unread[name] + self._reorder_named[name].dropped + self._named_copies[name].dropped

    def streams(
        self, messages: Mapping[str, Sequence[Any]]
    ) -> tuple[JointStream | None, BaseStream | None, dict[str, Any]]:
        """Return the measurements of joints, base and named sensors in messages, by topic, once their order is sure."""
        joints, dropped_joints = self.joint_reader.read(messages[JOINTS])
        base, dropped_base = self.odometry_reader.read(messages[ODOMETRY])
        self._refused += dropped_joints
        self._refused_base += dropped_base
        joints, base = self._without_copies(joints), self._pose_copies.push(base)
        for conversion in self._conversions:
            joints = conversion.joints(joints, self._robot.inputs, len(self._robot.model.independent_joints))
            base = conversion.base(base)
        self.faults.add(joints, base)
        found = {}
        for name, each in self.instruments.items():
            measured, dropped = each.reader.read(messages[name])
            self._unread[name] += dropped
            found[name] = self._reorder_named[name].push(self._named_copies[name].push(measured))
        if self._reference is not None:
            located = self._reference.push(found)
        elif not self.alone:
            located = self._reorder.push(base)
        elif self._with_orientation:
            located = measured_orientation(found[IMU])
            self.orientation_measured |= located is not None
        else:
            located = self._reckoning.push(found[IMU])
        stored = self.stored_momentum.stream() if self._has_stored_momentum else None
        if stored is not None:
            every = range(len(self._robot.inputs))
            joints[tuple(every[-stored.position.shape[1] :])] = stored
        merged = self.merge.push(joints)
        if merged is not None:
            merged = merged.without_stored_momentum(len(self._robot.model.independent_joints))
        return self._all_joints(merged), located, found

    def completes(self, end: int, name: str, newest: Mapping[str, int | None]) -> bool:
        """Return whether no message still to come belongs to a window.

        The first joints after its `end` (ns) complete it, with odometry and gyros no earlier than these. `name` is the
        topic of the latest message, `newest` the latest stamp (ns) of each topic; None before the first.
        """
        joints, base = newest[JOINTS], newest[self.base_topic]
        if joints is None or base is None:
            return False
        joints -= self.merge.hold
        wanted = joints if name == JOINTS else end
        for gyro, each in self.instruments.items():
            latest = newest[gyro]
            if each.follower.field == 'further' and (
                latest is None or latest - self._reorder_named[gyro].hold < wanted
            ):
                return False
        hold = self._reorder.hold if self.base_topic == ODOMETRY else 0
        return joints >= end and base - hold >= wanted

    def _without_copies(self, joints: Mapping[tuple[int, ...], JointStream]) -> dict[tuple[int, ...], JointStream]:
        """Return joint readings, by the kind of message, without those that have come before."""
        new = {}
        for kind, stream in joints.items():
            copies = self._joint_copies.setdefault(kind, Copies(_joints, round(TIME_JUMP * 1e9)))
            left = copies.push(stream)
            if left is not None:
                new[kind] = left
        return new

    def _all_joints(self, measured: JointStream | None) -> JointStream | None:
        """Return the measurements of all joints, those that mimic others too."""
        moved = self._robot.model.transmission
        if measured is None or moved.direct:
            return measured
        position, velocity = moved.positions(measured.position), moved.rates(measured.velocity)
        return replace(measured, position=position, velocity=velocity)


def _joints(stream: JointStream) -> Array:
    return np.concatenate((stream.position, stream.velocity), axis=1)


def _poses(stream: BaseStream) -> Array:
    twist = stream.linear_velocity, stream.angular_velocity
    return np.concatenate((stream.position, stream.rotation.reshape(-1, 9), *twist), axis=1)


class Segment:
    """The readers of a run's messages, and its method; parameters as for Session.

    Parameters
    ----------
    conversions : of the readings, in order
    """

    def __init__(
        self,
        config: EstimatorConfig,
        robot: Robot,
        make: MakeEstimator | None,
        before: Continuation | None,
        *,
        conversions: Sequence[Conversion] = (),
    ) -> None:
        self._config = config
        self._robot = robot
        self._left = [round(1e9 * part * config.window) for part in _LEFT]
        self._processed = (-1, 0)  # end of the window last processed in, and how many of the times of `_LEFT` passed
        model, described = robot.model, robot.kernel
        falling = falling_frame(config.orbit, model, located=config.located)
        named = instruments(config, model, None if falling is None else falling.to_falling_frame)
        self.intake = Intake(config, robot, named, conversions)
        make = make or partial(make_estimator, before=before)
        method = partial(make, config, described, robot.known)
        self.track = TargetTrack(config.target, config.frame_prefix, falling)
        self._capture = make_capture(config, described, method, self.track)
        robot.begin(self._capture)
        self.thrust = Thrust(model, uncertain_thrusters(config.thrust, model))
        noise = config.noise
        gyros = [each.sensor for each in named.values() if isinstance(each.sensor, GyroSensor)]
        checks: list[Check] = [twist_check(), HeldBase(described)]
        if config.method == 'trajectory':
            poses = [each.sensor for each in named.values() if isinstance(each.sensor, PoseSensor)]
            of_sensors = [gyro_check(each, described.kinematics) for each in gyros]
            of_sensors += [pose_check(each, described.kinematics) for each in poses]
            checks.append(SensorChecks(of_sensors))
        filled = config.poses.alone and any(each.link is None for each in gyros)
        self.identifier = Identifier(
            self._capture or method(),
            config.window,
            max(config.maximum_gap, REFERENCE_GAP) if filled else config.maximum_gap,
            WindowChecks(checks, JointRates(model.joint_names)),
            (self.thrust,) if falling is None else (self.thrust, falling),
            NoiseEstimator(
                noise.declared,
                described.model.joints,
                noise.undeclared,
                estimate=noise.estimate,
                trusted=noise.trust_declared,
                unread=(*described.springs.joints, *model.transmission.followers),
                of_base=not config.poses.alone,
            ),
            view=None if falling is None else falling.to_falling_frame,
            followers={name: each.follower for name, each in named.items()},
        )

    @property
    def dropped(self) -> Counter[str]:
        """Unused messages, by cause."""
        return self.intake.dropped + self.identifier.dropped + self.thrust.dropped + self.track.dropped

    def dropped_of(self, name: str) -> Counter[str]:
        """Return the unused messages of odometry or a named sensor, by cause."""
        if name != ODOMETRY:
            return self.intake.dropped_of(name)
        located = self.intake.base_topic == ODOMETRY
        return self.intake.dropped_odometry + (self.identifier.synchroniser.dropped_base if located else Counter())

    def process(
        self, messages: Mapping[str, Sequence[Any]], *, last: bool = False, unstamped: Sequence[str] = ()
    ) -> list[Estimate]:
        """Return the estimates of messages, by topic; raise one of UNSOLVABLE if the equations have no solution.

        `unstamped` are the topics, in words, some of whose messages had no valid stamp until now.
        """
        if unstamped:
            self.intake.faults.name('nanosec', 0, _NANOSEC.format(listing(unstamped)))
        streams = self.intake.streams(messages)
        self.thrust.odometry_frame = self.track.odometry_frame = self.intake.odometry_reader.frame
        found = self.identifier.push(*streams, last=last)
        estimates = map(self.intake.faults.applied, found)
        return [self._with_doubts(each) if each.contradicted else each for each in estimates]

    def _with_doubts(self, estimate: Estimate) -> Estimate:
        """Return a contradicted estimate with causes that no likelihood can score: wheels, and a robot held exact."""
        text = unmoved_joints(self.intake.joint_reader.others, self._robot.model, ())
        causes, warnings = estimate.causes, estimate.warnings
        if text:  # second, with the gain of the first
            causes = (*causes[:1], (text, causes[0][1] if causes else 0.0), *causes[1:])
        if self._config.method != 'trajectory' and not causes:
            warnings = (*warnings, _NO_CAUSES.format(self._config.method))
        if self._robot.exact and all(cause != EXACT_ROBOT for cause, _ in causes):
            warnings = (*warnings, EXACT_ROBOT)
        return replace(estimate, causes=causes, warnings=warnings)

    def is_due(self, name: str, stamp: int, queue: MessageQueue) -> bool:
        """Return whether to process after a message (stamp in ns): a part of a window has gathered, or all of it."""
        waiting, intake = queue.waiting, self.intake
        if sum(waiting.values()) >= PART:
            return True
        end = self.identifier.end_of_window
        both = waiting[JOINTS] > 0 and waiting[intake.base_topic] > 0
        if end is None or (both and self._part_gathered(stamp, end)):
            return both
        return stamp >= end and intake.completes(end, name, queue.newest)

    def _part_gathered(self, stamp: int, end: int) -> bool:
        """Return, once for each time of `_LEFT`, whether it has passed, so that little is left to do at the end."""
        passed = sum(stamp >= end - left for left in self._left) if stamp < end else 1
        if not passed or (end, passed) <= self._processed:
            return False
        self._processed = (end, passed)
        return True

    def closing(self, newest: int | None) -> int | None:
        """Return the end (ns) of the window whose last messages are coming; `newest` is the joints' stamp (ns)."""
        end = self.identifier.end_of_window
        if end is None or newest is None or newest < end - round(_CLOSING * 1e9 * self._config.window):
            return None
        return end

    def captured(self, newest: int | None) -> str:
        """Set the capture at a stamp (ns, None before the first), as `Session.capture` does."""
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
            raise DataError(f'the capture was announced before, at {before:.6g} s; accepted: a later one, or reset')
        capture.restart_at(time)
        return f'captured {time:.3f} s after the first sample, not {before:.3f} s: the estimate since then is dropped'


class Recording:
    """What a run was given since it began, in order; what of it the segment still has to take is the backlog."""

    def __init__(self, *, kept: bool) -> None:
        self._kept: list[Given] | None = [] if kept else None
        self._backlog: deque[Given] = deque()
        self.first: int | None = None  # ns, latest stamp when the first messages of it came

    @property
    def pending(self) -> bool:
        """Whether there is a backlog."""
        return bool(self._backlog)

    def add(self, given: Given, latest: int | None = None, *, kept: bool = True) -> None:
        """Add what comes next; messages come with the latest stamp (ns); `kept` if the run needs it to begin again."""
        self._backlog.append(given)
        self.first = latest if self.first is None else self.first
        if self._kept is not None and kept:
            self._kept.append(given)
            if self.first is None:  # commands without measurements
                del self._kept[:-LARGEST_BACKLOG]

    def next(self) -> Given:
        """Return what the segment takes next."""
        return self._backlog.popleft()

    def begin_again(self) -> None:
        """Let the segment take everything again."""
        self._backlog = deque(self._kept or ())

    def forget(self, *, kept: bool) -> None:
        """Forget what the segment has taken; keep what comes, or nothing any more."""
        self._kept, self.first = list(self._backlog) if kept else None, None


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
    repairs : causes of a contradiction that the run takes into account, in the order in which they were found
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
        refuse_repair(config)
        self.robot = Robot(config, urdf)
        self.config = replace(config, window=self.robot.window)
        self._declared = self.config, self.robot
        self._earlier_robot: tuple[tuple[Repair, ...], Robot] = (), self.robot  # of repairs that the run has no more
        self._make = make
        self._before = before or read_continuation(config, urdf)
        self.reset()

    def reset(self) -> None:
        """Forget everything and start again."""
        self.config, self.robot = self._declared
        self._named = inputs(self.config)
        slow = [name for name, each in self._named.items() if each.slow]
        self.queue = MessageQueue((JOINTS, ODOMETRY, *self._named), slow)
        self.received: Counter[str] = Counter()
        robot = self.robot
        # Of poses without a name: that of the marker, a frame that is no link's.
        frame = '' if robot.marker is not None else self.config.frame_prefix + robot.model.base_link
        self.base_source = BaseSource(frame, self.config.pose.tf_child_frame, needed=self.config.by_odometry)
        self.restarts: list[str] = []
        self._blamed = ''  # the first cause of the latest contradiction
        self._carried: tuple[str, ...] = ()  # what had contradicted the run that came to its end before this one
        self.restarted = 0
        self._earlier: Counter[str] = Counter()  # dropped in earlier segments
        self._earlier_of: dict[str, Counter[str]] = {name: Counter() for name in (ODOMETRY, *self._named)}
        self._received_earlier: Counter[str] = Counter()
        self._replaced_earlier: Counter[str] = Counter()
        self._used_earlier = 0
        self._ready: list[Estimate] = []
        self._latest = -1  # ns, stamp of the latest estimate
        # A run that continues another one has the unknowns of that one.
        self._repairs_wanted = self.config.repair and self._before is None
        self._recording = Recording(kept=self._repairs_wanted)
        self._begin()

    def _begin(self) -> None:
        """Begin a segment as declared."""
        self.repairs: tuple[Repair, ...] = ()
        self._policy = RepairPolicy()
        self.config, self.robot = self._declared
        self._open()

    def _open(self) -> None:
        """Open a segment."""
        self._segment = Segment(
            self.config, self.robot, self._make, self._before, conversions=conversions(self.repairs)
        )
        self.intake, self.thrust = self._segment.intake, self._segment.thrust
        if self.restarts and not self._carried:
            self._segment.identifier.add_note(self.restarts[-1])

    # Messages

    def add_joint_state(self, message: Any) -> bool:
        """Add a JointState, unread; return whether it is time for `process`."""
        return self._add(JOINTS, message)

    def add_odometry(self, message: Any) -> bool:
        """Add an Odometry, pose or transform, unread; return whether it is time for `process`."""
        due = [self._add(ODOMETRY, each) for each in self.base_source.accepted([message])]
        return any(due)

    def add_named(self, message: Any, name: str = IMU) -> bool:
        """Add a message, unread, of a sensor by the name of its parameters; return whether it is time for `process`."""
        if name not in self._named:
            self._earlier[IMU_NOT_ASKED_FOR] += 1
            return False
        return self._add(name, message)

    def add_at_once(
        self, joint_states: Sequence[Any], odometry: Sequence[Any], named: Mapping[str, Sequence[Any]]
    ) -> bool:
        """Add messages, of named sensors, too, in order, if all are regular; else return False: add them one by one."""
        if not self.base_source.accepts(odometry):
            return False
        messages = {JOINTS: joint_states, ODOMETRY: self.base_source.accepted(odometry)}
        added = self.queue.add_regular(messages | {name: named[name] for name in self._named})
        unused = sum(len(each) for name, each in named.items() if name not in self._named)
        if added and unused:
            self._earlier[IMU_NOT_ASKED_FOR] += unused
        return added

    def add_thrust(self, message: Any) -> None:
        """Add a WrenchStamped of commanded thrust, which acts from its stamp on."""
        frame, stamp, wrench = wrench_of(message)
        frame = frame.removeprefix(self.config.frame_prefix)
        newest = self.queue.latest
        if self._recording.pending or self.thrust.affects_samples(frame, stamp, wrench, newest):
            # Earlier messages are processed without it, however the calls are spread.
            self._ready = self.process(at_once=False)
        self._give(partial(_add_thrust, frame=frame, stamp=stamp, wrench=wrench, newest=newest))

    def add_stored_momentum(self, message: Any) -> None:
        """Add a Vector3Stamped of the momentum that wheels or gyros store."""
        frame, stamp, momentum = vector_of(message)
        sample = frame.removeprefix(self.config.frame_prefix), stamp, momentum
        self._give(partial(_add_stored_momentum, sample=sample))

    def add_target_pose(self, message: Any) -> None:
        """Add a PoseStamped, PoseWithCovarianceStamped or Odometry of a frame on the target before its capture."""
        self._give(partial(_add_target_pose, message=message))

    def process(self, *, at_once: bool = True, last: bool = False) -> list[Estimate]:
        """Process the added messages and return the new estimates; how calls are spread makes no difference to them.

        Where a repair starts the run again, all its estimates come again. If not `at_once`, `run_slice` makes them, and
        only those of new windows are returned. After the `last` messages windows do not wait for later ones.
        """
        goes_on = at_once or not self._recording.pending
        self._record(last=last)
        estimates: list[Estimate] = []
        while goes_on and self._recording.pending:
            repairs = self.repairs
            found = self._take_next(new_only=not at_once)
            estimates = estimates + found if self.repairs == repairs else []  # those of a run that was given up go
            goes_on = at_once
        self._forget_silence()
        ready, self._ready = self._ready, []
        return ready + estimates

    def _forget_silence(self) -> None:
        """Forget messages that no repair comes back to: estimates stopped long ago, or have not begun."""
        newest = self.queue.latest
        if not self._repairs_wanted or self._recording.pending or newest is None:
            return
        begun = self.collected > 0
        since = self._segment.identifier.origin if begun else self._recording.first
        if since is not None and newest - since > round(_SILENCE * 1e9):
            self._policy.over = begun
            self._recording.forget(kept=not begun)

    def finish(self) -> list[Estimate]:
        """Return the estimates of windows that wait for later ones, after the last `process` of a recording."""
        return self.process(last=True)

    def run_slice(self) -> bool:
        """Run a slice of the background work; return whether some is left before the next window.

        Call it after the estimates of a window are published. When it runs makes no difference to the numbers.
        """
        if self._recording.pending:
            found = self._take_next(new_only=True)
            self._ready = self._ready + found
            return True
        try:
            return self._segment.identifier.estimator.tasks.run_slice()
        except UNSOLVABLE as error:
            self._end(error)
            return False

    def capture(self) -> str:
        """Take the body for captured at the latest stamp, and return when that was, in a sentence.

        A second call moves a capture that was announced too early: data since then are forgotten.

        Raises DataError: The run did not begin before a capture, has had it, or has no samples yet.
        """
        self._ready = self.process()
        return self._segment.captured(self.queue.latest)

    # State

    def model_summary(self) -> ModelSummary:
        """Return a summary of the robot description, with the joints that messages have named so far."""
        chosen = bool(self.config.target_link)
        heard = [name for name in self.intake.joint_reader.heard if name not in self.config.wheels.names]
        heard += self.config.flexible.joints if heard else ()
        weighed = contradicted_mass(self.config.known_links, self.robot.kernel)
        return summarise(self.robot.model, self.robot.target_link, chosen=chosen, heard=heard, weighed=weighed)

    def posterior(self) -> Posterior | None:
        """Return the posterior of the run; None if its method has none, or none yet."""
        return self._segment.identifier.estimator.posterior()

    @property
    def frames(self) -> Frames:
        """The frames that its next estimates are given in."""
        return self._frames(self.robot)

    def frames_of(self, estimate: Estimate) -> Frames:
        """Return the frames that an estimate is given in."""
        return self._frames(self.robot_of(estimate))

    def robot_of(self, estimate: Estimate) -> Robot:
        """Return the robot of an estimate, as its repairs describe it; a segment after it has none of them."""
        if estimate.repairs == self.repairs:
            return self.robot
        repairs, robot = self._earlier_robot
        if repairs != estimate.repairs:
            robot = Robot(repaired(self._declared[0], estimate.repairs), self._described(estimate.repairs))
            self._earlier_robot = estimate.repairs, robot
        return robot

    def is_described_by(self, urdf: str) -> bool:
        """Return whether a robot description is the one that this run was given."""
        return urdf == self._declared[1].urdf

    def _described(self, repairs: Sequence[Repair]) -> str:
        return described(self._declared[1].urdf, repairs)

    def _frames(self, robot: Robot) -> Frames:
        return Frames(robot.target_link, self.intake.odometry_reader.frame, self.config.frame_prefix)

    @property
    def catching_up(self) -> bool:
        """Whether a run that was started again has not yet taken all messages; `run_slice` goes on with it."""
        return self._recording.pending

    @property
    def closing(self) -> int | None:
        """End (ns) of the window whose last messages are coming, so that its estimate is the next thing to do."""
        return None if self._recording.pending else self._segment.closing(self.queue.newest[JOINTS])

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

    def dropped_of(self, name: str) -> Counter[str]:
        """Return the unused messages of odometry or a named sensor, by cause."""
        source = self.base_source.dropped if name == ODOMETRY else Counter()
        return self.queue.dropped_of(name) + source + self._unused_of(name)

    def used_of(self, name: str) -> int:
        """Return how many messages of odometry or a named sensor are used."""
        return max(self.received[name] - sum(self._unused_of(name).values()), 0)

    def _unused_of(self, name: str) -> Counter[str]:
        """Return the received messages of odometry or a named sensor that are not used, by cause."""
        if name in self._named and name not in self.intake.instruments:
            return self._earlier_of[name] + Counter({LEFT_OUT: self.received[name] - self._received_earlier[name]})
        return self._earlier_of[name] + self._segment.dropped_of(name)

    @property
    def named(self) -> Mapping[str, Input]:
        """The topics of named sensors, by the names of their parameters."""
        return self._named

    @property
    def replaced(self) -> Counter[str]:
        """Messages with an unusable part, which parameters replace, by cause."""
        return self._replaced_earlier + self.intake.odometry_reader.replaced

    def _add(self, name: str, message: Any) -> bool:
        stamp = stamp_of(message)
        jumped = self.queue.add(name, stamp, message)
        if jumped is None:
            if self._recording.pending:  # windows of the segment are past: messages wait, to be taken many at once
                return sum(self.queue.waiting.values()) >= PART
            return self._segment.is_due(name, stamp, self.queue)
        if jumped:
            self._ready = self.process(last=True)
            self._start_again(jumped)
        self.queue.confirm_jump(name, message)
        return True

    def _start_again(self, reason: str, *, carried: bool = False) -> None:
        """Begin a new segment; a reason that holds for it as well is carried on, before its own warnings."""
        self._earlier += self._segment.dropped
        self._earlier_of = {name: self._unused_of(name) for name in self._earlier_of}
        self._received_earlier = self.received.copy()
        self._replaced_earlier = self.replaced
        self._used_earlier += self.collected
        self.restarts = [*self.restarts[1 - _RESTARTS_KEPT :], f'{reason}; started again']
        self.restarted += 1
        self._carried = tuple(self.restarts[-1:]) if carried else ()
        self._recording.forget(kept=self._repairs_wanted)
        self._latest = -1
        self._begin()

    def _record(self, *, last: bool) -> None:
        """Take the messages from the queue; the segment comes to them after what it was given before."""
        messages = self.queue.take_all()
        self.received.update({name: number_of(each) for name, each in messages.items()})
        wrong = self.queue.dropped_by(BAD_NANOSEC).items()
        unstamped = [SPOKEN.get(name, name) for name, count in wrong if count]
        given = partial(Segment.process, messages=messages, last=last, unstamped=unstamped)
        self._recording.add(given, self.queue.latest, kept=last or bool(unstamped) or any(map(len, messages.values())))

    def _give(self, given: Given) -> None:
        """Let the segment take something after everything that it was given before."""
        behind = self._recording.pending
        self._recording.add(given)
        if not behind:
            self._take_next()

    def _take_next(self, *, new_only: bool = False) -> list[Estimate]:
        """Let the segment take what comes next; return its estimates, or only those of new windows."""
        try:
            estimates = self._recording.next()(self._segment)
        except UNSOLVABLE as error:
            self._end(error)
            return []
        except DataError as error:  # its unknowns are known with the first windows
            if self._before is None:
                raise
            self._before = None
            self._start_again(f'continue_from is left out: {error}')
            return []
        self._blamed = next((cause for each in estimates[::-1] for cause, _ in each.likely_causes), self._blamed)
        if not self._repairs_wanted:
            return self._with_texts(estimates)
        for estimate in estimates:
            repair = self._policy.repair(estimate, self.config, self.repairs)
            if repair is not None and self._repair(repair):
                return []
        if self._policy.over:
            self._recording.forget(kept=False)
        found = [replace(each, repairs=self.repairs) for each in self._with_texts(estimates)]
        found = [each for each in found if not new_only or each.stamp > self._latest]
        self._latest = max([self._latest, *(each.stamp for each in found)])
        return found

    def _with_texts(self, estimates: list[Estimate]) -> list[Estimate]:
        """Return estimates whose first warnings are repairs, and what has contradicted a run that came to its end."""
        texts = (*map(str, self.repairs), *self._carried)
        return [replace(each, warnings=(*texts, *each.warnings)) for each in estimates] if texts else estimates

    def _end(self, error: Exception) -> None:
        """End a run that has no solution, and begin the next; what contradicted it is wrong for that one as well."""
        before = f'; likeliest before: {self._blamed}' if self._blamed else ''
        self._start_again(f'the equations could not be solved ({error}){before}', carried=bool(self._blamed))

    def _repair(self, repair: Repair) -> bool:
        """Start the run again with one more repair; return whether its parameters can be used."""
        before = self.config, self.robot, self.repairs
        try:
            self.repairs = joined(self.repairs, repair.since_sample(self._segment.identifier.origin))
            self.config = repaired(self._declared[0], self.repairs)
            self.robot = Robot(self.config, self._described(self.repairs))
            self._open()
        except (ModelError, ParameterError):  # robot or parameters given do not go with it
            self.config, self.robot, self.repairs = before
            return False
        self._policy, self._ready = RepairPolicy(), []
        self._recording.begin_again()
        return True


def _add_thrust(segment: Segment, frame: str, stamp: int, wrench: Array, newest: int | None) -> list[Estimate]:
    thrust = segment.thrust
    thrust.add_command(frame, stamp, wrench, newest)
    for noted, text in ((thrust.late, LATE_THRUST), (thrust.exact, EXACT_THRUST)):
        if noted:
            segment.identifier.add_note(text)
    if thrust.shared:
        segment.intake.faults.name('thrust', stamp, SHARED_THRUST.format(thrust.shared))
    return []


def _add_stored_momentum(segment: Segment, sample: tuple[str, int, Array]) -> list[Estimate]:
    segment.intake.stored_momentum.add_sample(*sample)
    return []


def _add_target_pose(segment: Segment, message: Any) -> list[Estimate]:
    segment.track.add(message)
    return []
