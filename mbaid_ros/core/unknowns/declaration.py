"""The known side of a robot where a prediction is linearised: its URDF, moved by what has been estimated of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from mbaid_ros.core.array_record import ArrayRecord
from mbaid_ros.core.geometry import Array, moved_base
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.samples import Samples


@dataclass(frozen=True, eq=False)
class NominalModel:
    """What the prediction takes for known.

    Attributes
    ----------
    kernel : bodies and joint placements
    zeros : (n,) rad or m, what is added to the measured joint positions
    mount : (6,) the base's frame in the one that the odometry locates: rotation vector (rad), position (m)
    delay : s, by how much the joints' stamps are late
    thrust : (5 f,) by how much each thruster is off its command: scale, turn, delay; empty is not at all
    gyro : (12,) bias, scale, turn and what axes have in common, of a gyro that alone tells the orientation
    """

    kernel: MomentumKernel
    zeros: Array
    mount: Array
    delay: float
    thrust: Array = field(default_factory=lambda: np.zeros(0))
    gyro: Array = field(default_factory=lambda: np.zeros(12))

    @staticmethod
    def nominal(kernel: MomentumKernel) -> NominalModel:
        """Return the robot as its URDF has it."""
        return NominalModel(kernel, np.zeros(kernel.model.joints), np.zeros(6), 0.0)

    def corrected(self, samples: Samples) -> Samples:
        """Return samples of the base's own frame: q + zeros, p + R mu_p and R Exp(mu_R); delayed as they are."""
        if not (np.any(self.zeros) or np.any(self.mount)):
            return samples
        rotation, away, linear = moved_base(
            samples.base_rotation, samples.base_linear_velocity, samples.base_angular_velocity, self.mount
        )
        return replace(
            samples,
            joint_position=samples.joint_position + self.zeros,
            base_position=samples.base_position + away,
            base_rotation=rotation,
            base_linear_velocity=linear,
        )


@dataclass(frozen=True)
class JointMotion(ArrayRecord):
    """What n joints do at N instants.

    Attributes
    ----------
    position, rate, acceleration : (N, n) rad or m, and per s and s^2
    torque, torque_rate : (N, n) N m or N, about or along each axis, that moves all that it carries; and per s
    """

    position: Array
    rate: Array
    acceleration: Array
    torque: Array
    torque_rate: Array


@dataclass(frozen=True)
class ImuMotion:
    """How an IMU turns in B windows, odometry axes.

    Attributes
    ----------
    rate : (B, 3) rad/s, mean angular velocity at the knots
    slope : (B, 3) its weighted mean slope
    axes : (B, 3, 3) weighted mean of R, its axes to the odometry's
    stretching, turning : (B, 3, 3) weighted means of R diag(R^T w) and of [w]x R
    crossing : (B, 3, 3) weighted mean of R X(R^T w), X as in `geometry.crossed`
    """

    rate: Array
    slope: Array
    axes: Array
    stretching: Array
    turning: Array
    crossing: Array


@dataclass(frozen=True)
class Reading:
    """A window's motion, as what the sensors read depends on it; B windows, angular parts first, odometry axes.

    Attributes
    ----------
    twist : (B, 6) mean twist (w, v) of the base at the knots
    slope : (B, 6) weighted mean of (w', v' - w x v)
    rotation : (B, 3, 3) mean orientation of the base at the knots
    turning, sliding : (B, 3, 3) weighted means of [w]x R and [v]x R
    time : (B,) s, of the windows' middles
    position : (B, 3) m, mean position of the base at the knots, from the run's origin
    axes : (B, 3, 3) weighted mean of R
    origin : (3,) m, the run's, in the odometry frame
    imu : where there is one
    """

    twist: Array
    slope: Array
    rotation: Array
    turning: Array
    sliding: Array
    time: Array
    position: Array
    axes: Array
    origin: Array = field(default_factory=lambda: np.zeros(3))
    imu: ImuMotion | None = None


