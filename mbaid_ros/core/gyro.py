"""A gyro on the base or on a link: messages, parameters, integration, errors, rows, faults; also without poses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache, partial
from typing import Any, ClassVar

import numpy as np

from mbaid_ros.core.contracts import (
    Carried,
    Course,
    Instrument,
    Linear,
    Motion,
    NominalModel,
    Observation,
    Stack,
    Unknown,
    Words,
    deviation_text,
    diagonal,
)
from mbaid_ros.core.geometry import (
    Array,
    Flags,
    cross,
    crossed,
    exp,
    log,
    rotate,
    rotate_back,
    rotation_from_quaternion,
    skew,
)
from mbaid_ros.core.odometry.faults import (
    CONTRADICTS,
    FITTED,
    Meanings,
    RateCheck,
    RateMotion,
    axes_between,
    ends,
    likeliest,
    slope_over_window,
    spread,
    turn_between,
)
from mbaid_ros.core.odometry.model import parabolic_weights, total
from mbaid_ros.core.odometry.stream import QUATERNION_TOLERANCE, orientation_only, usable_covariance
from mbaid_ros.core.repair import Repair, Setting, numbers, wider_prior
from mbaid_ros.core.robot.model import Kinematics, Link, PlaneDetector, RobotModel, express, sensor_link
from mbaid_ros.core.robot.momentum import MomentumKernel, inverse_inertia_and_joint_momentum
from mbaid_ros.core.samples import IMU_TYPE, ArrayRecord, BaseStream, ImuStream, Input, Samples, Stamps, stamps_of
from mbaid_ros.core.windows import Window, gradient
from mbaid_ros.errors import ParameterError, listing
from mbaid_ros.parameters import by_name, named_groups, parameter, topic_of

IMU = 'imu'  # the first gyro
SATURATED = 'IMU: angular velocity at the end of its range, or stuck'
LARGEST_BACKLOG = 1_000_000  # measurements that wait for joints: more are memory without an end
# Readings in a row that are the same to the last bit, and how fast (rad/s): a gyro whose range is not known is at its
# end.
_STUCK, _FAST = 8, 0.5
# A gyro that is further behind the joints than that (ns) has stopped: samples wait for it no longer.
_PATIENCE = 1_000_000_000
_NOWHERE = -1  # index of an entry not found
_ONCE_MORE = 256  # rotations, after which rounding is taken off: it has grown to some 1e-14 by then
BIAS, STRETCH, TURN, CROSS, LATE = GYRO = ('gyro bias', 'gyro scale', 'gyro mount', 'gyro cross-axis', 'gyro delay')
DRIFT = 'gyro drift'
_SCALES, _CROSSES = range(3, 6), range(9, 12)  # places of the scales and of the cross-axis sensitivities
_LATE = 12  # place of the delay: as many numbers are before it
_OFF = 0.02  # part of the motion that a declared error of the gyro's scale or mount may make
_DRIFT_TIME = 30.0  # s, in which a walk of the bias goes as far as a drift that is found
_TURNED = 0.2  # rad, from which the axes of a gyro are others: no declared mount is as far off
_FIRST = 5  # windows of a mean angular momentum: noise is far below the rate, disturbances have hardly acted
IMU_FRAME = 'IMU: frame_id is no link on the base'
IMU_NOT_FINITE = 'IMU: NaN or infinite value'
IMU_NOT_REAL = 'IMU: angular velocity beyond anything real'
IMU_WITHOUT_RATE = 'IMU: the angular velocity is marked as not measured (covariance -1)'
IMU_BAD_QUATERNION = 'IMU: orientation is no unit quaternion'
_ALONG = 1.0 - 1e-4  # cosine from which the axes of a link count as the base's: scales about either hardly differ
_LARGEST = 1e4  # rad/s: no gyro measures as much
_IMU_DELAY_STD = 5e-3  # s, of stamps that a driver sets on arrival: half a period at 100 Hz


@dataclass(frozen=True)
class GyroConfig:
    """The angular velocity of a gyro."""

    noise_density: float = parameter(0.0, 'rad/s/sqrt(Hz)', minimum=0.0)
    """White noise density of the gyro, as in data sheets: standard deviation of a reading over the square root of the
    rate. 0: its topic is not used."""
    bias_std: float = parameter(0.01, 'rad/s', minimum=0.0)
    """Standard deviation of the gyro's initial bias about each axis."""
    bias_walk: float = parameter(2e-5, 'rad/s/sqrt(s)', minimum=0.0)
    """Random walk of the gyro's bias: standard deviation of its change in a second; grows with the square root of
    time."""
    scale_std: float = parameter(0.01, minimum=0.0)
    """Relative standard deviation of the gyro's scale on each axis; 0: exact."""
    cross_axis_std: float = parameter(0.0, minimum=0.0)
    """Standard deviation of the gyro's cross-axis sensitivity, without the common misalignment; data sheets of MEMS
    have 0.01 to 0.02 as a maximum. 0: exact."""
    orientation_std: float = parameter(0.01, 'rad', minimum=0.0)
    """Standard deviation of the IMU's misalignment about each axis; 0: exact."""
    range: float = parameter(0.0, 'rad/s', minimum=0.0)
    """Largest measurable angular velocity: readings at that limit are not used. 0: unknown; then fast readings that
    repeat to the last bit are not used."""
    frame: str = parameter('')
    """Link that carries the IMU and whose axes it measures in: on the base or moved by joints, such as the target; not
    by a joint of flexible.joints. Empty: the frame_id of the messages, a link on the base. Where one of these is
    askew to the base, set it: scales are about its axes, and count about any while it is empty."""


