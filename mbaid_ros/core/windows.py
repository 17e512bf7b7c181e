"""Windows: samples averaged to knots, windows with their neighbours, gaps that end a row of windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from itertools import pairwise
from typing import Protocol

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, Integers, cross, crossed, exp, log, mounted_base, skew
from mbaid_ros.core.robot.momentum import THRUSTER_ERRORS, BodyStates, about_points
from mbaid_ros.core.robot.urdf import Transmission
from mbaid_ros.core.samples import (
    ArrayRecord,
    Samples,
    SensorNoise,
    Stamps,
)

# Knots that a window needs of its neighbours, before and after, for its fourth-order formulas.
BEFORE, AFTER = 3, 4
# Weights of the two or four knots around an empty one: exact for straight lines and cubics.
_LINEAR, _CUBIC = np.array([1.0, 1.0]) / 2.0, np.array([-1.0, 4.0, 4.0, -1.0]) / 6.0
# Rows of a twist (v, w) in the order (angular, linear) of a pose error.
ANGULAR_FIRST = np.array([3, 4, 5, 0, 1, 2])
# Of a fourth difference, what `midpoints` leaves out: of midway values, and at the ends of the knots.
_TRUNCATION, _AT_AN_END = 3.0 / 256.0, 1.0 / 8.0
_FOURTH = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
_KNOT = 0.05  # s, wanted spacing of knots: errors of the fourth-order formulas are then below the noise
# Knots in a period of the fastest passive joint, everything else held: a free robot swings up to twice as fast.
_KNOTS_A_PERIOD = 10.0
_FEWEST_KNOTS = 5  # of a window: the window before it needs four of them
# Range of a joint's knots from which it has moved, in deviations of one sample: noise reaches nine in an hour.
_MOVED = 10.0


class Windows:
    """Collects samples and releases each window of a length (s) once a later sample has arrived.

    Window k holds the samples with k <= time / length < k + 1.
    """

    def __init__(self, length: float) -> None:
        self._length = length
        self._parts: list[Samples] = []

    def push(self, samples: Samples) -> list[Samples]:
        """Add samples; return the windows that they close, in order, without empty ones."""
        number = self._numbers(samples)
        last = self._numbers(self._parts[-1])[-1] if self._parts else number[0]
        starts = np.flatnonzero(np.diff(number, prepend=last))
        closed = []
        begin = 0
        for start in starts:
            if start > begin:
                self._parts.append(samples[begin:start])
            closed.append(Samples.concatenate(self._parts))
            self._parts = []
            begin = start
        self._parts.append(samples[begin:])
        return closed

    def flush(self) -> list[Samples]:
        """Return the open window."""
        parts, self._parts = self._parts, []
        return [Samples.concatenate(parts)] if parts else []

    def _numbers(self, samples: Samples) -> Stamps:
        # A nanosecond of slack: 0.5 s after the first sample is in window 1, however the division rounds.
        return np.floor((samples.time + 1e-9) / self._length).astype(np.int64)


@dataclass(frozen=True)
class Knots(ArrayRecord):
    """J consecutive knots, equally spaced; all NaN where one has no sample."""

    joint_position: Array  # (J, n)
    base_rotation: Array  # (J, 3, 3)
    base_position: Array  # (J, 3) m, relative to the run's origin
    base_twist: Array  # (J, 6) (v, w) in odometry axes; NaN where not measured
    spread: Array  # (J,) variance of the sample times in the knot over the square of the knots' spacing
    offset: Array  # (J,) mean of the sample times less the knot's centre, over the knots' spacing
    impulse: Array  # (J, 6) change of (P, L) by known thrust, L about the run's origin
    stored: Array  # (J, c) readings of the momentum stored inside bodies
    # gravity_columns, thrust: (J, 60 b), (J, 30 f) as in Samples, L about the run's origin
    gravity_columns: Array
    thrust: Array
    further: Array  # (J, c) as in Samples; NaN where a sample has none
    # (J, 36) where the gyro alone measures the orientation: its error since the run began, odometry axes, by each error
    # of the gyro (3 x 12, rows first): bias, scale, turn, cross-axis; none where it is measured
    attitude_sensitivity: Array
    # (J, 2, c) as in Samples, sums over the first and the second half of a knot's time
    readings: Array = field(default_factory=lambda: np.zeros((0, 2, 0)))

    def __post_init__(self) -> None:
        """Fill in the default."""
        if len(self.readings) != len(self.spread):
            object.__setattr__(self, 'readings', np.zeros((len(self.spread), 2, 0)))

    @property
    def empty(self) -> Flags:
        """Which knots have no sample, (J,)."""
        return np.isnan(self.spread)

    @staticmethod
    def stack(parts: list[Knots]) -> Knots:
        """Return as many knots of each part, side by side along the second axis."""
        return Knots(*(np.stack([getattr(part, field.name) for part in parts], axis=1) for field in fields(Knots)))


def averages(windows: Sequence[Samples], starts: Array, spacing: float, count: int, origin: Array) -> Knots:
    """Return the knots of W windows, one after the other.

    Parameters
    ----------
    windows : W of them
    starts : (W,) s, times at which they begin
    spacing : s, between knots
    count : number of knots in each
    origin : (3,) m, subtracted from the positions
    """

    def joined(name: str) -> Array:
        return np.concatenate([getattr(each, name) for each in windows])

    stamps, rotation = joined('time'), joined('base_rotation')
    window = np.repeat(np.arange(len(windows)), [len(each) for each in windows])
    inside = np.clip(np.floor((stamps - starts[window] + 1e-9) / spacing).astype(int), 0, count - 1)
    number = window * count + inside
    first = np.searchsorted(number, np.arange(len(windows) * count))
    sizes = np.diff(np.append(first, len(stamps)))
    empty = sizes == 0
    share = sizes[~empty].astype(float)

    def mean(values: Array) -> Array:
        result = np.full((len(sizes), *values.shape[1:]), np.nan)
        total = np.add.reduceat(values, first[~empty], axis=0)
        result[~empty] = total / share.reshape(-1, *(1,) * (values.ndim - 1))
        return result

    time = mean(stamps)
    middle = rotation[np.minimum(first + sizes // 2, len(stamps) - 1)]
    turns = log(rotation @ np.swapaxes(middle[number], 1, 2))
    twist = np.concatenate((joined('base_linear_velocity'), joined('base_angular_velocity')), axis=1)
    return Knots(
        joint_position=mean(joined('joint_position')),
        base_rotation=exp(mean(turns)) @ middle,
        base_position=mean(joined('base_position') - origin),
        base_twist=mean(twist),
        spread=mean((stamps - time[number]) ** 2) / spacing**2,
        offset=(time - np.repeat(starts, count)) / spacing - np.tile(np.arange(count), len(windows)) - 0.5,
        impulse=mean(_columns_about(joined('impulse'), origin, 1)),
        stored=mean(joined('stored')),
        gravity_columns=mean(_columns_about(joined('gravity_columns'), origin, 10)),
        thrust=mean(_columns_about(joined('thrust'), origin, THRUSTER_ERRORS)),
        further=mean(joined('further')),
        attitude_sensitivity=np.zeros((len(sizes), 0)),
        readings=_halves(joined('readings'), stamps - starts[window], window * count, spacing, len(sizes)),
    )


def _halves(readings: Array, time: Array, begin: Integers, spacing: float, knots: int) -> Array:
    """Return sums (J, 2, c) over the halves of J knots, by the samples (N, c) that hold them.

    Parameters
    ----------
    time, begin : (N,) s, of the samples since their window began, and the number of its first knot
    spacing : s, between knots
    """
    sums = np.zeros((2 * knots, readings.shape[1]))
    if readings.shape[1]:
        half = 2 * begin + np.maximum(np.floor((time + 1e-9) / (0.5 * spacing)).astype(int), 0)
        np.add.at(sums, np.minimum(half, 2 * knots - 1), readings)
    return sums.reshape(knots, 2, -1)


def knot_poses(knots: Knots) -> tuple[Array, Array]:
    """Return orientation (J, ..., 3, 3) and position (J, ..., 3), m, at the centres of knots, as of `midpoints`."""
    return _centre_rotation(knots), _centre(knots.base_position, knots)


def at_the_base(knots: Knots, mount: Array) -> Knots:
    """Return the knots of a base at (6,) `mount` in the measured frame: p + R mu_p, R Exp(mu_R)."""
    twist = knots.base_twist.copy()
    rotation, away, twist[..., :3] = mounted_base(knots.base_rotation, twist[..., :3], twist[..., 3:], mount)
    return replace(knots, base_rotation=rotation, base_position=knots.base_position + away, base_twist=twist)


def bridged(knots: Knots) -> Knots:
    """Return knots with the empty ones filled in from the two or four around each."""
    if not np.any(knots.empty):
        return knots
    values = {field.name: getattr(knots, field.name).copy() for field in fields(Knots)}
    for index in np.flatnonzero(knots.empty):
        far = 2 <= index < len(knots) - 2 and not np.any(knots.empty[[index - 2, index + 2]])
        around = index + (np.array([-2, -1, 1, 2]) if far else np.array([-1, 1]))
        weights = _CUBIC if far else _LINEAR
        for name, value in values.items():
            if name == 'readings':
                continue  # an empty knot has none
            if name == 'base_rotation':
                back = value[index - 1].T
                value[index] = exp(weights @ log(value[around] @ back)) @ value[index - 1]
            else:
                value[index] = np.tensordot(weights, value[around], axes=1)
    return Knots(**values)


def _columns_about(columns: Array, origin: Array, numbers: int) -> Array:
    """Return columns of (P, L), one for each of some numbers, with L about a point."""
    if not columns.shape[1]:
        return columns
    return about_points(columns, np.broadcast_to(origin, (len(columns), 3)), numbers).reshape(columns.shape)


@dataclass(frozen=True)
class Midpoints(ArrayRecord):
    """The motion midway between J knots, and the change from one knot to the next; windows may be a second axis."""

    joint_position: Array  # (J - 1, n)
    joint_velocity: Array  # (J - 1, n)
    base_rotation: Array  # (J - 1, 3, 3)
    base_position: Array  # (J - 1, 3)
    base_twist: Array  # (J - 1, 6)
    turn: Array  # (J - 1, 3) rad, rotation vector from each knot to the next, odometry axes
    step: Array  # (J - 1, 3) m, displacement from each knot to the next
    impulse: Array  # (J - 1, ...) as of the knots, midway
    stored: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (J - 1, ...) as of the knots, midway
    gravity_columns: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (J - 1, ...) as of the knots, midway
    thrust: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (J - 1, ...) as of the knots, midway
    # (J - 1, c) how fast the further sensors' numbers change: of a gyro rad/s, in its axes; NaN where unknown
    further: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        """Replace omitted arrays by arrays of no columns; those of stacks are given."""
        for name in ('stored', 'gravity_columns', 'thrust', 'further'):
            if len(getattr(self, name)) != len(self.turn):
                object.__setattr__(self, name, np.zeros((len(self.turn), 0)))

    @property
    def flat(self) -> Midpoints:
        """The intervals of several windows, one after the other along one axis."""
        intervals = self.turn[..., 0]
        count, axes = intervals.size, intervals.ndim
        return Midpoints(*(values.reshape(count, *values.shape[axes:]) for values in vars(self).values()))


def midpoints(knots: Knots, spacing: float) -> Midpoints:
    """Return the motion midway between knots.

    Values at the knot centres are the means less the offset times the slope and half the spread times the second
    difference; midway values take off a sixteenth, rates a twenty-fourth of the neighbours' differences. At the ends
    the corrections follow the line through the two nearest.
    """
    joints = knots.joint_position.shape[-1]
    parts = (knots.joint_position, knots.base_position, knots.base_twist, knots.stored, knots.further)
    moving = _centre(np.concatenate(parts, axis=-1), knots)
    midway = _midway(moving)
    rotation = _centre_rotation(knots)
    turn = _turns(rotation)
    bend = _padded(turn[2:] - turn[:-2])
    # With the angular velocity w: half the turn has an eighth of its commutator D^3 / 12 w' x w, not a half.
    half = 0.5 * turn - bend / 16.0 - cross(bend, turn) / 64.0
    difference = moving[1:] - moving[:-1]
    turning = difference[..., :joints]
    end = joints + 9 + knots.stored.shape[-1]
    turned = difference[..., end:]
    return Midpoints(
        joint_position=midway[..., :joints],
        joint_velocity=(turning - _second_difference(turning) / 24.0) / spacing,
        base_rotation=exp(half) @ rotation[:-1],
        base_position=midway[..., joints : joints + 3],
        base_twist=midway[..., joints + 3 : joints + 9],
        turn=turn,
        step=difference[..., joints : joints + 3],
        impulse=_mean(knots.impulse, knots),
        stored=midway[..., joints + 9 : end],
        gravity_columns=_mean(knots.gravity_columns, knots),
        thrust=_mean(knots.thrust, knots),
        further=(turned - _second_difference(turned) / 24.0) / spacing,
    )


def with_joints_later(middle: Midpoints, late: float, lags: Array, spacing: float) -> Midpoints:
    """Return the joints' motion `late` s after the midpoints, to third order, beside the base's at the midpoints.

    Each joint is later by its own of `lags` (n,), s, as well; empty is by none.
    """
    rate, each = middle.joint_velocity, late + lags if lags.size else late
    second = gradient(rate) / spacing
    third = gradient(second) / spacing
    return replace(
        middle,
        joint_position=middle.joint_position + each * (rate + each / 2.0 * (second + each / 3.0 * third)),
        joint_velocity=rate + each * (second + each / 2.0 * third),
        stored=middle.stored + late / spacing * gradient(middle.stored),
    )


def with_gears(middle: Midpoints, gears: Array, transmission: Transmission) -> Midpoints:
    """Return the joints' motion where each deviates from its reading by its own angle; (n, 3) as of `NominalModel`.

    Joints that follow others deviate with these as well.
    """
    position, rate = middle.joint_position, middle.joint_velocity
    by_sine, by_cosine, by_angle = gears.T
    sine, cosine = np.sin(position), np.cos(position)
    if not transmission.direct:
        off = by_sine * sine + by_cosine * cosine + by_angle * position
        faster = rate * (by_sine * cosine - by_cosine * sine + by_angle)
        off, faster = (each @ transmission.errors.T for each in (off, faster))
        return replace(middle, joint_position=position + off, joint_velocity=rate + faster)
    return replace(
        middle,
        joint_position=position + by_sine * sine + by_cosine * cosine + by_angle * position,
        joint_velocity=rate * (1.0 + by_sine * cosine - by_cosine * sine + by_angle),
    )


def gradient(values: Array) -> Array:
    """Return the slope of (J, ...) per step: half the difference of the neighbours, at the ends of the parabola."""
    return _slope(values[1:] - values[:-1])


def _turns(rotation: Array) -> Array:
    return log(rotation[1:] @ np.swapaxes(rotation[:-1], -1, -2))


def _centre(values: Array, knots: Knots) -> Array:
    """Return the values at the knots' centres. Twice: the first slopes are of means that are off themselves."""
    offset, square = knots.offset[..., None], (knots.spread + knots.offset**2)[..., None]
    centred = values - offset * gradient(values)
    step = centred[1:] - centred[:-1]
    return values - offset * _slope_to(offset, step) - 0.5 * square * _padded(step[1:] - step[:-1])


