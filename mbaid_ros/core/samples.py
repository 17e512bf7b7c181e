"""What the core is fed with: synchronised samples of the joints and of the base, a batch at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from mbaid_ros.core.array_record import ArrayRecord
from mbaid_ros.core.geometry import Array, Flags

Stamps = npt.NDArray[np.int64]


@dataclass(frozen=True)
class SensorNoise:
    """One standard deviation of each sensor channel, a sample (white where nothing else is said).

    Attributes
    ----------
    joint_position : rad (m for a prismatic joint)
    joint_velocity : rad/s (m/s)
    base_position, base_orientation : m, rad; used where the Odometry carries no pose covariance
    base_linear_velocity, base_angular_velocity : m/s, rad/s; used where it carries no twist covariance
    base_correlation_time : s, over which the errors of the base's poses are correlated; 0 for white noise
    """

    joint_position: float
    joint_velocity: float
    base_position: float
    base_orientation: float
    base_linear_velocity: float
    base_angular_velocity: float
    base_correlation_time: float = 0.0

    def pose_covariance(self) -> Array:
        """Return the (6, 6) covariance of (position, orientation)."""
        return np.diag(np.repeat([self.base_position, self.base_orientation], 3) ** 2)

    def twist_covariance(self) -> Array:
        """Return the (6, 6) covariance of (linear, angular) velocity."""
        return np.diag(np.repeat([self.base_linear_velocity, self.base_angular_velocity], 3) ** 2)

    def found_in(self, samples: Samples) -> SensorNoise:
        """Return the noise of a window: as its samples have turned out to be, where they tell."""
        if not samples.noise.shape[1]:
            return self
        position, velocity, time = samples.noise[-1].tolist()
        return replace(self, joint_position=position, joint_velocity=velocity, base_correlation_time=time)


@dataclass(frozen=True)
class Samples(ArrayRecord):
    """A batch of N samples, joints and base at common stamps.

    Attributes
    ----------
    time : (N,) s since the first sample of the run, increasing
    joint_position : (N, n) rad or m, in the model's joint order
    joint_velocity : (N, n) rad/s or m/s
    base_position : (N, 3) m, origin of the base link in the odometry frame
    base_rotation : (N, 3, 3), base link to odometry frame
    base_linear_velocity : (N, 3) m/s, of the base link's origin, in odometry axes
    base_angular_velocity : (N, 3) rad/s, in odometry axes
    pose_covariance : (N, 6, 6) position and orientation (fixed axes), both in odometry axes
    twist_covariance : (N, 6, 6) linear and angular velocity, in base axes
    joint_rate_gain : (N, n) variance of a velocity over that of a position (1/s^2) where it was taken from the
        positions; NaN, also where not given, is a measured velocity
    rate_tilt : (N, n + 6) velocities of the joints, linear and angular ones of the base: variance of how their errors
        tilt over a window, over that of errors which are independent and have as noisy a mean; 1, also where not given,
        is a measured velocity
    impulse : (N, 6) what known thrust has changed (P, L) by since the first sample, odometry frame, L about its origin:
        N s, N m s; zero where not given
    stored : (N, c) what is read of what stores momentum inside bodies, as `Storage` has it: rad/s, N m s; none where
        not given
    tide : (N, 60 b) what an orbit has changed (P, L) by since the first sample, by the standard parameters of each of b
        bodies (6 x 10, rows first), falling frame, L about its origin; none where not given
    thrust : (N, 30 f) what known thrust has changed (P, L) by, L about the odometry's origin, by how much each of f
        thrusters is off its command: scale, turn, delay (6 x 5, rows first); none where not given
    gyro : (N, 3) rad, integral of the angular velocity that an IMU measures, since it began, in base axes, or, where
        joints move the link that it is on, in those of that link; NaN where it is not known, (N, 0) where there is no
        IMU
    apart : (N,) s, between the poses, or between the samples where these are further apart; 0 where not known
    noise : (N, 3) standard deviation of joint positions and velocities, and over what time (s) the errors of poses are
        correlated, as they have turned out to be; (N, 0) where they are as declared
    """

    time: Array
    joint_position: Array
    joint_velocity: Array
    base_position: Array
    base_rotation: Array
    base_linear_velocity: Array
    base_angular_velocity: Array
    pose_covariance: Array
    twist_covariance: Array
    joint_rate_gain: Array = field(default_factory=lambda: np.zeros((0, 0)))
    rate_tilt: Array = field(default_factory=lambda: np.zeros((0, 0)))
    impulse: Array = field(default_factory=lambda: np.zeros((0, 6)))
    stored: Array = field(default_factory=lambda: np.zeros((0, 0)))
    tide: Array = field(default_factory=lambda: np.zeros((0, 0)))
    thrust: Array = field(default_factory=lambda: np.zeros((0, 0)))
    gyro: Array = field(default_factory=lambda: np.zeros((0, 0)))
    apart: Array = field(default_factory=lambda: np.zeros(0))
    noise: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        """Take velocities as measured, and no thrust, where nothing else is said."""
        if len(self.impulse) != len(self.time):
            object.__setattr__(self, 'impulse', np.zeros((len(self.time), 6)))
        if len(self.apart) != len(self.time):
            object.__setattr__(self, 'apart', np.zeros(len(self.time)))
        for name in ('stored', 'tide', 'thrust', 'gyro', 'noise'):
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
    """Joint measurements as they arrived.

    Attributes
    ----------
    stamp : (N,) int64 ns
    position, velocity : (N, n) in the model's joint order
    stored : (N, c) as in Samples; none where not given
    """

    stamp: Stamps
    position: Array
    velocity: Array
    stored: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        """Take nothing as stored where nothing is said."""
        if len(self.stored) != len(self.stamp):
            object.__setattr__(self, 'stored', np.zeros((len(self.stamp), 0)))

    def divided(self, joints: int) -> JointStream:
        """Return the first n alone as joints; the rates of the others are what is read of stored momentum."""
        if self.position.shape[1] == joints:
            return self
        return JointStream(self.stamp, self.position[:, :joints], self.velocity[:, :joints], self.velocity[:, joints:])


@dataclass(frozen=True)
class BaseStream(ArrayRecord):
    """Base measurements as they arrived.

    Attributes
    ----------
    stamp : (N,) int64 ns
    position : (N, 3) m, base link origin in the odometry frame
    rotation : (N, 3, 3) base link to odometry axes
    linear_velocity, angular_velocity : (N, 3) m/s, rad/s, in odometry axes
    pose_covariance, twist_covariance : (N, 6, 6) as in Samples
    declared : (N, 4) whether the message says how noisy position, orientation, linear and angular velocity are; all of
        it where not given
    """

    stamp: Stamps
    position: Array
    rotation: Array
    linear_velocity: Array
    angular_velocity: Array
    pose_covariance: Array
    twist_covariance: Array
    declared: Flags = field(default_factory=lambda: np.ones((0, 4), dtype=bool))

    def __post_init__(self) -> None:
        """Take messages for complete where nothing else is said."""
        if len(self.declared) != len(self.stamp):
            object.__setattr__(self, 'declared', np.ones((len(self.stamp), 4), dtype=bool))


@dataclass(frozen=True)
class ImuStream(ArrayRecord):
    """Measurements of an IMU as they arrived.

    Attributes
    ----------
    stamp : (N,) int64 ns
    angular_velocity : (N, 3) rad/s, in base axes, or, where joints move the link that it is on, in those of that link
    rotation : (N, 3, 3) base link to world axes; NaN where it is not told, also where not given
    rotation_covariance : (N, 3, 3) rad^2, world axes
    declared : (N,) whether the message says how noisy the orientation is
    """

    stamp: Stamps
    angular_velocity: Array
    rotation: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))
    rotation_covariance: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))
    declared: Flags = field(default_factory=lambda: np.zeros(0, dtype=bool))

    def __post_init__(self) -> None:
        """Take no orientation as told where nothing is said."""
        for name in ('rotation', 'rotation_covariance'):
            if len(getattr(self, name)) != len(self.stamp):
                object.__setattr__(self, name, np.full((len(self.stamp), 3, 3), np.nan))
        if len(self.declared) != len(self.stamp):
            object.__setattr__(self, 'declared', np.zeros(len(self.stamp), dtype=bool))
