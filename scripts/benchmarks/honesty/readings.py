"""Readings of a motion: views are sensors in another place or convention, defects are errors of what they publish."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

from mbaid_ros.core.geometry import (
    Array,
    Flags,
    cross,
    exp,
    quaternion_from_rotation,
    rotate,
    rotate_back,
    rotation_from_quaternion,
)
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.sensors import BaseReadings, JointReadings, Sensors
from mbaid_ros.simulation.simulation import Truth

Indices = npt.NDArray[np.signedinteger[Any]]


@dataclass(frozen=True)
class Readings:
    """Readings of a run; their `time` becomes the stamps."""

    truth: Truth  # the motion seen from the sensors
    joints: JointReadings
    base: BaseReadings


View = Callable[[Truth], Truth]
Defect = Callable[[Readings, np.random.Generator], Readings]


def read(truth: Truth, noise: SensorNoise, seed: int) -> Readings:
    """Return readings with white noise."""
    return read_by(Sensors(noise, seed), truth)


def read_by(sensors: Sensors, truth: Truth) -> Readings:
    """Return the readings of given sensors."""
    return Readings(truth, sensors.joints(truth), sensors.base(truth))


# -- views


def changed(name: str, change: Callable[[Array], Array], truth: Truth) -> Truth:
    """Return a motion of which one quantity is read as a function of it."""
    return replace(truth, **{name: change(getattr(truth, name))})


def joints_scaled(factors: Array | float, truth: Truth) -> Truth:
    """Return a motion whose joints are read larger by factors, as with the wrong unit, sign or gear ratio."""
    return replace(truth, joint_position=factors * truth.joint_position, joint_velocity=factors * truth.joint_velocity)


def misgeared(joint: int, factor: float, truth: Truth) -> Truth:
    """Return a motion of which one joint is read larger by a factor."""
    return joints_scaled(1.0 + (factor - 1.0) * _unit(truth, joint), truth)


def zero_off(joint: int, angle: float, truth: Truth) -> Truth:
    """Return a motion whose joint reads less than its angle (rad)."""
    return replace(truth, joint_position=truth.joint_position - angle * _unit(truth, joint))


def geared(joint: int, size: float, truth: Truth) -> Truth:
    """Return a motion whose joint is off by so much (rad) times the sine of its angle: an eccentric gear."""
    own = _unit(truth, joint)
    angle, rate = truth.joint_position[:, joint, None], truth.joint_velocity[:, joint, None]
    return replace(
        truth,
        joint_position=truth.joint_position - size * np.sin(angle) * own,
        joint_velocity=truth.joint_velocity - size * np.cos(angle) * rate * own,
    )


def swapped(one: int, other: int, truth: Truth) -> Truth:
    """Return a motion with the readings of two joints exchanged."""
    order = np.arange(truth.joint_position.shape[1])
    order[[one, other]] = order[[other, one]]
    return replace(truth, joint_position=truth.joint_position[:, order], joint_velocity=truth.joint_velocity[:, order])


def mounted(position: Array, turn: Array, truth: Truth) -> Truth:
    """Return the motion of a frame elsewhere on the base, at (3,) m and turned by a (3,) rotation vector."""
    rotation = rotation_from_quaternion(truth.base_orientation)
    place, orientation = truth.base_position + rotate(rotation, position), _continuous(rotation @ exp(turn))
    return twist_turned(
        turn, replace(twist_of_point(position, truth), base_position=place, base_orientation=orientation)
    )


def scaled(factor: float, truth: Truth) -> Truth:
    """Return a motion whose lengths are seen larger by a factor."""
    velocity = factor * truth.base_linear_velocity
    return replace(truth, base_position=factor * truth.base_position, base_linear_velocity=velocity)


def in_orbit_frame(rate: float, truth: Truth) -> Truth:
    """Return a motion in a frame that turns about its z axis (rad/s)."""
    spin = np.array([0.0, 0.0, rate])
    back = exp(-truth.time[:, None] * spin)
    rotation = rotation_from_quaternion(truth.base_orientation)
    turning = rotate_back(rotation, np.broadcast_to(spin, (len(truth), 3)))
    return replace(
        truth,
        base_position=rotate(back, truth.base_position),
        base_orientation=_continuous(back @ rotation),
        base_linear_velocity=truth.base_linear_velocity - rotate_back(rotation, cross(spin, truth.base_position)),
        base_angular_velocity=truth.base_angular_velocity - turning,
    )


def twist_late(delay: float, truth: Truth) -> Truth:
    """Return a motion with the base's twist of a while ago (s)."""
    then, time = truth.time - delay, truth.time
    return _twist_by(lambda values: np.column_stack([np.interp(then, time, each) for each in values.T]), truth)


