"""Further poses by name (star tracker, camera, motion capture): messages, parameters, errors, rows in the filter."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from itertools import combinations
from typing import Any, ClassVar, NamedTuple

import numpy as np

from mbaid_ros.core.clocks import LATE
from mbaid_ros.core.contracts import (
    Carried,
    Course,
    Instrument,
    Linear,
    Motion,
    Observation,
    Words,
    deviation_text,
    diagonal,
)
from mbaid_ros.core.geometry import Array, Flags, Integers, exp, log, rotate, skew
from mbaid_ros.core.noise import FoundNoise
from mbaid_ros.core.odometry.faults import (
    CONTRADICTS,
    Meanings,
    RateCheck,
    RateMotion,
    likeliest,
    spread,
    turn_between,
)
from mbaid_ros.core.odometry.model import MarkerConfig, marker_frame
from mbaid_ros.core.odometry.stream import AttachedFrame, OdometryReader, PoseReader, orientation_only, source_of
from mbaid_ros.core.outliers import OUTLIER, ResidualGate
from mbaid_ros.core.repair import Repair, Setting, numbers, widened, wider_prior
from mbaid_ros.core.robot.model import Kinematics, Link, RobotModel, sensor_link
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import BasePose, BaseStream, Input, Packets, Samples, SensorNoise, Stamps, block_std
from mbaid_ros.core.windows import ANGULAR_FIRST, Window, knot_poses
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import by_name, named_groups, parameter

POSE_TYPES = (
    'nav_msgs/msg/Odometry',
    'geometry_msgs/msg/PoseStamped',
    'geometry_msgs/msg/PoseWithCovarianceStamped',
    'geometry_msgs/msg/TransformStamped',
    'geometry_msgs/msg/QuaternionStamped',
)
MEASURES = ('position', 'orientation', 'both')
_ROWS = {'position': np.arange(3, 6), 'orientation': np.arange(3), 'both': np.arange(6)}  # of a pose error
MOUNT, WORLD, DELAY, SCALE, WANDER = 'pose mount', 'pose world', 'pose delay', 'pose scale', 'pose wander'
TURNING, DRIFT = 'pose turning', 'pose drift'
_ASSUMED = np.array([1e-3, 1e-4])  # m, rad, of a sensor of which nothing is declared and too little is read
EARLY = 'pose much sooner than usual after the one before'
NO_SAMPLE = 'no sample around the stamp of a pose'
# Part of the least time between two readings so far, before which samples do not wait for the next one.
_SOONEST = 0.9
_PATIENCE = 1_000_000_000  # ns: a sensor that is further behind the joints has stopped
# rad, m: how far off the first reading may place the sensor's world; no prior, in effect.
_WORLD_TURN, _WORLD_SHIFT = 0.05, 0.3
_STENCIL = 4  # knots that the motion between two is interpolated from
REFERENCE_GAP = 2.5  # s, between poses that a gyro fills: two readings at .5 Hz
_TURNED = 0.2  # rad, from which the axes of a sensor are others: no declared mount is as far off
_OFF = 0.02  # part of the motion that declared errors and the time between reading and sample may make
_MILLIMETRE = 1e-3  # m: a unit
_COUNT, _TIME, _ROTATION, _POSITION, _COVARIANCE = 0, 1, slice(2, 11), slice(11, 14), slice(14, 50)
_WIDTH = 50  # columns of the sums over readings
_NO_ROTATION = (0.0, 0.0, 0.0, 1.0)  # quaternion x, y, z, w of a position alone


@dataclass(frozen=True)
class NamedPoseConfig:
    """A sensor of the base's pose or a part of it."""

    measures: str = parameter('both', choices=MEASURES)
    """What it measures: position, orientation, or both."""
    frame: str = parameter('')
    """Link that it locates: of the base or moved by joints, such as the target. Empty: child_frame_id of the messages,
    or the base link. A marker is placed in its frame."""
    marker: MarkerConfig = field(default_factory=MarkerConfig)
    position_std: float = parameter(0.0, 'm', minimum=0.0)
    """Standard deviation of each coordinate of a position, where the messages carry no covariance; 0: found in the
    readings, or, below 5 Hz, .001."""
    orientation_std: float = parameter(0.0, 'rad', minimum=0.0)
    """Standard deviation of an orientation about each axis, where the messages carry no covariance; 0: found in the
    readings, or, below 5 Hz, 1e-4."""
    correlation_time: float = parameter(0.0, 's', minimum=0.0)
    """Time over which its errors are correlated; needs its deviations. 0: white noise."""
    mount_position_std: float = parameter(2e-3, 'm', minimum=0.0)
    """Standard deviation of each coordinate of its place on the base; 0: exact."""
    mount_orientation_std: float = parameter(2e-3, 'rad', minimum=0.0)
    """Standard deviation of its alignment on the base about each axis; 0: exact."""
    time_offset_std: float = parameter(5e-3, 's', minimum=0.0)
    """Prior standard deviation of the delay of its stamps; 0: exact."""
    scale_std: float = parameter(1e-3, minimum=0.0)
    """Relative standard deviation of the lengths that it measures; 0: exact."""
    turning_std: float = parameter(1e-6, 'rad/s', minimum=0.0)
    """Standard deviation of the drift of the orientation that it measures, about each axis, as of a world frame that
    turns; 0: it does not drift."""
    same_world: bool = parameter(default=False)
    """Whether its world frame is that of the odometry. Otherwise the constant turn and displacement between the two are
    unknown, and found from the data. With poses.alone, the first sensor of the position and the first of the
    orientation have one world: align them."""
    use: bool = parameter(default=True)
    """Whether it is used."""


