"""The target: its prior, its tracked poses before the capture, the captured body alone, slip and exchange."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from mbaid_ros.core.contracts import RIGHT, Convention, NominalModel, Unknown
from mbaid_ros.core.filter.gaussian import SquareRootInformation
from mbaid_ros.core.filter.posterior import MeanAndCovariance
from mbaid_ros.core.filter.time_update import pose_reset, with_process_noise
from mbaid_ros.core.free_flight import (
    CENTRE,
    FEWEST,
    LEVER,
    RATIOS,
    TURN,
    FreeFlight,
    PoseNoise,
    Track,
    free_flight,
)
from mbaid_ros.core.geometry import (
    Array,
    chi_square_limit,
    cross,
    exp,
    log,
    rotate,
    rotation_from_quaternion,
    skew,
    unvec,
    vec,
)
from mbaid_ros.core.links import BodyDeviations
from mbaid_ros.core.odometry.stream import QUATERNION_TOLERANCE, PoseReader, odometry_shape, source_of
from mbaid_ros.core.orbit import FallingFrame
from mbaid_ros.core.repair import Repair
from mbaid_ros.core.results.estimate import Estimate, Event
from mbaid_ros.core.robot.body import physical, physical_jacobian, standard
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.state import ANGULAR, BODY, LINEAR, MOMENTUM, Layout, Point, Variables
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import parameter

# Relative standard deviation from which a mass may be zero, at two standard deviations.
_MASS_MAY_VANISH = 0.5
_KNOWN = 0.1  # relative standard deviation of a mass, up to which its centre of mass can be compared
_STILL_A_LINK = 0.5  # times its described mass, that a link has at least: a captured body makes it no lighter
_NO_MOMENTUM = 1e-9  # N s, of a frame that nothing locates: it moves with the common centre of mass
NOT_A_POSE = 'the pose of the target is no pose'
OTHER_FRAME = 'the pose of the target is in another frame'
_UNUSED = 'the run goes on without the poses of the target'
_LONGEST, _MOST = 120.0, 3000  # s, poses: older ones, or more, add little
_REMEMBERED = 20_000  # poses
_SHARP_CENTRE, _SHARP_RATIOS = 0.1, 0.1  # m, 1: standard deviations above which the motion leaves them open
# Times the noise, from which inverted poses are tried, and those are not of a free body: by the noise as specified, and
# as neighbouring poses have it, which errors that last exceed.
_DOUBTFUL, _NOT_FREE, _NOT_FREE_BY_DIFFERENCES = 1.5, 2.5, 5.0
_FOR_SURE = 0.6  # of that, which inverted poses must leave to be named
_LATE = 1.0  # s without a pose before the capture, from which that is reported
_READER = PoseReader('', '')
_BY_CHANCE = 1e-4  # that a cause leaves as much of a contradiction
_STEPS_OF_CHANGE = 5  # of the search for its size
_AS_LIKELY = 10.0  # chi-square by which another cause may leave more, and be named, too
_TINY = 1e-30  # of complex steps, whose derivatives are exact
# Numbers of the motion: velocity of a point of the body, spin, centre of mass, ratios of inertia, velocity of that.
_POINT, _SPIN, _CENTRE, _RATIOS, _VELOCITY = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 14), slice(14, 17)
_NUMBERS = 17  # of these
# Numbers that predict them: momentum (P, L) of the whole, body, turn and place of the link, momentum of the robot.
_WHOLE, _BODY, _LINK, _ROBOT = slice(0, 6), slice(6, 16), slice(16, 22), slice(22, 28)
# m, of gyration: a search begins with the first, and no target's is much larger than the second.
_GUESSED_RADIUS, _LARGEST_RADIUS = 0.7, 2.5


@dataclass(frozen=True)
class TargetPriorConfig:
    """The prior of the target link with the captured body."""

    mass: float = parameter(0.0, 'kg', minimum=0.0)
    """Mass of the target link, if known."""
    mass_std: float = parameter(0.0, 'kg', minimum=0.0)
    """Standard deviation of the target's mass; 0: unknown."""
    com: tuple[float, ...] = parameter((), 'm', lengths=(0, 3))
    """Centre of mass of the target link in its frame, if known."""
    com_std: float = parameter(0.0, 'm', minimum=0.0)
    """Standard deviation of each coordinate of target_prior.com; needs mass_std too; 0: unknown."""


@dataclass(frozen=True)
class MomentumConfig:
    """The prior of the total momentum."""

    linear_prior_std: float = parameter(0.0, 'N s', minimum=0.0)
    """Standard deviation of the total linear momentum about zero, if the servicer matched velocities before the
    capture; 0: unknown."""


@dataclass(frozen=True)
class DebrisConfig:
    """The captured body alone."""

    report: bool = parameter(default=False)
    """Also report the captured body alone: the estimate minus the target link's <inertial>, which known_links.<link>
    then describes, as in calibrate. It needs all ten numbers: on a table, use a separate link for the body."""


def changed_by(text: str, mass: float | None, centre: Array) -> str:
    """Return a target-changed text with the size of the change: kg, None if fixed, and (3,) m of the centre of mass."""
    along = ', '.join(f'{value:+.3g}' for value in centre)
    heavier = '' if mass is None else f', the mass by {mass:+.3g} kg'
    return f'{text}; the centre of mass has changed by ({along}) m{heavier}'


@dataclass(frozen=True)
class Debris:
    """The captured body: mass, CoM and inertia about it (10,), with covariance, in the target link's frame."""

    parameters: Array
    covariance: Array

    @property
    def std(self) -> Array:
        """One standard deviation of each parameter, (10,)."""
        return np.sqrt(np.diag(self.covariance))