def _mean(values: Array, knots: Knots) -> Array:
    """Return the means of both knots, each at its centre, of quantities that may jump: to first order only."""
    centred = values - knots.offset[..., None] * gradient(values)
    return np.asarray(0.5 * (centred[1:] + centred[:-1]))


def _centre_rotation(knots: Knots) -> Array:
    """Return the orientations at the knots' centres, in the same way."""
    offset, square = knots.offset[..., None], (knots.spread + knots.offset**2)[..., None]
    turn = _turns(knots.base_rotation)
    turn = _turns(exp(-offset * _slope(turn)) @ knots.base_rotation)
    return exp(-offset * _slope_to(offset, turn) - 0.5 * square * _padded(turn[1:] - turn[:-1])) @ knots.base_rotation


def _slope(step: Array) -> Array:
    """Return the change a knot's spacing at each knot, from those between knots."""
    return _padded(0.5 * (step[1:] + step[:-1]))


def _slope_to(offset: Array, step: Array) -> Array:
    """Return the same to fourth order, for steps of first-order centres an offset away."""
    slope = _slope(step)
    return slope - (1.0 - 4.0 * offset**2) / 6.0 * _second_difference(slope)


def _midway(values: Array) -> Array:
    step = values[1:] - values[:-1]
    return 0.5 * (values[1:] + values[:-1]) - _padded(step[2:] - step[:-2]) / 16.0