@dataclass(frozen=True)
class PosesConfig:
    """Further sensors of the base's pose beside odometry."""

    names: tuple[str, ...] = parameter(())
    """Further poses, each on the topic of its name: Odometry (without its twist), PoseStamped,
    PoseWithCovarianceStamped, TransformStamped or QuaternionStamped."""
    alone: bool = parameter(default=False)
    """Nothing else locates the base: odom and pose are ignored. One of poses.names has to measure the orientation.
    Without a position, linear momentum and mass are unobservable. Only for method trajectory."""
    each: Mapping[str, Mapping[str, Any]] = by_name(NamedPoseConfig, 'name')

    @property
    def without_frames(self) -> PosesConfig:
        """The same on any robot."""
        each = {name: {key: value for key, value in own.items() if key != 'frame'} for name, own in self.each.items()}
        return replace(self, each=each)

    @property
    def used(self) -> dict[str, NamedPoseConfig]:
        """Those in use by their names.

        Raises ParameterError: A name is taken, given twice or no topic's.
        """
        found = named_groups(NamedPoseConfig, 'poses', self.names, self.each)
        return {name: own for name, own in found.items() if own.use}

    def measuring(self, part: str) -> list[str]:
        """Return the names of those that measure a part of the pose: 'position' or 'orientation'."""
        return [name for name, own in self.used.items() if own.measures in (part, 'both')]


def pose_inputs(config: PosesConfig) -> dict[str, Input]:
    """Return the topics of poses by the names of their parameters."""
    return {f'poses.{name}': Input(name, POSE_TYPES, slow=True) for name in config.used}


class NamedPoseReader:
    """Reads the messages of one sensor: Odometry, poses, transforms or quaternions.

    Parameters
    ----------
    measures : as of the parameters
    frame : child frame of messages that name none
    reader : of poses
    """

    def __init__(self, measures: str, frame: str, reader: OdometryReader) -> None:
        self._measures = measures
        self._poses, self._reader = PoseReader(frame, ''), reader

    @property
    def other_frame(self) -> str:
        """The latest frame that is no link on the base; empty if there was none."""
        return self._reader.other_child_frame

    def read(self, messages: Sequence[Any]) -> tuple[BaseStream | None, Counter[str]]:
        """Return the measurements, and the numbers of dropped messages by cause."""
        return self._reader.read([pose for message in messages for pose in self._read(message)])

    def _read(self, message: Any) -> list[Any]:
        if isinstance(message, Packets) or source_of(message) == 'odom':
            return [message]
        return [self._measured(pose) for pose in self._poses.read(message)]

    def _measured(self, pose: BasePose) -> BasePose:
        """Return a pose without the part that is not measured."""
        numbers = pose.numbers
        if self._measures == 'position':
            numbers = (*numbers[:3], *_NO_ROTATION)
        elif self._measures == 'orientation':
            numbers = (0.0, 0.0, 0.0, *numbers[3:])
        return replace(pose, numbers=numbers)


class PoseCollector:
    """Sums the readings of one sensor up to each sample; the result does not depend on how the stream is cut.

    Parameters
    ----------
    maximum_gap : ns, that a reading may be before the first sample after it
    measures : as of the parameters
    view : transforms measurements of the odometry's world to an inertial frame; None of another world, or where it is
        one
    located : returns orientations (N, 3, 3) and positions (N, 3), m, of the frame that it locates, at samples
    found : whether levels of position and orientation are found in readings without a covariance

    Attributes
    ----------
    newest : ns, stamp of the latest reading; None before the first
    dropped : readings that were not used, by cause
    """

    field = 'readings'
    on_base = False  # it is no gyro

    def __init__(
        self,
        maximum_gap: int,
        measures: str,
        *,
        same_world: bool,
        view: Callable[[BaseStream], BaseStream] | None = None,
        located: Callable[[Samples], tuple[Array, Array]] | None = None,
        found: tuple[bool, bool] = (False, False),
    ) -> None:
        self._gate, self._found = ResidualGate(2), np.array(found)
        self._noise = FoundNoise(_ASSUMED)
        self._maximum_gap, self._measures, self._view = maximum_gap, measures, view
        self._located = located or (lambda samples: (samples.base_rotation, samples.base_position))
        self._world: tuple[Array, Array] | None = (
            (np.eye(3), np.zeros(3)) if same_world else None
        )  # turn and displacement from the odometry's
        self._pending: BaseStream | None = None
        self._first: Array | None = None  # (3, 3) orientation of the first reading
        self._least = np.iinfo(np.int64).max  # ns, between two readings
        self._taken = np.iinfo(np.int64).min  # stamp of the last sample
        self.newest: int | None = None
        self.dropped: Counter[str] = Counter()

    def push(self, stream: BaseStream | None) -> None:
        """Add readings in the order of their stamps."""
        if stream is None or not len(stream.stamp):
            return
        early = self._early(stream.stamp)
        late = (stream.stamp <= self._taken) & ~early
        self.dropped[LATE] += int(np.sum(late))
        self.dropped[EARLY] += int(np.sum(early))
        stream = stream[~(late | early)]
        if len(stream.stamp):
            stream = stream if self._view is None else self._view(stream)
            stream = self._with_noise(stream) if self._found.any() else stream
            self._pending = stream if self._pending is None else BaseStream.concatenate([self._pending, stream])

    def _early(self, stamp: Stamps) -> Flags:
        """Return which readings come sooner than samples wait for them, (N,)."""
        early = np.zeros(len(stamp), dtype=bool)
        for place, each in enumerate(stamp.tolist()):
            if self.newest is not None:
                early[place] = each - self.newest < _SOONEST * self._least < np.iinfo(np.int64).max / 2
                self._least = min(self._least, each - self.newest)
            self.newest = each
        return early

    def complete_until(self, joints: int) -> int:
        """Return the last stamp (ns) until which no more readings come; `joints` is the latest stamp of these."""
        silent = joints - _PATIENCE
        if self.newest is None:
            return silent
        due = self.newest + (int(_SOONEST * self._least) - 1 if self._least < np.iinfo(np.int64).max / 2 else 0)
        return max(due, silent)

    def forget_before(self, stamp: int) -> None:
        """Do nothing: readings are forgotten with the samples that they belong to."""

    def columns(self, samples: Samples, stamps: Stamps) -> Array:
        """Return the sums (N, c) over the readings since the sample before, for samples in order."""
        sums = np.zeros((len(stamps), _WIDTH))
        self._taken = int(stamps[-1]) if len(stamps) else self._taken
        if self._pending is None or not len(stamps):
            return sums
        count = int(np.searchsorted(self._pending.stamp, stamps[-1], side='right'))
        read, self._pending = self._pending[:count], self._pending[count:]
        place = np.searchsorted(stamps, read.stamp, side='left')
        near = stamps[place] - read.stamp <= self._maximum_gap
        self.dropped[NO_SAMPLE] += int(np.sum(~near))
        read, place = read[near], place[near]
        if not len(place):
            return sums
        rotation, position, covariance = self._in_world(read, samples, int(place[0]))
        good = ~self._outlying(rotation, position, covariance, samples[place])
        self.dropped[OUTLIER] += int(np.sum(~good))
        rotation, position, covariance = rotation[good], position[good], covariance[good]
        read, place = read[good], place[good]
        each = np.empty((len(place), _WIDTH))
        origin = int(stamps[0]) - round(1e9 * float(samples.time[0]))
        each[:, _COUNT], each[:, _TIME] = 1.0, (read.stamp - origin) * 1e-9
        each[:, _ROTATION], each[:, _POSITION] = rotation.reshape(-1, 9), position
        each[:, _COVARIANCE] = covariance.reshape(-1, 36)
        np.add.at(sums, place, each)
        return sums

    def _with_noise(self, stream: BaseStream) -> BaseStream:
        """Return readings with the noise found so far, where their messages have none."""
        if self._first is None:
            self._first = stream.rotation[0]
        turns = log(self._first.T @ stream.rotation)
        levels = self._noise.levels(stream.stamp, np.concatenate((stream.position, turns), axis=1))
        covariance = stream.pose_covariance.copy()
        for part, own in enumerate((slice(0, 3), slice(3, 6))):
            which = ~stream.declared[:, part] & self._found[part]
            covariance[which, own, own] = levels[which, part, None, None] ** 2 * np.eye(3)
        return replace(stream, pose_covariance=covariance)

    def _outlying(self, rotation: Array, position: Array, covariance: Array, samples: Samples) -> Flags:
        """Return which readings leave the motion of samples, (N,)."""
        turned, there = self._located(samples)
        turns = log(rotation @ np.swapaxes(turned, -1, -2))
        residual = np.stack((position - there, turns), axis=1)
        measured = [self._measures != 'orientation', self._measures != 'position']
        return self._gate.outliers(residual * np.array(measured)[:, None], block_std(covariance))

    def _in_world(self, read: BaseStream, samples: Samples, place: int) -> tuple[Array, Array, Array]:
        """Return orientations, positions and covariances in the odometry's world, which the first reading places."""
        if self._world is None:
            turn: Array = np.eye(3)
            rotation, position = (each[0] for each in self._located(samples[place : place + 1]))
            if self._measures != 'position':
                turn = read.rotation[0] @ rotation.T
            self._world = turn, read.position[0] - turn @ position
        turn, shift = self._world
        axes = np.zeros((6, 6))
        axes[:3, :3] = axes[3:, 3:] = turn
        # Sums over axes: products of matrices show the size of the batch in the last bit.
        covariance = np.einsum('ji,njk,kl->nil', axes, read.pose_covariance, axes)
        rotation = np.einsum('ji,njk->nik', turn, read.rotation)
        return rotation, np.einsum('ji,nj->ni', turn, read.position - shift), covariance


