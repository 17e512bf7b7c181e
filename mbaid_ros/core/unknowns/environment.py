"""Disturbances: gravity of an undeclared orbit, an orbit's shape, torques and forces, thrusters.

In a frame that falls along an orbit a mass at x falls by G x faster, with a symmetric G without trace (Hill 1878). Of a
robot with the integrals H of x and S of x x^T over its mass, the momentum about the frame's origin changes by

    P' = G H,    L' = the axial vector of S G

a second. G turns with the orbit, by 2 n: over minutes it changes at a constant rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from mbaid_ros.core.geometry import Array, cross, skew, unvec
from mbaid_ros.core.linear_algebra import chi_square_limit
from mbaid_ros.core.results.status import Reason
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.robot.momentum import THRUSTER_ERRORS
from mbaid_ros.core.robot.orbit import Orbit, orbit_fixed_frame
from mbaid_ros.core.unknowns.declaration import Linear, NominalModel, Reading, Unknown, Words, diagonal

GRAVITY, SHAPE = 'gravity gradient', 'orbit shape'
TORQUE, FORCE = 'external torque', 'external force'
DisturbanceAxes = Literal['body', 'inertial', 'orbit']

# Orthonormal symmetric matrices without trace, (5, 3, 3).
_TRACELESS = np.array(
    [
        np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) / np.sqrt(2.0),
        np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]) / np.sqrt(2.0),
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]) / np.sqrt(2.0),
        np.diag([1.0, -1.0, 0.0]) / np.sqrt(2.0),
        np.diag([1.0, 1.0, -2.0]) / np.sqrt(6.0),
    ]
)
_FALSE_ALARM = 1e-9  # chance that noise looks like a gradient as large: each window asks once, for days
_NEAR = 200.0  # m from its origin, beyond which a frame does not count as one that falls with the robot


@dataclass(frozen=True, eq=False)
class _Disturbance(Linear):
    """An unknown that changes the momentum as time goes by; none of a planar motion, as tables do not orbit."""

    in_equations = True
    changes_momentum = True

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return no direction."""
        del detector
        return np.zeros((len(self.factor), 0))


@dataclass(frozen=True, eq=False)
class Gravity(_Disturbance):
    """The five numbers of a gradient G at the begin, 1/s^2, and of its change a second."""

    words: ClassVar = {
        GRAVITY: Words(
            remedy='an undeclared orbit: set orbit.mean_motion, or orbit.undeclared_rate to 0',
            deviation=lambda _, value: (
                f'a gravity gradient acts as at {orbit_rate(value):.2g} rad/s: set orbit.mean_motion'
            ),
        )
    }

    def momentum_rates(self, whole: Array, origin: Array, time: Array, rotation: Array) -> Array:
        """Return the change of (P, L) a second by each of them."""
        del rotation
        rates = gravity_gradient_rates(_TRACELESS, whole, origin if np.linalg.norm(origin) < _NEAR else np.zeros(3))
        return np.concatenate((rates, time[:, None, None] * rates), axis=2)

    def finding(self, mean: Array, covariance: Array) -> Reason | None:
        """Return that there is an undeclared orbit, if the data show one.

        The model is not adequate then: the gradient is estimated to first order, beside a body that it acts on and that
        is not known either. That suffices to detect it, but not for valid intervals.
        """
        if not self.count:
            return None
        now = slice(5)  # the others are its rate
        square = float(mean[now] @ np.linalg.solve(covariance[now, now], mean[now]))
        if square <= chi_square_limit(_FALSE_ALARM, 5):
            return None
        return Reason(orbit_fixed_frame(orbit_rate(self.factor @ mean)), 'contradiction', 0.5 * square)


def gravity_gradient_rates(gradients: Array, whole: Array, origin: Array) -> Array:
    """Return the changes of (P, L) a second, (B, 6, k), by (k, 3, 3) or (B, k, 3, 3) gradients; as `momentum_rates`."""
    mass, first, inertia = whole[:, 0], whole[:, 1:4], unvec(whole[:, 4:])
    second = 0.5 * np.trace(inertia, axis1=1, axis2=2)[:, None, None] * np.eye(3) - inertia
    weighed = (second + first[:, :, None] * origin)[:, None] @ gradients  # (B, k, 3, 3)
    rates = np.zeros((len(whole), 6, gradients.shape[-3]))
    rates[:, :3] = np.swapaxes((gradients @ (first + mass[:, None] * origin)[:, None, :, None])[..., 0], 1, 2)
    for axis, (one, other) in enumerate(((1, 2), (2, 0), (0, 1))):
        rates[:, 3 + axis] = weighed[..., one, other] - weighed[..., other, one]
    return rates


