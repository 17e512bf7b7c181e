"""Exact derivatives of the momentum by each measured quantity, linear in the unknown parameters.

With twists and momenta at one common point, moving a subtree by the unit twist S changes its momentum h by S x* h, and
the twists of its bodies by S x V, less the part that is held fixed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, cross, skew
from mbaid_ros.core.robot.kernel import BodyStates, MomentumKernel
from mbaid_ros.core.robot.momentum import inertia_matrix, momentum, regressor


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives of the momentum (P, L_b) by the measured quantities z, at N states: d h / dz = known + target phi.

    The order of z is: joint positions (n), joint velocities (n), base orientation (3, odometry axes), base linear and
    angular velocity (3 + 3, base axes). About the base's origin the momentum does not depend on the base's position.
    """

    known: Array  # (N, 6, 2 n + 9)
    target: Array  # (N, 6, 2 n + 9, 10 k), to be multiplied by the standard parameters of the k unknown links


def sensitivity(kernel: MomentumKernel, states: BodyStates) -> Sensitivity:
    """Return the derivatives of the momentum by the measurements, at N states."""
    members, owner, twists = _movers_and_twists(kernel, states)
    joint_twist = states.configuration.joint_twist
    parts = []
    for link in kernel.unknown:
        moves = members[:, link.body]  # 1 where the joint moves the link
        rotation, position = states.configuration.link_pose(link)
        # The regressor is linear in the twist: that of the unit twists, (N, 6, 60), makes all others.
        units = regressor(rotation[:, None], position[:, None], np.eye(6)).reshape(-1, 6, 60)
        moving = np.concatenate(
            (twists * moves[owner, None], states.body_twist[:, None, link.body] * moves[:, None]), 1
        )
        products = np.moveaxis((moving @ units).reshape(*moving.shape, 10), -1, 1)
        parts.append(_assembled(joint_twist, *np.split(products, [twists.shape[1]], axis=2)))
    return Sensitivity(sensitivity_of_known(kernel, states), np.concatenate(parts, axis=-1))


def sensitivity_of_known(kernel: MomentumKernel, states: BodyStates) -> Array:
    """Return the (N, 6, 2 n + 9) derivatives of the known bodies' momentum alone."""
    members, owner, twists = _movers_and_twists(kernel, states)
    composite = members @ states.known
    momenta = members @ states.momenta  # of the bodies that the joints move, and of the whole
    joint_twist = states.configuration.joint_twist
    return _assembled(joint_twist, momentum(composite[:, owner], twists)[:, None], momenta[:, None])[..., 0]


def sensitivity_to_joints(kernel: MomentumKernel, states: BodyStates) -> tuple[Array, Array]:
    """Return the (N, 6, n) derivatives of the known bodies' momentum by joint positions, and by joint velocities."""
    positions, velocities = np.split(sensitivity_of_known(kernel, states)[..., : 2 * kernel.model.joints], 2, axis=-1)
    return positions, velocities


def _movers_and_twists(kernel: MomentumKernel, states: BodyStates) -> tuple[Array, Array, Array]:
    """Return the bodies moved by each joint, and (last) the base, (n + 1, n + 1); the mover of each twist; the twists.

    The (N, 2 n + 6, 6) twists: the changes of the joints' children by turning, the joints' own, the base's unit twists.
    """
    ancestors = kernel.kinematics.ancestors  # (bodies, joints)
    joint_twist = states.configuration.joint_twist
    joints = joint_twist.shape[1]
    # Composite bodies: everything that joint j moves, and (last) the whole robot.
    members = np.concatenate((ancestors.T, np.ones((1, joints + 1))))
    # q_j turns its subtree, but the carrier's velocity is held: S_j x* h - I (S_j x V_j), V_j of the child.
    carried = motion_cross(joint_twist, states.body_twist[:, 1:])
    unit = _base_twists(states.configuration.rotation[:, 0])
    owner = np.concatenate((np.arange(joints), np.arange(joints), np.full(6, joints)))
    return members, owner, np.concatenate((carried, joint_twist, unit), axis=1)


def _assembled(joint_twist: Array, moved: Array, momenta: Array) -> Array:
    """Return the derivatives of c momenta, (N, 6, 2 n + 9, c), in the order of `Sensitivity`.

    Parameters
    ----------
    joint_twist : (N, n, 6) S_j
    moved : (N, c, 2 n + 6, 6) momentum of the subtrees at the twists S_j x V_j, S_j and the base's unit twists
    momenta : (N, c, n + 1, 6) momentum of the subtree of joint j, and (last) of everything
    """
    joints = joint_twist.shape[1]
    moved, momenta = np.moveaxis(moved, 1, -1), np.moveaxis(momenta, 1, -1)  # as they are multiplied: (N, ..., 6, c)
    positions = _force_matrix(joint_twist) @ momenta[:, :joints] - moved[:, :joints]
    # The base's orientation turns everything: S x* h of the whole robot.
    orientation = _TURNS @ momenta[:, joints, None]
    rates, velocities = moved[:, joints : 2 * joints], moved[:, 2 * joints :]
    return np.concatenate((positions, rates, orientation, velocities), axis=1).swapaxes(1, 2)


def motion_cross(left: Array, right: Array) -> Array:
    """Return the twist S x V, for (..., 6) twists (u, w)."""
    linear = cross(left[..., 3:], right[..., :3]) + cross(left[..., :3], right[..., 3:])
    return np.concatenate((linear, cross(left[..., 3:], right[..., 3:])), axis=-1)


def force_cross(twist: Array, momentum_vector: Array) -> Array:
    """Return S x* h, for (..., 6) twists (u, w) and momenta (P, L)."""
    linear, angular = momentum_vector[..., :3], momentum_vector[..., 3:]
    moment = cross(twist[..., 3:], angular) + cross(twist[..., :3], linear)
    return np.concatenate((cross(twist[..., 3:], linear), moment), axis=-1)


def _force_matrix(twist: Array) -> Array:
    """Return the (..., 6, 6) matrix that makes S x* h of h."""
    matrix = np.zeros((*twist.shape, 6))
    matrix[..., :3, :3] = matrix[..., 3:, 3:] = skew(twist[..., 3:])
    matrix[..., 3:, :3] = skew(twist[..., :3])
    return matrix


_TURNS = _force_matrix(np.eye(6)[3:])  # by the unit twists about the axes


def _base_twists(rotation: Array) -> Array:
    """Return the (N, 6, 6) unit twists along and about the base's axes, one a row."""
    twists = np.zeros((len(rotation), 6, 6))
    twists[:, :3, :3] = twists[:, 3:, 3:] = np.swapaxes(rotation, -1, -2)
    return twists


def mobility_and_momentum(bodies: Array, body_twist: Array) -> tuple[Array, Array]:
    """Return the inverse of the locked inertia (N, 6, 6) and the momentum (N, 6) of all bodies about the base's origin.

    Raises LinAlgError: All mass lies on a line, and the locked inertia has no inverse.

    Parameters
    ----------
    bodies : (N, b, 10) standard parameters of the bodies at N instants, about the base's origin in common axes
    body_twist : (N, b, 6) (u, w) at the base's origin
    """
    mobility = np.linalg.inv(inertia_matrix(np.sum(bodies, axis=1)))
    return mobility, np.sum(momentum(bodies, body_twist), axis=1)