@dataclass(frozen=True, eq=False)
class PoseSensor:
    """A pose, or a part of it, with stamps of its own, as a sensor: compared with the base's pose between knots."""

    name: str
    measures: str
    columns: slice  # of its sums in `Samples.readings`
    lever: Array = field(default_factory=lambda: np.zeros(3))  # m, in axes of its link, of a point without a turn
    noise: Mapping[str, float] = field(default_factory=dict)  # by the names of parameters
    link: Link | None = None  # that it locates, where joints move it; None on the base
    moved_by: Array = field(default_factory=lambda: np.zeros(0))  # (n,) 1 of each joint that moves this link, else 0
    correlation_time: float = 0.0  # s, of its errors

    of_pose = True

    @property
    def leave_out(self) -> Mapping[str, Setting]:
        """The parameter that leaves it out."""
        return {f'{self.name}.use': False}

    def without(self, window: Window) -> Window:
        """Return a window in which it has read nothing."""
        return _without_readings(window, self.columns.start, self.columns.stop)

    @property
    def of_base(self) -> Array:
        """The parts of the pose error that it measures."""
        return np.eye(6)[_ROWS[self.measures]]

    def observed(self, course: Course, base: Motion) -> Observation:
        """Return by how much its readings in windows are off the knots, in the mean."""
        groups, place, weights = self._groups(course)
        own, inside, count = course.stack.windows[0].inside, course.inside, groups[..., _COUNT]
        share, some = count / np.maximum(np.sum(count, axis=0), 1.0), np.maximum(count, 1.0)
        rotation, position = (each[own.start : own.stop + 1] for each in knot_poses(course.knots))
        turned, there = _between(rotation, position, place, weights)
        from_base: Array = np.zeros_like(there)
        if self.link is not None:
            turned, from_base = self._on_link(course, place, turned)
            there = there + from_base
        lever = rotate(turned, self.lever)
        read = groups[..., _ROTATION].reshape(*count.shape, 3, 3) / some[..., None, None]
        away = groups[..., _POSITION] / some[..., None] - base.origin - there - lever
        off = np.concatenate(
            (log(np.where(count[..., None, None] > 0.0, read @ np.swapaxes(turned, -1, -2), np.eye(3))), away), -1
        )
        mean, at, arms = (np.sum(share[..., None] * each, axis=0) for each in (off, there, from_base + lever))
        axes = np.sum(share[..., None, None] * turned, axis=0)
        total = np.sum(count, axis=0)
        rows, known = _ROWS[self.measures], total > 0.0
        covariance = np.sum(groups[..., _COVARIANCE], axis=0).reshape(-1, 6, 6) / np.maximum(total, 1.0)[:, None, None]
        covariance = covariance * self._share_left(total, course.stack.windows[0].length)[:, None, None]
        covariance = np.where(known[:, None, None], covariance[:, ANGULAR_FIRST[:, None], ANGULAR_FIRST], np.eye(6))
        axes[~known], at[~known] = base.rotation[~known], base.position[~known]
        by_base = np.tile(np.eye(6), (len(total), 1, 1))
        by_base[:, 3:, :3] = -skew(arms)
        then = np.sum(share[..., None] * _over_window(place - 0.5, len(course.twist)), axis=0)
        twist = (by_base @ np.einsum('bm,mbx->bx', then, course.twist)[..., ANGULAR_FIRST, None])[..., 0]
        gain, carried = None, None
        if self.link is not None:
            carried = Carried(_instants(np.sum(share * place, axis=0), course), self._by_loads(arms))
            joint_twist = course.placed.joint_twist[carried.instants]
            gain = np.einsum('brnx,bnx->brn', carried.by_loads, joint_twist)
            rates = np.einsum('bm,mbn->bn', then, course.around.joint_velocity[inside])
            twist += (gain @ rates[..., None])[..., 0]
            carried, gain = replace(carried, by_loads=carried.by_loads[:, rows]), gain[:, rows]
        motion = replace(
            base, position=at, rotation=axes, twist=twist, slope=twist[:, rows], rate=np.zeros((len(total), len(rows)))
        )
        return Observation(
            np.where(known[:, None], mean[:, rows], np.nan),
            covariance[:, rows[:, None], rows],
            motion,
            gain,
            weights=np.sum(share[..., None] * weights, axis=0),
            of_base=by_base[:, rows] if arms.any() else None,
            carried=carried,
        )

    def _share_left(self, count: Array, length: float) -> Array:
        """Return the variance of the mean of some readings in windows, (B,), over that of one.

        Of correlated errors it is that about their value in the middle of the window, which is an unknown: a process
        that changes by 2 t / T of its variance in t. The middle value of a window stands for all of it.
        """
        white = 1.0 / np.maximum(count, 1.0)
        if self.correlation_time == 0.0:
            return white
        part = length / self.correlation_time
        return np.where(count > 1.0, part / 6.0 - white * np.expm1(-2.0 * part * white), part / 2.0)

    def _groups(self, course: Course) -> tuple[Array, Array, Array]:
        """Return sums over readings (g, B, c), their mean places in knots (g, B), and the weights of knots there."""
        window = course.stack.windows
        inside = window[0].inside
        sums = course.knots.readings[inside.start : inside.stop + 1][..., self.columns].copy()
        # From the middle of the first knot to that of the next window's: the motion in between is known.
        sums[0, :, 0], sums[-1, :, 1] = 0.0, 0.0
        groups = np.concatenate((sums[:, :, 0], sums[:, :, 1]))
        count, starts = groups[..., _COUNT], np.array([each.start for each in window])
        mean_time = np.where(count > 0.0, groups[..., _TIME] / np.maximum(count, 1.0), starts)
        place = (mean_time - starts) / course.spacing - 0.5
        return groups, place, _interpolation(place, len(sums))

    def _on_link(self, course: Course, place: Array, turned: Array) -> tuple[Array, Array]:
        """Return the orientation (g, B, 3, 3) of its link, and how far it is from the base's origin, (g, B, 3) m.

        Parameters
        ----------
        place : (g, B) of readings, in knots from the windows' first one
        turned : (g, B, 3, 3) orientation of the base then
        """
        assert self.link is not None
        shape = course.around.turn.shape[:2]
        rotation, position = (each.reshape(*shape, *each.shape[1:]) for each in course.placed.link_pose(self.link))
        back = np.swapaxes(course.around.base_rotation, -1, -2)
        middle = place - 0.5 + course.inside.start  # in intervals
        relative, away = _between(
            back @ rotation, (back @ position[..., None])[..., 0], middle, _interpolation(middle, shape[0])
        )
        return turned @ relative, rotate(turned, away)

    def _by_loads(self, arms: Array) -> Array:
        """Return its motion (B, 6, n, 6) by small motions of the joints' loads; `arms` (B, 3) m, from the base."""
        found = np.zeros((len(arms), 6, len(self.moved_by), 6))
        found[:, :3, :, 3:] = np.eye(3)[:, None]
        found[:, 3:, :, :3] = np.eye(3)[:, None]
        found[:, 3:, :, 3:] = -skew(arms)[:, :, None]
        return found * self.moved_by[:, None]


