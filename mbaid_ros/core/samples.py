"""Readings as arrays: streams and samples, packets of serialised messages, the rates that positions give."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Any, ClassVar, Generic, Literal, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre

from mbaid_ros.core.geometry import Array, Flags, cross, log

S = TypeVar('S', bound='ArrayRecord')
Index = int | slice | npt.NDArray[np.bool_] | npt.NDArray[np.intp]
Stamps = npt.NDArray[np.int64]
# Fourth degree: rates to third order in time; the remainder is far below the noise for motions slower than the window.
_DEGREE = 4
# Condition number of a fit, beyond which its stamps lie too close together, and a lower degree serves.
_WORST_CONDITION = 1e4
FEWEST = 2  # samples that a rate can be taken from
JOINT_STATE_TYPE = 'sensor_msgs/msg/JointState'
ODOMETRY_TYPE = 'nav_msgs/msg/Odometry'
IMU_TYPE = 'sensor_msgs/msg/Imu'
ENCAPSULATION = b'\x00\x01'  # plain CDR, little-endian
_BODY = 4  # where the message begins
_HEADER = 12  # where the message goes on after its stamp
_SPARE = 3  # bytes that may follow a message: it is padded to a multiple of four
MOST_NAMES = 10_000  # names of a message: no robot has as many joints
_LONGEST_HEAD = 100_000  # bytes: layouts are kept, with their constant parts
_length = struct.Struct('<I').unpack_from
_MOST_LAYOUTS = 64  # that are remembered of a topic
_stamp = struct.Struct('<4xiI').unpack_from
# Causes for which messages, or parts of them, are unusable.
JOINT_MISSING = 'joint missing'
LENGTH_MISMATCH = 'names and values differ in number'
NOT_FINITE = 'NaN or infinite value'
NAMED_TWICE = 'joint named twice'
TOO_MANY_NAMES = 'more than 10000 names'
NOT_REAL = 'value beyond anything real'
WRONG_CHILD_FRAME = 'child_frame_id is no frame on the base'
BAD_QUATERNION = 'orientation is not a unit quaternion'
LOST_TRACKING = 'tracking of the base lost, a pose of zeros'
POSE_COVARIANCE = 'covariance of the pose is none'
TWIST_COVARIANCE = 'covariance of the twist is none'
Source = Literal['odom', 'pose', 'tf']


class Input(NamedTuple):
    """A topic that a named sensor speaks on, and the message types that it may have."""

    topic: str
    types: tuple[str, ...]
    slow: bool = False  # whether a second or more between two messages is no gap


class ArrayRecord:
    """A frozen dataclass of arrays whose first axes go together; the base of such classes."""

    __slots__ = ()
    __dataclass_fields__: ClassVar[dict[str, Any]]  # `fields` of it takes longer than to slice the arrays

    def __len__(self) -> int:
        """Return how many entries there are."""
        return len(getattr(self, next(iter(self.__dataclass_fields__))))

    def __getitem__(self: S, index: Index) -> S:
        """Return a slice of the entries, or those of a mask or of indices; a single one without the axis."""
        return type(self)(*[getattr(self, name)[index] for name in self.__dataclass_fields__])

    @classmethod
    def concatenate(cls: type[S], parts: Sequence[S]) -> S:
        """Return the entries of the parts, in order."""
        if len(parts) == 1:
            return parts[0]
        return cls(*[_joined([getattr(part, name) for part in parts]) for name in cls.__dataclass_fields__])


def _joined(values: Sequence[Any]) -> Any:
    """Return arrays, or records of arrays within records, joined along their first axes."""
    first = values[0]
    return first.concatenate(values) if isinstance(first, ArrayRecord) else np.concatenate(values)


_SECOND = 1_000_000_000  # ns
NO_STAMP = int(np.iinfo(np.int64).min)  # in place of a stamp that is none


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviation of each sensor channel, a sample (white unless noted)."""

    joint_position: float  # rad (m for a prismatic joint)
    joint_velocity: float  # rad/s (m/s)
    # base_position, base_orientation: m, rad; used where the Odometry carries no pose covariance
    base_position: float
    base_orientation: float
    # base_linear_velocity, base_angular_velocity: m/s, rad/s; used where it carries no twist covariance
    base_linear_velocity: float
    base_angular_velocity: float
    base_correlation_time: float = 0.0  # s, over which the errors of the base's poses are correlated; 0 for white noise

    def pose_covariance(self) -> Array:
        """Return the (6, 6) covariance of (position, orientation)."""
        return np.diag(np.repeat([self.base_position, self.base_orientation], 3) ** 2)

    def twist_covariance(self) -> Array:
        """Return the (6, 6) covariance of (linear, angular) velocity."""
        return np.diag(np.repeat([self.base_linear_velocity, self.base_angular_velocity], 3) ** 2)

    def for_window(self, samples: Samples) -> SensorNoise:
        """Return the noise of a window: estimated levels of the joints, if its samples have them."""
        if not samples.noise.shape[1]:
            return self
        position, velocity, time = samples.noise[-1].tolist()
        return replace(self, joint_position=position, joint_velocity=velocity, base_correlation_time=time)