def debris(estimate: Estimate, link: Array, link_covariance: Array | None = None) -> Debris | None:
    """Return the captured body, None where not all ten parameters are determined or its mass may be zero.

    Standard parameters add up, so those of the link are subtracted, and the covariances of both added.

    Parameters
    ----------
    estimate : of link and captured body together
    link : (10,) standard parameters (m, h, I_o) of the link itself
    link_covariance : (10, 10) of the link's parameters; known exactly where not given
    """
    if not np.all(estimate.identifiable) or not np.all(np.isfinite(estimate.covariance)):
        return None
    together = standard(estimate.parameters)
    alone = together - link
    if alone[0] <= 0.0:
        return None
    # Covariance of (m, h, I_o) from that of (m, r_c, I_c), then on to the captured body's own (m, r_c, I_c).
    onward = physical_jacobian(alone)
    change = np.linalg.solve(physical_jacobian(together).T, onward.T).T
    covariance = change @ estimate.covariance @ change.T
    if link_covariance is not None:
        covariance = covariance + onward @ link_covariance @ onward.T
    if covariance[0, 0] > (_MASS_MAY_VANISH * alone[0]) ** 2:
        return None
    return Debris(physical(alone), covariance)


class DebrisPublication:
    """The captured body alone, as estimates that follow each other have it."""

    def __init__(self) -> None:
        self._published: Debris | None = None

    def next_published(self, found: Debris | None) -> Debris | None:
        """Return the next one, without numbers where it is not determined any more; None where that is known."""
        before, self._published = self._published, found
        if found is None and before is not None:
            return replace(before, parameters=np.full(10, np.nan), covariance=np.full((10, 10), np.nan))
        return found


@dataclass(frozen=True)
class TargetPrior:
    """The prior of the target link: mass and CoM, where given. Its step in time: `filter/time_update.py`."""

    mass: float = 0.0  # kg; 0 where nothing is known of it
    mass_std: float = 0.0  # kg
    # (3,) m in the link's frame; not used where the mass is unknown, as their product is estimated.
    com: tuple[float, ...] = ()
    com_std: float = 0.0  # m

    @property
    def declared(self) -> bool:
        """Whether anything is."""
        return self.mass_std > 0.0

    def apply(self, mean: Array, factor: Array) -> None:
        """Put it into mean (10,) and covariance factor (10, 10) of (m, h, I_o): h = m c, to first order."""
        if self.mass_std == 0.0:
            return
        mean[0], factor[0, 0] = self.mass, self.mass_std
        if self.com and self.com_std > 0.0:
            centre = np.array(self.com)
            mean[1:4] = self.mass * centre
            factor[1:4] = 0.0
            factor[1:4, 1:4] = self.mass * self.com_std * np.eye(3)
            factor[1:4, 0] = centre * self.mass_std


@dataclass(frozen=True, eq=False)
class KnownTarget:
    """All of the target link known beforehand, as it is before a capture."""

    parameters: Array  # (10,) standard parameters (m, h, I_o)
    factor: Array  # (10, 10) of their covariance

    @property
    def declared(self) -> bool:
        """Whether anything is."""
        return True

    def apply(self, mean: Array, factor: Array) -> None:
        """Put it into mean (10,) and covariance factor (10, 10) of (m, h, I_o)."""
        mean[:], factor[:] = self.parameters, self.factor


def target_changed_text(time: float, *, exchanged: bool) -> str:
    """Return that the body moved in the grasp at a time, s, or was exchanged for another."""
    if exchanged:
        return f'another body is in the grasp since {time:.1f} s, caught or lost: identify it from then on'
    return f'the body moved in the grasp at {time:.1f} s: identify it again from then on'


def other_targets(kernel: MomentumKernel) -> Iterator[Convention]:
    """Yield another unknown link on each other body: the last one with an inertia."""
    last = {link.body: link for link in kernel.model.links if link.parameters[0] > 0.0}
    for body, link in last.items() if len(kernel.unknown) == 1 else ():
        if body != kernel.target.body:
            found = f'the unknown body seems to be attached to {link.name}, not {kernel.target.name}'
            yield Convention(
                f'{found}: set target_link: {link.name}',
                kernel.with_unknown_link(link.name),
                misfit_left=RIGHT,
                least_mass=_STILL_A_LINK * float(link.parameters[0]),
                repair=Repair(found, {'target_link': link.name}),
            )


@dataclass(frozen=True, eq=False)
class ChangedTarget:
    """A target that has changed in a run."""

    time: float  # s since the first sample
    text: str  # the event in words
    exchanged: bool  # whether it is another body, not the same elsewhere
    before: MeanAndCovariance | None  # state until then; None where unknown

    def event(self, after: MeanAndCovariance | None) -> Event:
        """Return it as an event, with the change of mass and centre of mass where both states are known."""
        text, both = self.text, [each for each in (self.before, after) if each is not None]
        known = [each.deviation[BODY.start] < _KNOWN * each.mean[BODY.start] for each in both]
        if len(both) == 2 and all(known):
            then, now = (each.mean[BODY] for each in both)
            heavier = float(now[0] - then[0]) if self.exchanged else None
            text = changed_by(text, heavier, now[1:4] / now[0] - then[1:4] / then[0])
        return Event(self.time, 'target_changed', np.zeros(3), np.zeros(3), text)


def declared_linear_momentum(config: MomentumConfig, *, located: bool) -> float:
    """Return the standard deviation of the linear momentum, N s; 0 where nothing is known of it."""
    return config.linear_prior_std if located else _NO_MOMENTUM


