"""Passive joints, which a spring holds: how their deflections and momenta change (appendages.md).

The state of each is its deflection and s, the component along its axis of the momentum of all that it carries: no rate
is differentiated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.kinematics import Configuration, Kinematics
from mbaid_ros.core.robot.momentum import inertia_matrix, momentum, regressor
from mbaid_ros.core.robot.sensitivity import force_cross, motion_cross
from mbaid_ros.core.samples import ArrayRecord


@lru_cache(maxsize=32)  # of the robots at the latest linearisation points
def cantilever(kinematics: Kinematics) -> Array:
    """Return derivatives (n, n + 1, 10) of the inertia that each joint carries at zero, by the bodies' parameters."""
    placed = kinematics.configure(np.eye(3)[None], np.zeros((1, kinematics.model.joints)))
    axes = placed.joint_twist[0]
    columns = regressor(placed.rotation, placed.position, axes[:, None])  # (n, n + 1, 6, 10)
    return np.asarray(kinematics.ancestors.T[..., None] * np.einsum('ia,ibak->ibk', axes, columns))


def spring_constants(kernel: MomentumKernel, known: Array) -> tuple[Array, Array]:
    """Return stiffness and damping (f,) of the passive joints, all bodies (n + 1, 10) known; SI units."""
    springs = kernel.springs
    inertia = np.sum(cantilever(kernel.kinematics)[list(springs.joints)] * known, axis=(1, 2))
    return inertia * springs.frequency**2, 2.0 * springs.damping_ratio * inertia * springs.frequency


def moves(kernel: MomentumKernel) -> Array:
    """Return whether each passive joint moves each other one, or is it, (f, f)."""
    joints = list(kernel.springs.joints)
    return np.asarray(kernel.kinematics.ancestors[np.array(joints) + 1][:, joints].T > 0.0)


@dataclass(frozen=True)
class PassiveInertias(ArrayRecord):
    """The f passive joints of a robot in N configurations, about the base's origin, odometry axes."""

    # axes, gamma: (N, f, 6) unit twists X; momentum of unit rates, Gamma
    axes: Array
    gamma: Array
    inertia: Array  # (N, f, 6, 6) of all that each carries
    mobility: Array  # (N, 6, 6) M^-1, the passive joints held
    mobility_of_joints: Array  # (N, f, f) inverse of H - Gamma^T M^-1 Gamma

    @staticmethod
    def from_bodies(kernel: MomentumKernel, known: Array, placed: Configuration, mobility: Array) -> PassiveInertias:
        """Return the inertias by all bodies `known` (N, n + 1, 10) at the base's origin, odometry axes."""
        joints, up = list(kernel.springs.joints), moves(kernel)
        axes = placed.joint_twist[:, joints]
        inertia = inertia_matrix(kernel.kinematics.ancestors.T[joints] @ known)
        gamma = (inertia @ axes[..., None])[..., 0]
        across = axes @ np.swapaxes(gamma, 1, 2)  # X_i . Gamma_j
        locked = np.where(up, across, np.where(up.T, np.swapaxes(across, 1, 2), 0.0))
        free = np.linalg.inv(locked - gamma @ mobility @ np.swapaxes(gamma, 1, 2))
        return PassiveInertias(axes, gamma, inertia, mobility, free)

    def solve(self, total: Array, along: Array) -> tuple[Array, Array]:
        """Return base twists (N, 6, c) and rates (N, f, c) with momenta (N, 6, c) and (N, f, c) along the joints."""
        moved = self.mobility @ total
        rates = self.mobility_of_joints @ (along - self.gamma @ moved)
        return moved - self.mobility @ (np.swapaxes(self.gamma, 1, 2) @ rates), rates

    @property
    def free_mobility(self) -> Array:
        """(M - Gamma H^-1 Gamma^T)^-1, (N, 6, 6): from momentum to twist, the momenta along the joints held."""
        across = self.gamma @ self.mobility
        return np.asarray(self.mobility + np.swapaxes(across, 1, 2) @ self.mobility_of_joints @ across)