def _instants(place: Array, course: Course) -> Integers:
    """Return the intervals (B,) of a course nearest to places in knots from the windows' first one."""
    nearest = np.clip(np.floor(place).astype(int), 0, course.inside.stop - course.inside.start - 1)
    windows = len(course.stack.windows)
    return np.asarray((course.inside.start + nearest) * windows + np.arange(windows))


@lru_cache(maxsize=256)
def _without_readings(window: Window, begin: int, end: int) -> Window:
    readings = window.knots.readings.copy()
    readings[..., begin:end] = 0.0
    return replace(window, knots=replace(window.knots, readings=readings))


def _interpolation(place: Array, count: int) -> Array:
    """Return the weights (..., count) of knots by which cubics interpolate at places between them, in knots."""
    first = np.clip(np.floor(place).astype(int) - 1, 0, count - _STENCIL)
    x = place - first
    cubic = np.stack(
        (
            -(x - 1.0) * (x - 2.0) * (x - 3.0) / 6.0,
            x * (x - 2.0) * (x - 3.0) / 2.0,
            -x * (x - 1.0) * (x - 3.0) / 2.0,
            x * (x - 1.0) * (x - 2.0) / 6.0,
        ),
        axis=-1,
    )
    weights = np.zeros((*place.shape, count))
    np.put_along_axis(weights, first[..., None] + np.arange(_STENCIL), cubic, axis=-1)
    return weights


def _over_window(place: Array, count: int) -> Array:
    """Return the weights (..., m) of a window's m intervals by which the cubic fitted to all of them is at places.

    A sensor of few readings reads where the motion is no longer as in the middle of the window.
    """
    middle, order = 0.5 * (count - 1), min(4, count)
    fit = np.linalg.pinv(np.vander((np.arange(count) - middle) / count, order))
    return np.asarray((((place - middle) / count)[..., None] ** np.arange(order - 1, -1, -1)) @ fit)


