"""Gyro and clocks: the errors of an IMU, a delay of the joints' stamps, a drift between clocks.

A gyro reads (1 + diag(k) + C) Exp(-e) w(t - d) + b, C symmetric without a diagonal, in the declared axes of its frame,
w in those of its link.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.robot.model import Link
from mbaid_ros.core.unknowns.declaration import Linear, NominalModel, Reading, Unknown, Words, diagonal

BIAS, STRETCH, TURN, CROSS, LATE = GYRO = ('gyro bias', 'gyro scale', 'gyro mount', 'gyro cross-axis', 'gyro delay')
OFFSET, CLOCK = 'time offset', 'clock drift'
_LATE = 12  # place of the delay: as many numbers are before it


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


@dataclass(frozen=True, eq=False)
class Gyro(Unknown):
    """Bias (rad/s), scale, turn (rad) of its axes, cross-axis sensitivity, (3,) each, and delay (s)."""

    # (13, w) factor of the change of the bias in a second
    wandering: Array = field(default_factory=lambda: np.zeros((13, 0)))
    errors: GyroErrors = field(default_factory=GyroErrors)  # as declared

    in_readings = True
    in_equations = False  # which do not know of it

    @property
    def random_walk(self) -> Array:
        """The walk of the bias."""
        return self.wandering

    def reading(self, motion: Reading) -> tuple[Array, Array] | None:
        """Return how the orientation reads that is measured in the same axes: R_read = R Exp(e)."""
        if not self.errors.with_orientation:
            return None
        pose, twist = np.zeros((2, len(motion.rotation), 6, 13))
        pose[:, :3, 6:9] = motion.rotation
        return pose, twist

    def gyro_reading(self, motion: Reading) -> Array:
        """Return its reading by each."""
        assert motion.imu is not None, 'there is an IMU'
        own = motion.imu
        return np.concatenate((own.axes, own.stretching, own.turning, own.crossing, -own.slope[..., None]), axis=-1)

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

    def applied_to(self, side: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with these errors."""
        return replace(side, gyro=side.gyro + value[:_LATE]) if self.errors.alone else side

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return bias and scale of its reading about the normal, and the delay."""
        normal = self._normal(detector)
        basis = np.zeros((13, 3))
        basis[:3, 0], basis[3:6, 1], basis[_LATE, 2] = normal, normal**2 / np.linalg.norm(normal**2), 1.0
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
    labels = (*np.repeat(GYRO[:4], 3).tolist(), LATE)
    return Gyro(diagonal(deviations), labels, wandering[:, : 3 * (own.walk > 0.0)], own)


_CLEAR = 4.0  # standard deviations, from which a delay is one: joints are moved in time at the price of noise in them


@dataclass(frozen=True, eq=False)
class TimeOffset(Unknown):
    """A constant delay of the joints' stamps, s. A pose error that comes of joints tau too late is -tau (w, v)."""

    words: ClassVar = {
        OFFSET: Words(
            remedy='the offset between the stamps: more motion determines it',
            deviation=lambda _, value: f'the joints are stamped {1e3 * np.sum(value):+.3g} ms late: check the stamps',
        )
    }
    in_readings = True
    in_equations = False  # of the measured motion at one instant

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return how much further on pose and twist are read."""
        return motion.twist[..., None], motion.slope[..., None]

    def gyro_reading(self, motion: Reading) -> Array:
        """Return how much further on the angular velocity is read."""
        assert motion.imu is not None, 'there is an IMU'
        return motion.imu.slope[..., None]

    def linearisation_value(self, value: Array, deviation: Array) -> Array:
        """Return the delay that the joints are taken later by: none, unless it is clearly one."""
        return np.where(np.abs(value) > _CLEAR * deviation, value, 0.0)

    def applied_to(self, side: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with this delay."""
        return replace(side, delay=side.delay + float(value[0]))


def time_offset(deviation: float) -> TimeOffset:
    """Return the offset as an unknown, of a standard deviation, s."""
    return TimeOffset(np.array([[deviation]]), (OFFSET,))


@dataclass(frozen=True, eq=False)
class ClockDrift(Linear):
    """How fast the joints' clock runs, s/s: a delay that grows with time since the run began.

    The momentum is then that of the joints' clock. Linear, as far as the base's motion is over that delay: to some
    50 ms, eight minutes at 100 ppm.
    """

    words: ClassVar = {
        CLOCK: Words(
            remedy='the drift between the clocks of joints and odometry: synchronise them (time_offset.drift_std)',
            deviation=lambda _, value: (
                f'the clocks drift apart by {1e6 * np.sum(value):+.3g} ppm: synchronise them, or raise '
                'time_offset.drift_std'
            ),
        )
    }

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return how much further on pose and twist are read, and how much faster the base is by the joints' clock."""
        time = motion.time[:, None]
        return (time * motion.twist)[..., None], (time * motion.slope + motion.twist)[..., None]

    def gyro_reading(self, motion: Reading) -> Array:
        """Return how much further on the angular velocity is read."""
        assert motion.imu is not None, 'there is an IMU'
        return (motion.time[:, None] * motion.imu.slope + motion.imu.rate)[..., None]


def clock_drift(deviation: float) -> ClockDrift:
    """Return the drift as an unknown, of a standard deviation, s/s."""
    return ClockDrift(np.array([[deviation]]), (CLOCK,))