def twist_in_odometry_axes(truth: Truth) -> Truth:
    """Return a motion whose twist is given in the axes of the odometry frame, not in the base's."""
    rotation = rotation_from_quaternion(truth.base_orientation)
    return _twist_by(lambda values: rotate(rotation, values), truth)


def twist_turned(turn: Array, truth: Truth) -> Truth:
    """Return a motion whose twist is given in axes turned by a (3,) rotation vector."""
    return _twist_by(lambda values: values @ exp(turn), truth)


def twist_of_point(position: Array, truth: Truth) -> Truth:
    """Return a motion whose twist is that of another point, (3,) m from the base's, in its axes."""
    linear = truth.base_linear_velocity + cross(truth.base_angular_velocity, position)
    return replace(truth, base_linear_velocity=linear)


def _unit(truth: Truth, joint: int) -> Array:
    return np.eye(truth.joint_position.shape[1])[joint]


def _twist_by(change: Callable[[Array], Array], truth: Truth) -> Truth:
    linear, angular = change(truth.base_linear_velocity), change(truth.base_angular_velocity)
    return replace(truth, base_linear_velocity=linear, base_angular_velocity=angular)


def _continuous(rotation: Array) -> Array:
    """Return (N, 4) quaternions of (N, 3, 3) rotations, continuous in time."""
    quaternion = quaternion_from_rotation(rotation)
    flips = np.cumprod(np.where(np.sum(quaternion[1:] * quaternion[:-1], axis=1) < 0.0, -1.0, 1.0))
    return quaternion * np.concatenate(([1.0], flips))[:, None]


# -- defects


def coloured(white: Array, time: Array, constant: float) -> Array:
    """Return errors (N, 3) at (N,) s as an autoregression with a time constant (s), as large as the white ones."""
    keep = float(np.exp(-np.mean(np.diff(time)) / constant))
    scale = np.full((len(white), 1), np.sqrt(1.0 - keep**2))
    scale[0] = 1.0
    return np.asarray(lfilter([1.0], [1.0, -keep], scale * white, axis=0))


def correlated(constant: float, readings: Readings, _rng: np.random.Generator) -> Readings:
    """Give the poses' noise a time constant (s), with the same size."""
    base, truth = readings.base, readings.truth
    # Of a small rotation, the vector is twice the quaternion's imaginary part.
    error = 2.0 * quaternions.product(base.orientation, quaternions.conjugate(truth.base_orientation))[:, :3]
    orientation = quaternions.product(quaternions.exp(coloured(error, truth.time, constant)), truth.base_orientation)
    position = truth.base_position + coloured(base.position - truth.base_position, truth.time, constant)
    return _base(readings, position=position, orientation=orientation)


def wandering(step: float, readings: Readings, rng: np.random.Generator) -> Readings:
    """Let the odometry's position walk randomly (m / sqrt(s))."""
    length = np.sqrt(np.diff(readings.base.time, prepend=readings.base.time[0]))[:, None]
    walk = np.cumsum(step * length * rng.normal(size=readings.base.position.shape), axis=0)
    return _base(readings, position=readings.base.position + walk)


def outliers(share: float, readings: Readings, rng: np.random.Generator) -> Readings:
    """Displace a share of the poses by 0.2 m and 5 degrees."""
    return _displaced(readings, rng.random(len(readings.base.time)) < share, rng)


