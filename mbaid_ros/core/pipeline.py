"""Samples in, estimates out: common stamps of all streams, checks of windows, then the method."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol, TypeVar

import numpy as np

from mbaid_ros.core.clocks import LARGEST_BACKLOG, Found, StampPattern
from mbaid_ros.core.contracts import Check, Follower, Force, converted
from mbaid_ros.core.filter.posterior import Posterior
from mbaid_ros.core.geometry import Array, exp, log
from mbaid_ros.core.gyro import RateIntegrator
from mbaid_ros.core.joints.faults import CHECKS, JointFaults, JointRates
from mbaid_ros.core.joints.stream import joint_channels
from mbaid_ros.core.links import impossible
from mbaid_ros.core.noise import NoiseEstimator, NoiseLevels
from mbaid_ros.core.odometry.faults import MILLIMETRES, CoarsePositions, PlanarPoses, twist_check
from mbaid_ros.core.odometry.stream import POSE, hermite
from mbaid_ros.core.outliers import JOINT_OUTLIER, JOINTS_HELD, Flips, FrameJumps, Outliers, Repeats
from mbaid_ros.core.repair import Conversion, Repair
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.verdict import Reason, Severity, notes, with_reasons
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.samples import FEWEST, BaseStream, JointStream, Samples, Stamps, with_rates
from mbaid_ros.core.windows import Windows
from mbaid_ros.tasks import Tasks

OUT_OF_ORDER = 'stamp not after the one before'
NO_ODOMETRY = 'no odometry around the stamp'
ODOMETRY_GAP = 'gap in the odometry'
_BEFORE_ALL = np.iinfo(np.int64).min
_TYPICAL_NOISE = 1e-4  # rad or m, of joint positions of which nothing is specified
Stream = TypeVar('Stream', JointStream, BaseStream)
RATE_MISSING = 'velocity missing, and too few positions to derive it'
JOINT_RATES_DERIVED = (
    'JointState without velocities: derived from the positions of each window, with the resulting noise; method '
    'trajectory does not need them'
)
TWIST_DERIVED = (
    'no twist of the base: derived from the poses of each window, with the resulting noise; method trajectory does '
    'not need it'
)
POSES_ALONE = 'no twist of the base: the poses alone are used'
GYRO_ALONE = 'nothing locates the base: the angular velocity of the IMU alone is used, about the common centre of mass'
ORIENTATION_AND_GYRO = (
    'nothing locates the base: orientation and angular velocity of the IMU are used, about the common centre of mass'
)
POSES_AND_GYRO = 'no twist of the base: the poses and the angular velocity of the IMU are used'
WITHOUT_GYRO = 'the angular velocity of the IMU is not used: method trajectory uses it'
NOTHING: Mapping[str, Any] = {}
_ZEROS = 10  # poses of zeros, from which tracking had not begun
_POSITION, _ORIENTATION = 1e-3, 1e-4  # m, rad, noise of the base's poses
_CERTAIN = 1e6  # log-likelihood that such a cause counts as: more than a filter finds for any other
_GRAVE: Mapping[str, Severity] = {
    'planar': 'conflict',
    'nanosec': 'conflict',
}  # symptoms beside those of joints that spoil any estimate
_AT_ONCE = 300  # readings that are looked at together at most


class Synchroniser:
    """Turns two streams into samples; the result does not depend on how they are cut into pieces.

    Parameters
    ----------
    maximum_gap : s, longest time between two odometry stamps that is interpolated
    view : transforms measurements of the base to an inertial frame, if that of the odometry is none
    followers : of named sensors' readings, by name; samples then wait for them
    noise : receives the readings that are used
    """

    def __init__(
        self,
        maximum_gap: float,
        view: Callable[[BaseStream], BaseStream] | None = None,
        followers: Mapping[str, Follower] | None = None,
        noise: NoiseEstimator | None = None,
    ) -> None:
        self._noise = noise
        self._view = view
        self._followers = followers or {}
        self._gyros = [each for each in self._followers.values() if isinstance(each, RateIntegrator)]
        self._maximum_gap = round(maximum_gap * 1e9)
        self._joints: JointStream | None = None
        self._base: BaseStream | None = None
        self._origin: int | None = None
        self._previous: int | None = None  # stamp of the last joint measurement that was used
        self._newest: dict[type, int] = {}  # latest stamp of each stream, used up or not
        self._repeats = Repeats[BaseStream](POSE)
        self.flips = Flips()
        self.jumps = FrameJumps()
        self._outliers = Outliers[BaseStream](self._maximum_gap, POSE)
        joints = joint_channels(_TYPICAL_NOISE if noise is None else noise.joint_position)
        self._held = Repeats[JointStream](joints, JOINTS_HELD, together=True)
        self._joint_outliers = Outliers[JointStream](self._maximum_gap, joints, JOINT_OUTLIER)
        self._dropped: Counter[str] = Counter()
        self._dropped_base: Counter[str] = Counter()

    @property
    def dropped(self) -> Counter[str]:
        """Measurements that were not used, by cause."""
        followers = sum((each.dropped for each in self._followers.values()), self._dropped + self.dropped_base)
        return +(self._held.dropped + self._joint_outliers.dropped + followers)

    @property
    def dropped_base(self) -> Counter[str]:
        """Measurements of the base that were not used, by cause."""
        return +sum((gate.dropped for gate in (self._repeats, self.flips, self._outliers)), self._dropped_base)

    @property
    def outlying_joint(self) -> int | None:
        """Index of the joint that most outliers are of; None if there is no outlier."""
        most = self._joint_outliers.by_channel.most_common(1)
        return most[0][0] if most else None

    @property
    def joint_interval(self) -> float:
        """Time between the latest two joint readings that differ, s, where a driver repeats readings."""
        return self._held.interval

    @property
    def origin(self) -> int:
        """Stamp of the first sample, ns: time 0 of every sample."""
        return self._origin or 0

    def push(
        self, joints: JointStream | None, base: BaseStream | None, named: Mapping[str, Any] = NOTHING
    ) -> Samples | None:
        """Add measurements, of further sensors by name; return the samples that they complete, None if there are none.

        Stamps not after their predecessor in the stream are dropped and counted; so are repeated poses and outliers.
        """
        joints = self._new_measurements(joints)
        if joints is not None and joints.position.shape[1]:
            joints = self._joint_outliers.push(self._held.push(joints))
        self._joints = self._append(self._joints, joints)
        new = self._repeats.push(self._new_measurements(base))  # a pose is repeated in the frame that it is measured in
        if new is not None and self._view is not None:
            new = self._view(new)
        new = self._outliers.push(self.flips.push(new))
        # A frame that turns by itself has no constant correction, and other sensors' poses may be in the corrected one.
        if self._view is None and len(self._gyros) == len(self._followers):
            new = self.jumps.push(new)
        self._base = self._append(self._base, new)
        if self._noise is not None:
            self._noise.add_readings(joints, new)
        for name, follower in self._followers.items():
            follower.push(named.get(name))
        if self._joints is None or self._base is None:
            return None
        waiting, known = self._joints.stamp, self._base.stamp
        ready = int(np.searchsorted(waiting, self._measured_until(known), side='right'))
        early = int(np.searchsorted(waiting, known[0], side='left'))
        early = min(early, ready)
        self._dropped[NO_ODOMETRY] += early
        samples = self._interpolate(self._joints[early:ready], self._base) if ready > early else None
        self._joints = self._joints[max(early, ready) :]
        # The last odometry before the next joints is one end of their interval, the one before gives its length.
        pending = int(self._joints.stamp[0]) if len(self._joints.stamp) else self._newest[JointStream] + 1
        held_back = (self._held.waiting_since, self._joint_outliers.waiting_since)
        pending = min([pending, *(stamp for stamp in held_back if stamp is not None)])
        first = max(int(np.searchsorted(known, pending, side='right')) - 2, 0)
        self._base = self._base[first:]
        for follower in self._followers.values():
            follower.forget_before(int(self._base.stamp[0]))
        return samples

    def _measured_until(self, base: Stamps) -> int:
        """Return the last stamp of the base (N,) up to which all sensors are known; the least integer if none."""
        newest, until = self._newest[JointStream], int(base[-1])
        of_gyros = [each.complete_until(newest) for each in self._gyros]
        if of_gyros:
            # Samples between two of the base need the gyros until the second.
            place = int(np.searchsorted(base, min(of_gyros), side='right'))
            until = int(base[place - 1]) if place else _BEFORE_ALL
        return min([until, *(each.complete_until(newest) for each in self._followers.values())])

    def _new_measurements(self, new: Stream | None) -> Stream | None:
        """Return the measurements whose stamps are after all earlier ones of their stream."""
        if new is None or not len(new.stamp):
            return None
        newest = self._newest.get(type(new), _BEFORE_ALL)
        before = np.maximum.accumulate(np.concatenate(([newest], new.stamp[:-1])))
        in_order = new.stamp > before
        self._newest[type(new)] = max(int(before[-1]), int(new.stamp[-1]))
        if not np.all(in_order):
            self._dropped_from(new)[OUT_OF_ORDER] += int(np.sum(~in_order))
            new = new[in_order]
        return new

    def _append(self, buffer: Stream | None, new: Stream | None) -> Stream | None:
        if new is None:
            return buffer
        if buffer is not None:
            new = new.concatenate((buffer, new))
        excess = len(new.stamp) - LARGEST_BACKLOG
        if excess > 0:
            self._dropped_from(new)[NO_ODOMETRY] += excess
            new = new[excess:]
        return new

    def _dropped_from(self, stream: JointStream | BaseStream) -> Counter[str]:
        return self._dropped_base if isinstance(stream, BaseStream) else self._dropped

    def _interpolate(self, joints: JointStream, base: BaseStream) -> Samples | None:
        right = np.searchsorted(base.stamp, joints.stamp, side='left')
        left = np.where(base.stamp[right] == joints.stamp, right, right - 1)
        interval = base.stamp[right] - base.stamp[np.maximum(right - 1, 0)]
        spacing = np.diff(joints.stamp, prepend=joints.stamp[0] if self._previous is None else self._previous)
        self._previous = int(joints.stamp[-1])
        usable = base.stamp[right] - base.stamp[left] <= self._maximum_gap
        self._dropped[ODOMETRY_GAP] += int(np.sum(~usable))
        if not np.any(usable):
            return None
        # Samples that share one odometry interval share its noise, which averages out that much less.
        shared = np.asarray(
            np.where(spacing > 0, np.maximum(interval / np.maximum(spacing, 1), 1.0), 1.0)[usable], dtype=float
        )
        apart = 1e-9 * np.maximum(interval, spacing)[usable]
        joints, left, right = joints[usable], left[usable], right[usable]
        if self._origin is None:
            self._origin = int(joints.stamp[0])
        time = (joints.stamp - self._origin) * 1e-9
        samples = replace(hermite(joints, base, (left, right), self._maximum_gap, time, shared), apart=apart)
        if self.jumps.found:
            samples = replace(samples, frame=self.jumps.variances(joints.stamp))
        for name in ('further', 'readings'):
            columns = [each.columns(samples, joints.stamp) for each in self._followers.values() if each.field == name]
            if columns:
                samples = replace(samples, **{name: np.concatenate(columns, axis=1)})
        on_base = next((gyro for gyro in self._gyros if gyro.on_base), None)
        if on_base is None:
            return samples
        return replace(samples, base_rotation=_by_gyro(on_base, samples, joints.stamp, base, (left, right)))


def _by_gyro(
    gyro: RateIntegrator, samples: Samples, stamp: Stamps, base: BaseStream, ends: tuple[Stamps, Stamps]
) -> Array:
    """Return the orientations (N, 3, 3) between two of the base by a gyro, its error spread evenly in between."""
    left, right = ends
    (now, at), (begin, first), (end, last) = (
        gyro.integral_at(each) for each in (stamp, base.stamp[left], base.stamp[right])
    )
    length = base.stamp[right] - base.stamp[left]
    part = ((stamp - base.stamp[left]) / np.where(length > 0, length, 1))[:, None]
    rotation = base.rotation[left]
    turn = log(np.swapaxes(rotation, -1, -2) @ base.rotation[right])
    turned = rotation @ exp(now - begin + part * (turn - (end - begin)))
    known = (at == first) & (at == last) & (at >= 0) & (length > 0)
    return np.where(known[:, None, None], turned, samples.base_rotation)


class WindowChecks:
    """Follows windows, leaves out rates that contradict the positions, and returns reasons to distrust a run.

    Parameters
    ----------
    checks : of each window; None asks whether the twist is the rate of the poses
    joint_rates : leaves out joint velocities that are no rates of the positions; None leaves all in
    """

    def __init__(self, checks: Sequence[Check] | None = None, joint_rates: JointRates | None = None) -> None:
        self._checks = [twist_check()] if checks is None else checks
        self._joint_rates = joint_rates
        self._reasons: dict[float, list[Reason]] = {}  # by the end of the latest windows, s

    def with_valid_rates(self, windows: Sequence[Samples]) -> list[Samples]:
        """Return the next windows without rates that contradict the positions."""
        self._reasons.clear()
        return [self._checked(window) for window in windows]

    def reasons(self, time: float) -> list[Reason]:
        """Return the findings up to the end of a window of the latest call, s."""
        return self._reasons.get(time, [])

    def _checked(self, window: Samples) -> Samples:
        found = [check.update(window) for check in self._checks]
        checked = window
        if self._joint_rates is not None:
            checked = self._joint_rates.with_valid_rates(window)
            found.insert(0, self._joint_rates.reason())
        self._reasons[float(window.time[-1])] = [reason for reason in found if reason is not None]
        return checked


class Estimator(Protocol):
    """A method of identification."""

    method: str
    needs_rates: bool  # whether it works with measured velocities, of the joints and of the base

    @property
    def tasks(self) -> Tasks:
        """Its background work, of which the next `update` completes what it needs; when it runs changes no numbers."""

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Take closed windows, in order, and return the estimates they lead to; origin: ns, stamp at time 0."""

    def posterior(self) -> Posterior | None:
        """Return the posterior, from which a motion is planned; None where the method has none, or not yet."""


