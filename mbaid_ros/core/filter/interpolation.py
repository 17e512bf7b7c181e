"""The motion midway between knots, to fourth order.

The mean of two knots is not the value midway: the correction comes from the neighbours' differences. Joint rates are
differences of the same knots as the joint angles, so that joint noise telescopes when rates are integrated.

All arrays begin with the axis of the J knots. Where knots of several windows are worked through at once, these lie side
by side along a second axis, which the shapes below leave out.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from mbaid_ros.core.array_record import ArrayRecord
from mbaid_ros.core.filter.knots import Knots
from mbaid_ros.core.geometry import Array, cross, exp, log


@dataclass(frozen=True)
class Midpoints(ArrayRecord):
    """The motion midway between J knots (J - 1 intervals), and what was measured from one knot to the next.

    Attributes
    ----------
    joint_position, joint_velocity : (J - 1, n)
    base_rotation, base_position, base_twist : (J - 1, 3, 3), (J - 1, 3), (J - 1, 6)
    turn : (J - 1, 3) rad, rotation vector from each knot to the next, odometry axes
    step : (J - 1, 3) m, displacement from each knot to the next
    impulse : (J - 1, 6) as of the knots, the mean of both
    stored : (J - 1, c) readings of what stores momentum inside bodies
    tide, thrust : (J - 1, 60 b), (J - 1, 30 f) as of the knots, the mean of both
    gyro : (J - 1, 3) rad/s, measured angular velocity in the IMU's axes; NaN where not known, none where there is none
    gyro_axes : (J - 1, 3, 3) these to odometry axes; none where the IMU is on the base, in whose axes it then measures
    gyro_gain : (J - 1, 3, n) its angular velocity against the base by the joint rates, odometry axes; none alike
    """

    joint_position: Array
    joint_velocity: Array
    base_rotation: Array
    base_position: Array
    base_twist: Array
    turn: Array
    step: Array
    impulse: Array
    stored: Array = field(default_factory=lambda: np.zeros((0, 0)))
    tide: Array = field(default_factory=lambda: np.zeros((0, 0)))
    thrust: Array = field(default_factory=lambda: np.zeros((0, 0)))
    gyro: Array = field(default_factory=lambda: np.zeros((0, 0)))
    gyro_axes: Array = field(default_factory=lambda: np.zeros((0, 0)))
    gyro_gain: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        """Take nothing as stored, no orbit and no uncertain thrust where nothing is said."""
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
    difference; midway values take a sixteenth, rates a twenty-fourth of the neighbours' differences off. At the ends
    the neighbour's correction serves.
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
    """Return the joints' motion `late` s after the midpoints, to third order, with the base's at the midpoints.

    What is stored inside bodies is read with the joints, and is late with them.
    """
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
    """Return the slope of (J, ...) per step: half the difference of the neighbours, at the ends the step."""
    slope = np.empty_like(values)
    slope[1:-1] = 0.5 * (values[2:] - values[:-2])
    slope[0], slope[-1] = values[1] - values[0], values[-1] - values[-2]
    return slope


def _turns(rotation: Array) -> Array:
    return log(rotation[1:] @ np.swapaxes(rotation[:-1], -1, -2))


def _centre(values: Array, knots: Knots) -> Array:
    """Return the values at the knots' centres. Twice: the first slopes are of means that are off themselves."""
    offset, square = knots.offset[..., None], (knots.spread + knots.offset**2)[..., None]
    centred = values - offset * gradient(values)
    return values - offset * gradient(centred) - 0.5 * square * _second_difference(centred)


def _mean(values: Array, knots: Knots) -> Array:
    """Return the means of both knots, each at its centre, of what may begin and end at once: to first order only."""
    centred = values - knots.offset[..., None] * gradient(values)
    return np.asarray(0.5 * (centred[1:] + centred[:-1]))


def _centre_rotation(knots: Knots) -> Array:
    """Return the orientations at the knots' centres, in the same way."""
    offset, square = knots.offset[..., None], (knots.spread + knots.offset**2)[..., None]
    turn = _turns(knots.base_rotation)
    turn = _turns(exp(-offset * _slope(turn)) @ knots.base_rotation)
    return exp(-offset * _slope(turn) - 0.5 * square * _padded(turn[1:] - turn[:-1])) @ knots.base_rotation


def _slope(turn: Array) -> Array:
    """Return the turn a knot's spacing at each knot, from those between knots."""
    return np.concatenate((turn[:1], 0.5 * (turn[1:] + turn[:-1]), turn[-1:]))


def _midway(values: Array) -> Array:
    step = values[1:] - values[:-1]
    return 0.5 * (values[1:] + values[:-1]) - _padded(step[2:] - step[:-2]) / 16.0


def _second_difference(values: Array) -> Array:
    step = values[1:] - values[:-1]
    return _padded(step[1:] - step[:-1])


def _padded(inner: Array) -> Array:
    return np.concatenate((inner[:1], inner, inner[-1:]))
