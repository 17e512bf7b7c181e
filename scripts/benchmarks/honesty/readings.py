"""What sensors make of a motion: where they look from, and what is wrong with what they say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.honesty.floating import turned
from benchmarks.spoilt import coloured
from mbaid_ros.core.geometry import Array, Flags, cross, exp, rotate, rotate_back, rotation_from_quaternion
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.core.simulation import quaternions
from mbaid_ros.core.simulation.run import Truth
from mbaid_ros.core.simulation.sensors import BaseReadings, JointReadings, Sensors

Indices = npt.NDArray[np.signedinteger[Any]]


@dataclass(frozen=True)
class Readings:
    """What the sensors of a run say; `time` of either kind becomes its stamps.

    Attributes
    ----------
    truth : the motion as it is seen from where the sensors are
    joints, base : what they read
    """

    truth: Truth
    joints: JointReadings
    base: BaseReadings


Defect = Callable[[Readings, np.random.Generator], Readings]
View = Callable[[Truth], Truth]


def read(truth: Truth, noise: SensorNoise, seed: int) -> Readings:
    """Return readings with white noise."""
    sensors = Sensors(noise, seed)
    return Readings(truth, sensors.joints(truth), sensors.base(truth))


# --- Views: motions as they look from elsewhere.


def zero_off(joint: int, angle: float, truth: Truth) -> Truth:
    """Return a motion whose joint reads less than it is (rad)."""
    return replace(truth, joint_position=truth.joint_position - angle * np.eye(truth.joint_position.shape[1])[joint])


def geared(joint: int, size: float, truth: Truth) -> Truth:
    """Return a motion whose joint is off by so much (rad) times the sine of its angle: an eccentric gear."""
    own = np.eye(truth.joint_position.shape[1])[joint]
    angle, rate = truth.joint_position[:, joint, None], truth.joint_velocity[:, joint, None]
    return replace(
        truth,
        joint_position=truth.joint_position - size * np.sin(angle) * own,
        joint_velocity=truth.joint_velocity - size * np.cos(angle) * rate * own,
    )


def sign_flipped(joint: int, truth: Truth) -> Truth:
    """Return a motion of which a joint is read with the wrong sign."""
    signs = 1.0 - 2.0 * np.eye(truth.joint_position.shape[1])[joint]
    return replace(truth, joint_position=signs * truth.joint_position, joint_velocity=signs * truth.joint_velocity)


def swapped(one: int, other: int, truth: Truth) -> Truth:
    """Return a motion of which two joints are taken for each other."""
    order = np.arange(truth.joint_position.shape[1])
    order[[one, other]] = order[[other, one]]
    return replace(truth, joint_position=truth.joint_position[:, order], joint_velocity=truth.joint_velocity[:, order])


def misgeared(joint: int, factor: float, truth: Truth) -> Truth:
    """Return a motion of which a joint is read larger by a factor, as with the wrong gear ratio."""
    factors = 1.0 + (factor - 1.0) * np.eye(truth.joint_position.shape[1])[joint]
    return replace(truth, joint_position=factors * truth.joint_position, joint_velocity=factors * truth.joint_velocity)


def mounted(position: Array, turn: Array, truth: Truth) -> Truth:
    """Return the motion of a frame elsewhere on the base, at (3,) m and turned by a (3,) rotation vector."""
    rotation = rotation_from_quaternion(truth.base_orientation)
    angular = truth.base_angular_velocity
    return replace(
        truth,
        base_position=truth.base_position + rotate(rotation, position),
        base_orientation=turned(truth, rotation @ exp(turn)),
        base_linear_velocity=(truth.base_linear_velocity + cross(angular, position)) @ exp(turn),
        base_angular_velocity=angular @ exp(turn),
    )


def scaled(factor: float, truth: Truth) -> Truth:
    """Return a motion whose lengths are seen larger by a factor."""
    return replace(
        truth,
        base_position=factor * truth.base_position,
        base_linear_velocity=factor * truth.base_linear_velocity,
    )


def in_orbit_frame(rate: float, truth: Truth) -> Truth:
    """Return a motion in a frame that turns about its z axis (rad/s)."""
    back = exp(-rate * truth.time[:, None] * np.array([0.0, 0.0, 1.0]))
    rotation = rotation_from_quaternion(truth.base_orientation)
    spin = np.array([0.0, 0.0, rate])
    return replace(
        truth,
        base_position=rotate(back, truth.base_position),
        base_orientation=turned(truth, back @ rotation),
        base_linear_velocity=truth.base_linear_velocity - rotate_back(rotation, cross(spin, truth.base_position)),
        base_angular_velocity=truth.base_angular_velocity
        - rotate_back(rotation, np.broadcast_to(spin, (len(truth), 3))),
    )


def twist_late(delay: float, truth: Truth) -> Truth:
    """Return a motion with the base's twist of a while ago (s)."""
    linear, angular = (
        np.column_stack([np.interp(truth.time - delay, truth.time, column) for column in values.T])
        for values in (truth.base_linear_velocity, truth.base_angular_velocity)
    )
    return replace(truth, base_linear_velocity=linear, base_angular_velocity=angular)


