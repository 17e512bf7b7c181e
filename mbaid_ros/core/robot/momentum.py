"""Momentum of rigid bodies and its regressor, in standard parameters, for batches.

Momentum is (P, L_b): linear, and angular about the origin of the base link, in odometry axes. About the odometry origin
L = L_b + p x P with p the position of the base link.
"""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array, bracket, cross, rotate, rotate_back, skew, unvec


def momentum(parameters: Array, twist: Array) -> Array:
    """Return the momentum of bodies.

    Parameters
    ----------
    parameters : (..., 10) (m, h, I_o) about the base origin in odometry axes: kg, kg m, kg m^2
    twist : (..., 6) (u, w) at the base origin

    Returns
    -------
    (..., 6) array (P, L_b): kg m/s, kg m^2/s
    """
    mass, first_moment, inertia = parameters[..., :1], parameters[..., 1:4], unvec(parameters[..., 4:])
    linear, angular = twist[..., :3], twist[..., 3:]
    # P = m u + w x h;  L_b = h x u + I_o w
    return np.concatenate(
        (
            mass * linear + cross(angular, first_moment),
            cross(first_moment, linear) + rotate(inertia, angular),
        ),
        axis=-1,
    )


def inertia_matrix(parameters: Array) -> Array:
    """Return the (..., 6, 6) spatial inertia M with momentum = M twist.

    Parameters
    ----------
    parameters : (..., 10) (m, h, I_o) about the base origin in odometry axes
    """
    matrix = np.zeros((*parameters.shape[:-1], 6, 6))
    first = skew(parameters[..., 1:4])
    matrix[..., :3, :3] = parameters[..., :1, None] * np.eye(3)
    matrix[..., :3, 3:] = -first
    matrix[..., 3:, :3] = first
    matrix[..., 3:, 3:] = unvec(parameters[..., 4:])
    return matrix


def regressor(rotation: Array, position: Array, twist: Array) -> Array:
    """Return Y with momentum = Y (m, h, I_o) for a link's parameters in its own frame.

    The standard form: linear in all ten parameters, because the inertia is taken about the link's origin. (The paper's
    eqs. 9 and 14 take it about the centre of mass, where it is not.)

    Parameters
    ----------
    rotation, position : (..., 3, 3), (..., 3) m, the link's frame: R, and r relative to the base origin
    twist : (..., 6) of the link (u, w) at the base origin

    Returns
    -------
    (..., 6, 10) array
    """
    angular = twist[..., 3:]
    velocity = twist[..., :3] + cross(angular, position)  # v, of the link's origin
    shape = np.broadcast_shapes(rotation.shape[:-2], twist.shape[:-1])
    spin = skew(angular)
    matrix = np.zeros((*shape, 6, 10))
    # P = m v + [w]x R h (docs/method.md, eq. 1)
    first = spin @ rotation
    matrix[..., :3, 0] = velocity
    matrix[..., :3, 1:4] = first
    # L_b = m r x v + ([r]x [w]x R - [v]x R) h + R bracket(R^T w) vec(I_o) (eq. 2, about the base's origin)
    matrix[..., 3:, 0] = cross(position, velocity)
    matrix[..., 3:, 1:4] = skew(position) @ first - skew(velocity) @ rotation
    matrix[..., 3:, 4:] = rotation @ bracket(rotate_back(rotation, angular))
    return matrix
