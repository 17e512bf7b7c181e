"""Where the odometry is mounted: the base's frame in the one that it locates.

With the mount mu = (mu_R, mu_p), R_true = R Exp(mu_R) and p_true = p + R mu_p. What is read is the other way round.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.robot.momentum import inertia_matrix
from mbaid_ros.core.robot.sensitivity import force_cross, motion_cross
from mbaid_ros.core.unknowns.declaration import Linear, NominalModel, Reading, Unknown


@dataclass(frozen=True, eq=False)
class OdometryMount(Unknown):
    """Rotation vector (rad) and position (m) of the base's frame in the one that the odometry locates."""

    read = True

    def equation_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return how the equations of a robot that is measured by its odometry's frame depend on where that is.

        A turn of the base takes everything along but the measured twist (docs/trajectory.md, eq. 2). A base that is
        elsewhere, by a, moves faster by w x a, and the angular momentum about its origin is less by a x P.
        """
        del kernel
        rotation = states.configuration.rotation[:, 0]
        inertia = np.sum(inertia_matrix(states.known), axis=1)
        total, twist = states.known_momentum, states.body_twist[:, 0]
        axes = np.swapaxes(rotation, 1, 2)  # (N, 3, 3), one a row
        turn, faster, away = np.zeros((3, len(rotation), 3, 6))
        turn[..., 3:] = axes
        faster[..., :3] = cross(twist[:, None, 3:], axes)
        away[..., 3:] = cross(axes, total[:, None, :3])
        turned = force_cross(turn, total[:, None]) - motion_cross(turn, twist[:, None]) @ inertia
        return np.swapaxes(np.concatenate((turned, faster @ inertia + away), axis=1), 1, 2)

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return what it takes off the pose, and off the velocity: v_read = v_true - w x R mu_p.

        A pose error turns the twist that is read, for that is turned by the pose; the mount's part of it does not.
        """
        pose, twist = np.zeros((2, len(motion.rotation), 6, 6))
        pose[:, :3, :3] = pose[:, 3:, 3:] = -motion.rotation
        twist[:, :3, :3] = twist[:, 3:, 3:] = -motion.turning
        twist[:, 3:, :3] = -motion.sliding
        return pose, twist

    def moved(self, side: NominalModel, value: Array) -> NominalModel:
        """Return the known side with this mount."""
        return replace(side, mount=side.mount + value)

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return the turn about the normal and the displacement in the plane."""
        plane = detector.plane_of(0)
        basis = np.zeros((6, 3))
        basis[:3, 0], basis[3:, 1:] = plane.normal, plane.across.T
        return basis


def odometry_mount(position_std: float, orientation_std: float) -> OdometryMount:
    """Return the mount as an unknown, of these standard deviations (m, rad); 0 is exact."""
    deviations = np.repeat((orientation_std, position_std), 3)
    return OdometryMount(np.diag(deviations)[:, deviations > 0.0], ('mount',) * 6)


SCALE = 'odometry scale'


@dataclass(frozen=True, eq=False)
class OdometryScale(Linear):
    """What of every length is too much, relative: positions are read (1 + s) times as far as they are."""

    in_equations = True

    def equation_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return how the momentum follows from the velocity that is read; the arm of the linear one is left out."""
        del kernel
        inertia = np.sum(inertia_matrix(states.known), axis=1)
        return -inertia[..., :3] @ states.body_twist[:, 0, :3, None]

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return the position as far as the base has come, and its velocity."""
        pose, twist = np.zeros((2, len(motion.time), 6, 1))
        pose[:, 3:, 0], twist[:, 3:, 0] = motion.position, motion.twist[:, 3:]
        return pose, twist


def odometry_scale(deviation: float) -> OdometryScale:
    """Return the scale as an unknown, of a relative standard deviation."""
    return OdometryScale(np.array([[deviation]]), (SCALE,))


TURNS, SPEEDS = ('twist bias', 'twist velocity bias')


@dataclass(frozen=True, eq=False)
class TwistBias(Linear):
    """Constant in base axes, angular (rad/s) and linear (m/s)."""

    in_equations = True

    def equation_columns(self, kernel: MomentumKernel, states: BodyStates) -> Array:
        """Return how the momentum follows from the twist that is read."""
        del kernel
        inertia = np.sum(inertia_matrix(states.known), axis=1)
        rotation = states.configuration.rotation[:, 0]
        return -np.concatenate((inertia[..., 3:] @ rotation, inertia[..., :3] @ rotation), axis=-1)

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return the base's axes."""
        pose, twist = np.zeros((2, len(motion.time), 6, 6))
        twist[:, :3, :3] = twist[:, 3:, 3:] = motion.axes
        return pose, twist

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return the turn about the normal and the speeds in the plane."""
        plane = detector.plane_of(0)
        basis = np.zeros((6, 3))
        basis[:3, 0], basis[3:, 1:] = plane.normal, plane.across.T
        return basis


def twist_bias(angular: float, linear: float) -> TwistBias:
    """Return the bias as an unknown, of standard deviations in rad/s and m/s; 0 is exact."""
    deviations = np.repeat((angular, linear), 3)
    return TwistBias(np.diag(deviations)[:, deviations > 0.0], (TURNS,) * 3 + (SPEEDS,) * 3)