@dataclass(frozen=True)
class ImuConfig(GyroConfig):
    """The angular velocity of an IMU; with `noise_density` the topic imu is used."""

    alone: bool = parameter(default=False)
    """Nothing locates the base: the gyro alone measures its rotation about the common centre of mass. Only for method
    trajectory; odom and pose are ignored, linear momentum and heading are unobservable."""
    orientation: bool = parameter(default=False)
    """With imu.alone: also use the orientation in the messages, as from a star tracker, unless its covariance is -1
    (REP 145). The gyro then fills the gaps between messages, and the heading is observable."""


@dataclass(frozen=True)
class NamedGyroConfig(GyroConfig):
    """A gyro by name."""

    use: bool = parameter(default=True)
    """Whether it is used."""


@dataclass(frozen=True)
class GyrosConfig:
    """Further gyros beside that of imu, on any links."""

    names: tuple[str, ...] = parameter(())
    """Further gyros, each an Imu on the topic of its name; gyros.<name>.noise_density is needed."""
    each: Mapping[str, Mapping[str, Any]] = by_name(NamedGyroConfig, 'name')

    @property
    def without_frames(self) -> GyrosConfig:
        """The same gyros on any robot."""
        each = {name: {key: value for key, value in own.items() if key != 'frame'} for name, own in self.each.items()}
        return GyrosConfig(self.names, each)


def declared_gyros(imu: ImuConfig, further: GyrosConfig) -> dict[str, GyroConfig]:
    """Return the gyros in use by the names of their parameters: imu, gyros.arm; the topic is the last part.

    Raises ParameterError: A name is taken, given twice or no topic's, or has no noise.
    """
    found: dict[str, GyroConfig] = {IMU: imu} if imu.noise_density > 0.0 else {}
    for name, gyro in named_groups(NamedGyroConfig, 'gyros', further.names, further.each).items():
        if gyro.use and gyro.noise_density == 0.0:
            raise ParameterError(f"parameter 'gyros.{name}.noise_density' is 0; accepted: its noise, above 0")
        found |= {f'gyros.{name}': gyro} if gyro.use else {}
    return found


def gyro_inputs(imu: ImuConfig, further: GyrosConfig) -> dict[str, Input]:
    """Return the topics of gyros by the names of their parameters."""
    return {name: Input(topic_of(name), (IMU_TYPE,)) for name in declared_gyros(imu, further)}


@dataclass(frozen=True)
class _Integrated(ArrayRecord):
    """N readings of a gyro and the integral of its rate."""

    stamp: Stamps  # ns
    rate: Array  # (N, 3) rad/s
    angle: Array  # (N, 3) rad
    segment: Stamps  # number of the gap-free segment