def _second_difference(values: Array) -> Array:
    step = values[1:] - values[:-1]
    return _padded(step[1:] - step[:-1])


def _padded(inner: Array) -> Array:
    """Return values with one more at either end, on the line through the two nearest."""
    if len(inner) < 2:
        return np.concatenate((inner, inner, inner))
    return np.concatenate((2.0 * inner[:1] - inner[1:2], inner, 2.0 * inner[-1:] - inner[-2:-1]))


@dataclass(frozen=True)
class WindowNoise:
    """Noise of the means of a window's measurements."""

    samples: int  # number in the window
    joint_position: float | Array  # standard deviation of one sample, rad or m; (n,) where joints differ
    pose: Array  # (6, 6) mean covariance of one sample, (orientation, position), odometry axes
    twist: Array  # (6, 6) of one sample, (angular, linear), base axes
    correlation_time: float = 0.0  # s, of the errors of the poses; 0 for independent ones


def window_noises(windows: Sequence[Samples], noise: SensorNoise) -> list[WindowNoise]:
    """Return the noise of windows' means."""
    poses, twists = (
        np.stack([np.add.reduce(each, axis=0) / len(each) for each in covariances])[
            :, ANGULAR_FIRST[:, None], ANGULAR_FIRST
        ]
        for covariances in ([each.pose_covariance for each in windows], [each.twist_covariance for each in windows])
    )
    return [
        WindowNoise(len(window), declared.joint_position, pose, twist, declared.base_correlation_time)
        for window, pose, twist in zip(windows, poses, twists, strict=True)
        for declared in [noise.for_window(window)]
    ]