def gravity(rate: float) -> Gravity:
    """Return the gradient as an unknown, that of a circular orbit at a rate (rad/s) in a plane of any direction."""
    size = np.sqrt(6.0 / 5.0) * rate**2
    deviations = np.repeat((size, np.sqrt(3.0) * rate * size), len(_TRACELESS))
    return Gravity(diagonal(deviations), (GRAVITY,) * len(deviations))


def orbit_rate(value: Array) -> float:
    """Return the mean motion, rad/s, of an orbit with a gradient of (10,) numbers at the begin."""
    return float((value[:5] @ value[:5] / 6.0) ** 0.25)


@dataclass(frozen=True, eq=False)
class Circle:
    """A circular orbit that may be none."""

    orbit: Orbit  # the circle, the epoch at the begin of the run
    eccentricity: float  # up to which it may be none
    relative_twist: bool = True  # whether the twist is read relative to a frame that turns


@dataclass(frozen=True, eq=False)
class OrbitShape(_Disturbance):
    """The numbers k, h and d of an orbit beside its circle (orbit.md)."""

    circle: Circle

    words: ClassVar = {
        SHAPE: Words(
            'eccentricity and mean motion of the orbit',
            'orbit.undeclared_eccentricity, or set orbit.eccentricity and orbit.true_anomaly',
            'the shape of the orbit: set orbit.eccentricity, or orbit.undeclared_eccentricity to 0',
            lambda _, __: (
                'the orbit is no circle, or orbit.mean_motion is wrong: set orbit.eccentricity and orbit.true_anomaly'
            ),
        )
    }

    def momentum_rates(self, whole: Array, origin: Array, time: Array, rotation: Array) -> Array:
        """Return the momentum by gravity beside that of the circle."""
        del rotation
        orbit = self.circle.orbit
        gradient, normal = orbit.gradient(time), skew(orbit.normal)
        brought = gravity_gradient_rates(gradient[:, None], whole, origin)
        if orbit.is_rotating:
            # The run's origin is read turned, too.
            turned: Array = np.concatenate((normal @ brought[:, :3], normal @ brought[:, 3:]), axis=1)
            turned[:, 3:] += skew(np.cross(orbit.normal, origin)) @ brought[:, :3]
        else:
            turned = gravity_gradient_rates((normal @ gradient - gradient @ normal)[:, None], whole, origin)
        ahead, stronger = self._orbit_sensitivity(time)[::2]
        return np.asarray(brought * stronger[:, None] + turned * ahead[:, None])

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return the rotation of a co-rotating frame back, about its own origin."""
        pose: Array = np.zeros((len(motion.time), 6, 3))
        twist: Array = pose
        if self.circle.orbit.is_rotating:
            normal = np.broadcast_to(self.circle.orbit.normal, motion.position.shape)
            turn = np.concatenate((normal, cross(normal, motion.origin + motion.position)), axis=1)[..., None]
            ahead, faster, _ = self._orbit_sensitivity(motion.time)
            pose = np.asarray(-turn * ahead[:, None])
            if self.circle.relative_twist:
                twist = np.asarray(-turn * faster[:, None])
        return pose, twist

    def _orbit_sensitivity(self, time: Array) -> tuple[Array, Array, Array]:
        """Return how D, its rate and s depend on the numbers, (N, 3) each."""
        n = self.circle.orbit.mean_motion
        angle, one = n * time, np.ones(len(time))
        sine, cosine = np.sin(angle), np.cos(angle)
        ahead = np.column_stack((2.0 * sine, 2.0 * cosine - 2.0, angle))
        faster = n * np.column_stack((2.0 * cosine, -2.0 * sine, one))
        return ahead, faster, np.column_stack((3.0 * cosine, -3.0 * sine, 2.0 * one))


def orbit_shape(circle: Circle) -> OrbitShape:
    """Return an orbit's deviation from a circle as an unknown: each number is the eccentricity in one direction."""
    return OrbitShape(np.sqrt(0.5) * circle.eccentricity * np.eye(3), (SHAPE,) * 3, circle)