@dataclass(frozen=True)
class Samples(ArrayRecord):
    """A batch of N samples, joints and base at common stamps."""

    time: Array  # (N,) s since the first sample of the run, increasing
    joint_position: Array  # (N, n) rad or m, in the model's joint order
    joint_velocity: Array  # (N, n) rad/s or m/s
    base_position: Array  # (N, 3) m, origin of the base link in the odometry frame
    base_rotation: Array  # (N, 3, 3), base link to odometry frame
    base_linear_velocity: Array  # (N, 3) m/s, of the base link's origin, in odometry axes
    base_angular_velocity: Array  # (N, 3) rad/s, in odometry axes
    pose_covariance: Array  # (N, 6, 6) position and orientation (fixed axes), both in odometry axes
    twist_covariance: Array  # (N, 6, 6) linear and angular velocity, in base axes
    # (N, n) variance of a velocity over that of a position (1/s^2) if derived from positions; NaN, the default, for a
    # measured velocity
    joint_rate_gain: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (N, n + 6) of the velocities of joints and base (linear, angular): variance of their errors' tilt over a window,
    # over that of independent errors with as noisy a mean; 1, the default, for a measured velocity
    rate_tilt: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (N, 6) change of (P, L) by known thrust since the first sample, odometry frame, L about its origin: N s, N m s;
    # zero by default
    impulse: Array = field(default_factory=lambda: np.zeros((0, 6)))
    # (N, c) readings of the momentum stored inside bodies, as in `Storage`: rad/s, N m s; none by default
    stored: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (N, 60 b) derivatives of the change of (P, L) by an orbit since the first sample, by the standard parameters of b
    # bodies (6 x 10, rows first), falling frame, L about its origin; none by default
    gravity_columns: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (N, 30 f) derivatives of the change of (P, L) by known thrust, L about the odometry's origin, by the errors of f
    # thrusters: scale, turn, delay (6 x 5, rows first); none by default
    thrust: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (N, c) integrals of the gyros, each in columns of its own: (3,) rad, of its angular velocity since it began, in
    # base axes, or, if joints move its link, in those of that link; NaN where unknown, (N, 0) without any
    further: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (N, c) sums over the readings of sensors with stamps of their own, since the sample before, each in columns of
    # its own; zeros where a sensor has read nothing, (N, 0) without any
    readings: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (N,) s, between the poses, or between the samples if these are further apart; 0 where unknown
    apart: Array = field(default_factory=lambda: np.zeros(0))
    # (N, 3) estimated standard deviations of joint positions and velocities, and correlation time of the poses' errors
    # (s); (N, 0) where they are as declared
    noise: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (N, 2) variance of a component of all corrections so far by which the poses are in the frame of the first ones: of
    # their turn, rad^2, and of their displacement at the base, m^2; zeros where the poses do not jump
    frame: Array = field(default_factory=lambda: np.zeros((0, 2)))

    def __post_init__(self) -> None:
        """Fill in the defaults."""
        if len(self.frame) != len(self.time):
            object.__setattr__(self, 'frame', np.zeros((len(self.time), 2)))
        if len(self.impulse) != len(self.time):
            object.__setattr__(self, 'impulse', np.zeros((len(self.time), 6)))
        if len(self.apart) != len(self.time):
            object.__setattr__(self, 'apart', np.zeros(len(self.time)))
        for name in ('stored', 'gravity_columns', 'thrust', 'further', 'readings', 'noise'):
            if len(getattr(self, name)) != len(self.time):
                object.__setattr__(self, name, np.zeros((len(self.time), 0)))
        if self.joint_rate_gain.shape != self.joint_velocity.shape:
            object.__setattr__(self, 'joint_rate_gain', np.full(self.joint_velocity.shape, np.nan))
        if len(self.rate_tilt) != len(self.time):
            object.__setattr__(self, 'rate_tilt', np.ones((len(self.time), self.joint_velocity.shape[1] + 6)))

    @cached_property
    def missing_rates(self) -> tuple[bool, bool]:
        """Whether joint velocities, and whether parts of the base's twist, are missing."""
        # One number that is not finite makes a sum that is not.
        twist = self.base_linear_velocity.sum() + self.base_angular_velocity.sum()
        return not math.isfinite(self.joint_velocity.sum()), not math.isfinite(twist)