class Identifier:
    """One identification, from its first measurement on.

    The estimates do not depend on the partition of the measurements into calls: the live node hands over a few at a
    time, a replay thousands, and both get the same numbers.

    Parameters
    ----------
    estimator : the method
    window : s, length of a window
    maximum_gap : s, longest odometry interval that is interpolated
    checks : of windows before they are identified; None makes those of the twist alone
    forces : known changes of the momentum, in the order in which they are added to windows
    noise : follows how noisy the sensors are; None takes it as declared
    view : from odometry to the frame in which it is used; None: as it is
    followers : of named sensors' readings, by name
    """

    def __init__(
        self,
        estimator: Estimator,
        window: float,
        maximum_gap: float,
        checks: WindowChecks | None = None,
        forces: Sequence[Force] = (),
        noise: NoiseEstimator | None = None,
        *,
        view: Callable[[BaseStream], BaseStream] | None = None,
        followers: Mapping[str, Follower] | None = None,
    ) -> None:
        self.estimator = estimator
        self.synchroniser = Synchroniser(maximum_gap, view, followers, noise)
        self._windows = Windows(window)
        self._noise = noise
        self._levels: dict[float, NoiseLevels] = {}  # by the end of the latest windows, s
        self._checks = checks or WindowChecks()
        self._forces = forces
        self._window = window
        self._notes: dict[str, float] = {}  # notes on the data for the user, and since when (s)
        self.used = 0
        self.end_of_window: int | None = None  # ns, stamp that closes the window that is open
        self._dropped: Counter[str] = Counter()

    def add_note(self, text: str) -> None:
        """Add a warning to every estimate."""
        self._notes[text] = -np.inf

    @property
    def origin(self) -> int:
        """Stamp of the first sample, ns: time 0 of every estimate."""
        return self.synchroniser.origin

    @property
    def dropped(self) -> Counter[str]:
        """Measurements that were not used, by cause."""
        return self._dropped + self.synchroniser.dropped

    def push(
        self,
        joints: JointStream | None,
        base: BaseStream | None,
        named: Mapping[str, Any] = NOTHING,
        *,
        last: bool = False,
    ) -> list[Estimate]:
        """Take measurements, of further sensors by name, and return the estimates of the windows they close.

        After the `last` ones windows do not wait for the noise of more.
        """
        samples = self.synchroniser.push(joints, base, named)
        windows: list[Samples] = []
        if samples is not None:
            self.used += len(samples)
            number = np.floor((samples.time[-1] + 1e-9) / self._window) + 1.0
            self.end_of_window = self.synchroniser.origin + round(number * self._window * 1e9)
            windows = self._windows.push(samples)
        closed = self._prepared(windows, last=last)
        if not closed:
            return []
        estimates = self.estimator.update(closed, self.synchroniser.origin)
        if self._levels:
            estimates = [replace(each, noise=self._levels.get(each.time)) for each in estimates]
        return [with_reasons(each, self._reasons(each.time)) for each in estimates]

    def _prepared(self, windows: list[Samples], *, last: bool) -> list[Samples]:
        """Return closed windows with the velocities their method needs, without those that cannot have them."""
        for force in self._forces:
            windows = [force.with_momentum(window, self.origin) for window in windows]
        if self._noise is not None:
            each = self._noise.windows_with_noise(windows, self.origin, last=last)
            windows = [window for window, _ in each]
            self._levels = {float(window.time[-1]): levels for window, levels in each}
        windows = self._checks.with_valid_rates(windows)
        return [window for window in map(self._with_rates, windows) if window is not None]

    def _with_rates(self, window: Samples) -> Samples | None:
        """Return a window with the velocities its method needs, None if it cannot have them; note the source."""
        start = float(window.time[0])
        joints, base = window.missing_rates
        if not self.estimator.needs_rates:
            if base:
                self._notes.setdefault(_measured(window), start)
            return window
        if window.further.shape[1]:
            self._notes.setdefault(WITHOUT_GYRO, start)
        if (joints or base) and len(window) < FEWEST:
            self._dropped[RATE_MISSING] += len(window)
            self.used -= len(window)
            return None
        if joints:
            self._notes.setdefault(JOINT_RATES_DERIVED, start)
        if base:
            self._notes.setdefault(TWIST_DERIVED, start)
        return with_rates(window)

    def _reasons(self, time: float) -> list[Reason]:
        """Return the notes on the data up to the end of a window, s: none of later windows in the same call."""
        levels = self._levels.get(time)
        texts = [] if levels is None else levels.warnings
        jumps = self.synchroniser.jumps.text(self.origin + round(1e9 * time), self.origin)
        texts = [jumps, *texts] if jumps else texts
        reasons = notes([*texts, *(text for text, since in self._notes.items() if since <= time)])
        if levels is not None and levels.in_another_unit:
            meant = converted(MILLIMETRES, Conversion(scale=1e-3))
            reasons.append(Reason(MILLIMETRES, 'contradiction', _CERTAIN, meant))
        return [*reasons, *self._checks.reasons(time)]