def _between(rotation: Array, position: Array, place: Array, weights: Array) -> tuple[Array, Array]:
    """Return the pose (g, B, 3, 3), (g, B, 3) between knots, by the same weights as pose errors are interpolated.

    The noise of the knots is then that of their pose errors.

    Parameters
    ----------
    rotation, position : (k, B, 3, 3), (k, B, 3) at the knots
    place, weights : (g, B), (g, B, k)
    """
    beside = np.arange(place.shape[1])
    nearest = rotation[np.clip(np.round(place).astype(int), 0, len(rotation) - 1), beside]
    turns = np.sum(
        np.swapaxes(weights, 1, 2)[..., None] * log(rotation[None] @ np.swapaxes(nearest, -1, -2)[:, None]), axis=1
    )
    return exp(turns) @ nearest, np.sum(np.swapaxes(weights, 1, 2)[..., None] * position[None], axis=1)


@dataclass(frozen=True, eq=False)
class PoseErrors(Linear):
    """Of a pose sensor: turn (rad) and displacement (m) of its mount, the same of its world, delay (s), scale, 14."""

    name: str = ''
    measures: str = 'both'

    words: ClassVar = {
        MOUNT: Words(
            'mounts of the named poses',
            'poses.<name>.mount_position_std, .mount_orientation_std',
            'the mount of {}: measure it (poses.<name>.mount_position_std, .mount_orientation_std)',
            lambda name, value: (
                f'{name} is mounted {1e3 * np.linalg.norm(value[3:6]):.3g} mm and '
                f'{1e3 * np.linalg.norm(value[:3]):.3g} mrad off: measure its mount'
            ),
        ),
        WORLD: Words(
            'worlds of the named poses',
            'poses.<name>.same_world',
            'the world frame of {}: align it with that of the odometry (poses.<name>.same_world)',
        ),
        DELAY: Words(
            'delays of the named poses',
            'poses.<name>.time_offset_std',
            'the delay of {}: more motion determines it',
            lambda name, value: f'{name} is stamped {1e3 * np.sum(value):+.3g} ms late: check its stamps',
        ),
        SCALE: Words(
            'lengths of the named poses',
            'poses.<name>.scale_std',
            'the lengths of {}: calibrate them (poses.<name>.scale_std)',
            lambda name, value: f'lengths of {name} are {1e2 * np.sum(value):+.3g} % off: calibrate it',
        ),
    }
    redrawn_per_motion = True

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair | None:
        """Return mount or delay as uncertain as it is off; None of a world, of which nothing is declared."""
        del kernel
        kind = cause.partition(':')[0]
        if kind == WORLD:
            return None
        text, of = deviation_text(cause, value).partition(':')[0], f'poses.{self.name}'
        if kind in {DELAY, SCALE}:
            parameter_of, unit = ('time_offset_std', 's') if kind == DELAY else ('scale_std', '')
            return wider_prior(text, f'{of}.{parameter_of}', value, std, unit)
        parts = zip(('orientation', 'position'), np.split(value, 2), strict=True)
        parameters: dict[str, Setting] = {
            f'{of}.mount_{part}_std': widened(float(np.max(np.abs(own)))) for part, own in parts if own.any()
        }
        return Repair(text, parameters, value=numbers(value), std=numbers(std), unit='rad, m')

    def measured(self, sensor: str, motion: Motion) -> Array | None:
        """Return how much further on it reads the base by each."""
        if sensor != f'poses.{self.name}':
            return None
        read = np.zeros((len(motion.time), 6, 14))
        read[:, :3, :3] = read[:, 3:, 3:6] = motion.rotation
        read[:, :3, 6:9] = read[:, 3:, 9:12] = np.eye(3)
        read[:, 3:, 6:9] = -skew(motion.position)
        read[:, :, 12], read[:, 3:, 13] = -motion.twist, motion.position + motion.origin  # from its world's origin on
        return read[:, _ROWS[self.measures]]


@dataclass(frozen=True, eq=False)
class PoseWander(Linear):
    """Errors of a pose sensor that are correlated in time: turn (rad) and displacement (m) of its readings, 6."""

    name: str = ''
    measures: str = 'both'
    time: float = 0.0  # s

    words: ClassVar = {
        WANDER: Words(
            'correlated errors of the named poses',
            'poses.<name>.position_std, .orientation_std',
            'the correlated errors of {}: average over more time, or calibrate it',
            lambda name, value: (
                f'{name} is off by {1e3 * np.linalg.norm(value[3:6]):.3g} mm and '
                f'{1e3 * np.linalg.norm(value[:3]):.3g} mrad for a while: look at its driver'
            ),
        )
    }
    redrawn_per_motion = True

    @property
    def time_constants(self) -> Array:
        """Time constants of the errors."""
        return np.full(self.count, self.time)

    def measured(self, sensor: str, motion: Motion) -> Array | None:
        """Return how much further on it reads the base by each."""
        if sensor != f'poses.{self.name}':
            return None
        return np.tile(np.eye(6), (len(motion.time), 1, 1))[:, _ROWS[self.measures]]