@dataclass(frozen=True)
class JointStream(ArrayRecord):
    """Joint measurements as they arrived."""

    stamp: Stamps  # (N,) int64 ns
    position: Array  # (N, n) in the model's joint order
    velocity: Array  # (N, n) in the model's joint order
    stored: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (N, c) as in Samples; none by default

    def __post_init__(self) -> None:
        """Fill in the defaults."""
        if len(self.stored) != len(self.stamp):
            object.__setattr__(self, 'stored', np.zeros((len(self.stamp), 0)))

    def without_stored_momentum(self, joints: int) -> JointStream:
        """Return the first n as joints; the rates of the others are readings of stored momentum."""
        if self.position.shape[1] == joints:
            return self
        return JointStream(self.stamp, self.position[:, :joints], self.velocity[:, :joints], self.velocity[:, joints:])


@dataclass(frozen=True)
class BaseStream(ArrayRecord):
    """Base measurements as they arrived."""

    stamp: Stamps  # (N,) int64 ns
    position: Array  # (N, 3) m, base link origin in the odometry frame
    rotation: Array  # (N, 3, 3) base link to odometry axes
    linear_velocity: Array  # (N, 3) m/s, in odometry axes
    angular_velocity: Array  # (N, 3) rad/s, in odometry axes
    pose_covariance: Array  # (N, 6, 6) as in Samples
    twist_covariance: Array  # (N, 6, 6) as in Samples
    # (N, 4) whether the message has the noise of position, orientation, linear and angular velocity; all by default
    declared: Flags = field(default_factory=lambda: np.ones((0, 4), dtype=bool))

    def __post_init__(self) -> None:
        """Fill in the defaults."""
        if len(self.declared) != len(self.stamp):
            object.__setattr__(self, 'declared', np.ones((len(self.stamp), 4), dtype=bool))


@dataclass(frozen=True)
class ImuStream(ArrayRecord):
    """Measurements of an IMU as they arrived."""

    stamp: Stamps  # (N,) int64 ns
    angular_velocity: Array  # (N, 3) rad/s, in base axes, or, if joints move its link, in those of that link
    # (N, 3, 3) base link to world axes; NaN, the default, where not measured
    rotation: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))
    rotation_covariance: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))  # (N, 3, 3) rad^2, world axes
    # (N,) whether the message has the noise of the orientation
    declared: Flags = field(default_factory=lambda: np.zeros(0, dtype=bool))
    # (N, 3) rad/s, angular velocity in the gyro's own axes; by default those of `angular_velocity`
    read: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        """Fill in the defaults."""
        if len(self.read) != len(self.stamp):
            object.__setattr__(self, 'read', self.angular_velocity)
        for name in ('rotation', 'rotation_covariance'):
            if len(getattr(self, name)) != len(self.stamp):
                object.__setattr__(self, name, np.full((len(self.stamp), 3, 3), np.nan))
        if len(self.declared) != len(self.stamp):
            object.__setattr__(self, 'declared', np.zeros(len(self.stamp), dtype=bool))


def block_std(covariance: Array) -> Array:
    """Return the mean standard deviations (N, 2) of the linear and the angular block of covariances (N, 6, 6)."""
    variance = np.diagonal(covariance, axis1=1, axis2=2).reshape(-1, 2, 3)
    return np.asarray(np.sqrt(np.mean(variance, axis=2)))


@dataclass(frozen=True)
class PolynomialFit:
    """A polynomial fitted to N instants, for any number of signals."""

    # values, slopes: (N, d + 1) the polynomials and their derivatives (1/s) at the instants
    values: Array
    slopes: Array
    solve: Array  # (d + 1, N) from measurements to coefficients
    mean_gain: float  # variance of the mean slope over that of one measurement, 1/s^2
    tilt: float  # variance of the slope's trend, at the root mean square of the instants, over that of its mean

    def smooth(self, measured: Array) -> tuple[Array, Array]:
        """Return values and derivatives of (N, k) signals."""
        coefficients = self.solve @ measured
        return self.values @ coefficients, self.slopes @ coefficients