def declared_target(config: TargetPriorConfig) -> TargetPrior:
    """Return the prior of the target; a value without its deviation, or the reverse, is refused."""
    given = {
        'mass': f'{config.mass:g} kg' if config.mass else '',
        'mass_std': f'{config.mass_std:g} kg' if config.mass_std else '',
        'com': f'{[*config.com]} m' if config.com else '',
        'com_std': f'{config.com_std:g} m' if config.com_std else '',
    }
    needs = ('mass', 'mass_std'), ('mass_std', 'mass'), ('com', 'com_std'), ('com_std', 'com'), ('com_std', 'mass_std')
    for name, other in needs:
        if given[name] and not given[other]:
            raise ParameterError(
                f"parameter 'target_prior.{name}' is {given[name]} without 'target_prior.{other}'; accepted: both"
            )
    return TargetPrior(config.mass, config.mass_std, config.com, config.com_std)


def described_prior(config: TargetPriorConfig, kernel: MomentumKernel, given: Mapping[str, float]) -> KnownTarget:
    """Return the prior of a target link that the robot description describes as well as `given`."""
    target, name = kernel.target, f'known_links.{kernel.target.name[:60]}'
    stds = [given.get(part, 0.0) for part in ('mass_relative_std', 'com_std', 'inertia_relative_std')]
    if min(stds) <= 0.0 or target.parameters[0] <= 0.0:
        raise ParameterError(
            f"parameter '{name}' is of the link that is identified; accepted: mass_relative_std, com_std and "
            'inertia_relative_std, all above 0, and an <inertial> in the robot description, or target_prior.mass'
        )
    if config.mass_std > 0.0:
        raise ParameterError(f"parameters '{name}' and 'target_prior' are both of the same link; accepted: one")
    return KnownTarget(target.parameters, BodyDeviations(*stds).factor(target.parameters))


def another_body(gaussian: SquareRootInformation, variables: Variables, *, exchanged: bool) -> SquareRootInformation:
    """Return the gaussian with an unknown target, or with the same mass elsewhere in the grasp, and a new pose error.

    Parameters
    ----------
    gaussian : before
    variables : of the filter
    exchanged : whether it is another body, which brings or takes along a momentum of its own
    """
    own, opened = variables.first_unknown, variables.uninformative_deviation.copy()
    if not exchanged:
        opened[MOMENTUM] = opened[BODY.start] = 0.0
    places = np.flatnonzero(opened)
    return pose_reset(with_process_noise(gaussian, variables.from_state[:own, places] * opened[places]), variables)


@dataclass(frozen=True)
class TrackedTargetConfig:
    """Poses of a frame on the target, tracked before its capture."""

    position_std: float = parameter(0.0, 'm', minimum=0.0)
    """Standard deviation of each coordinate of a pose on target_pose; 0: estimated from the poses."""
    orientation_std: float = parameter(0.0, 'rad', minimum=0.0)
    """Standard deviation of its orientation about each axis; 0: estimated from the poses."""
    correlation_time: float = parameter(0.0, 's', minimum=0.0)
    """Time in which the correlation of the errors of these poses falls to 1/e; 0: estimated from the poses."""
    frame: tuple[float, ...] = parameter((), lengths=(0, 7))
    """Tracked frame in the target link's frame once grasped: x, y, z in m, and a quaternion x, y, z, w. Empty: by the
    poses and the robot at the capture; with capture.settling, by poses that go on after it."""

    @property
    def grasped_frame(self) -> GraspedFrame | None:
        """The tracked frame in that of the target link, where it is given.

        Raises ParameterError: Its quaternion is none.
        """
        if not self.frame:
            return None
        turn = np.array(self.frame[3:])
        length = float(np.linalg.norm(turn))
        if not abs(length - 1.0) < QUATERNION_TOLERANCE:
            raise ParameterError(f"parameter 'target.frame' ends with a quaternion of length {length:g}; accepted: 1")
        return GraspedFrame(rotation_from_quaternion(turn), np.array(self.frame[:3]))


@dataclass(frozen=True, eq=False)
class GraspedFrame:
    """The tracked frame in that of the target link."""

    rotation: Array  # (3, 3) to the link's axes
    position: Array  # (3,) m
    factor: Array | None = None  # (6, 6) of the covariance of turn and place, link axes, by the robot; None: as given


@dataclass(frozen=True)
class _Reading:
    """One pose as it came."""

    frame: str
    stamp: int  # ns
    position: Array
    rotation: Array


