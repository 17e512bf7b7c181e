"""The declaration of an unknown: its prior, its words, and how momentum and readings depend on it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np

from mbaid_ros.core.geometry import Array, mounted_base
from mbaid_ros.core.results.status import Reason
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.samples import Samples


@dataclass(frozen=True, eq=False)
class NominalModel:
    """The robot that a prediction is linearised at: its URDF, moved by the estimates."""

    kernel: MomentumKernel  # bodies and joint placements
    zeros: Array  # (n,) rad or m, added to the measured joint positions
    mount: Array  # (6,) the base's frame in the one that the odometry locates: rotation vector (rad), position (m)
    delay: float  # s, by how much the joints' stamps are late
    # (5 f,) by how much each thruster is off its command: scale, turn, delay; empty is not at all
    thrust: Array = field(default_factory=lambda: np.zeros(0))
    # (12,) bias, scale, turn and cross-axis of a gyro that alone observes the orientation
    gyro: Array = field(default_factory=lambda: np.zeros(12))

    @staticmethod
    def nominal(kernel: MomentumKernel) -> NominalModel:
        """Return the robot as its URDF has it."""
        return NominalModel(kernel, np.zeros(kernel.model.joints), np.zeros(6), 0.0)

    def corrected(self, samples: Samples) -> Samples:
        """Return samples of the base's own frame: q + zeros, p + R mu_p and R Exp(mu_R); delayed as they are."""
        if not (np.any(self.zeros) or np.any(self.mount)):
            return samples
        rotation, away, linear = mounted_base(
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
class ImuMotion:
    """How an IMU turns in B windows, odometry axes."""

    # rate, slope: (B, 3) rad/s, mean angular velocity at the knots; its weighted mean slope
    rate: Array
    slope: Array
    axes: Array  # (B, 3, 3) weighted mean of R, its axes to the odometry's
    # stretching, turning, crossing: (B, 3, 3) weighted means of R diag(R^T w), [w]x R and R X(R^T w), X as in
    # `geometry.crossed`
    stretching: Array
    turning: Array
    crossing: Array


@dataclass(frozen=True)
class Reading:
    """A window's motion, for the derivatives of the readings; B windows, angular parts first, odometry axes."""

    # twist, slope: (B, 6) mean twist (w, v) of the base at the knots; weighted mean of (w', v' - w x v)
    twist: Array
    slope: Array
    rotation: Array  # (B, 3, 3) mean orientation of the base at the knots
    # turning, sliding, axes: (B, 3, 3) weighted means of [w]x R, [v]x R and R
    turning: Array
    sliding: Array
    time: Array  # (B,) s, of the windows' middles
    position: Array  # (B, 3) m, mean position of the base at the knots, from the run's origin
    axes: Array
    origin: Array = field(default_factory=lambda: np.zeros(3))  # (3,) m, the run's, in the odometry frame
    imu: ImuMotion | None = None  # where there is one


class PlacedFrame(Protocol):
    """A frame on the base."""

    @property
    def rotation(self) -> Array:
        """Its axes in the base link's frame, (3, 3)."""

    @property
    def position(self) -> Array:
        """Its origin there, (3,) m."""


@dataclass(frozen=True)
class Words:
    """The words for the causes of one kind: 'zero:elbow' is of the kind 'zero'."""

    every: str = ''  # all causes of the kind together
    parameter: str = ''  # where their standard deviation is declared
    remedy: str = ''  # how to know them better; {} stands for the name
    # of the thing's name and its numbers (SI units), what they would have to be, and what to do
    deviation: Callable[[str, Array], str] | None = None


@dataclass(frozen=True, eq=False)
class Unknown:
    """An uncertain thing of the nominal model.

    The k numbers themselves (SI units) are `factor` times e independent standard normal ones, which are the filter's.
    """

    factor: Array  # (k, e) of the prior covariance factor factor^T
    labels: tuple[str, ...]  # k, the cause of each number in the error budget

    # By the kind of its labels.
    words: ClassVar[Mapping[str, Words]] = {}
    # Whether the sensors' readings depend on it. Windows that follow each other then share its linearisation point: the
    # pose error that links them is about the readings.
    in_readings = False
    # Whether the momentum of the robot that moves as measured depends on it.
    in_equations = True
    # Whether it changes the momentum with time.
    changes_momentum = False
    # Whether it is drawn anew for every motion.
    redrawn_per_motion = False
    # Whether it is drawn anew after every gap in the data.
    redrawn_after_gap = False
    # Whether it adds to the joints' motion.
    moves_joints = False
    # Whether a calibration file holds it: links, placements of joints, mount.
    calibrated = False
    # Whether the joints' noise drives its numbers beyond their prior.
    noise_driven = False

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

    def mass_row(self) -> Array | None:
        """Return how the robot's mass depends on its independent numbers, (e,), kg; None where it does not."""
        return None

    def equation_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return how the momentum equations about the base's origin depend on it, at measured motion, (N, 6, k)."""
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

    def deflections(self, position: Array, rate: Array) -> tuple[Array, Array]:
        """Return how much further on and faster than read (N, n) the joints are by it, (N, n, k) each."""
        raise NotImplementedError(type(self).__name__)

    def gyro_reading(self, motion: Reading) -> Array | None:
        """Return how much more the angular velocity of an IMU reads by it, odometry axes, (B, 3, k); None: nothing."""
        del motion
        return None

    @property
    def random_walk(self) -> Array:
        """The (k, w) factor of the covariance that a second adds; no columns where it is constant."""
        return np.zeros((len(self.factor), 0))

    @property
    def time_constants(self) -> Array:
        """Time constant (e,) of each independent number that is a first-order Gauss-Markov process, s; inf: constant.

        Its prior is the stationary one, of unit variance; numbers D apart correlate by exp(-D / time).
        """
        return np.full(self.count, np.inf)

    def process_variances(self, rates: Array) -> Array:
        """Return the variances (B, e) that the joints' noise adds to its numbers, where that drives them.

        Parameters
        ----------
        rates : (B, f) that a window's noise adds to each passive joint, rad/s or m/s
        """
        raise NotImplementedError(type(self).__name__)

    @property
    def joint_columns(self) -> Array | None:
        """How much further on than read the joints are by each independent number, (n, e); None: it is not of them."""
        return None

    def linearisation_value(self, value: Array, deviation: Array) -> Array:
        """Return the linearisation point (k,) of an estimate (k,) with standard deviations (k,)."""
        del deviation
        return value

    def eased(self, part: float, unknowns: Sequence[Unknown]) -> Unknown:
        """Return it as a search takes it that begins with a loose swing of passive joints: itself, where of none.

        Parameters
        ----------
        part : 1 in the loosest stage: the swing's change from window to window, relative to that at the start
        unknowns : all of the state
        """
        del part, unknowns
        return self

    def finding(self, mean: Array, covariance: Array) -> Reason | None:
        """Return why its estimate by itself contradicts the model, with the likelihood gain; None where it does not.

        Parameters
        ----------
        mean, covariance : (e,), (e, e) of its independent numbers
        """
        del mean, covariance
        return None

    def applied_to(self, side: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with this value (k,)."""
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
    """An unknown, mostly of the readings, that enters the measurement linearly: windows need no relinearisation."""

    in_readings = True
    in_equations = False

    def linearisation_value(self, value: Array, deviation: Array) -> Array:
        """Return zero: windows are linearised as read."""
        del deviation
        return np.zeros_like(value)

    def applied_to(self, side: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model as it is."""
        del value
        return side


def diagonal(deviations: Sequence[float] | Array) -> Array:
    """Return the (k, e) factor of independent numbers with these standard deviations (k,); 0 is exact."""
    sizes = np.asarray(deviations, dtype=float)
    return np.diag(sizes)[:, sizes > 0.0]


def uncertain(*unknowns: Unknown) -> tuple[Unknown, ...]:
    """Return those that are not exact, in the same order."""
    return tuple(unknown for unknown in unknowns if unknown.count and unknown.factor.any())


def twist_in_plane(detector: PlaneDetector) -> Array:
    """Return the (6, 3) basis of the base's planar twists: the turn about the normal, two directions in the plane."""
    plane = detector.plane_of_body(0)
    basis = np.zeros((6, 3))
    basis[:3, 0], basis[3:, 1:] = plane.normal, plane.axes.T
    return basis