class RateIntegrator:
    """Integrates the rate of a gyro; the result does not depend on how the stream is cut into pieces.

    Parameters
    ----------
    maximum_gap : ns, longest time between two measurements that is interpolated
    largest : rad/s, range of the gyro; 0 if unknown
    on_base : whether it is fixed to the base; else joints are between

    Attributes
    ----------
    newest : ns, stamp of the latest measurement; None before the first
    dropped : measurements that were not used, by cause
    """

    field = 'further'

    def __init__(self, maximum_gap: int, largest: float = 0.0, *, on_base: bool = True) -> None:
        self.on_base = on_base
        self._maximum_gap = maximum_gap
        self._largest = largest
        none = np.zeros(0, dtype=np.int64)
        self._kept = _Integrated(none, np.zeros((0, 3)), np.zeros((0, 3)), none)
        self._segments = 0  # so far
        self._sampled = _NOWHERE  # in which of them the last sample was
        self._last: Array = np.full(3, np.nan)  # reading
        self._alike = np.zeros(3, dtype=np.int64)  # readings in a row that were the same as this, by axis
        self.newest: int | None = None
        self.dropped: Counter[str] = Counter()

    def push(self, stream: ImuStream | None) -> None:
        """Add measurements in the order of their stamps."""
        if stream is None or not len(stream.stamp):
            return
        self.newest = int(stream.stamp[-1])
        lost = self._saturated(stream.read)
        self.dropped[SATURATED] += int(np.sum(lost))
        self._integrate(stream, lost)
        self.forget_before(np.iinfo(np.int64).min)

    def complete_until(self, joints: int) -> int:
        """Return the last stamp (ns) that the rate is waited for; `joints` is the latest stamp of these."""
        silent = joints - _PATIENCE
        return silent if self.newest is None else max(self.newest, silent)

    def columns(self, samples: Samples, stamps: Stamps) -> Array:
        """Return the integral at samples, as `integral_at_samples` does."""
        del samples
        return self.integral_at_samples(stamps)

    def integral_at_samples(self, stamps: Stamps) -> Array:
        """Return the integral at samples, in order, (N, 3) rad: NaN in a gap, or else at the first sample after it."""
        turned, part = self.integral_at(stamps)
        if not len(stamps):
            return turned
        earlier = np.concatenate(([self._sampled], part[:-1]))
        self._sampled = int(part[-1])
        across = (part != earlier) & (earlier != _NOWHERE)
        return np.where(across[:, None], np.nan, turned)

    def integral_at(self, stamps: Stamps) -> tuple[Array, Stamps]:
        """Return the integral at instants (N, 3), rad, and the number of their gap-free segment; NaN, -1 in a gap."""
        known, rate, turned, parts = vars(self._kept).values()
        if not len(known):
            return np.full((len(stamps), 3), np.nan), np.full(len(stamps), _NOWHERE)
        right = np.minimum(np.searchsorted(known, stamps, side='left'), len(known) - 1)
        left = np.where(known[right] == stamps, right, np.maximum(right - 1, 0))
        length, since = (known[right] - known[left]) * 1e-9, (stamps - known[left]) * 1e-9
        slope = (rate[right] - rate[left]) / np.where(length > 0.0, length, 1.0)[:, None]
        value = turned[left] + since[:, None] * (rate[left] + 0.5 * since[:, None] * slope)
        inside = (stamps >= known[0]) & (stamps <= known[-1]) & (parts[left] == parts[right])
        return np.where(inside[:, None], value, np.nan), np.where(inside, parts[left], _NOWHERE)

    def forget_before(self, stamp: int) -> None:
        """Drop readings that no instant after a stamp needs."""
        count, surplus = len(self._kept), int(np.searchsorted(self._kept.stamp, stamp, side='right')) - 1
        surplus = min(max(surplus, count - LARGEST_BACKLOG), count - 1)  # new readings are added to the last
        if surplus > 0:
            self._kept = self._kept[surplus:]

    def _integrate(self, stream: ImuStream, lost: Flags) -> None:
        """Integrate measurements (trapezoid); lost ones make a gap."""
        good = ~lost
        if not np.any(good):
            self._segments += 1
            return
        stamp, rate = stream.stamp[good], stream.angular_velocity[good]
        breaks = np.cumsum(lost)[good]
        gap = np.diff(breaks, prepend=0) > 0
        last = self._kept[-1:]
        # Without a reading before, the integral begins at the first one.
        before = last if len(last) else _Integrated(stamp[:1], rate[:1], np.zeros((1, 3)), last.segment)
        apart = np.diff(stamp, prepend=before.stamp)
        steps = 0.5e-9 * apart[:, None] * (np.concatenate((before.rate, rate[:-1])) + rate)
        gap |= apart > self._maximum_gap
        # One after the other, from the last sum: the same sums however the stream is cut.
        turned = np.cumsum(np.concatenate((before.angle, steps)), axis=0)[1:]
        part = self._segments + np.cumsum(gap)
        self._segments = int(part[-1]) + int(bool(lost[-1]))  # lost ones at the end part it from the next ones
        self._kept = _Integrated.concatenate([self._kept, _Integrated(stamp, rate, turned, part)])

    def _saturated(self, rate: Array) -> Flags:
        """Return which readings are at the end of the gyro's range, or stuck, (N,)."""
        if self._largest > 0.0:
            return np.asarray(np.any(np.abs(rate) >= self._largest * (1.0 - 1e-6), axis=1))
        same = rate == np.concatenate((self._last[None], rate[:-1]))
        place = np.arange(len(rate))[:, None]
        # Readings since the last change, those of earlier calls among them.
        changed = np.maximum.accumulate(np.where(same, -1, place), axis=0)
        alike = np.where(changed < 0, self._alike + place + 1, place - changed)
        if len(rate):
            self._last, self._alike = rate[-1], alike[-1]
        return np.asarray(np.any((alike >= _STUCK - 1) & (np.abs(rate) > _FAST), axis=1))


class DeadReckoning:
    """Integrates an orientation; the result does not depend on how the stream is cut into pieces."""

    def __init__(self) -> None:
        self._last: tuple[int, Array, Array] | None = None  # stamp, rate, orientation
        self._count = 0

    def push(self, imu: ImuStream | None) -> BaseStream | None:
        """Add measurements in the order of their stamps; return the orientation of the base at each."""
        if imu is None or not len(imu.stamp):
            return None
        readings = zip(imu.stamp.tolist(), imu.angular_velocity, strict=True)
        return orientation_only(imu.stamp, np.array([self._integrated(*reading) for reading in readings]))

    def _integrated(self, stamp: int, rate: Array) -> Array:
        """Return the orientation at the next measurement: with a rate that changes evenly, to fourth order."""
        if self._last is None:
            rotation: Array = np.eye(3)
        else:
            before, first, start = self._last
            step = 1e-9 * (stamp - before)
            turn = 0.5 * step * (first + rate) + step**2 / 12.0 * cross(first, rate)
            rotation = start @ exp(turn)
            self._count += 1
            if self._count % _ONCE_MORE == 0:
                left, _, right = np.linalg.svd(rotation)
                rotation = left @ right
        self._last = stamp, rate, rotation
        return rotation


@dataclass(frozen=True)
class GyroErrors:
    """How far an IMU's angular velocity may be off: standard deviations, 0 is exact."""

    bias: float = 0.0  # rad/s
    scale: float = 0.0  # relative
    orientation: float = 0.0  # rad
    delay: float = 0.0  # s
    walk: float = 0.0  # rad/s/sqrt(s), of the bias
    cross: float = 0.0  # relative, of one axis in another
    alone: bool = False  # whether it alone observes the orientation, which windows are linearised along
    with_orientation: bool = False  # whether the IMU measures the orientation, too, in the same axes
    link: Link | None = None  # that the IMU is on, where joints move it; None on the base
    axes: Array = field(default_factory=lambda: np.eye(3))  # of its sensitivity, in the axes that it is read in
    name: str = IMU  # of its parameters
    among: bool = False  # whether its labels carry its name, as there are others