def twist_in_odometry_axes(truth: Truth) -> Truth:
    """Return a motion whose twist is given in the axes of the odometry frame, not in the base's."""
    rotation = rotation_from_quaternion(truth.base_orientation)
    linear, angular = truth.base_linear_velocity, truth.base_angular_velocity
    return replace(
        truth, base_linear_velocity=rotate(rotation, linear), base_angular_velocity=rotate(rotation, angular)
    )


def twist_in_degrees(truth: Truth) -> Truth:
    """Return a motion whose angular velocity is in degrees a second."""
    return replace(truth, base_angular_velocity=np.rad2deg(truth.base_angular_velocity))


def twist_of_point(position: Array, truth: Truth) -> Truth:
    """Return a motion whose twist is that of another point, (3,) m from the base's, in its axes."""
    linear = truth.base_linear_velocity + cross(truth.base_angular_velocity, position)
    return replace(truth, base_linear_velocity=linear)


def twist_turned(turn: Array, truth: Truth) -> Truth:
    """Return a motion whose twist is given in axes that are turned by a (3,) rotation vector."""
    linear, angular = (each @ exp(turn) for each in (truth.base_linear_velocity, truth.base_angular_velocity))
    return replace(truth, base_linear_velocity=linear, base_angular_velocity=angular)


def in_degrees(truth: Truth) -> Truth:
    """Return a motion whose joints are read in degrees."""
    position, velocity = np.rad2deg(truth.joint_position), np.rad2deg(truth.joint_velocity)
    return replace(truth, joint_position=position, joint_velocity=velocity)


def in_millimetres(truth: Truth) -> Truth:
    """Return a motion whose positions, not velocities, are in millimetres."""
    return replace(truth, base_position=1e3 * truth.base_position)


def turned_round(truth: Truth) -> Truth:
    """Return a motion whose orientation turns from the odometry frame to the base."""
    return replace(truth, base_orientation=quaternions.conjugate(truth.base_orientation))


def scalar_first(truth: Truth) -> Truth:
    """Return a motion whose quaternions are (w, x, y, z)."""
    return replace(truth, base_orientation=np.roll(truth.base_orientation, 1, axis=-1))


# --- Defects of what is read.


def with_base(readings: Readings, position: Array, orientation: Array) -> Readings:
    """Return readings with other poses."""
    return replace(readings, base=replace(readings.base, position=position, orientation=orientation))


def correlated(constant: float, readings: Readings, _rng: np.random.Generator) -> Readings:
    """Give the poses' noise a time constant (s), as strong as it was."""
    base, truth = readings.base, readings.truth
    # Of a small rotation, the vector is twice the quaternion's imaginary part.
    error = 2.0 * quaternions.product(base.orientation, quaternions.conjugate(truth.base_orientation))[:, :3]
    orientation = quaternions.product(quaternions.exp(coloured(error, truth.time, constant)), truth.base_orientation)
    position = truth.base_position + coloured(base.position - truth.base_position, truth.time, constant)
    return with_base(readings, position, orientation)


def wandering(step: float, readings: Readings, rng: np.random.Generator) -> Readings:
    """Let the odometry's position walk randomly (m / sqrt(s))."""
    length = np.sqrt(np.diff(readings.base.time, prepend=readings.base.time[0]))[:, None]
    walk = np.cumsum(step * length * rng.normal(size=readings.base.position.shape), axis=0)
    return with_base(readings, readings.base.position + walk, readings.base.orientation)


def outliers(share: float, readings: Readings, rng: np.random.Generator) -> Readings:
    """Throw a share of the poses off by 0.2 m and 5 degrees."""
    hit = rng.random(len(readings.base.time)) < share
    return _thrown(readings, hit, rng)