def with_truncation(noise: WindowNoise, knots: Knots, *, at_an_end: bool) -> WindowNoise:
    """Return the noise of a window with the truncation error of its knots' fourth-order formulas, from the data.

    A fourth difference over the whole window, scaled to neighbouring knots, has less noise than the formulas.
    """
    stride = (len(knots) - 1) // 4
    five = knots[: 4 * stride + 1 : stride]
    turned = log(five.base_rotation @ five.base_rotation[2].T)
    linear, angular = five.base_twist[:, :3], five.base_twist[:, 3:]
    values = np.concatenate((turned, five.base_position, angular, linear, five.joint_position), axis=1)
    size = (_AT_AN_END if at_an_end else _TRUNCATION) / stride**4
    variance = noise.samples * np.nan_to_num(size * (_FOURTH @ values)) ** 2
    return replace(
        noise,
        joint_position=np.sqrt(noise.joint_position**2 + variance[12:]),
        pose=noise.pose + np.diag(variance[:6]),
        twist=noise.twist + np.diag(variance[6:12]),
    )


@dataclass(frozen=True, eq=False)
class Window:
    """A window's knots, with the neighbours that its formulas need."""

    knots: Knots  # Knots
    inside: slice  # the window's own intervals among theirs; each begins at a knot of the window
    spacing: float  # s, between knots
    noise: WindowNoise  # WindowNoise
    start: float  # s since the first sample of the run
    after_gap: bool  # whether a gap (or the start) comes before it
    origin: Array = field(default_factory=lambda: np.zeros(3))  # (3,) m, of the run in the odometry frame
    gap: float = 0.0  # s from the end of the window before to its start
    # (2,) variance of a component of the turn, rad^2, and of the displacement, m^2, of the poses' correction since then
    frame: Array = field(default_factory=lambda: np.zeros(2))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of knots, and first and last own interval: the same in a stack."""
        return len(self.knots), self.inside.start, self.inside.stop

    @property
    def length(self) -> float:
        """Of its own intervals, s."""
        return (self.inside.stop - self.inside.start) * self.spacing


@lru_cache(maxsize=256)
def without_twist(window: Window) -> Window:
    """Return a window of poses alone; the same object whenever it is asked for."""
    nothing = np.full_like(window.knots.base_twist, np.nan)
    return replace(window, knots=replace(window.knots, base_twist=nothing))


@dataclass(frozen=True)
class Prediction(ArrayRecord):
    """The predicted twist (v, w) of the base at N instants, odometry axes."""

    twist: Array  # (N, 6)
    by_parameters: Array  # (N, 6, u) derivative by the parameters
    # (N, 6, 6) F, derivative of (v, w) by an error (theta, rho) of the base's pose, at fixed axes of V
    by_pose_error: Array

    @property
    def error_slope(self) -> Array:
        """F~ (..., 6, 6), the rate of a pose error xi = (theta, rho): F~ xi = (F_w xi, F_v xi - v x theta)."""
        slope = self.by_pose_error[..., ANGULAR_FIRST, :]
        slope[..., 3:, :3] -= skew(self.twist[..., :3])  # the predicted velocity turns with the true base
        return slope

    def divided(self, shapes: Sequence[tuple[int, ...]]) -> list[Prediction]:
        """Return parts of the instants, each with several leading axes instead of one."""
        ends = np.cumsum([np.prod(shape) for shape in shapes])
        parts = [self[int(end - np.prod(shape)) : int(end)] for shape, end in zip(shapes, ends, strict=True)]
        return [
            Prediction(*(values.reshape(*shape, *values.shape[1:]) for values in vars(part).values()))
            for part, shape in zip(parts, shapes, strict=True)
        ]


class SwingInertias(Protocol):
    """The inertias of f passive joints at N instants, as `PassiveInertias`."""

    @property
    def gamma(self) -> Array:
        """Momentum of unit rates, Gamma, (N, f, 6)."""

    @property
    def inverse_inertia(self) -> Array:
        """M^-1, the passive joints held, (N, 6, 6)."""

    @property
    def mobility_of_joints(self) -> Array:
        """Inverse of H - Gamma^T M^-1 Gamma, (N, f, f)."""

    def solve(self, total: Array, along: Array) -> tuple[Array, Array]:
        """Return base twists (N, 6, c) and rates (N, f, c) with momenta (N, 6, c) and (N, f, c) along the joints."""


class Swing(Protocol):
    """How the state x = (deflections, s) of f passive joints changes at N instants, as `PassiveColumns`."""

    @property
    def inertias(self) -> SwingInertias:
        """Of the passive joints."""

    @property
    def slope(self) -> Array:
        """Rates of x, (N, 2 f)."""

    @property
    def by_state(self) -> Array:
        """Derivatives of these by x, (N, 2 f, 2 f)."""

    @property
    def by_parameters(self) -> Array:
        """Derivatives of these by the parameters, (N, 2 f, u)."""

    @property
    def twist_by_state(self) -> Array:
        """Derivative of the base's twist by x, (N, 6, 2 f)."""

    def __getitem__(self, index: Integers) -> Swing:
        """Return that of some instants."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """The bodies of a robot that moves as predicted, at N instants."""

    parameters: Array  # (n + 1, 10) standard parameters of each, in its own frame
    inverse_inertia: Array  # (N, 6, 6) M^-1; with passive joints (M - Gamma H^-1 Gamma^T)^-1
    states: BodyStates  # as the momentum equations need them
    passive: Swing | None = None  # how passive joints swing; None without any

    def __getitem__(self, index: Integers) -> Bodies:
        """Return those of some instants."""
        passive = None if self.passive is None else self.passive[index]
        return Bodies(self.parameters, self.inverse_inertia[index], self.states[index], passive)


@dataclass(frozen=True)
class Averaged:
    """The windows that a new one completes: the one before it with all its neighbours, itself without later ones.

    `joints_moved`: whether a joint has moved by more than its noise by then.
    """

    ready: Window | None
    still_open: Window | None
    joints_moved: bool


class KnotAveraging:
    """Averages closed windows to a chain of knots, with a latency of one window.

    Parameters
    ----------
    noise : of the joint sensors, and of the base where the samples carry none
    length : s, of a window
    orientation_measured : whether anything but the gyro measures the orientation of the base
    fastest : Hz, highest natural frequency of passive joints; 0 without any

    Attributes
    ----------
    origin : (3,) m, first position of the base, which all positions are relative to
    """

    def __init__(
        self,
        noise: SensorNoise,
        length: float,
        *,
        orientation_measured: bool = True,
        fastest: float = 0.0,
    ) -> None:
        self._wanted = min(_KNOT, 1.0 / (_KNOTS_A_PERIOD * fastest)) if fastest else _KNOT
        self._alike = fastest > 0.0  # a spring adds up errors that alternate with the number of samples in a knot
        self._orientation_measured = orientation_measured
        self._course: Array = np.zeros(36)
        self._noise = noise
        self._length = length
        self.origin: Array = np.zeros(3)
        self._knots_per_window = 0
        self._number = -1
        self._end: float | None = None  # s, of the last window that had all its neighbours
        self._kept: Knots | None = None  # of the last two windows of the call before
        self._linked = 0  # number of windows without a gap up to the last, at most three
        self._latest: WindowNoise | None = None  # of the last of them
        self._frame: Array = np.zeros(2)  # variances of the poses' corrections, at the end of the latest window
        self._frame_at_end: Array = np.zeros(2)  # the same of the last window that had all its neighbours
        self._lowest: Array = np.array(np.inf)
        self._highest: Array = np.array(-np.inf)
        self._moved = False

    def average(self, windows: list[Samples]) -> list[Averaged]:
        """Return the windows that closed ones complete."""
        if not self._knots_per_window:
            self.origin = windows[0].base_position[0].copy()
            self._knots_per_window = knots_per_window(windows[0], self._length, self._wanted, alike=self._alike)
        length, count = self._length, self._knots_per_window
        numbers = [int(np.floor((window.time[0] + 1e-9) / length)) for window in windows]
        new = averages(windows, np.array(numbers) * length, length / count, count, self.origin)
        if not self._orientation_measured:
            new = self._followed(new, count)
        knots = new if self._kept is None else Knots.concatenate([self._kept, new])
        joint_position = new.joint_position.reshape(len(windows), count, -1)
        extremes = [extreme.reduce(joint_position, axis=1) for extreme in (np.fmin, np.fmax)]
        empty = knots.empty.tolist()
        averaged = []
        each = zip(numbers, window_noises(windows, self._noise), *extremes, strict=True)
        for place, (number, noise, lowest, highest) in enumerate(each, start=len(knots) // count - len(windows)):
            frames = windows[place - len(knots) // count + len(windows)].frame
            ready, still_open = self._collect(knots, empty, place, number, noise, frames)
            if self._linked and not self._moved:
                self._lowest, self._highest = np.minimum(self._lowest, lowest), np.maximum(self._highest, highest)
                self._moved = bool(np.any(self._highest - self._lowest > _MOVED * noise.joint_position))
            averaged.append(Averaged(ready, still_open, self._moved))
        self._kept = knots[-2 * count :]
        return averaged

    def _followed(self, knots: Knots, count: int) -> Knots:
        """Return knots with the effect of the gyro's errors on the orientation, window by window."""
        parts = []
        for begin in range(0, len(knots), count):
            followed, self._course = _with_course(knots[begin : begin + count], self._length / count, self._course)
            parts.append(followed)
        return Knots.concatenate(parts)

    def _collect(
        self, knots: Knots, empty: list[bool], place: int, number: int, noise_now: WindowNoise, frames: Array
    ) -> tuple[Window | None, Window | None]:
        """Return the window before the one at `place` among the knots, now with all its neighbours, and that window.

        Parameters
        ----------
        knots, empty : of this window and those around it, and which are empty
        place, number, noise_now, frames : of the window among these, and in the run; its noise; `frame` of its samples
        """
        count = self._knots_per_window
        begin, end = place * count, (place + 1) * count
        gap = any(empty[begin:end]) and any(one and other for one, other in pairwise(empty[begin:end]))
        jumped = not np.array_equal(frames[0], frames[-1])  # the poses, within the window
        moved = jumped or not np.array_equal(frames[0], self._frame)
        if gap or moved or number != self._number + 1 or (self._linked and empty[begin - 1] and empty[begin]):
            self._linked = 0  # a gap: only momentum and body carry over
        self._number, self._frame = number, frames[-1]
        if gap or jumped or (empty[begin] and not self._linked):
            return None, None
        self._linked = min(self._linked + 1, 3)
        noise, self._latest = self._latest, noise_now
        ready = None
        if self._linked > 1 and noise is not None:
            ready = self._window(knots, empty, place - 1, AFTER, noise)
            self._end, self._frame_at_end = ready.start + ready.length, self._frame
        still_open = None if empty[end - 1] else self._window(knots, empty, place, 0, noise_now)
        return ready, still_open

    def _window(self, knots: Knots, empty: list[bool], place: int, after: int, noise: WindowNoise) -> Window:
        """Return a window with `after` knots after it; the last interval of one without a successor is missing."""
        count = self._knots_per_window
        earlier = self._linked > (2 if after else 1)
        begin, end = place * count, (place + 1) * count + after
        first = begin - BEFORE if earlier else begin
        # An empty knot is bridged from both sides: drop one at an outer end. None is at the start after a gap.
        if empty[first]:
            first += 1
        if after and empty[end - 1]:
            end -= 1
        parts = knots[first:end]
        if any(empty[first:end]):
            parts = bridged(parts)
        start = (self._number - (1 if after else 0)) * self._length
        return Window(
            knots=parts,
            inside=slice(begin - first, begin - first + count - (0 if end > begin + count else 1)),
            spacing=self._length / count,
            noise=with_truncation(noise, parts, at_an_end=not (earlier and after)),
            start=start,
            after_gap=not earlier,
            origin=self.origin,
            gap=0.0 if earlier or self._end is None else start - self._end,
            frame=np.zeros(2) if earlier or self._end is None else self._frame - self._frame_at_end,
        )