@dataclass(frozen=True, eq=False)
class PoseDrift(Linear):
    """A steady drift of a pose sensor: angular velocity (rad/s) and velocity (m/s) of its world, 6.

    Momentum is conserved in a world that moves steadily, and not in one that turns.
    """

    name: str = ''
    measures: str = 'both'

    words: ClassVar = {
        TURNING: Words(
            'drifts of the named poses',
            'poses.<name>.turning_std',
            'the drift of {}: another sensor of the orientation shows it (poses.<name>.turning_std)',
            lambda name, value: (
                f'the orientation of {name} drifts by {6e4 * np.linalg.norm(value):.3g} mrad a minute: calibrate it, '
                f'or raise poses.{name}.turning_std'
            ),
        ),
        DRIFT: Words(
            deviation=lambda name, value: (
                f'{name} drifts by {_drifted(value)} a minute: calibrate it, or leave it out (poses.{name}.use)'
            )
        ),
    }
    redrawn_per_motion = True

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair:
        """Return a drift of the orientation as uncertain as it is large; where positions may drift, it is left out."""
        del kernel
        text, of = deviation_text(cause, value).partition(':')[0], f'poses.{self.name}'
        if cause.startswith(TURNING) or self.measures == 'orientation':
            return wider_prior(text, f'{of}.turning_std', value[:3], std[:3], 'rad/s')
        return Repair(text, {f'{of}.use': False}, value=numbers(value), std=numbers(std), unit='rad/s, m/s')

    def measured(self, sensor: str, motion: Motion) -> Array | None:
        """Return how much further on it reads the base by each."""
        if sensor != f'poses.{self.name}':
            return None
        read = np.zeros((len(motion.time), 6, 6))
        read[:, :3, :3] = read[:, 3:, 3:] = np.eye(3)
        read[:, 3:, :3] = -skew(motion.position + motion.origin)
        return (motion.time[:, None, None] * read)[:, _ROWS[self.measures]]


def _drifted(value: Array) -> str:
    """Return what a drift (6,), rad/s and m/s, makes in a minute."""
    sizes = 6e4 * np.linalg.norm(value.reshape(2, 3), axis=1)
    return ' and '.join(f'{size:.3g} {unit}' for size, unit in zip(sizes, ('mrad', 'mm'), strict=True) if size)


def pose_drift(name: str, measures: str, turning: float, drift: float = 0.0) -> PoseDrift:
    """Return the drift of a pose sensor as an unknown, of standard deviations in rad/s and m/s; 0 is none.

    One that moves as well is a cause of its own beside the declared one, which only turns.
    """
    turns, moves = (float(measures in (part, 'both')) for part in ('orientation', 'position'))
    label = f'{DRIFT if drift else TURNING}:{name}'
    return PoseDrift(diagonal(np.repeat((turns * turning, moves * drift), 3)), (label,) * 6, name, measures)


def pose_wander(name: str, config: NamedPoseConfig) -> PoseWander:
    """Return the correlated errors of a pose sensor.

    Raises ParameterError: Their size is not declared.
    """
    levels = _levels(config)
    if config.correlation_time > 0.0 and not all(levels.values()):
        missing = next(part for part, value in levels.items() if not value)
        raise ParameterError(
            f"parameter 'poses.{name}.correlation_time' is {config.correlation_time:g} s, and "
            f"'poses.{name}.{missing}_std' is 0; accepted: the size of these errors"
        )
    sizes = np.repeat([levels.get(part, 0.0) for part in ('orientation', 'position')], 3)
    lasting = float(config.correlation_time > 0.0)
    return PoseWander(
        diagonal(lasting * sizes), (f'{WANDER}:{name}',) * 6, name, config.measures, config.correlation_time
    )


def pose_errors(name: str, config: NamedPoseConfig, *, same_world: bool) -> PoseErrors:
    """Return the errors of a pose sensor, in the odometry's world or in one of its own."""
    turns, moves = (float(config.measures in (part, 'both')) for part in ('orientation', 'position'))
    world = 0.0 if same_world else 1.0
    sizes = (
        *(turns * config.mount_orientation_std, moves * config.mount_position_std),
        *(world * turns * _WORLD_TURN, world * moves * _WORLD_SHIFT),
    )
    labels = (*(f'{MOUNT}:{name}',) * 6, *(f'{WORLD}:{name}',) * 6, f'{DELAY}:{name}', f'{SCALE}:{name}')
    return PoseErrors(
        diagonal([*np.repeat(sizes, 3).tolist(), config.time_offset_std, moves * config.scale_std]),
        labels,
        name=name,
        measures=config.measures,
    )


def declared_poses(config: PosesConfig) -> tuple[Linear, ...]:
    """Return the errors of all pose sensors."""
    places, used = _reference_names(config), config.used
    constant = [pose_errors(name, own, same_world=own.same_world or name in places) for name, own in used.items()]
    drifts = (pose_drift(name, own.measures, own.turning_std) for name, own in used.items())
    return (*constant, *drifts, *(pose_wander(name, own) for name, own in used.items()))


def pose_sensors(
    config: PosesConfig, model: RobotModel, frame_prefix: str, passive: Collection[str] = ()
) -> tuple[PoseSensor, ...]:
    """Return poses as sensors with columns one after the other.

    Raises ParameterError: A sensor cannot be on the frame that its parameters name, or too little is measured.

    Parameters
    ----------
    frame_prefix, passive : as of `sensor_link`
    """
    _refuse(config)
    found, ancestors = [], Kinematics(model).ancestors
    for place, (name, own) in enumerate(config.used.items()):
        frame = _frame(name, own, model, frame_prefix, passive)
        if frame.link is not None and name in _reference_names(config):
            raise ParameterError(
                f"parameter 'poses.{name}.frame' is '{own.frame}', and it is the first to locate the base, as "
                "'poses.alone' is true; accepted: a link of the base"
            )
        found.append(
            PoseSensor(
                f'poses.{name}',
                own.measures,
                slice(_WIDTH * place, _WIDTH * (place + 1)),
                frame.position if own.measures == 'position' else np.zeros(3),
                {f'poses.{name}.{part}_std': value for part, value in _levels(own).items()},
                frame.link,
                ancestors[0 if frame.link is None else frame.link.body],
                own.correlation_time,
            )
        )
    return tuple(found)


def _levels(config: NamedPoseConfig) -> dict[str, float]:
    """Return the declared noise of the parts that a sensor measures."""
    levels = {'position': config.position_std, 'orientation': config.orientation_std}
    return {part: value for part, value in levels.items() if config.measures in (part, 'both')}