def one_outlier(readings: Readings, rng: np.random.Generator) -> Readings:
    """Throw one pose off by 0.2 m and 5 degrees."""
    return _thrown(readings, np.arange(len(readings.base.time)) == len(readings.base.time) // 2, rng)


def _thrown(readings: Readings, hit: Flags, rng: np.random.Generator) -> Readings:
    way = rng.normal(size=(len(hit), 2, 3))
    way *= hit[:, None, None] / np.linalg.norm(way, axis=2, keepdims=True)
    orientation = quaternions.product(quaternions.exp(np.deg2rad(5.0) * way[:, 1]), readings.base.orientation)
    return with_base(readings, readings.base.position + 0.2 * way[:, 0], orientation)


def thinned(every: int, readings: Readings, _rng: np.random.Generator) -> Readings:
    """Keep one in so many odometry messages."""
    return replace(readings, base=_some(readings.base, np.arange(0, len(readings.base.time), every)))


def repeated(every: int, readings: Readings, _rng: np.random.Generator) -> Readings:
    """Repeat the last pose and twist, newly stamped, until another comes: one in so many is new."""
    count = len(readings.base.time)
    held = _some(readings.base, np.arange(count) // every * every)
    return replace(readings, base=replace(held, time=readings.base.time))


def gyro_biased(bias: float, readings: Readings, _rng: np.random.Generator) -> Readings:
    """Add a constant to the angular velocity (rad/s about each axis)."""
    angular = readings.base.angular_velocity + bias
    return replace(readings, base=replace(readings.base, angular_velocity=angular))


def without_twist(readings: Readings, _rng: np.random.Generator) -> Readings:
    """Fill the twist with zeros, as what does not measure it does."""
    nothing = np.zeros_like(readings.base.linear_velocity)
    return replace(readings, base=replace(readings.base, linear_velocity=nothing, angular_velocity=nothing))


def joints_late(delay: float, drift: float, readings: Readings, _rng: np.random.Generator) -> Readings:
    """Stamp the joints late (s) by a clock that runs fast (s/s)."""
    return replace(readings, joints=replace(readings.joints, time=delay + (1.0 + drift) * readings.joints.time))


def quantised(step: float, readings: Readings, _rng: np.random.Generator) -> Readings:
    """Round the joints' positions to steps (rad)."""
    position = step * np.round(readings.truth.joint_position / step)
    return replace(readings, joints=replace(readings.joints, position=position))


def dropout(begin: float, end: float, readings: Readings, _rng: np.random.Generator) -> Readings:
    """Lose the odometry for a while (s)."""
    time = readings.base.time
    return replace(readings, base=_some(readings.base, np.flatnonzero((time < begin) | (time >= end))))


def lossy(share: float, readings: Readings, rng: np.random.Generator) -> Readings:
    """Leave out a share of all odometry messages, at random."""
    return replace(
        readings, base=_some(readings.base, np.flatnonzero(rng.uniform(size=len(readings.base.time)) > share))
    )


def jittering(most: float, readings: Readings, rng: np.random.Generator) -> Readings:
    """Stamp the odometry up to so much (s) early or late, at random, in order."""
    time = readings.base.time + rng.uniform(-most, most, len(readings.base.time))
    return replace(readings, base=replace(readings.base, time=np.maximum.accumulate(np.maximum(time, 0.0))))


def frozen(joint: int, begin: float, end: float, readings: Readings, _rng: np.random.Generator) -> Readings:
    """Let a joint's reading stay where it is between two times (s)."""
    joints, position, velocity = readings.joints, readings.joints.position.copy(), readings.joints.velocity.copy()
    within = (joints.time >= begin) & (joints.time < end)
    position[within, joint], velocity[within, joint] = position[np.argmax(within), joint], 0.0
    return replace(readings, joints=replace(joints, position=position, velocity=velocity))


def slipped(joint: int, size: float, begin: float, readings: Readings, _rng: np.random.Generator) -> Readings:
    """Let a joint's reading jump (rad) at a time (s), and stay off."""
    position = readings.joints.position.copy()
    position[readings.joints.time >= begin, joint] += size
    return replace(readings, joints=replace(readings.joints, position=position))


def _some(base: BaseReadings, rows: Indices) -> BaseReadings:
    arrays = ('time', 'position', 'orientation', 'linear_velocity', 'angular_velocity')
    return replace(base, **{name: getattr(base, name)[rows] for name in arrays})


def clean(readings: Readings, _rng: np.random.Generator) -> Readings:
    """Return readings as they are."""
    return readings


def at_once(truth: Truth) -> Truth:
    """Return a motion as it is."""
    return truth
