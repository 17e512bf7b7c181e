"""Samples averaged to knots, and the motion midway between these, to fourth order.

A knot is the mean of the samples of a few hundredths of a second. The mean is not the value at the centre, nor that of
two knots the value midway: `midpoints` corrects both by the neighbours' differences, also where samples come unevenly.
Joint rates are differences of the same knots as the joint angles: joint noise telescopes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, cross, exp, log, mounted_base
from mbaid_ros.core.robot.momentum import THRUSTER_ERRORS, about_points
from mbaid_ros.core.samples import ArrayRecord, Samples

# Knots that a window needs of its neighbours, before and after, for its fourth-order formulas.
BEFORE, AFTER = 3, 4
# Weights of the two or four knots around an empty one: exact for straight lines and cubics.
_LINEAR, _CUBIC = np.array([1.0, 1.0]) / 2.0, np.array([-1.0, 4.0, 4.0, -1.0]) / 6.0


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
    # tide, thrust: (J, 60 b), (J, 30 f) as in Samples, L about the run's origin
    tide: Array
    thrust: Array
    gyro: Array  # (J, 3) rad, as in Samples; NaN where a sample has none, none at all where there is no IMU
    # (J, 36) where the gyro alone measures the orientation: its error since the run began, odometry axes, by each error
    # of the gyro (3 x 12, rows first): bias, scale, turn, cross-axis; none where it is measured
    course: Array

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
        tide=mean(_columns_about(joined('tide'), origin, 10)),
        thrust=mean(_columns_about(joined('thrust'), origin, THRUSTER_ERRORS)),
        gyro=mean(joined('gyro')),
        course=np.zeros((len(sizes), 0)),
    )


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
    tide: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (J - 1, ...) as of the knots, midway
    thrust: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (J - 1, ...) as of the knots, midway
    # (J - 1, 3) rad/s, measured angular velocity in the IMU's axes; NaN where unknown, none without an IMU
    gyro: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (J - 1, 3, 3) these to odometry axes; none where the IMU is on the base
    gyro_axes: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (J - 1, 3, n) derivative of its angular velocity against the base by the joint rates, odometry axes
    gyro_gain: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        """Replace omitted arrays by arrays of no columns."""
        for name in ('stored', 'tide', 'thrust', 'gyro', 'gyro_axes', 'gyro_gain'):
            if getattr(self, name).shape[: self.turn.ndim - 1] != self.turn.shape[:-1]:
                object.__setattr__(self, name, np.zeros((*self.turn.shape[:-1], 0)))

    @property
    def imu_axes(self) -> Array:
        """The axes of the IMU to those of the odometry, (J - 1, 3, 3)."""
        return self.gyro_axes if self.gyro_axes.shape[-1] else self.base_rotation

    @property
    def imu_rate(self) -> Array:
        """The angular velocity of the IMU against the base, odometry axes, (J - 1, 3) rad/s."""
        if not self.gyro_gain.shape[-1]:
            return np.zeros_like(self.turn)
        return np.asarray((self.gyro_gain @ self.joint_velocity[..., None])[..., 0])

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
    parts = (knots.joint_position, knots.base_position, knots.base_twist, knots.stored, knots.gyro)
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
        tide=_mean(knots.tide, knots),
        thrust=_mean(knots.thrust, knots),
        gyro=(turned - _second_difference(turned) / 24.0) / spacing,
    )


def with_joints_later(middle: Midpoints, late: float, spacing: float) -> Midpoints:
    """Return the joints' motion `late` s after the midpoints, to third order, beside the base's at the midpoints."""
    rate = middle.joint_velocity
    second = gradient(rate) / spacing
    third = gradient(second) / spacing
    return replace(
        middle,
        joint_position=middle.joint_position + late * (rate + late / 2.0 * (second + late / 3.0 * third)),
        joint_velocity=rate + late * (second + late / 2.0 * third),
        stored=middle.stored + late / spacing * gradient(middle.stored),
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