@dataclass(frozen=True, eq=False)
class Unknown:
    """An uncertain thing of the known side.

    The k numbers themselves (SI units) are `factor` times e independent standard normal ones, which is what the filter
    has among its variables.

    Attributes
    ----------
    factor : (k, e) of the prior covariance factor factor^T
    labels : k, what each number belongs to in the error budget
    """

    factor: Array
    labels: tuple[str, ...]

    # Whether the sensors' readings depend on it. Windows that follow each other then share its linearisation point: the
    # pose error that links them is about the readings.
    read = False
    # Whether the momentum of the robot that moves as measured depends on it.
    in_equations = True
    # Whether it changes the momentum as time goes by.
    pushes = False
    # Whether every motion has one of its own.
    of_a_motion = False
    # Whether it adds to the joints' motion.
    of_joints = False

    @property
    def count(self) -> int:
        """Number e of independent numbers."""
        return self.factor.shape[1]

    @cached_property
    def causes(self) -> tuple[str, ...]:
        """Of each independent number, the label it has most to do with."""
        size = np.sqrt(np.sum(self.factor**2, axis=1, keepdims=True))
        relative = np.abs(self.factor) / np.where(size > 0.0, size, 1.0)
        return tuple(self.labels[row] for row in np.argmax(relative, axis=0)) if self.count else ()

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """Of each independent number, the part of its cause that it is, where that may be mistaken by itself; or ''."""
        return ('',) * self.count

    def part(self, cause: str) -> Unknown:
        """Return its independent numbers that have most to do with a label alone."""
        return replace(self, factor=self.factor[:, np.array(self.causes) == cause])

    def momentum_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array | None:
        """Return how the momentum depends on it, all twists as they are, (N, 6, k); None where it does not.

        Parameters
        ----------
        kernel : of the robot where it is linearised
        states : of N samples, all bodies known
        """
        del kernel, states
        return None

    def equation_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return how the momentum equations about the base's origin depend on it, at measured motion, (N, 6, k).

        Parameters
        ----------
        kernel, states : as for `momentum_columns`
        """
        columns = self.momentum_columns(kernel, states)
        if columns is None:
            raise NotImplementedError(type(self).__name__)
        return columns

    def momentum_rates(self, whole: Array, origin: Array, time: Array, rotation: Array) -> Array:
        """Return how fast (P, L) change by it, (B, 6, k), where they do.

        Parameters
        ----------
        whole : (B, 10) standard parameters of the whole robot in odometry axes, about the point that L is about
        origin : (3,) m, that point in the odometry frame
        time : (B,) s since the begin
        rotation : (B, 3, 3) of the base
        """
        raise NotImplementedError(type(self).__name__)

    def reading(self, motion: Reading) -> tuple[Array, Array] | None:
        """Return how much more mean pose (angular, linear) and twist of B windows read by it, (B, 6, k) each."""
        del motion
        return None

    def deflections(self, motion: JointMotion) -> tuple[Array, Array]:
        """Return how much further on and faster than read the joints are by it, (N, n, k) each."""
        raise NotImplementedError(type(self).__name__)

    def gyro_reading(self, motion: Reading) -> Array | None:
        """Return how much more the angular velocity of an IMU reads by it, odometry axes, (B, 3, k); None for nothing.

        It does not depend on how the odometry is mounted, or what its frame does.
        """
        del motion
        return None

    @property
    def walk(self) -> Array:
        """The (k, w) factor of what it changes by in a second, covariance factor factor^T; of no columns: it stays."""
        return np.zeros((len(self.factor), 0))

    @property
    def times(self) -> Array:
        """Time constant (e,) of each independent number that is a first-order Gauss-Markov process, s; inf: it stays.

        Its prior is the stationary one: variance one. What lies D apart has a correlation of exp(-D / time).
        """
        return np.full(self.count, np.inf)

    @property
    def joint_steps(self) -> Array | None:
        """How much further on than read the joints are by each independent number, (n, e); None: it is not of them.

        Where the number changes, joints move as no reading tells, and the base with them.
        """
        return None

    def settled(self, value: Array, deviation: Array) -> Array:
        """Return the value to linearise at, of an estimate (k,) with standard deviations (k,)."""
        del deviation
        return value

    def moved(self, side: NominalModel, value: Array) -> NominalModel:
        """Return the known side with this value (k,)."""
        raise NotImplementedError

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return orthonormal (k, p) directions of it that a planar motion depends on."""
        del detector
        return np.eye(len(self.factor))

    def in_plane(self, detector: PlaneDetector) -> Unknown:
        """Return it as a planar motion depends on it."""
        basis = self.plane_basis(detector)
        seen = basis.T @ self.factor
        # The same covariance with no more columns than directions.
        root = np.asarray(np.linalg.qr(seen.T, mode='r')).T if seen.shape[1] > seen.shape[0] else seen
        return replace(self, factor=basis @ root)


@dataclass(frozen=True, eq=False)
class Linear(Unknown):
    """An unknown, of the readings as a rule, that windows are not linearised at: they stay as they are read."""

    read = True
    in_equations = False

    def settled(self, value: Array, deviation: Array) -> Array:
        """Return zero: the windows are those that are read."""
        del deviation
        return np.zeros_like(value)

    def moved(self, side: NominalModel, value: Array) -> NominalModel:
        """Return the known side as it is."""
        del value
        return side