def _measured(window: Samples) -> str:
    """Return the sensors that measure the base's motion in a window without its twist."""
    located, oriented = np.isfinite(np.diagonal(window.pose_covariance[0])[[0, 3]]).tolist()
    if not located:
        return ORIENTATION_AND_GYRO if oriented else GYRO_ALONE
    return POSES_AND_GYRO if window.further.shape[1] and bool(np.isfinite(window.further).all()) else POSES_ALONE


class PlainFaults:
    """Follows joint readings as they arrive, and names faults that need no model.

    Parameters
    ----------
    model : RobotModel
    noise : rad or m, standard deviation of a joint position
    """

    def __init__(self, model: RobotModel, noise: float) -> None:
        self._model, self._noise = model, noise
        self._kinds: dict[tuple[int, ...], tuple[JointFaults, StampPattern]] = {}
        self._waiting: list[tuple[Mapping[tuple[int, ...], JointStream], BaseStream | None]] = []
        self._count = 0  # of these readings
        self._base = StampPattern('the poses of the base', _POSITION)
        self._plane = PlanarPoses(model)
        self._coarse = CoarsePositions()
        self._zeros: int | None = 0  # poses at the begin; None once there are others
        self._found: dict[str, tuple[int, Reason]] = {}  # by symptom: from which stamp on (ns), and the reason
        text, repair = impossible(model)
        if text:
            self.name('description', np.iinfo(np.int64).min, text, repair)

    def add(self, streams: Mapping[tuple[int, ...], JointStream], base: BaseStream | None = None) -> None:
        """Take readings (N, k), by the joints that they are of, and of the base, in the order of arrival.

        They are looked at before the next estimate, or when there are many: few cost as much as many.
        """
        count = sum(len(each.stamp) for each in (*streams.values(), base) if each is not None)
        if not count:
            return
        self._waiting.append((streams, base))
        self._count += count
        if self._count >= _AT_ONCE:
            self._inspect()

    def _inspect(self) -> None:
        """Look at the readings that wait."""
        waiting, self._waiting, self._count = self._waiting, [], 0
        poses = [base for _, base in waiting if base is not None and len(base.stamp)]
        if poses:
            base = BaseStream.concatenate(poses)
            turns = _POSITION / _ORIENTATION * base.rotation.reshape(-1, 9)
            self._name_all(self._base.add(base.stamp, np.concatenate((base.position, turns), axis=1)))
            self._begin(base)
            self._plane.add_poses(base)
            self._name_all(self._coarse.add_poses(base))
        count = len(self._model.independent_joints)
        for kind in dict.fromkeys(kind for streams, _ in waiting for kind in streams):
            columns = [column for column, joint in enumerate(kind) if joint < count]
            stream = JointStream.concatenate([streams[kind] for streams, _ in waiting if kind in streams])
            if columns and len(stream.stamp):
                if kind not in self._kinds:
                    joints = JointFaults(self._model, [kind[column] for column in columns], self._noise)
                    self._kinds[kind] = joints, StampPattern('the joint states', self._noise)
                joints, stamps = self._kinds[kind]
                own = JointStream(stream.stamp, stream.position[:, columns], stream.velocity[:, columns])
                self._name_all(joints.add(own))
                self._name_all(stamps.add(own.stamp, own.position))
                self._plane.add_joints(joints.names, own.stamp, own.position)
        self._name_all(self._plane.found())

    def applied(self, estimate: Estimate) -> Estimate:
        """Return an estimate with the reasons that were plain by its end, the gravest first."""
        self._inspect()
        reasons = [reason for _, (since, reason) in sorted(self._found.items(), key=_rank) if since <= estimate.stamp]
        if not reasons:
            return estimate
        explained = with_reasons(estimate, reasons[::-1])  # the last one leads the causes
        plain = tuple(reason.text for reason in reasons)
        return replace(explained, warnings=(*plain, *(text for text in explained.warnings if text not in plain)))

    @property
    def texts(self) -> list[str]:
        """All faults that are plain by now, the gravest first."""
        self._inspect()
        return [reason.text for _, (_, reason) in sorted(self._found.items(), key=_rank)]

    def _begin(self, base: BaseStream) -> None:
        """Look at how poses begin: those of zeros, before what locates the base has seen it, end at once."""
        if self._zeros is None:
            return
        away = np.maximum(np.abs(base.position).max(axis=1), np.abs(base.rotation - np.eye(3)).max(axis=(1, 2)))
        self._zeros += int(np.argmax(away > 0.0)) if away.any() else len(away)
        if away.any():
            first = int(np.argmax(away > 0.0))
            if self._zeros >= _ZEROS and away[first] > _ORIENTATION:
                text = (
                    f'the first {self._zeros} poses of the base are zero: tracking had not begun; read the bag with '
                    '--start, or start the estimator later'
                )
                self.name('zeros', int(base.stamp[first]), text)
            self._zeros = None

    def name(self, symptom: str, since: int, text: str, repair: Repair | None = None) -> None:
        """Name a fault that is plain from a stamp (ns) on: a cause where anything is wrong."""
        severity = CHECKS[symptom].severity if symptom in CHECKS else _GRAVE.get(symptom, 'note')
        if symptom not in self._found or since < self._found[symptom][0]:
            self._found[symptom] = since, Reason(text, severity, _CERTAIN, repair)

    def _name_all(self, found: Iterable[Found | tuple[str, int, str, Repair | None]]) -> None:
        for each in found:
            self.name(*each)


def _rank(found: tuple[str, tuple[int, Reason]]) -> tuple[bool, int]:
    """Return the order of a symptom: the gravest first, then as in the table."""
    symptom, (_, reason) = found
    return reason.severity == 'note', list(CHECKS).index(symptom) if symptom in CHECKS else -1