def _said_of(name: str, parameter: str) -> str:
    """Return a parameter of a gyro by the name in its labels: that of the first one is empty."""
    return f'gyros.{name}.{parameter}' if name not in {'', IMU} else f'{IMU}.{parameter}'


def _off(what: str, scale: float, unit: str, parameter: str) -> Words:
    """Return the words of one kind of errors, whose size is shown in a unit."""

    def deviation(name: str, value: Array) -> str:
        size = scale * float(np.sqrt(np.sum(value**2)))
        return f'{what_gyro(name)} has {what} of {size:.3g} {unit}: calibrate it, or raise {_said_of(name, parameter)}'

    return Words(remedy=f'{what} of a gyro: more motion determines it', deviation=deviation)


def what_gyro(name: str) -> str:
    """Return a gyro in words, by its topic or the name in its labels."""
    return f'the gyro {name}' if name not in ('', IMU) else 'the IMU'


@dataclass(frozen=True, eq=False)
class Gyro(Unknown):
    """Bias (rad/s), scale, turn (rad) of its axes, cross-axis sensitivity, (3,) each, and delay (s)."""

    # (13, w) factor of the change of the bias in a second
    wandering: Array = field(default_factory=lambda: np.zeros((13, 0)))
    errors: GyroErrors = field(default_factory=GyroErrors)  # as declared

    words: ClassVar = {
        BIAS: _off('a bias', 1.0, 'rad/s', 'bias_std'),
        STRETCH: _off('an error of its scales', 1e2, '%', 'scale_std'),
        TURN: _off('a misalignment', 1e3, 'mrad', 'orientation_std'),
        CROSS: _off('a cross-axis sensitivity', 1e2, '%', 'cross_axis_std'),
        LATE: Words(
            remedy='the delay of a gyro: more motion determines it',
            deviation=lambda name, value: (
                f'{what_gyro(name)} is stamped {1e3 * np.sum(value):+.3g} ms late against the poses: check its stamps'
            ),
        ),
    }
    of_measurement = True
    in_equations = False  # which do not know of it

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair | None:
        """Return an error as uncertain as it is large; a delay has no parameter, and the gyro is left out."""
        del kernel
        kind, _, name = cause.partition(':')
        text = deviation_text(cause, value).partition(':')[0]
        if kind == LATE:
            return Repair(text, without_gyro(self.errors.name), value=numbers(value), std=numbers(std), unit='s')
        unit = {BIAS: 'rad/s', TURN: 'rad'}.get(kind, '')
        parameter = {BIAS: 'bias_std', STRETCH: 'scale_std', TURN: 'orientation_std', CROSS: 'cross_axis_std'}[kind]
        return wider_prior(text, _said_of(name, parameter), value, std, unit)

    @property
    def random_walk(self) -> Array:
        """The walk of the bias."""
        return self.wandering

    def measured(self, sensor: str, motion: Motion) -> Array | None:
        """Return its reading by each, and how an orientation measured in the same axes reads: R_read = R Exp(e)."""
        if sensor == self.errors.name:
            parts = (motion.axes, motion.stretching, motion.turning, motion.crossing, -motion.slope[..., None])
            return np.concatenate(parts, axis=-1)
        if sensor != 'pose' or not self.errors.with_orientation:
            return None
        pose = np.zeros((len(motion.rotation), 6, 13))
        pose[:, :3, 6:9] = motion.rotation
        return pose

    def linearisation_value(self, value: Array, deviation: Array) -> Array:
        """Return zero where poses are measured: the readings are linear, and windows are those that are read.

        Without poses they are the integrated gyro's, less the estimate of its errors.
        """
        del deviation
        if not self.errors.alone:
            return np.zeros_like(value)
        numbers = self.factor @ value
        numbers[_LATE] = 0.0
        return np.asarray(np.linalg.pinv(self.factor) @ numbers)

    def applied_to(self, nominal: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with these errors."""
        return replace(nominal, gyro=nominal.gyro + value[:_LATE]) if self.errors.alone else nominal

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return bias and scale of its reading about the normal, and the delay."""
        normal = self._normal(detector)
        basis = np.zeros((13, 3))
        of_scale = np.concatenate((normal**2, crossed(normal) @ normal))
        basis[:3, 0], basis[_LATE, 2] = normal, 1.0
        basis[[*_SCALES, *_CROSSES], 1] = of_scale / np.linalg.norm(of_scale)
        return basis

    def _normal(self, detector: PlaneDetector) -> Array:
        """Return the normal of the plane of motion in its axes, (3,)."""
        if self.errors.link is None:
            return detector.plane_of_body(0).normal
        plane = detector.plane(self.errors.link)
        assert plane is not None, 'the motion is planar'
        return plane.normal

    def in_plane(self, detector: PlaneDetector) -> Gyro:
        """Return its planar part; the irrelevant part of the bias no longer walks."""
        seen = super().in_plane(detector)
        normal = self.plane_basis(detector)[:3, :1]
        wandering = np.zeros((13, 1))
        wandering[:3] = normal * np.sqrt(np.sum((normal.T @ self.wandering[:3]) ** 2))
        return replace(
            self,
            factor=seen.factor,
            labels=seen.labels,
            wandering=wandering if self.wandering.any() else self.wandering,
        )


def gyro(errors: GyroErrors | None) -> Gyro:
    """Return the errors of an IMU as an unknown; None if there is no IMU."""
    own = errors or GyroErrors()
    deviations = np.array([*np.repeat((own.bias, own.scale, own.orientation, own.cross), 3), own.delay])
    wandering = np.zeros((13, 3))
    wandering[:3] = own.walk * np.eye(3)
    of = f':{topic_of(own.name)}' if own.among or own.name != IMU else ''
    labels = tuple(f'{label}{of}' for label in (*np.repeat(GYRO[:4], 3).tolist(), LATE))
    factor = (_turned(own.axes) * deviations)[:, deviations > 0.0]
    return Gyro(factor, labels, wandering[:, : 3 * (own.walk > 0.0)], own)


def _turned(axes: Array) -> Array:
    """Return the (13, 13) numbers, in the axes of the readings, by those in the (3, 3) axes A of the sensitivity.

    Scales s and cross-axis sensitivities c make the symmetric matrix A (diag(s) + X(c)) A^T.
    """
    turned = np.eye(13)
    each = np.stack([axes @ own @ axes.T for own in (*map(np.diag, np.eye(3)), *crossed(np.eye(3)))], axis=-1)
    sensitivity = (*_SCALES, *_CROSSES)
    turned[np.ix_(sensitivity, sensitivity)] = np.concatenate((each[[0, 1, 2], [0, 1, 2]], each[[1, 0, 0], [2, 2, 1]]))
    return turned


@dataclass(frozen=True, eq=False)
class GyroDrift(Linear):
    """A steady change of a gyro's bias, rad/s^2, (3,): a walk hardly goes as far."""

    name: str = IMU

    words: ClassVar = {
        DRIFT: Words(
            deviation=lambda name, value: (
                f'the bias of {what_gyro(name)} drifts by {6e4 * np.linalg.norm(value):.3g} mrad/s a minute: let it '
                f'warm up, or raise {_said_of(name, "bias_walk")}'
            )
        )
    }

    def repair(self, cause: str, value: Array, std: Array, kernel: MomentumKernel) -> Repair:
        """Return a walk that goes as far."""
        del kernel
        text, root = deviation_text(cause, value).partition(':')[0], np.sqrt(_DRIFT_TIME)
        walk = wider_prior(text, f'{self.name}.bias_walk', root * value, root * std, 'rad/s/sqrt(s)')
        return replace(walk, value=numbers(value), std=numbers(std), unit='rad/s^2')

    def measured(self, sensor: str, motion: Motion) -> Array | None:
        """Return its reading by each."""
        return motion.time[:, None, None] * motion.axes if sensor == self.name else None


def drifting_gyro(name: str, deviation: float) -> GyroDrift:
    """Return the drift of a gyro's bias as an unknown, of a standard deviation in rad/s^2."""
    return GyroDrift(diagonal(np.full(3, deviation)), (f'{DRIFT}:{topic_of(name)}',) * 3, name)


def without_gyro(name: str) -> Mapping[str, Setting]:
    """Return the parameters that leave a gyro out, by the name of its parameters."""
    return {f'{IMU}.noise_density': 0.0} if name == IMU else {f'{name}.use': False}


@lru_cache(maxsize=256)
def _without_gyro(window: Window, begin: int, end: int) -> Window:
    further = window.knots.further.copy()
    further[..., begin:end] = np.nan
    return replace(window, knots=replace(window.knots, further=further))


def gyro_check(sensor: GyroSensor, kinematics: Kinematics) -> RateCheck:
    """Return the check whether a gyro turns as the poses do, and, on a link, as the joints move it."""
    without = Repair('', without_gyro(sensor.name))
    motion = partial(_turn_of_gyro, sensor=sensor, kinematics=kinematics)
    return RateCheck(motion, partial(_gyro_error, name=sensor.name), without, 'conflict')


def _turn_of_gyro(window: Samples, sensor: GyroSensor, kinematics: Kinematics) -> RateMotion | None:
    """Return how a gyro's link turned, in its axes at the start, by poses and gyro; None without a gyro."""
    if not window.further.shape[1]:
        return None
    rotation, count = window.base_rotation, len(window)
    if sensor.link is not None:
        rotation, _ = kinematics.configure(rotation, window.joint_position).link_pose(sensor.link)
    step = slope_over_window(log(rotation[0].T @ ends(rotation)))
    noise = np.sqrt(6.0 / count * spread(window.pose_covariance)[:3])
    rows = step, slope_over_window(ends(window.further[:, sensor.columns])), noise, np.zeros((3, 3)), rotation[0]
    return RateMotion(*(row[None] for row in rows))


def _gyro_error(motion: RateMotion, contradiction: float, name: str) -> tuple[str, float]:
    """Return the units or axes that a gyro has instead of the poses', and the gain; a bias is none."""
    del contradiction  # a bias has its part in it
    step, read = (each - np.mean(each, axis=0) for each in (motion.step, motion.read))
    declared = _OFF * np.sqrt(np.mean(np.sum(step**2, axis=1)))
    motion = replace(motion, step=step, read=read, noise=np.hypot(motion.noise, declared))
    contradiction = motion.misfit(motion.read)
    return likeliest(motion, contradiction, _gyro_meanings(motion, name)) if contradiction >= CONTRADICTS else ('', 0.0)


def _gyro_meanings(motion: RateMotion, name: str) -> Meanings:
    """Yield the conventions of a gyro, and the steps (W, 3) that each implies."""
    what = what_gyro(topic_of(name))
    text = f'the angular velocity of {what} is 57.3 times that of the poses: it is in degrees; accepted: rad/s, as in'
    yield 1.0, f'{text} REP 103', np.deg2rad(motion.read)
    meant, words = axes_between(motion.step, motion.read, motion.noise)
    if words:
        yield FITTED, f'{what} has {words}: correct the driver or its frame', meant
    turn, about = turn_between(motion.step, motion.read, motion.noise)
    if np.linalg.norm(log(turn)) > _TURNED:
        text = f'{what} is turned by {about} relative to its frame: correct the frame in the robot description, or set'
        yield 1.0, f'{text} {name}.frame', motion.read @ turn.T


@dataclass(frozen=True, eq=False)
class GyroSensor:
    """A gyro as a sensor of the base's angular velocity: turned by the measured pose, less the turn by joints."""

    name: str
    density: float  # rad/s/sqrt(Hz) of its noise
    columns: slice  # of its integral in `Samples.further`
    link: Link | None = None  # that it is on, where joints move it; None on the base
    axes: Array = field(default_factory=lambda: np.eye(3))  # its own, in those that it is read in
    moved_by: Array = field(default_factory=lambda: np.zeros(0))  # (n,) 1 of each joint that moves this link, else 0
    before: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (n, n) as of the robot's kinematics
    maybe_askew: bool = False  # whether its axes may be askew to those that it is read in, and nothing says how

    of_pose = False

    @property
    def noise(self) -> Mapping[str, float]:
        """The density of its noise."""
        return {f'{self.name}.noise_density': self.density}

    @property
    def leave_out(self) -> Mapping[str, Setting]:
        """A density of zero for the first gyro, as it has no name of its own."""
        return without_gyro(self.name)

    def without(self, window: Window) -> Window:
        """Return a window in which its integral is unknown."""
        return _without_gyro(window, self.columns.start, self.columns.stop)

    @property
    def of_base(self) -> Array:
        """The angular part."""
        return np.eye(3, 6)

    def observed(self, course: Course, base: Motion) -> Observation:
        """Return the mean angular velocity of the base that it measures."""
        around, inside, spacing = course.around, course.inside, course.spacing
        count, middle = inside.stop - inside.start, (inside.start + inside.stop) // 2
        axes, relative, gain, carried = around.base_rotation, np.zeros_like(around.turn), None, None
        if self.link is not None:
            shape = around.turn.shape[:-1]
            axes = course.placed.link_pose(self.link)[0].reshape(*shape, 3, 3)
            gain = np.swapaxes(course.placed.joint_twist[..., 3:] * self.moved_by[:, None], 1, 2).reshape(*shape, 3, -1)
            relative = (gain @ around.joint_velocity[..., None])[..., 0]
            carried = self._carried(course, middle)
        weight, axes = parabolic_weights(count)[:, None, None], axes[inside]
        changing = course.slope[..., 3:] + gradient(relative)[inside] / spacing
        relative = relative[inside]
        rate = course.twist[..., 3:] + relative
        within = rotate_back(axes, rate)
        own = replace(
            base,
            rate=base.twist[..., :3] + total(weight * relative),
            slope=total(weight * changing),
            axes=total(weight[..., None] * axes),
            stretching=total(weight[..., None] * axes * within[..., None, :]),
            turning=total(weight[..., None] * (skew(rate) @ axes)),
            crossing=total(weight[..., None] * (axes @ crossed(within))),
        )
        read = rotate(axes, around.further[inside][..., self.columns])
        noise = np.tile(_preintegrated(count, spacing) * self.density**2 * np.eye(3), (len(base.time), 1, 1))
        of_joints = None if gain is None else gain[middle]
        return Observation(total(weight * (read - relative)), noise, own, of_joints, carried=carried)

    def _carried(self, course: Course, middle: int) -> Carried:
        """Return how much more it reads by a turn u of each joint's load: w x u, of the angular velocity before it.

        Parameters
        ----------
        middle : the interval in the middle of the windows
        """
        windows = len(course.stack.windows)
        instants = middle * windows + np.arange(windows)
        turning = course.placed.joint_twist[instants][..., 3:]
        rate = course.twist[middle - course.inside.start][:, None, 3:] + self.before @ (
            turning * course.around.joint_velocity[middle][..., None]
        )
        by_loads = np.zeros((windows, 3, len(self.moved_by), 6))
        by_loads[..., 3:] = np.swapaxes(skew(rate) * self.moved_by[:, None, None], 1, 2)
        return Carried(instants, by_loads)


@cache
def _preintegrated(count: int, spacing: float) -> float:
    """Return the variance of a window's weighted angular velocity by white noise of unit density, 1/s.

    The integral at a knot is a mean over the knot's time, and a rate a difference of two, sharpened by the neighbours':
    the weights of the gyro's readings are the convolution of these.
    """
    fine = 20  # pieces of a knot
    between = np.zeros(count + 4)  # of the steps from knot to knot, those of two neighbours on either side among them
    between[2:-2] = parabolic_weights(count) / spacing
    between[1:-1] -= np.diff(between, 2) / 24.0
    steps = np.repeat(np.diff(np.pad(between, 1)), fine)  # of the knots' means
    readings = np.cumsum(-steps) / fine
    return float(np.sum(readings**2) * spacing / fine)


def gyro_sensors(
    gyros: Mapping[str, GyroConfig], model: RobotModel, frame_prefix: str, passive: Collection[str] = ()
) -> tuple[GyroSensor, ...]:
    """Return gyros, by the names of their parameters, as sensors with columns one after the other.

    Raises ParameterError: A gyro cannot be on the frame that its parameters name.

    Parameters
    ----------
    frame_prefix, passive : as of `sensor_link`
    """
    found = []
    for place, (name, config) in enumerate(gyros.items()):
        link = imu_link(config, model, frame_prefix, name, passive)
        columns = slice(3 * place, 3 * place + 3)
        if link is None or link.body:
            sensor = gyro_sensor(name, config.noise_density, model, link, columns)
            found.append(replace(sensor, maybe_askew=link is None and _has_askew_link(model)))
        else:
            sensor = gyro_sensor(name, config.noise_density, model, None, columns)
            found.append(replace(sensor, axes=link.rotation))
    return tuple(found)


def _has_askew_link(model: RobotModel) -> bool:
    """Return whether a link on the base, which messages of an IMU may name, has other axes than the base's."""
    rotations = [link.rotation for link in model.links if not link.body]
    return any(np.abs(each).max(axis=1).min() < _ALONG for each in rotations)


def gyro_sensor(
    name: str, density: float, model: RobotModel, link: Link | None = None, columns: slice = slice(0, 3)
) -> GyroSensor:
    """Return a gyro as a sensor; arguments as of `GyroSensor`, and the robot's model."""
    kinematics = Kinematics(model)
    moved_by = np.zeros(model.joints) if link is None else kinematics.ancestors[link.body]
    return GyroSensor(name, density, columns, link, moved_by=moved_by, before=kinematics.before)


def angular_momentum(kernel: MomentumKernel, target: Array, windows: Sequence[Window]) -> Array:
    """Return the angular momentum about the centre of mass, odometry axes, (3,); zero where poses locate the base.

    A gyro alone measures the motion then. A start at rest would be too far from a robot that tumbles.

    Parameters
    ----------
    kernel : of the robot
    target : (10,) standard parameters of its target
    windows : of which the first ones count
    """
    known, momenta = kernel.body_parameters(target), []
    for window in windows[:_FIRST]:
        middle = Stack((window,), (0,)).middle[window.inside].flat
        if np.isfinite(window.noise.pose[-1, -1]) or not middle.further.shape[-1]:
            continue
        read = middle.further[:, :3]
        if not np.all(np.isfinite(read)):
            continue
        placed = kernel.kinematics.configure(middle.base_rotation, middle.joint_position)
        joints = kernel.kinematics.body_twists(placed, middle.joint_velocity, np.zeros((len(middle), 6)))
        bodies = express(known, placed.rotation, placed.position)
        inverse_inertia, moving = inverse_inertia_and_joint_momentum(kernel, middle.stored, bodies, placed, joints)
        # V = M^-1 (h - b), no linear momentum: solve with the angular part of M^-1 alone.
        at_rest = (inverse_inertia @ moving[..., None])[..., 0]
        rate = rotate(middle.base_rotation, read) + at_rest[:, 3:]
        momenta.append(np.linalg.solve(inverse_inertia[:, 3:, 3:], rate[..., None])[..., 0])
    return np.mean(np.concatenate(momenta), axis=0) if momenta else np.zeros(3)


class ImuReader:
    """Reads Imu messages: the angular velocity in base axes, and the orientation where that is asked for.

    Of an IMU on a link that joints move, the angular velocity is in the axes of that link.

    Parameters
    ----------
    axes : (3, 3) of each frame that is accepted, by name: to those of the base link, or of the link that it moves with
    frame : name of the one it is in, which overrides the messages; empty leaves it to these
    orientation_std : rad, of an orientation whose covariance is not set; None does not read orientations
    """

    def __init__(self, axes: Mapping[str, Array], frame: str, orientation_std: float | None = None) -> None:
        self._axes = axes
        self._frame = frame
        self._orientation_std = orientation_std
        self.other_frame = ''

    def read(self, messages: Sequence[Any]) -> tuple[ImuStream | None, Counter[str]]:
        """Return the measurements, and the numbers of dropped messages by cause."""
        dropped: Counter[str] = Counter()
        frames = [self._frame or message.header.frame_id.lstrip('/') for message in messages]
        kept = []
        for message, frame in zip(messages, frames, strict=True):
            if frame not in self._axes:
                self.other_frame = frame
                dropped[IMU_FRAME] += 1
            elif message.angular_velocity_covariance[0] == -1.0:  # REP 145
                dropped[IMU_WITHOUT_RATE] += 1
            else:
                kept.append((message, frame))
        if not kept:
            return None, dropped
        rates = (message.angular_velocity for message, _ in kept)
        rate = np.array([(each.x, each.y, each.z) for each in rates], dtype=float)
        finite = np.all(np.isfinite(rate), axis=1)
        real = np.all(np.abs(rate) < _LARGEST, axis=1)
        dropped[IMU_NOT_FINITE] += int(np.sum(~finite))
        dropped[IMU_NOT_REAL] += int(np.sum(finite & ~real))
        turned = np.empty_like(rate)
        names = np.array([frame for _, frame in kept])
        for name in dict.fromkeys(names.tolist()):
            # A sum over axes: products of matrices show the size of the batch in the last bit.
            turned[names == name] = np.einsum('ij,nj->ni', self._axes[name], rate[names == name])
        stamps = stamps_of([message for message, _ in kept])
        if self._orientation_std is None:
            return ImuStream(stamps, turned, read=rate)[finite & real], +dropped
        stream = ImuStream(stamps, turned, *self._orientations(kept, self._orientation_std, dropped), rate)
        return stream[finite & real], +dropped

    def _orientations(
        self, kept: Sequence[tuple[Any, str]], deviation: float, dropped: Counter[str]
    ) -> tuple[Array, Array, Flags]:
        """Return orientations and covariances (N, 3, 3) each, NaN where none is given, and which messages give them."""
        given = [(message.orientation, message.orientation_covariance) for message, _ in kept]
        quaternion = np.array([(each.x, each.y, each.z, each.w) for each, _ in given], dtype=float)
        covariance = np.array([each for _, each in given], dtype=float).reshape(-1, 3, 3)
        present: Flags = covariance[:, 0, 0] != -1.0  # REP 145
        with np.errstate(over='ignore', invalid='ignore'):
            unit = np.abs(np.sqrt(np.sum(quaternion**2, axis=1)) - 1.0) < QUATERNION_TOLERANCE
        dropped[IMU_BAD_QUATERNION] += int(np.sum(present & ~unit))
        good = present & unit
        rotation: Array = np.full((len(kept), 3, 3), np.nan)
        measured = rotation_from_quaternion(quaternion[good])
        # That of the sensor's frame in the world: the base's is turned back by where the sensor is on it.
        back = np.array([self._axes[frame] for _, frame in kept])[good]
        rotation[good] = np.einsum('nij,nkj->nik', measured, back)
        default = deviation**2 * np.eye(6)
        declared: Flags = good.copy()
        for index in np.flatnonzero(good).tolist():
            whole = default.copy()
            whole[3:, 3:] = covariance[index]
            used = usable_covariance(whole, default)
            covariance[index], declared[index] = used.matrix[3:, 3:], used.is_given[1]
        return rotation, np.where(good[:, None, None], covariance, np.nan), declared


def imu_link(
    config: GyroConfig, model: RobotModel, frame_prefix: str, name: str = IMU, passive: Collection[str] = ()
) -> Link | None:
    """Return the link of an IMU; None if its messages name one on the base.

    Raises ParameterError: There is no such link, joints that nothing reads move it, or it measures alone on the arm.

    Parameters
    ----------
    frame_prefix, passive : as of `sensor_link`
    name : of its parameters
    """
    if not config.frame:
        return None
    link = sensor_link(model, config.frame, frame_prefix, f'{name}.frame', passive)
    if link.body and isinstance(config, ImuConfig) and config.alone:
        raise ParameterError(
            f"parameter '{name}.frame' is '{config.frame}', and 'imu.alone' is true; accepted: "
            f'{listing(each.name for each in model.links if not each.body)}'
        )
    return link


def gyro_instruments(
    gyros: Mapping[str, GyroConfig],
    sensors: Sequence[GyroSensor],
    model: RobotModel,
    frame_prefix: str,
    orientation_std: float,
    maximum_gap: int,
) -> list[Instrument]:
    """Return the readers and integrators of gyros, by the names of their parameters.

    Parameters
    ----------
    frame_prefix, orientation_std : as of `imu_reader`
    maximum_gap : as of `RateIntegrator`
    """
    return [
        Instrument(
            sensor,
            imu_reader(gyros[sensor.name], sensor, model, frame_prefix, orientation_std),
            RateIntegrator(maximum_gap, gyros[sensor.name].range, on_base=sensor.link is None),
            _numbers,
        )
        for sensor in sensors
    ]


def _numbers(stream: ImuStream) -> Array:
    return np.concatenate((stream.angular_velocity, stream.rotation.reshape(len(stream.stamp), -1)), axis=1)


def imu_reader(
    config: GyroConfig, sensor: GyroSensor, model: RobotModel, frame_prefix: str, orientation_std: float
) -> ImuReader:
    """Return the reader of a gyro's messages: in base axes, or in those of a link that joints move.

    Parameters
    ----------
    frame_prefix : before the names of links in frame names
    orientation_std : rad, of an orientation in messages without a covariance
    """
    axes = {frame_prefix + link.name: link.rotation for link in model.links if link.body == 0}
    if sensor.link is not None:
        axes = {config.frame: np.eye(3)}
    oriented = isinstance(config, ImuConfig) and config.orientation
    return ImuReader(axes, config.frame, orientation_std if oriented else None)


def declared_gyro(config: GyroConfig, sensor: GyroSensor, *, among: bool = False) -> Gyro:
    """Return the errors of a gyro, that may be one among others."""
    alone = oriented = False
    if isinstance(config, ImuConfig):
        alone, oriented = config.alone, config.orientation
    scale, shared = config.scale_std, config.cross_axis_std
    if sensor.maybe_askew:
        # A (diag(s) + X(c)) A^T with any A: its diagonal, and the rest times the square root of 2, vary by no more.
        scale = max(scale, np.sqrt(2.0) * shared)
        shared = scale / np.sqrt(2.0)
    errors = GyroErrors(
        config.bias_std,
        scale,
        config.orientation_std,
        0.0 if alone else _IMU_DELAY_STD,  # alone, its delay is the joints' time offset
        config.bias_walk,
        shared,
        alone=alone and not oriented,
        with_orientation=oriented,
        link=sensor.link,
        axes=sensor.axes,
        name=sensor.name,
        among=among,
    )
    return gyro(errors)