def polynomial_fit(time: Array) -> PolynomialFit:
    """Return the fit for N >= 2 instants (s, increasing): of degree 4, or of as much as they determine."""
    for degree in range(min(_DEGREE, len(time) - 1), 1, -1):
        local, condition = _fitted(time, degree)
        if condition < _WORST_CONDITION:
            return local
    return _fitted(time, 1)[0]


def _fitted(time: Array, degree: int) -> tuple[PolynomialFit, float]:
    """Return the fit of a degree to N instants, s, and its condition number."""
    half = 0.5 * (time[-1] - time[0])
    place = (time - time[0]) / half - 1.0
    values = legendre.legvander(place, degree)
    orthonormal, triangle = np.linalg.qr(values)
    slopes = values[:, :-1] @ _derivatives(degree) / half
    solve = np.linalg.solve(triangle, orthonormal.T)
    off = (place - np.mean(place))[:, None]
    trend = off / np.sqrt(np.mean(off**2))  # independent errors have as large a trend as a mean
    mean, tilt = (float(np.sum((np.mean(part, axis=0) @ solve) ** 2)) for part in (slopes, trend * slopes))
    return PolynomialFit(values, slopes, solve, mean, tilt / mean), float(np.linalg.cond(triangle))


@cache
def _derivatives(degree: int) -> Array:
    """Return the coefficients (d, d + 1) of the derivatives of the first d + 1 Legendre polynomials."""
    return np.asarray(legendre.legder(np.eye(degree + 1)))


def with_rates(window: Samples) -> Samples:
    """Return a window of at least two samples with every velocity, incomplete ones derived from the positions."""
    joints, base = window.missing_rates
    if not joints and not base:
        return window
    local = polynomial_fit(window.time)
    if joints:
        window = _joint_rates(window, local)
    return _base_rates(window, local) if base else window