@dataclass(frozen=True)
class DisturbanceModel:
    """How a force or torque from outside varies."""

    deviation: float = 0.0  # N or N m, standard deviation along each axis; 0 is none
    # s, time constant of the first-order Gauss-Markov process that each component is; 0: constant in a motion
    time: float = 0.0
    axes: DisturbanceAxes = 'body'  # in which it is constant or varies; those of the orbit are LVLH
    orbit: Orbit | None = None  # whose axes these are, its epoch at the begin of the run

    def rotation(self, time: Array, base: Array) -> Array:
        """Return the (B, 3, 3) rotations from its axes to inertial ones, (B,) s after the begin; `base` of the base."""
        if self.axes == 'body':
            return base
        if self.axes == 'inertial' or self.orbit is None:
            return np.broadcast_to(np.eye(3), base.shape)
        down = -self.orbit.zenith_at(time)
        across = np.broadcast_to(-self.orbit.normal, down.shape)
        return np.stack((cross(across, down), across, down), axis=-1)


@dataclass(frozen=True, eq=False)
class ExternalTorque(_Disturbance):
    """A torque, (3,) N m; another one in every motion."""

    model: DisturbanceModel

    words: ClassVar = {
        TORQUE: Words(
            'external torques',
            'disturbance.torque_std',
            'an external torque: shield it, or record longer (disturbance.torque_std)',
            lambda name, value: (
                f'a torque of {np.linalg.norm(value):.2g} N m {_varying(name)}: find its source, or raise '
                'disturbance.torque_std'
            ),
        )
    }
    redrawn_per_motion = True

    @property
    def time_constants(self) -> Array:
        """The time constant of each component; inf where it is constant."""
        return np.full(self.count, self.model.time or np.inf)

    def momentum_rates(self, whole: Array, origin: Array, time: Array, rotation: Array) -> Array:
        """Return the change of (P, L) a second by each component."""
        del origin
        rates = np.zeros((len(whole), 6, 3))
        rates[:, 3:] = self.model.rotation(time, rotation)
        return rates

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return the one about the normal."""
        if self.model.axes == 'body':
            return np.asarray(detector.plane_of_body(0).normal[:, None])
        return detector.equation_selection()[2:, 3:].T


@dataclass(frozen=True, eq=False)
class ExternalForce(ExternalTorque):
    """A force, (3,) N, through the common centre of mass; another one in every motion. Its lever arm is a torque."""

    words: ClassVar = {
        FORCE: Words(
            'external forces',
            'disturbance.force_std',
            'an external force: shield it, or record longer (disturbance.force_std)',
            lambda name, value: (
                f'a force of {np.linalg.norm(value):.2g} N {_varying(name)}: find its source, or raise '
                'disturbance.force_std'
            ),
        )
    }

    def momentum_rates(self, whole: Array, origin: Array, time: Array, rotation: Array) -> Array:
        """Return the change of (P, L) a second by each component."""
        del origin
        axes, centre = self.model.rotation(time, rotation), whole[:, 1:4] / whole[:, :1]
        return np.concatenate((axes, skew(centre) @ axes), axis=1)

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return the two in the plane."""
        if self.model.axes == 'body':
            return np.asarray(detector.plane_of_body(0).axes.T)
        return detector.equation_selection()[:2, :3].T


def _varying(name: str) -> str:
    return f'from outside varies with {name}' if name else 'acts from outside'


def disturbances(torque: DisturbanceModel, force: DisturbanceModel) -> tuple[ExternalTorque, ExternalForce]:
    """Return a torque and a force from outside as unknowns."""
    labels = (
        (f'{kind}:{push.time:g} s' if push.time else kind,) * 3 for kind, push in ((TORQUE, torque), (FORCE, force))
    )
    factors = (diagonal(np.full(3, push.deviation)) for push in (torque, force))
    one, other = zip(factors, labels, (torque, force), strict=True)
    return ExternalTorque(*one), ExternalForce(*other)


@dataclass(frozen=True, eq=False)
class Thrusters(Unknown):
    """Scale, turn (rad, in the axes of its frame) and delay (s) of each thruster less those of its command."""

    frames: tuple[str, ...]  # names of the thrusters

    def momentum_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return the momentum (P, L) that they have brought, which is subtracted to leave a constant."""
        del kernel
        return -np.moveaxis(states.thrust, 1, 2).reshape(len(states.thrust), 6, -1)

    def applied_to(self, side: NominalModel, value: Array) -> NominalModel:
        """Return the nominal model with these thrusters."""
        return replace(side, thrust=side.thrust + value if side.thrust.size else value)


def thrusters(frames: Sequence[str], scale_std: float, direction_std: float, delay_std: float) -> Thrusters:
    """Return thrusters by their frames as an unknown; relative, rad about each axis and s; 0 is exact."""
    deviations = np.tile([scale_std, *(direction_std,) * 3, delay_std], len(frames))
    labels = tuple(f'thrust:{frame}' for frame in frames for _ in range(THRUSTER_ERRORS))
    return Thrusters(diagonal(deviations), labels, tuple(frames))
