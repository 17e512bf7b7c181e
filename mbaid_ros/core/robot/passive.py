"""Passive joints, which a spring holds: how their deflections and momenta change (appendages.md).

The state of each is its deflection and s, the component along its axis of the momentum of all that it carries: no rate
is differentiated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel, cantilever_inertias
from mbaid_ros.core.robot.kinematics import Configuration
from mbaid_ros.core.robot.momentum import inertia_matrix, momentum
from mbaid_ros.core.robot.sensitivity import force_cross, motion_cross
from mbaid_ros.core.samples import ArrayRecord


def spring_constants(kernel: MomentumKernel, known: Array) -> tuple[Array, Array]:
    """Return stiffness and damping (f,) of the passive joints, all bodies (n + 1, 10) known; SI units."""
    springs, inertia = kernel.springs, inertias_at_zero(kernel, known)
    return inertia * springs.rate**2, 2.0 * springs.ratio * inertia * springs.rate


def inertias_at_zero(kernel: MomentumKernel, known: Array) -> Array:
    """Return the inertia (f,) about or along each passive joint's axis of all that it carries, all joints at zero."""
    return _inertias_at_zero(kernel, known.tobytes())


@lru_cache(maxsize=16)
def _inertias_at_zero(kernel: MomentumKernel, known: bytes) -> Array:
    bodies = np.frombuffer(known).reshape(-1, 10)
    return cantilever_inertias(kernel.model, bodies)[list(kernel.springs.joints)]


def above(kernel: MomentumKernel) -> Array:
    """Return which passive joint moves which other, or is it, (f, f) True or False."""
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
    free: Array  # (N, f, f) inverse of H - Gamma^T M^-1 Gamma

    @staticmethod
    def of(kernel: MomentumKernel, known: Array, placed: Configuration, mobility: Array) -> PassiveInertias:
        """Return them; `known` (N, n + 1, 10) are all bodies at the base's origin, odometry axes."""
        joints, up = list(kernel.springs.joints), above(kernel)
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
        rates = self.free @ (along - self.gamma @ moved)
        return moved - self.mobility @ (np.swapaxes(self.gamma, 1, 2) @ rates), rates

    @property
    def free_mobility(self) -> Array:
        """(M - Gamma H^-1 Gamma^T)^-1, (N, 6, 6): from momentum to twist, the momenta along the joints held."""
        across = self.gamma @ self.mobility
        return np.asarray(self.mobility + np.swapaxes(across, 1, 2) @ self.free @ across)