def pose_instruments(
    config: PosesConfig,
    model: RobotModel,
    frame_prefix: str,
    maximum_gap: int,
    view: Callable[[BaseStream], BaseStream] | None,
    passive: Collection[str] = (),
) -> list[Instrument]:
    """Return the readers and collectors of pose sensors.

    Parameters
    ----------
    frame_prefix, passive : as of `sensor_link`
    maximum_gap, view : as of `PoseCollector`
    """
    places, kinematics = _reference_names(config), Kinematics(model)
    found = []
    sensors = pose_sensors(config, model, frame_prefix, passive)
    for sensor, (name, own) in zip(sensors, config.used.items(), strict=True):
        same = own.same_world or name in places
        collector = PoseCollector(
            maximum_gap,
            own.measures,
            same_world=same,
            view=view if same else None,
            located=partial(_located, sensor=sensor, kinematics=kinematics),
            found=(own.position_std == 0.0, own.orientation_std == 0.0),
        )
        found.append(Instrument(sensor, _reader(name, own, model, frame_prefix), collector, _numbers))
    return found


def _located(samples: Samples, sensor: PoseSensor, kinematics: Kinematics) -> tuple[Array, Array]:
    """Return orientations (N, 3, 3) and positions (N, 3), m, of the frame that a sensor locates, at samples."""
    rotation, position = samples.base_rotation, samples.base_position
    if sensor.link is not None:
        turned, away = kinematics.configure(rotation, samples.joint_position).link_pose(sensor.link)
        rotation, position = turned, position + away
    return rotation, position + rotate(rotation, sensor.lever)


def _numbers(stream: BaseStream) -> Array:
    return np.concatenate((stream.position, stream.rotation.reshape(-1, 9)), axis=1)


def _reader(name: str, config: NamedPoseConfig, model: RobotModel, prefix: str) -> NamedPoseReader:
    """Return the reader of a sensor's messages."""
    levels = config.position_std or 1e-3, config.orientation_std or 1e-4
    noise = SensorNoise(0.0, 0.0, *levels, 1.0, 1.0)
    frame = _frame(name, config, model, prefix)
    base = prefix + model.base_link
    if config.measures == 'position':  # a point; where it is on the base is of no use without a turn
        reader = OdometryReader({}, AttachedFrame(np.eye(3), np.zeros(3)), (), 'child', noise)
    elif frame.given:
        reader = OdometryReader({}, AttachedFrame(frame.rotation, frame.position), (), 'child', noise)
    else:
        links = {
            prefix + link.name: AttachedFrame(link.rotation, link.position) for link in model.links if not link.body
        }
        reader = OdometryReader(links, None, [prefix + link.name for link in model.links], 'child', noise)
    return NamedPoseReader(config.measures, base, reader)


class _Frame(NamedTuple):
    """The frame that a sensor locates, in that of the base link, or of a link that joints move."""

    rotation: Array  # (3, 3)
    position: Array  # (3,) m
    link: Link | None  # that one; None on the base
    given: bool  # whether parameters say which it is


def _frame(name: str, config: NamedPoseConfig, model: RobotModel, prefix: str, passive: Collection[str] = ()) -> _Frame:
    """Return the frame that a sensor locates; arguments as of `sensor_link`.

    Raises ParameterError: It is no link, or its marker's orientation is no unit quaternion.
    """
    try:
        marker = marker_frame(config.marker)
    except ParameterError as error:
        raise ParameterError(str(error).replace("'marker.", f"'poses.{name}.marker.")) from error
    rotation, position = (np.eye(3), np.zeros(3)) if marker is None else (marker.rotation, marker.position)
    if not config.frame:
        return _Frame(rotation, position, None, marker is not None)
    link = sensor_link(model, config.frame, prefix, f'poses.{name}.frame', passive)
    if link.body:
        return _Frame(rotation, position, link, given=True)
    return _Frame(link.rotation @ rotation, link.position + link.rotation @ position, None, given=True)


def _reference_names(config: PosesConfig) -> tuple[str, ...]:
    """Return the sensors, where nothing else locates the base, that do: of its position, and of its orientation."""
    if not config.alone:
        return ()
    return (*config.measuring('position')[:1], *config.measuring('orientation')[:1])


def _refuse(config: PosesConfig) -> None:
    """Refuse sensors that cannot be used together."""
    if config.alone and not config.measuring('orientation'):
        raise ParameterError(
            "parameter 'poses.alone' is true, and none of 'poses.names' measures the orientation; accepted: one that "
            'does'
        )
    for name, own in config.used.items():
        if own.measures == 'position' and not own.same_world and name not in _reference_names(config):
            raise ParameterError(
                f"parameter 'poses.{name}.same_world' is false, and it measures positions alone, which do not "
                'determine how its world is turned; accepted: true'
            )


class _Displacement:
    """How what a sensor locates has turned and moved since its first reading, by samples and as it reads."""

    def __init__(self, sensor: PoseSensor, kinematics: Kinematics) -> None:
        self._sensor, self._kinematics = sensor, kinematics
        self._first: tuple[Array, Array, Array, Array] | None = None

    def __call__(self, window: Samples) -> RateMotion | None:
        """Return the motion until a window; None where the sensor has read nothing in it."""
        sums = window.readings[:, self._sensor.columns]
        rows = np.flatnonzero(sums[:, _COUNT])
        if not len(rows):
            return None
        mean = sums[rows] / sums[rows, :1]
        turned, there = _located(window[rows], self._sensor, self._kinematics)
        read = turned, there, mean[:, _ROTATION].reshape(-1, 3, 3), mean[:, _POSITION]
        if self._first is None:
            self._first = (turned[0], there[0], read[2][0], read[3][0])
        rotation, position, own_rotation, own_position = self._first
        step = np.concatenate((log(rotation.T @ turned), there - position), axis=1)
        seen = np.concatenate((log(own_rotation.T @ read[2]), read[3] - own_position), axis=1)
        noise = np.sqrt(spread(mean[:, _COVARIANCE].reshape(-1, 6, 6)) + spread(window.pose_covariance))
        own = _ROWS[self._sensor.measures]
        parts = (np.mean(step, axis=0)[own], np.mean(seen, axis=0)[own], noise[own], np.zeros((3, 3)), rotation)
        return RateMotion(*(part[None] for part in parts))


def pose_check(sensor: PoseSensor, kinematics: Kinematics) -> RateCheck:
    """Return the check whether a sensor moves as the base's pose does, and, on a link, as the joints move it."""
    error = partial(_pose_error, sensor=sensor)
    return RateCheck(_Displacement(sensor, kinematics), error, Repair('', sensor.leave_out), 'conflict')