def _joint_rates(window: Samples, local: PolynomialFit) -> Samples:
    absent = ~np.all(np.isfinite(window.joint_velocity), axis=0)
    # About a mid-window position: differences of large angles would lose digits.
    middle = window.joint_position[len(window) // 2]
    slopes = local.smooth(window.joint_position - middle)[1]
    gain = np.where(absent, len(window) * local.mean_gain, np.nan)  # single samples whose mean is as noisy as the slope
    tilt = window.rate_tilt.copy()
    tilt[:, : len(absent)][:, absent] = local.tilt
    return replace(
        window,
        joint_velocity=np.where(absent, slopes, window.joint_velocity),
        joint_rate_gain=np.broadcast_to(gain, slopes.shape),
        rate_tilt=tilt,
    )


def _base_rates(window: Samples, local: PolynomialFit) -> Samples:
    linear = np.all(np.isfinite(window.base_linear_velocity))
    angular = np.all(np.isfinite(window.base_angular_velocity))
    velocity, rate = _base_slopes(window.base_position, window.base_rotation, local)
    to_base = np.zeros((len(window), 6, 6))
    to_base[:, :3, :3] = to_base[:, 3:, 3:] = np.swapaxes(window.base_rotation, -1, -2)
    derived = len(window) * local.mean_gain * (to_base @ window.pose_covariance @ np.swapaxes(to_base, -1, -2))
    covariance, tilt = window.twist_covariance.copy(), window.rate_tilt.copy()
    for block, measured in ((slice(0, 3), linear), (slice(3, 6), angular)):
        if not measured:
            covariance[:, block] = covariance[..., block] = 0.0
            covariance[:, block, block] = derived[:, block, block]
            tilt[:, -6:][:, block] = local.tilt
    return replace(
        window,
        base_linear_velocity=window.base_linear_velocity if linear else velocity,
        base_angular_velocity=window.base_angular_velocity if angular else rate,
        twist_covariance=covariance if linear or angular else derived,
        rate_tilt=tilt,
    )


def _base_slopes(position: Array, rotation: Array, local: PolynomialFit) -> tuple[Array, Array]:
    """Return linear and angular velocities (N, 3) m/s, rad/s, odometry axes, by the poses of a window.

    Parameters
    ----------
    position, rotation : (N, 3) m, (N, 3, 3)
    local : the fit to their instants
    """
    middle = len(position) // 2
    velocity = local.smooth(position - position[middle])[1]
    turn, slope = local.smooth(log(rotation @ rotation[middle].T))
    # R = Exp(turn) R_mid turns at w = J_l(turn) turn', with the left Jacobian of the rotation group.
    angle = np.sqrt(np.sum(turn**2, axis=-1, keepdims=True))
    second = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    third = np.where(angle > 1e-3, (1.0 - np.sinc(angle / np.pi)) / np.maximum(angle, 1e-3) ** 2, 1.0 / 6.0)
    bend = cross(turn, slope)
    return velocity, slope + second * bend + third * cross(turn, bend)


class MisfitError(Exception):
    """The bytes are not laid out as they are understood here; a general deserialiser may know more."""


class Cursor:
    """Goes through the bytes of a message and notes the parts that all messages laid out alike have in common.

    Raises MisfitError where the bytes are encoded in another way, or too few.
    """

    def __init__(self, data: bytes) -> None:
        if len(data) < _HEADER or data[:2] != ENCAPSULATION:
            raise MisfitError
        self._data = data
        self._place = _HEADER
        self.constant = [(0, len(ENCAPSULATION))]  # begin and end

    def length(self) -> int:
        """Return the length that stands next."""
        begin = self._aligned(4)
        if begin + 4 > len(self._data):
            raise MisfitError
        self._note(begin, begin + 4)
        return int(_length(self._data, begin)[0])

    def string(self) -> str:
        """Return the text that comes next."""
        length = self.length()
        begin, end = self._place, self._place + length
        if length < 1 or end > len(self._data) or end > _LONGEST_HEAD or self._data.find(0, begin, end) != end - 1:
            raise MisfitError
        self._note(begin, end)
        try:
            return self._data[begin : end - 1].decode()
        except UnicodeDecodeError as error:
            raise MisfitError from error

    def strings(self) -> tuple[str, ...]:
        """Return the texts that come next, after their number."""
        count = self.length()
        if count > MOST_NAMES:
            raise MisfitError
        return tuple(self.string() for _ in range(count))

    def sequence(self) -> tuple[int, int]:
        """Return place and number of the doubles that come next, after their number; they may vary."""
        count = self.length()
        return self.doubles(count), count

    def doubles(self, count: int) -> int:
        """Return the place of so many doubles that come next; they may vary."""
        begin = self._aligned(8) if count else self._place
        if begin + 8 * count > len(self._data):
            raise MisfitError
        self._place = begin + 8 * count
        return begin

    def end(self) -> None:
        """Check that nothing follows but padding."""
        if len(self._data) - self._place > _SPARE:
            raise MisfitError

    def _aligned(self, size: int) -> int:
        return _BODY + (self._place - _BODY + size - 1) // size * size

    def _note(self, begin: int, end: int) -> None:
        """Go on to an end; the bytes between must be the same in other messages. Padding, which varies, is left out."""
        if self.constant[-1][1] == begin:
            begin = self.constant.pop()[0]
        self.constant.append((begin, end))
        self._place = end


class PacketLayout:
    """The common parts of messages of one layout: size in bytes, strings and lengths, and the places of the numbers."""

    def __init__(self, data: bytes, cursor: Cursor, places: dict[str, tuple[int, int]]) -> None:
        cursor.end()
        self.size = len(data)
        self._constant = [(begin, data[begin:end]) for begin, end in cursor.constant]
        self._record = np.dtype(
            {
                'names': ['stamp', *places],
                'formats': [[('sec', '<i4'), ('nanosec', '<u4')], *(('<f8', (n,)) for _, n in places.values())],
                'offsets': [_BODY, *(place for place, _ in places.values())],
                'itemsize': len(data),
            }
        )

    def fits(self, data: bytes) -> bool:
        """Return whether a message is laid out like this."""
        return len(data) == self.size and all(data.startswith(part, begin) for begin, part in self._constant)

    def stamps(self, joined: bytes) -> Stamps | None:
        """Return the stamps (N,), ns, of N messages of this size in a row, None if one is not laid out like this."""
        content = np.frombuffer(joined, np.uint8).reshape(-1, self.size)
        for begin, part in self._constant:
            if not np.all(content[:, begin : begin + len(part)] == np.frombuffer(part, np.uint8)):
                return None
        return _stamps(np.frombuffer(joined, self._record))

    def _read(self, messages: Sequence[Packets[Any]]) -> tuple[Stamps, npt.NDArray[np.void]]:
        """Return the stamps (N,), ns, of N messages that are laid out like this, and all their numbers."""
        data = messages[0].data if len(messages) == 1 else b''.join([message.data for message in messages])
        records = np.frombuffer(data, self._record)
        return _stamps(records), records


def _stamps(records: npt.NDArray[np.void]) -> Stamps:
    stamp = records['stamp']
    nanosec = stamp['nanosec'].astype(np.int64)
    return np.where(nanosec < _SECOND, stamp['sec'].astype(np.int64) * _SECOND + nanosec, NO_STAMP)


Layout = TypeVar('Layout', bound=PacketLayout)


class Packets(Sequence[Any], Generic[Layout]):
    """N messages of one checked layout as their bytes, one after the other, with their stamps (N,), ns."""

    __slots__ = ('data', 'layout', 'stamps')

    def __init__(self, data: bytes, layout: Layout, stamps: Stamps) -> None:
        self.data = data
        self.layout: Layout = layout
        self.stamps = stamps

    def __len__(self) -> int:
        return len(self.stamps)

    def __getitem__(self, place: int | slice) -> Packets[Layout]:
        """Return one of them, or some."""
        some = slice(place, place + 1 or None) if isinstance(place, int) else place
        chosen = np.frombuffer(self.data, f'V{self.layout.size}')[some]
        if isinstance(place, int) and not len(chosen):
            raise IndexError(place)  # ends an iteration
        return Packets(chosen.tobytes(), self.layout, self.stamps[some])


class Packer(Generic[Layout]):
    """Makes packets of the messages of a topic, whose type has a kind of layout."""

    def __init__(self, kind: Callable[[bytes], Layout]) -> None:
        self._kind = kind
        self._known: dict[int, list[Layout]] = {}  # by the size of the messages
        self._count = 0

    def __call__(self, data: bytes) -> Packets[Layout] | None:
        """Return a message as packets, None where its bytes are not understood: a general deserialiser is to try."""
        for layout in self._known.get(len(data), ()):
            if layout.fits(data):
                return _packet(data, layout)
        try:
            learnt: Layout = self._kind(data)
        except MisfitError:
            return None
        if self._count == _MOST_LAYOUTS:
            self._known.clear()
            self._count = 0
        self._known.setdefault(len(data), []).append(learnt)
        self._count += 1
        return _packet(data, learnt)

    def many(self, given: Sequence[bytes]) -> Packets[Layout] | None:
        """Return messages together, None where not all are laid out as the first: then look at them one by one."""
        first = self(given[0]) if given else None
        if first is None:
            return None
        data = b''.join(given)
        stamps = first.layout.stamps(data) if set(map(len, given)) == {first.layout.size} else None
        return None if stamps is None else Packets(data, first.layout, stamps)


def _packet(data: bytes, layout: Layout) -> Packets[Layout]:
    second, nanosecond = _stamp(data)
    return Packets(data, layout, np.array([second * _SECOND + nanosecond if nanosecond < _SECOND else NO_STAMP]))


@dataclass(frozen=True)
class BasePose:
    """A pose of a frame on the base: stamp (ns), position and orientation (x, y, z, w), covariance (36,) or zeros."""

    stamp: int
    frame_id: str
    child_frame_id: str
    numbers: tuple[float, ...]
    covariance: Any


def stamp_of(message: Any) -> int:
    """Return the header stamp of a message, ns; NO_STAMP where its nanosec are a second or more."""
    if isinstance(message, Packets):  # one
        return int(message.stamps[0])
    if isinstance(message, BasePose):
        return message.stamp
    stamp = message.header.stamp
    return int(stamp.sec) * _SECOND + int(stamp.nanosec) if stamp.nanosec < _SECOND else NO_STAMP


def stamps_of(messages: Sequence[Any]) -> Stamps:
    """Return the header stamps of N messages, (N,) ns."""
    if isinstance(messages, Packets):
        return messages.stamps
    return np.array([stamp_of(message) for message in messages], dtype=np.int64)


def number_of(messages: Sequence[Any]) -> int:
    """Return the number of messages, some of which may be packets of several."""
    return sum(len(each) if isinstance(each, Packets) else 1 for each in messages)