@dataclass(frozen=True, eq=False)
class PassiveMotion:
    """How the state x = (deflections, s) of f passive joints changes at N instants."""

    inertias: PassiveInertias
    rates: Array  # (N, f) of the deflections
    along: Array  # (N, f) s
    forces: Array  # (N, f) rate of s
    by_state: Array  # (N, 2 f, 2 f) derivative of the rates of x by x
    twist_by_state: Array  # (N, 6, 2 f) and of the base's twist
    gyroscopic: Array  # (N, f, 6) derivative of the rate of s by the base's twist
    by_rate: Array  # (N, f, f) derivative of the rate of s by the deflections' rates
    turned: Array  # (N, f, 6) rate of change of the axes, V_p x X
    along_by: Array  # (N, f, f) derivative of s by the deflections at fixed twists

    @staticmethod
    def of(
        kernel: MomentumKernel,
        inertias: PassiveInertias,
        known: Array,
        motion: tuple[Array, Array, Array],
        constants: tuple[Array, Array],
    ) -> PassiveMotion:
        """Return it for a robot whose bodies, (N, n + 1, 10) and so expressed, move.

        `motion` has the twists of the bodies (N, n + 1, 6), deflections and their rates (N, f); `constants` are those
        of the springs.
        """
        twists, deflection, rates = motion
        joints, up = list(kernel.springs.joints), above(kernel)
        strictly = up & ~np.eye(len(joints), dtype=bool)
        axes, gamma, inertia = inertias.axes, inertias.gamma, inertias.inertia
        h = kernel.kinematics.ancestors.T[joints] @ momentum(known, twists)
        turned = motion_cross(twists[:, [kernel.model.parents[joint] for joint in joints]], axes)  # W = V_p x X
        swept = force_cross(axes, h) + (inertia @ turned[..., None])[..., 0]  # c = X x* h + I W
        stiffness, damping = constants
        # s and the gyroscopic part W . h of its rate, by deflections at fixed twists.
        along_by = np.where(
            up.T, gamma @ np.swapaxes(turned, 1, 2), np.where(strictly, axes @ np.swapaxes(swept, 1, 2), 0.0)
        )
        across = swept @ np.swapaxes(turned, 1, 2)  # c_i . W_j
        gyro_by = np.where(up.T, across, np.where(strictly, np.swapaxes(across, 1, 2), 0.0))
        by_rate = np.where(strictly.T, swept @ np.swapaxes(axes, 1, 2), 0.0)
        by_rate += np.where(up, turned @ np.swapaxes(gamma, 1, 2), 0.0) - np.diag(damping)
        count, size = len(rates), len(joints)
        total, along = np.zeros((count, 6, 2 * size)), np.zeros((count, size, 2 * size))
        total[..., :size] = -np.swapaxes(swept, 1, 2)
        along[..., :size], along[..., size:] = -along_by, np.eye(size)
        twist_by, rate_by = inertias.solve(total, along)
        force_by = by_rate @ rate_by + swept @ twist_by
        force_by[..., :size] += gyro_by - np.diag(stiffness)
        return PassiveMotion(
            inertias,
            rates,
            np.sum(axes * h, axis=-1),
            np.sum(turned * h, axis=-1) - stiffness * deflection - damping * rates,
            np.concatenate((rate_by, force_by), axis=1),
            twist_by,
            swept,
            by_rate,
            turned,
            along_by,
        )


def through_springs(kernel: MomentumKernel, axes: Array, gamma: Array) -> Array:
    """Return Gamma H^-1 H_dq (N, 6, n): the part of the joint rates' momentum that held passive joints cancel.

    `axes` (N, n, 6) are the unit twists of all joints, `gamma` (N, 6, n) the momenta of their unit rates.
    """
    joints, own = list(kernel.springs.joints), _across(kernel, axes, gamma)
    return np.asarray(gamma[..., joints] @ np.linalg.solve(own[..., joints], own))


def _across(kernel: MomentumKernel, axes: Array, gamma: Array) -> Array:
    """Return the rows (N, f, n) of the joint-space inertia that belong to passive joints."""
    up = kernel.kinematics.ancestors[1:].T > 0.0  # whether a joint moves another one, or is it
    across = axes @ gamma
    locked = np.where(up, across, np.where(up.T, np.swapaxes(across, 1, 2), 0.0))
    return np.asarray(locked[:, list(kernel.springs.joints)])


def driven(
    kernel: MomentumKernel, known: Array, axes: Array, gamma: Array, free_mobility: Array
) -> tuple[Array, Array]:
    """Return how the joints drive passive ones, and how these turn the base, with the rates of all others held.

    An error of a joint's reading is one of the predicted deflection, at once: what the springs make of that stays.

    Parameters
    ----------
    kernel, known : of the robot; (n + 1, 10) all bodies
    axes, gamma, free_mobility : (N, n, 6), (N, 6, n) as above; (N, 6, 6) as of `PassiveInertias`

    Returns
    -------
    (N, f, n) angular or linear acceleration of deflections by constant errors of the joints; (N, 6, f) twist by rates
    """
    joints, own = list(kernel.springs.joints), _across(kernel, axes, gamma)
    moved, inverse = gamma[..., joints], np.linalg.inv(own[..., joints])
    back = inverse @ np.swapaxes(moved, 1, 2)
    by_joints = back @ free_mobility @ (gamma - moved @ inverse @ own) - inverse @ own
    free = inverse + back @ free_mobility @ np.swapaxes(back, 1, 2)
    stiffness, _ = spring_constants(kernel, known)
    # free_mobility Gamma = M^-1 Gamma H (H - Gamma^T M^-1 Gamma)^-1, the latter `free`
    turned = -free_mobility @ moved @ inverse @ np.linalg.inv(free)
    return free @ (stiffness[:, None] * by_joints), turned
