"""How the momentum changes with each measured quantity: exact derivatives, linear in the target's parameters.

With twists and momenta at one common point, moving a subtree by the unit twist S changes its momentum h by S x* h, and
the twists of its bodies by S x V, less what is held fixed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.momentum import momentum, regressor


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives of the momentum (P, L_b) by the measured quantities z, at N states: d h / dz = known + target . phi.

    The order of z is: joint positions (n), joint velocities (n), base orientation (3, odometry axes), base linear and
    angular velocity (3 + 3, base axes). About the base's origin the momentum does not depend on the base's position.

    Attributes
    ----------
    known : (N, 6, 2 n + 9)
    target : (N, 6, 2 n + 9, 10), to be multiplied by the target's standard parameters
    """

    known: Array
    target: Array


def sensitivity(kernel: MomentumKernel, states: BodyStates) -> Sensitivity:
    """Return the derivatives of the momentum by the measurements.

    Parameters
    ----------
    kernel : MomentumKernel
    states : BodyStates of N samples
    """
    kinematics = kernel.kinematics
    ancestors = kinematics.ancestors  # (bodies, joints)
    joint_twist = states.configuration.joint_twist
    count, joints = joint_twist.shape[:2]
    # Composite bodies: everything that joint j moves, and (last) the whole robot.
    members = np.concatenate((ancestors.T, np.ones((1, joints + 1))))
    composite = members @ states.known
    composite_momentum = members @ momentum(states.known, states.body_twist)
    moves_target = members[:, kernel.target.body, None, None]  # (n + 1, 1, 1)
    target_momentum = states.regressor  # (N, 6, 10)

    unit = _base_twists(states.configuration.rotation[:, 0])
    # q_j turns its subtree, but the carrier's velocity is held: S_j x* h - I (S_j x V_j), V_j of the child.
    carried = motion_cross(joint_twist, states.body_twist[:, 1:])
    twists = np.concatenate((carried, joint_twist, unit), axis=1)  # (N, 2 n + 6, 6)
    owner = np.concatenate((np.arange(joints), np.arange(joints), np.full(6, joints)))
    known_part = momentum(composite[:, owner], twists)
    target_part = regressor(states.rotation[:, None], states.position[:, None], twists) * moves_target[owner]

    known = np.empty((count, 6, 2 * joints + 9))
    target = np.empty((count, 6, 2 * joints + 9, 10))
    known[..., :joints] = np.swapaxes(
        force_cross(joint_twist, composite_momentum[:, :joints]) - known_part[:, :joints], 1, 2
    )
    turned = force_cross(joint_twist[:, :, None], np.swapaxes(target_momentum, 1, 2)[:, None])  # (N, n, 10, 6)
    turned = np.swapaxes(turned, 2, 3) * moves_target[:joints]
    target[:, :, :joints] = np.swapaxes(turned - target_part[:, :joints], 1, 2)
    rates = slice(joints, 2 * joints)
    known[..., rates] = np.swapaxes(known_part[:, rates], 1, 2)
    target[:, :, rates] = np.swapaxes(target_part[:, rates], 1, 2)
    # The base's orientation turns everything: S x* h of the whole robot.
    turn = np.concatenate((np.zeros((3, 3)), np.eye(3)), axis=1)
    angles = slice(2 * joints, 2 * joints + 3)
    known[..., angles] = np.swapaxes(force_cross(turn, composite_momentum[:, joints, None]), 1, 2)
    target[:, :, angles] = np.moveaxis(force_cross(turn[:, None], np.swapaxes(target_momentum, 1, 2)[:, None]), -1, 1)
    velocities = slice(2 * joints + 3, None)
    known[..., velocities] = np.swapaxes(known_part[:, 2 * joints :], 1, 2)
    target[:, :, velocities] = np.swapaxes(target_part[:, 2 * joints :], 1, 2)
    return Sensitivity(known, target)


def motion_cross(left: Array, right: Array) -> Array:
    """Return the twist S x V, for (..., 6) twists (u, w)."""
    return np.concatenate(
        (
            cross(left[..., 3:], right[..., :3]) + cross(left[..., :3], right[..., 3:]),
            cross(left[..., 3:], right[..., 3:]),
        ),
        axis=-1,
    )


def force_cross(twist: Array, momentum_vector: Array) -> Array:
    """Return S x* h, for (..., 6) twists (u, w) and momenta (P, L)."""
    return np.concatenate(
        (
            cross(twist[..., 3:], momentum_vector[..., :3]),
            cross(twist[..., 3:], momentum_vector[..., 3:]) + cross(twist[..., :3], momentum_vector[..., :3]),
        ),
        axis=-1,
    )


def _base_twists(rotation: Array) -> Array:
    """Return the (N, 6, 6) unit twists along and about the base's axes, one a row."""
    twists = np.zeros((len(rotation), 6, 6))
    twists[:, :3, :3] = twists[:, 3:, 3:] = np.swapaxes(rotation, -1, -2)
    return twists