@dataclass(frozen=True, eq=False)
class PassiveMotion:
    """How the state x = (deflections, s) of f passive joints changes at N instants."""

    inertias: PassiveInertias
    constants: tuple[Array, Array]  # stiffness and damping, (f,)
    twist: Array  # (N, 6) of the base
    body_twist: Array  # (N, n + 1, 6) of all bodies
    rates: Array  # (N, f) of the deflections
    forces: Array  # (N, f) rate of s
    gyroscopic: Array  # (N, f, 6) derivative of the rate of s by the base's twist
    force_by_rate: Array  # (N, f, f) derivative of the rate of s by the deflections' rates
    axis_rates: Array  # (N, f, 6) rate of change of the axes, V_p x X
    # along_by, force_by: (N, f, f) derivative of s, and of its rate, by the deflections at fixed twists
    momentum_by_deflection: Array
    force_by_deflection: Array

    @staticmethod
    def from_state(
        kernel: MomentumKernel,
        inertias: PassiveInertias,
        known: Array,
        moving: tuple[Array, Array],
        state: tuple[Array, Array],
        constants: tuple[Array, Array],
    ) -> PassiveMotion:
        """Return the motion of a robot with bodies (N, n + 1, 10) at the base's origin, odometry axes.

        Parameters
        ----------
        kernel, inertias, known : of the robot, its passive joints, its bodies
        moving : twists of the bodies (N, n + 1, 6) by the other joints alone, and the momentum (N, 6) that they leave
        state : deflections and s, (N, f)
        constants : stiffness and damping, (f,)
        """
        body_twist, total = moving
        deflection, along = state
        joints, up = list(kernel.springs.joints), moves(kernel)
        subtrees = kernel.kinematics.ancestors.T[joints]
        strictly = up & ~np.eye(len(joints), dtype=bool)
        axes, gamma, inertia = inertias.axes, inertias.gamma, inertias.inertia
        carried = np.sum(axes * (subtrees @ momentum(known, body_twist)), axis=-1)
        twist, rates = (part[..., 0] for part in inertias.solve(total[..., None], (along - carried)[..., None]))
        body_twist = body_twist + twist[:, None] + subtrees.T @ (axes * rates[..., None])
        h = subtrees @ momentum(known, body_twist)
        turned = motion_cross(body_twist[:, [kernel.model.parents[joint] for joint in joints]], axes)  # W = V_p x X
        swept = force_cross(axes, h) + (inertia @ turned[..., None])[..., 0]  # c = X x* h + I W
        stiffness, damping = constants
        # s and the gyroscopic part W . h of its rate, by deflections at fixed twists.
        along_by = np.where(
            up.T, gamma @ np.swapaxes(turned, 1, 2), np.where(strictly, axes @ np.swapaxes(swept, 1, 2), 0.0)
        )
        across = swept @ np.swapaxes(turned, 1, 2)  # c_i . W_j
        force_by = np.where(up.T, across, np.where(strictly, np.swapaxes(across, 1, 2), 0.0)) - np.diag(stiffness)
        by_rate = np.where(strictly.T, swept @ np.swapaxes(axes, 1, 2), 0.0)
        by_rate += np.where(up, turned @ np.swapaxes(gamma, 1, 2), 0.0) - np.diag(damping)
        forces = np.sum(turned * h, axis=-1) - stiffness * deflection - damping * rates
        parts = (inertias, constants, twist, body_twist, rates, forces, swept, by_rate, turned, along_by, force_by)
        return PassiveMotion(*parts)

    def derivatives(self, total: Array, along: Array, force: Array) -> tuple[Array, Array]:
        """Return derivatives of the base's twist (N, 6, c + 2 f), and of the rates of x, by c numbers and by x.

        Parameters
        ----------
        total, along, force : (N, 6, c), (N, f, c), (N, f, c) what each number adds to the momentum, to s and to the
            rate of s at fixed twists and x
        """
        swept, nothing = np.swapaxes(self.gyroscopic, 1, 2), np.zeros_like(self.force_by_rate)
        total = np.concatenate((total, -swept, np.zeros_like(swept)), axis=-1)
        along = np.concatenate((along, -self.momentum_by_deflection, nothing + np.eye(nothing.shape[-1])), axis=-1)
        force = np.concatenate((force, self.force_by_deflection, nothing), axis=-1)
        twist, rates = self.inertias.solve(total, along)
        return twist, np.concatenate((rates, self.force_by_rate @ rates + self.gyroscopic @ twist + force), axis=1)


def passive_momenta(kernel: MomentumKernel, axes: Array, gamma: Array) -> Array:
    """Return the momenta (N, f, n) along the passive joints of unit rates of all joints, the base at rest.

    `axes` (N, n, 6) are the unit twists of all joints, `gamma` (N, 6, n) the momenta of their unit rates.
    """
    up = kernel.kinematics.ancestors[1:].T > 0.0  # whether a joint moves another one, or is it
    across = axes @ gamma
    locked = np.where(up, across, np.where(up.T, np.swapaxes(across, 1, 2), 0.0))
    return np.asarray(locked[:, list(kernel.springs.joints)])