def _with_course(knots: Knots, spacing: float, begin: Array) -> tuple[Knots, Array]:
    """Return knots oriented by the gyro alone with the effect of its errors, and that (36,) at the end of the last.

    Parameters
    ----------
    knots, spacing : in a row, s
    begin : (36,) before the first of them
    """
    rate = np.gradient(knots.further[:, :3], spacing, axis=0)
    errors = np.zeros((len(knots), 3, 12))
    errors[:, :, :3], errors[:, :, 6:9], errors[:, :, 9:] = np.eye(3), skew(rate), crossed(rate)
    errors[:, [0, 1, 2], [3, 4, 5]] = rate
    # After an empty knot the chain begins anew.
    steps = np.nan_to_num(spacing * (knots.base_rotation @ errors)).reshape(len(knots), -1)
    sums = np.cumsum(np.concatenate((begin[None], steps)), axis=0)
    return replace(knots, attitude_sensitivity=0.5 * (sums[1:] + sums[:-1])), sums[-1]


def knots_per_window(window: Samples, length: float, wanted: float, *, alike: bool = False) -> int:
    """Return the number of knots in a window of a length in s: as wanted, s apart, and no fewer samples than knots.

    Knots that are to be alike have as many samples each, if these come evenly.
    """
    spacing = float(np.median(np.diff(window.time))) if len(window) > 1 else length
    count, samples = max(round(length / max(wanted, spacing)), _FEWEST_KNOTS), round(length / spacing)
    return next((each for each in range(count, samples + 1) if samples % each == 0), count) if alike else count