def _pose_error(motion: RateMotion, contradiction: float, sensor: PoseSensor) -> tuple[str, float]:
    """Return the units or axes that a sensor has instead of the poses', and the gain."""
    parts = np.split(motion.step, motion.step.shape[1] // 3, axis=1)
    size = np.repeat([np.sqrt(np.mean(np.sum(part**2, axis=1))) for part in parts], 3)
    motion = replace(motion, noise=np.hypot(motion.noise, _OFF * size))
    contradiction = motion.misfit(motion.read)
    return (
        likeliest(motion, contradiction, _pose_meanings(motion, sensor)) if contradiction >= CONTRADICTS else ('', 0.0)
    )


def _pose_meanings(motion: RateMotion, sensor: PoseSensor) -> Meanings:
    """Yield the conventions of a sensor, and the steps (W, k) that each implies."""
    name, turns = sensor.name.partition('.')[2], 0 if sensor.measures == 'position' else 3
    if sensor.measures != 'orientation':
        meant = motion.read.copy()
        meant[:, turns:] *= _MILLIMETRE
        yield 1.0, f'the positions of {name} are in millimetres: accepted: metres, as in REP 103', meant
    turned: list[tuple[slice, Array, str]] = []
    for what, own in ('axes', slice(turns)), ('positions', slice(turns, None)):
        step, read, noise = (each[:, own] for each in (motion.step, motion.read, motion.noise))
        turn, about = turn_between(step, read, noise) if read.size else (np.eye(3), '')
        if np.linalg.norm(log(turn)) > _TURNED:
            turned.append((own, read @ turn.T, f'the {what} of {name} are turned by {about}'))
    for count in range(1, len(turned) + 1):
        for chosen in combinations(turned, count):
            meant = motion.read.copy()
            for own, values, _ in chosen:
                meant[:, own] = values
            text = ' and '.join(words for *_, words in chosen)
            how = f'correct its frame, or set {sensor.name}.marker.orientation'
            how = 'publish them in the frame of the orientations' if chosen[0][0].stop is None else how
            yield 1.0, f'{text}: {how}', meant


class Reference:
    """Makes the base's pose of the first sensors of position and of orientation, where nothing else locates it.

    Only the motion between windows' knots is taken from it, that of which the filter estimates the error.

    Parameters
    ----------
    position, orientation : names of the sensors; None: nothing measures a position
    lever : (3,) m, in base axes, of the point that the first one locates
    """

    def __init__(self, position: str | None, orientation: str, lever: Array) -> None:
        self._position, self._orientation, self._lever = position, orientation, lever
        self._waiting: BaseStream | None = None
        self._turns: BaseStream | None = None

    @property
    def name(self) -> str:
        """Name of the sensor whose stamps it has."""
        return self._position or self._orientation

    def push(self, streams: Mapping[str, Any]) -> BaseStream | None:
        """Add readings by the names of sensors; return the poses that they complete."""
        turns: BaseStream | None = streams.get(self._orientation)
        if self._position is None:
            if turns is None:
                return None
            found = orientation_only(turns.stamp, turns.rotation, turns.pose_covariance[:, 3:, 3:])
            return replace(found, declared=turns.declared)
        if self._position == self._orientation:
            return (
                None
                if turns is None
                else replace(turns, linear_velocity=_unknown(turns), angular_velocity=_unknown(turns))
            )
        self._waiting, self._turns = _joined(self._waiting, streams.get(self._position)), _joined(self._turns, turns)
        return self._completed()

    def _completed(self) -> BaseStream | None:
        """Return the waiting positions between orientations, with these."""
        waiting, turns = self._waiting, self._turns
        if waiting is None or turns is None or len(turns.stamp) < 2:
            return None
        count = int(np.searchsorted(waiting.stamp, turns.stamp[-1], side='right'))
        ready, self._waiting = waiting[:count], waiting[count:]
        ready = ready[ready.stamp >= turns.stamp[0]]
        if not len(ready.stamp):
            return None
        right = np.maximum(np.searchsorted(turns.stamp, ready.stamp, side='left'), 1)
        left = right - 1
        near = turns.stamp[right] - turns.stamp[left] <= round(REFERENCE_GAP * 1e9)
        ready, left, right = ready[near], left[near], right[near]
        if not len(ready.stamp):
            self._turns = turns[-1:]
            return None
        part = (ready.stamp - turns.stamp[left]) / (turns.stamp[right] - turns.stamp[left])
        turn = log(np.swapaxes(turns.rotation[left], -1, -2) @ turns.rotation[right])
        rotation = turns.rotation[left] @ exp(part[:, None] * turn)
        covariance = ready.pose_covariance.copy()
        covariance[:, 3:] = covariance[:, :, 3:] = 0.0
        covariance[:, 3:, 3:] = turns.pose_covariance[right, 3:, 3:]
        self._turns = turns[max(int(left[-1]), 0) :]
        return replace(
            ready,
            position=ready.position - rotate(rotation, self._lever),
            rotation=rotation,
            linear_velocity=_unknown(ready),
            angular_velocity=_unknown(ready),
            pose_covariance=covariance,
        )


def _unknown(stream: BaseStream) -> Array:
    return np.full((len(stream.stamp), 3), np.nan)


def _joined(first: BaseStream | None, second: BaseStream | None) -> BaseStream | None:
    if first is None or second is None:
        return second if first is None else first
    return BaseStream.concatenate([first, second])


def reference(config: PosesConfig, model: RobotModel, frame_prefix: str) -> Reference | None:
    """Return what locates the base where nothing but named poses does; None where the odometry does."""
    if not config.alone:
        return None
    position, orientation = (config.measuring(part)[:1] for part in ('position', 'orientation'))
    lever: Array = np.zeros(3)
    if position and config.used[position[0]].measures == 'position':
        lever = _frame(position[0], config.used[position[0]], model, frame_prefix).position
    return Reference(f'poses.{position[0]}' if position else None, f'poses.{orientation[0]}', lever)