def one_outlier(readings: Readings, rng: np.random.Generator) -> Readings:
    """Displace one pose by 0.2 m and 5 degrees."""
    return _displaced(readings, np.arange(len(readings.base.time)) == len(readings.base.time) // 2, rng)


def _displaced(readings: Readings, hit: Flags, rng: np.random.Generator) -> Readings:
    way = rng.normal(size=(len(hit), 2, 3))
    way *= hit[:, None, None] / np.linalg.norm(way, axis=2, keepdims=True)
    orientation = quaternions.product(quaternions.exp(np.deg2rad(5.0) * way[:, 1]), readings.base.orientation)
    return _base(readings, position=readings.base.position + 0.2 * way[:, 0], orientation=orientation)


def thinned(every: int, readings: Readings, _rng: np.random.Generator) -> Readings:
    """Keep one in so many odometry messages."""
    return _some(readings, np.arange(0, len(readings.base.time), every))


def repeated(every: int, readings: Readings, _rng: np.random.Generator) -> Readings:
    """Repeat the last pose and twist with new stamps: one in so many is new."""
    held = _some(readings, np.arange(len(readings.base.time)) // every * every)
    return _base(held, time=readings.base.time)


def gyro_biased(bias: float, readings: Readings, _rng: np.random.Generator) -> Readings:
    """Add a constant to the angular velocity (rad/s about each axis)."""
    return _base(readings, angular_velocity=readings.base.angular_velocity + bias)


def without_twist(readings: Readings, _rng: np.random.Generator) -> Readings:
    """Fill the twist with zeros, as odometry does that does not measure it."""
    nothing = np.zeros_like(readings.base.linear_velocity)
    return _base(readings, linear_velocity=nothing, angular_velocity=nothing)


def joints_late(delay: float, drift: float, readings: Readings, _rng: np.random.Generator) -> Readings:
    """Stamp the joints late (s) by a clock that runs fast (s/s)."""
    return _joints(readings, time=delay + (1.0 + drift) * readings.joints.time)


def quantised(step: float, readings: Readings, _rng: np.random.Generator) -> Readings:
    """Round the joints' positions to steps (rad)."""
    return _joints(readings, position=step * np.round(readings.truth.joint_position / step))


def dropout(begin: float, end: float, readings: Readings, _rng: np.random.Generator) -> Readings:
    """Lose the odometry for a while (s)."""
    time = readings.base.time
    return _some(readings, np.flatnonzero((time < begin) | (time >= end)))


def lossy(share: float, readings: Readings, rng: np.random.Generator) -> Readings:
    """Lose a share of all odometry messages, at random."""
    return _some(readings, np.flatnonzero(rng.uniform(size=len(readings.base.time)) > share))


def jittering(most: float, readings: Readings, rng: np.random.Generator) -> Readings:
    """Stamp the odometry up to so much (s) early or late, at random, in order."""
    time = readings.base.time + rng.uniform(-most, most, len(readings.base.time))
    return _base(readings, time=np.maximum.accumulate(np.maximum(time, 0.0)))


def frozen(joint: int, begin: float, end: float, readings: Readings, _rng: np.random.Generator) -> Readings:
    """Freeze a joint's reading between two times (s)."""
    joints, position, velocity = readings.joints, readings.joints.position.copy(), readings.joints.velocity.copy()
    within = (joints.time >= begin) & (joints.time < end)
    position[within, joint], velocity[within, joint] = position[np.argmax(within), joint], 0.0
    return _joints(readings, position=position, velocity=velocity)


def slipped(joint: int, size: float, begin: float, readings: Readings, _rng: np.random.Generator) -> Readings:
    """Let a joint's reading jump (rad) at a time (s), and stay off."""
    position = readings.joints.position.copy()
    position[readings.joints.time >= begin, joint] += size
    return _joints(readings, position=position)


def one_late(least: float, most: float, readings: Readings, rng: np.random.Generator) -> Readings:
    """Read one joint late, by a delay between two (s): both are drawn."""
    truth, joint = readings.truth, int(rng.integers(readings.truth.joint_position.shape[1]))
    before = truth.time - rng.uniform(least, most)
    late = {}
    for name in ('position', 'velocity'):
        true, read = getattr(truth, f'joint_{name}')[:, joint], getattr(readings.joints, name).copy()
        read[:, joint] += np.interp(before, truth.time, true) - true
        late[name] = read
    return _joints(readings, **late)


def of_another_length(most: float, readings: Readings, rng: np.random.Generator) -> Readings:
    """Let the odometry see lengths larger by a factor, up to so much from 1."""
    factor = 1.0 + rng.uniform(-most, most)
    return _base(
        readings, position=factor * readings.base.position, linear_velocity=factor * readings.base.linear_velocity
    )


def _joints(readings: Readings, **changes: Array) -> Readings:
    return replace(readings, joints=replace(readings.joints, **changes))


def _base(readings: Readings, **changes: Array) -> Readings:
    return replace(readings, base=replace(readings.base, **changes))


def _some(readings: Readings, rows: Indices) -> Readings:
    arrays = ('time', 'position', 'orientation', 'linear_velocity', 'angular_velocity')
    return _base(readings, **{name: getattr(readings.base, name)[rows] for name in arrays})
