"""What sensors read of a motion, and what is wrong with what they say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.spoilt import coloured
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.sensors import BaseReadings, JointReadings, Sensors
from mbaid_ros.simulation.simulation import Truth

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


def read(truth: Truth, noise: SensorNoise, seed: int) -> Readings:
    """Return readings with white noise."""
    sensors = Sensors(noise, seed)
    return Readings(truth, sensors.joints(truth), sensors.base(truth))


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