class TargetTrack:
    """The poses of the target as they come, and its motion at the capture.

    Attributes
    ----------
    dropped : messages that were not taken, by cause
    odometry_frame : name of the frame that locates the base
    frame : tracked frame in that of the target link, as given

    Parameters
    ----------
    prefix : of link names in frame names
    falling : frame that falls in an orbit, where one is declared
    """

    def __init__(self, config: TrackedTargetConfig, prefix: str, falling: FallingFrame | None = None) -> None:
        self._config, self._prefix, self._falling = config, prefix, falling
        self.frame = config.grasped_frame
        self._readings: list[_Reading] = []
        self.dropped: Counter[str] = Counter()
        self.odometry_frame = ''

    def __bool__(self) -> bool:
        """Whether there is a pose."""
        return bool(self._readings)

    def add(self, message: Any) -> None:
        """Add a PoseStamped, PoseWithCovarianceStamped or Odometry."""
        poses: Sequence[Any] = [message] if source_of(message) == 'odom' else list(_READER.read(message))
        for each in poses:
            shape = odometry_shape(each)
            (stamp,), (numbers,), *_ = shape.columns([each])
            length = float(np.linalg.norm(numbers[3:7]))
            if not (np.all(np.isfinite(numbers[:7])) and abs(length - 1.0) < QUATERNION_TOLERANCE):
                self.dropped[NOT_A_POSE] += 1
                continue
            turn = rotation_from_quaternion(numbers[3:7])
            self._readings.append(_Reading(shape.frame_id.lstrip('/'), int(stamp), numbers[:3], turn))
        del self._readings[:-_REMEMBERED]

    def flight(
        self, kernel: MomentumKernel, windows: Sequence[Samples], origin: int, end: float, capture: float
    ) -> tuple[FreeFlight | None, tuple[str, ...]]:
        """Return the free motion of the target at the capture, or None, with what to know about it.

        Parameters
        ----------
        windows : of the robot before the capture, in order
        origin : ns, stamp at time 0
        end, capture : s, until when the target was free, and when it was captured
        """
        track, notes = self._located(kernel, windows, origin, (end - _LONGEST, end))
        count = len(track.time)
        if count < FEWEST:
            few = f'{count} usable poses of the target before the capture, of {FEWEST} at least: {_UNUSED}'
            return None, (*notes, few)
        gap, span = capture - float(track.time[-1]), float(np.ptp(track.time))
        if gap > span:
            return None, (*notes, f'the poses of the target end {gap:.3g} s before the capture: {_UNUSED}')
        if gap > _LATE + capture - end:
            notes = (*notes, f'the poses of the target end {gap:.3g} s before the capture: its motion is predicted')
        track = replace(track, time=track.time - capture)
        if self._falling is not None:
            track = replace(track, gradient=partial(_gradient, self._falling, origin + round(capture * 1e9)))
        config = self._config
        declared = PoseNoise(config.position_std, config.orientation_std, (config.correlation_time,) * 2)
        try:
            flight = free_flight(track, declared)
        except np.linalg.LinAlgError:
            return None, (*notes, f'no free body moves as the poses of the target do: {_UNUSED}')
        excess = _excess(flight, track, declared)
        if excess > _DOUBTFUL and (reason := _not_free(track, declared, excess)):
            return None, (*notes, reason)
        if flight.dropped:
            notes = (*notes, f'{flight.dropped} of {count} poses of the target jump and are not used')
        return flight, notes

    def frame_in_hand(
        self,
        kernel: MomentumKernel,
        windows: Sequence[Samples],
        origin: int,
        times: tuple[float, float],
        noise: PoseNoise,
    ) -> GraspedFrame | None:
        """Return the tracked frame in that of the target link, by poses between two times, s; None of few."""
        track, _ = self._located(kernel, windows, origin, times)
        seen = [_frame_at(kernel, windows, float(time), kernel.target) for time in track.time]
        pairs = [
            (link[0].T @ rotation, link[0].T @ (position - link[1]))
            for link, rotation, position in zip(seen, track.rotation, track.position, strict=True)
            if link is not None
        ]
        if len(pairs) < FEWEST:
            return None
        turns, places = (np.array(each) for each in zip(*pairs, strict=True))
        away = log(np.swapaxes(turns[:1], 1, 2) @ turns)
        rotation = turns[0] @ exp(np.mean(away, axis=0))
        scatter = np.concatenate((log(turns @ rotation.T), places - np.mean(places, axis=0)), axis=1)
        square, count = np.sum(scatter**2, axis=0) / (len(pairs) - 1), np.full(6, float(len(pairs)))
        sizes = noise.position, noise.orientation
        for part, time, size in zip((slice(3, 6), slice(3)), noise.correlation_times, sizes, strict=True):
            if time > 0.0:  # slow errors hardly scatter, and few of them are independent
                square[part] = np.maximum(square[part], size**2)
                step = float(np.ptp(track.time)) / (len(track.time) - 1)
                count[part] = max(count[0] * np.tanh(0.5 * step / time), 1.0)
        std = np.sqrt(square / count)
        return GraspedFrame(rotation, np.mean(places, axis=0), np.diag(std))

    def _located(
        self, kernel: MomentumKernel, windows: Sequence[Samples], origin: int, part: tuple[float, float]
    ) -> tuple[Track, tuple[str, ...]]:
        """Return the poses between two times, s since the first sample, in the odometry frame or one that falls."""
        own = self.odometry_frame.lstrip('/')
        links = {self._prefix + link.name: link for link in kernel.model.links}
        found: dict[int, tuple[Array, Array]] = {}
        unknown: Counter[str] = Counter()
        first, end = part
        for reading in self._readings:
            time = (reading.stamp - origin) * 1e-9
            if not first < time <= end:
                continue
            if reading.frame == own:
                turn = np.eye(3) if self._falling is None else self._falling.turned(np.array([reading.stamp]))[0]
                found[reading.stamp] = turn @ reading.position, turn @ reading.rotation
            elif reading.frame in links:
                seen = _frame_at(kernel, windows, time, links[reading.frame])
                if seen is not None:
                    found[reading.stamp] = seen[1] + seen[0] @ reading.position, seen[0] @ reading.rotation
            else:
                unknown[reading.frame] += 1
        notes = tuple(
            f"{count} poses of the target are in the frame '{frame}', which is neither '{own}' nor that of a link"
            for frame, count in unknown.items()
        )
        self.dropped[OTHER_FRAME] = max(self.dropped[OTHER_FRAME], unknown.total())
        stamps = sorted(found)
        stamps = stamps[:: len(stamps) // _MOST + 1]
        times = np.array([(stamp - origin) * 1e-9 for stamp in stamps])
        position, rotation = (np.array([found[stamp][part] for stamp in stamps]) for part in (0, 1))
        return Track(times, position.reshape(-1, 3), rotation.reshape(-1, 3, 3)), notes


def _gradient(falling: FallingFrame, capture: int, time: Array) -> Array:
    """Return the gradients of gravity at times, s after the capture, whose stamp is given, ns."""
    return falling.gradient(capture + np.round(time * 1e9))


def _frame_at(kernel: MomentumKernel, windows: Sequence[Samples], time: float, link: Any) -> tuple[Array, Array] | None:
    """Return rotation and position of a link's frame at a time, s; None where no samples are."""
    window = next((each for each in windows if each.time[0] <= time <= each.time[-1]), None)
    if window is None or len(window) < 2:
        return None
    after = int(np.clip(np.searchsorted(window.time, time), 1, len(window) - 1))
    before = after - 1
    part = (time - window.time[before]) / (window.time[after] - window.time[before])
    turn = log(window.base_rotation[before].T @ window.base_rotation[after])
    base = window.base_rotation[before] @ exp(part * turn)
    place, joints = (
        each[before] + part * (each[after] - each[before]) for each in (window.base_position, window.joint_position)
    )
    rotation, position = kernel.kinematics.configure(base[None], joints[None]).link_pose(link)
    return rotation[0], place + position[0]


def _excess(flight: FreeFlight, track: Track, declared: PoseNoise) -> float:
    """Return by how many times the poses miss a free body's, in units of their noise."""
    local = track.local_noise
    noise = declared.position or max(local[0], 1e-12), declared.orientation or max(local[1], 1e-12)
    return max(flight.largest[0] / noise[0], flight.largest[1] / noise[1])


def _not_free(track: Track, declared: PoseNoise, excess: float) -> str:
    """Return why poses are not used that no free body has, with the cause where there is one; empty if they are."""
    text = f'the poses of the target miss those of a free body by {excess:.3g} times their noise'
    try:
        inverse = _excess(free_flight(track.inverse, declared), track.inverse, declared)
    except np.linalg.LinAlgError:
        inverse = np.inf
    if inverse < _FOR_SURE * excess:
        return f'{text}; inverted they fit: publish the target in the frame, not the frame in the target; {_UNUSED}'
    given = declared.position > 0.0 and declared.orientation > 0.0
    if excess < (_NOT_FREE if given else _NOT_FREE_BY_DIFFERENCES):
        return ''
    return f'{text} (something acts on it, another object, or stamps that are wrong): {_UNUSED}'


@dataclass(frozen=True, eq=False)
class TargetAtCapture:
    """The target just before its capture, and the robot that captured it."""

    time: float  # s since the first sample
    flight: FreeFlight
    kernel: MomentumKernel  # of the robot, its target link with its own inertia
    sample: Samples  # one, of the robot at the capture
    momentum: Array  # (6,) (P, L) of the robot before it, odometry frame, L about its origin
    factor: Array  # (6, w) of its covariance
    # how that momentum depends on an unknown's independent numbers, (6, e)
    momentum_columns: Callable[[Unknown], Array]
    rigid: bool = True  # whether the grasp held from the capture on
    frame: GraspedFrame | None = None  # the tracked frame in that of the link, once grasped

    @property
    def grasp_known(self) -> bool:
        """Whether it is known how the link holds the body that was tracked."""
        return self.rigid or self.frame is not None

    @cached_property
    def link(self) -> tuple[Array, Array]:
        """Rotation (3, 3) and position (3,) m of the target link's frame at the capture, odometry frame.

        With a known tracked frame it is where the body, once grasped, has the link.
        """
        if self.frame is None:
            return _link_pose(self.kernel, self.sample)
        rotation = self.flight.rotation @ self.frame.rotation.T
        return rotation, _origin_of(self.flight) - rotation @ self.frame.position

    @property
    def distance_from_robot(self) -> Array:
        """How far that is from where the robot has it, rad and m; nan without such a frame."""
        if self.frame is None:
            return np.full(2, np.nan)
        (turned, placed), (rotation, position) = self.link, _link_pose(self.kernel, self.sample)
        return np.array((np.linalg.norm(log(turned @ rotation.T)), np.linalg.norm(placed - position)))

    @cached_property
    def link_by_flight(self) -> Array:
        """Factor (6, 20) of turn and place of the link by the same errors as in `measured`."""
        by_flight = np.zeros((6, len(self._flight_factor)))
        if self.frame is None:
            return by_flight
        arm = self.flight.rotation @ self.flight.lever
        from_link = self.link[0] @ self.frame.position
        by_flight[:3, TURN] = by_flight[3:, CENTRE] = np.eye(3)
        by_flight[3:, TURN], by_flight[3:, LEVER] = skew(from_link - arm), self.flight.rotation
        return by_flight @ self._flight_factor

    @cached_property
    def _flight_factor(self) -> Array:
        return np.linalg.cholesky(self.flight.covariance)

    def link_columns(self, unknown: Unknown) -> Array:
        """Return how turn (rad) and place (m) of the link depend on an unknown's independent numbers, (6, e)."""
        rotation, position = _link_pose(self.kernel, self.sample)
        columns = np.zeros((6, unknown.count))
        if self.frame is not None and self.frame.factor is None:
            return columns
        for place in range(unknown.count):
            value = 1e-3 * unknown.factor[:, place]
            moved = unknown.applied_to(NominalModel.nominal(self.kernel), value)
            there = _link_pose(moved.kernel, moved.corrected(self.sample))
            columns[:3, place], columns[3:, place] = log(there[0] @ rotation.T), there[1] - position
        return columns * 1e3

    @cached_property
    def link_factor(self) -> Array:
        """Factor (6, 6) of the covariance of turn and place of the link, by the noise of the base's pose.

        Of a tracked frame that poses after the capture have: by theirs.
        """
        if self.frame is not None:
            if self.frame.factor is None:
                return np.zeros((6, 6))
            rotation, _ = self.link
            by_frame = np.zeros((6, 6))
            by_frame[:3, :3] = by_frame[3:, 3:] = -rotation
            by_frame[3:, :3] = -skew(rotation @ self.frame.position) @ rotation
            return by_frame @ self.frame.factor
        covariance = self.sample.pose_covariance[0]
        by_pose = np.zeros((6, 6))
        by_pose[:3, 3:] = by_pose[3:, :3] = np.eye(3)
        by_pose[3:, 3:] = -skew(self.link[1] - self.sample.base_position[0])
        return np.asarray(by_pose @ np.linalg.cholesky(covariance))

    @cached_property
    def measured(self) -> tuple[Array, Array]:
        """The numbers of the motion, (17,), with a factor of their covariance."""
        flight, place = self.flight, self.link[1]
        step = 1e-6 * np.eye(flight.rows.shape[1] - 1)
        forward, back = (
            np.array([_motion_of(flight.moved(sign * each), place) for each in step]) for sign in (1.0, -1.0)
        )
        derivative = (forward - back).T / 2e-6
        return _motion_of(flight, place), np.asarray(derivative @ self._flight_factor)

    def selection(self, plane: Array | None) -> tuple[Array, Array]:
        """Return the (k, 17) numbers that the motion determines, whitened, and those alone: W (motion - measured).

        Second, the names of the groups that are used, as flags (velocity and spin, centre of mass, ratios).

        Parameters
        ----------
        plane : (3, 6) equations that hold in a plane, None in space
        """
        _, factor = self.measured
        covariance = factor @ factor.T
        if not self.grasp_known:
            free = np.zeros((3, _NUMBERS))
            free[:, _VELOCITY] = np.eye(3)
            return _white(free if plane is None else plane[:2, :3] @ free, covariance), np.array([True, False, False])
        linear, angular = (np.eye(3), np.eye(3)) if plane is None else (plane[:2, :3], plane[2:, 3:])
        centre = linear @ covariance[_CENTRE, _CENTRE] @ linear.T
        values, directions = np.linalg.eigh(centre)
        sharp = values < _SHARP_CENTRE**2
        if not sharp.all():
            # A tight direction is known as well as that of the spin, which turns it by the wide ones.
            spin = self.measured[0][_SPIN]
            turn = np.trace(covariance[_SPIN, _SPIN]) / max(float(spin @ spin), 1e-12)
            covariance[_CENTRE, _CENTRE] += turn * values[-1] * np.eye(3)
        ratios = covariance[_RATIOS, _RATIOS]
        shaped = plane is None and float(np.linalg.eigvalsh(ratios)[-1]) < _SHARP_RATIOS**2
        blocks = ((_POINT, linear), (_SPIN, angular), (_CENTRE, directions[:, sharp].T @ linear))
        parts = [*blocks, *([(_RATIOS, np.eye(5))] if shaped else [])]
        rows = np.zeros((sum(len(each) for _, each in parts), _NUMBERS))
        place = 0
        for where, each in parts:
            rows[place : place + len(each), where] = each
            place += len(each)
        return _white(rows, covariance), np.array([True, bool(sharp.any()), shaped])

    def with_other_poses(self, change: Array) -> TargetAtCapture:
        """Return the target by other poses: all turned (3 numbers, rad), larger (relative), later (s): (5,).

        Turned and larger about the odometry frame's origin.
        """
        flight, turned, larger, time = self.flight, exp(change[:3]), 1.0 + change[3], float(change[4])
        spin, inertia = flight.spin, flight.inertia
        moved = replace(
            flight,
            rotation=turned @ flight.rotation @ exp(time * spin),
            centre=turned @ (larger * (flight.centre + time * flight.velocity)),
            velocity=turned @ (larger * flight.velocity),
            spin=spin + time * np.linalg.solve(inertia, cross(inertia @ spin, spin)),
            lever=larger * flight.lever,
        )
        return replace(self, flight=moved)

    def motion_jacobian(self, change: Array) -> Array:
        """Return how the numbers of the motion depend on such a change, (17, 5)."""
        place, steps = self.link[1], 1e-5 * np.eye(len(change))
        ahead, back = (
            np.array([_motion_of(self.with_other_poses(change + sign * each).flight, place) for each in steps])
            for sign in (1.0, -1.0)
        )
        return (ahead - back).T / 2e-5

    def motion(self) -> Array:
        """Return velocity of the centre of mass and spin before the capture, with standard deviations, (4, 3)."""
        values, factor = self.measured
        std = np.sqrt(np.sum(factor**2, axis=1))
        return np.array([values[_VELOCITY], std[_VELOCITY], values[_SPIN], std[_SPIN]])

    def guess(self, mass: float) -> tuple[Array, Array]:
        """Return a body (10,) with the target link and a momentum (6,) of the whole that have the motion, of a mass."""
        values, _ = self.measured
        _, (_, centred, shaped) = self.selection(None) if self.grasp_known else (None, (True, False, False))
        rotation, position = self.link
        centre = values[_CENTRE] if centred else position
        ratios = np.eye(3) + (np.tensordot(values[_RATIOS], RATIOS, axes=1) if shaped else 0.0)
        inertia = mass * _GUESSED_RADIUS**2 * ratios
        velocity = values[_POINT] + cross(values[_SPIN], centre - position)
        linear = mass * velocity
        angular = cross(centre, linear) + inertia @ values[_SPIN]
        own = np.concatenate(([mass], rotation.T @ (centre - position), vec(rotation.T @ inertia @ rotation)))
        body = standard(own) + self.kernel.target.parameters
        return body, self.momentum + np.concatenate((linear, angular))


def _wrong_scale(sizes: Array) -> str:
    times = 1.0 / (1.0 + sizes[0])  # they are divided by that
    return (
        f'lengths in the poses of the target are {times:.3g} times the true ones: check the size of its marker or model'
    )


def _late_stamps(sizes: Array) -> str:
    word = 'late' if sizes[0] > 0.0 else 'early'
    return f'the stamps of the poses of the target are {abs(sizes[0]):.2g} s {word}: stamp them when the image is taken'


def _turned_frame(sizes: Array) -> str:
    degrees = np.rad2deg(np.linalg.norm(sizes))
    return f"the frame of the target's poses is turned by {degrees:.2g} deg: check how the camera is mounted"


# Errors of all poses: the numbers of the change (turn, scale, time) that mends them, and the words for their sizes.
_ERRORS_OF_POSES: tuple[tuple[list[int], Callable[[Array], str]], ...] = (
    ([3], _wrong_scale),
    ([4], _late_stamps),
    ([0, 1, 2], _turned_frame),
)


def _origin_of(flight: FreeFlight) -> Array:
    """Return the tracked frame's origin at the capture, (3,) m."""
    return np.asarray(flight.centre + flight.rotation @ flight.lever)


def _motion_of(flight: FreeFlight, place: Array) -> Array:
    """Return the numbers of a motion, (17,), with the velocity of the body's point at a place (3,) m."""
    spin = flight.rotation @ flight.spin
    ratios = flight.rotation @ flight.inertia @ flight.rotation.T
    point = flight.velocity + cross(spin, place - flight.centre)
    return np.concatenate((point, spin, flight.centre, np.tensordot(RATIOS, ratios, axes=2), flight.velocity))


def _link_pose(kernel: MomentumKernel, sample: Samples) -> tuple[Array, Array]:
    """Return rotation and position of the target link's frame in the odometry frame in one sample."""
    configuration = kernel.kinematics.configure(sample.base_rotation, sample.joint_position)
    rotation, position = configuration.link_pose(kernel.target)
    return rotation[0], sample.base_position[0] + position[0]


def _white(rows: Array, covariance: Array) -> Array:
    return np.asarray(np.linalg.solve(np.linalg.cholesky(rows @ covariance @ rows.T), rows))


@dataclass(frozen=True, eq=False)
class _Weights:
    """A body's numbers by which misfits of momenta are divided: mass, trace of inertia about its centre, (6, 6)."""

    mass: float
    trace: float
    back: Array


@dataclass(frozen=True, eq=False)
class CaptureRows:
    """The rows of conservation across the capture, in the filter's variables: predicted less measured motion.

    The momentum of the whole less that of the robot is the body's, at its measured motion linear in the ten parameters.
    Errors of the motion are weighed with the body's own inertia, at the point of linearisation.
    """

    target: TargetAtCapture
    layout: Layout
    origin: Array  # (3,) m, that the state's angular momentum is about, odometry frame

    @property
    def grasp_known(self) -> bool:
        """Whether it is known how the link holds the body."""
        return self.target.grasp_known

    @cached_property
    def _selected(self) -> Array:
        return self.target.selection(self.layout.plane)[0]

    @cached_property
    def _by_state(self) -> Array:
        """How the predicting numbers depend on the state, (28, s)."""
        layout, target = self.layout, self.target
        matrix = np.zeros((_ROBOT.stop, layout.size))
        matrix[_WHOLE, LINEAR.start : ANGULAR.stop] = np.eye(6)
        matrix[3:6, LINEAR] = skew(self.origin)
        matrix[_BODY, BODY] = np.eye(10)
        for unknown, place in zip(layout.unknowns, layout.places, strict=True):
            matrix[_LINK, place] = target.link_columns(unknown)
            matrix[_ROBOT, place] = target.momentum_columns(unknown)
        return matrix

    @property
    def _at_zero(self) -> Array:
        """The predicting numbers of a state of zeros, (28,)."""
        values = np.zeros(_ROBOT.stop)
        values[_BODY], values[_ROBOT] = -self.target.kernel.target.parameters, self.target.momentum
        return values

    def at(self, point: Point, variables: Variables) -> Array:
        """Return the (k, v + 1) rows of unit variance, values last, linearised at a point.

        Raises LinAlgError: The body there cannot be captured.
        """
        state = point.state
        value, by_numbers, _ = self._motion_rows(state)
        if self.layout.plane is None:  # a plane determines its one moment of inertia
            of_size, by_size = self._size(self._at_zero + self._by_state @ state)
            value, by_numbers = np.concatenate((value, of_size)), np.concatenate((by_numbers, by_size))
        rows = variables.rows(by_numbers @ self._by_state)
        return np.column_stack((rows, rows @ (variables.from_state @ state) - value))

    def pose_error(self, mean: Array, factor: Array) -> str:
        """Return which error of the poses explains their contradiction with a state; empty if none does.

        Raises LinAlgError: The body there cannot be captured.

        Parameters
        ----------
        mean, factor : (s,), (s, w) of the state and its covariance, without these rows
        """
        misfit, _ = self.normalised_misfit(mean, factor)
        if float(misfit @ misfit) < chi_square_limit(_BY_CHANCE, len(misfit)):
            return ''
        found = []
        for places, text in _ERRORS_OF_POSES:
            change: Array = np.zeros(5)
            for _ in range(_STEPS_OF_CHANGE):
                there = replace(self, target=self.target.with_other_poses(change))
                misfit, whitening = there.normalised_misfit(mean, factor)
                by_change = whitening @ self.target.motion_jacobian(change)[:, places]
                change[places] += np.linalg.lstsq(by_change, misfit)[0]
            left = float(misfit @ misfit)
            if left < chi_square_limit(_BY_CHANCE, len(misfit) - len(places)):
                found.append((left + 2.0 * len(places), text(change[places])))
        likely = min(found, default=(0.0, ''))[0] + _AS_LIKELY
        return ', or '.join(text for size, text in sorted(found) if size < likely)

    def normalised_misfit(self, mean: Array, factor: Array) -> tuple[Array, Array]:
        """Return by how many standard deviations the motion misses a state, (k,), and what made them so, (k, 17).

        Parameters
        ----------
        mean, factor : as of `pose_error`
        """
        value, by_numbers, root = self._motion_rows(mean)
        seen = by_numbers @ self._by_state @ factor
        white = np.linalg.cholesky(np.eye(len(value)) + seen @ seen.T)
        return np.linalg.solve(white, value), np.linalg.solve(root @ white, self._selected)

    def _motion_rows(self, state: Array) -> tuple[Array, Array, Array]:
        """Return the misfits (k,) in units of their noise, their derivatives (k, 28), and what W was divided by.

        Raises LinAlgError: The body there cannot be captured.
        """
        target = self.target
        misfit, by_numbers = self._misfit(self._at_zero + self._by_state @ state)
        value, by_numbers = self._selected @ misfit, self._selected @ by_numbers
        noise = np.column_stack((by_numbers[:, _LINK] @ target.link_factor, by_numbers[:, _ROBOT] @ target.factor))
        # Errors of the flight move the link with the motion: W measured has unit variance, so far.
        own, moved = self._selected @ target.measured[1], by_numbers[:, _LINK] @ target.link_by_flight
        shared = moved @ moved.T - own @ moved.T - moved @ own.T
        root = np.linalg.cholesky(np.eye(len(noise)) + noise @ noise.T + shared)
        return np.linalg.solve(root, value), np.linalg.solve(root, by_numbers), root

    def _misfit(self, numbers: Array) -> tuple[Array, Array]:
        """Return by how much the measured motion is short of the predicted one, (17,), and its derivatives (17, 28)."""
        body = numbers[_BODY]
        if not body[0] > 0.0:
            raise np.linalg.LinAlgError('a captured body without mass')
        moved = self._linear_misfit(numbers + 1j * _TINY * np.eye(len(numbers)), self._held(body))
        return moved[0].real, moved.imag.T / _TINY

    def _size(self, numbers: Array) -> tuple[Array, Array]:
        """Return the misfit (6,) of the inertia about the centre of mass with any plausible one, and derivatives.

        Without, directions that neither ratios nor momentum determine would lead to bodies that cannot exist.
        """
        body = numbers[_BODY]
        derivative = np.zeros((6, len(numbers)))
        scale = body[0] * _LARGEST_RADIUS**2
        derivative[:, _BODY] = physical_jacobian(body)[4:] / scale
        usual = body[0] * _GUESSED_RADIUS**2 * vec(np.eye(3))
        return (physical(body)[4:] - usual) / scale, derivative

    def _held(self, body: Array) -> _Weights:
        """Return what turns misfits of momenta into those of the motion, for a body (10,)."""
        rotation, _ = self.target.link
        turned = rotation @ unvec(body[4:]) @ rotation.T
        arm = skew(rotation @ body[1:4])
        matrix = np.block([[body[0] * np.eye(3), -arm], [arm, turned]])
        select = np.eye(6) if self.layout.plane is None else self.layout.plane
        back = select.T @ np.linalg.solve(select @ matrix @ select.T, select)
        trace = float(np.sum(physical(body)[[4, 7, 9]]))
        return _Weights(float(body[0]), trace if trace > 0.0 else 1.0, back)

    def _linear_misfit(self, numbers: Array, fixed: _Weights) -> Array:
        """Return the misfits (S, 17) of the motion with numbers (S, 28), complex or not.

        It is linear in momentum and body but for the inertia about its centre of mass.
        """
        rotation, position = self.target.link
        measured, _ = self.target.measured
        body, link = numbers[:, _BODY], numbers[:, _LINK]
        turned = rotation + skew_of(link[:, :3]) @ rotation
        mass, moved = body[:, :1], skew_of(link[:, 3:])
        first = rotate(turned, body[:, 1:4])
        # About the link's place as it is taken to be.
        about_link = turned @ _symmetric(body[:, 4:]) @ np.swapaxes(turned, 1, 2)
        about_link = about_link - skew_of(first) @ moved - moved @ skew_of(first)
        first = first + mass * link[:, 3:]
        arm = skew_of(first)
        velocity, spin = measured[_POINT], measured[_SPIN]
        came = numbers[:, _WHOLE] - numbers[:, _ROBOT]
        linear = came[:, :3] - mass * velocity + arm @ spin
        angular = came[:, 3:] - came[:, :3] @ skew(position).T - arm @ velocity - about_link @ spin
        short = np.concatenate((linear, angular), axis=1) @ fixed.back.T
        centre = (first - mass * (measured[_CENTRE] - position)) / fixed.mass
        inertia = about_link + arm @ arm / mass[:, :, None]
        share = np.tensordot(3.0 * inertia, RATIOS, axes=((1, 2), (1, 2)))
        share = share - np.trace(inertia, axis1=1, axis2=2)[:, None] * measured[_RATIOS]
        by_speed = (came[:, :3] - mass * measured[_VELOCITY]) / fixed.mass
        return np.concatenate((short, centre, share / fixed.trace, by_speed), axis=1)

    def point(self, mass: float) -> Point:
        """Return where a search begins, with a captured body of some mass."""
        body, momentum = self.target.guess(mass)
        momentum[3:] -= cross(self.origin, momentum[:3])
        return self.layout.point(self.layout.state(body, momentum))


def skew_of(vector: Array) -> Array:
    """Return [a]x (S, 3, 3) of (S, 3), complex or not."""
    matrix = np.zeros((*vector.shape, 3), vector.dtype)
    for row, column, part in ((2, 1, 0), (0, 2, 1), (1, 0, 2)):
        matrix[:, row, column], matrix[:, column, row] = vector[:, part], -vector[:, part]
    return matrix


def _symmetric(elements: Array) -> Array:
    """Return the matrices (S, 3, 3) of their elements (S, 6) (xx, xy, xz, yy, yz, zz), complex or not."""
    return elements[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
