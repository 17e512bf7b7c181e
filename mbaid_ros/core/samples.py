"""Records of arrays with one leading axis: samples of joints and base, and the streams that they are made of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, TypeVar

import numpy as np
import numpy.typing as npt

from mbaid_ros.core.geometry import Array, Flags

S = TypeVar('S', bound='ArrayRecord')
Index = int | slice | npt.NDArray[np.bool_] | npt.NDArray[np.intp]


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


Stamps = npt.NDArray[np.int64]


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
    tide: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (N, 30 f) derivatives of the change of (P, L) by known thrust, L about the odometry's origin, by the errors of f
    # thrusters: scale, turn, delay (6 x 5, rows first); none by default
    thrust: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (N, 3) rad, integral of an IMU's angular velocity since it began, in base axes, or, if joints move its link, in
    # those of that link; NaN where unknown, (N, 0) without an IMU
    gyro: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (N,) s, between the poses, or between the samples if these are further apart; 0 where unknown
    apart: Array = field(default_factory=lambda: np.zeros(0))
    # (N, 3) estimated standard deviations of joint positions and velocities, and correlation time of the poses' errors
    # (s); (N, 0) where they are as declared
    noise: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        """Fill in the defaults."""
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

    def __post_init__(self) -> None:
        """Fill in the defaults."""
        for name in ('rotation', 'rotation_covariance'):
            if len(getattr(self, name)) != len(self.stamp):
                object.__setattr__(self, name, np.full((len(self.stamp), 3, 3), np.nan))
        if len(self.declared) != len(self.stamp):
            object.__setattr__(self, 'declared', np.zeros(len(self.stamp), dtype=bool))
