"""One body's ten parameters in their two forms: standard (m, h, I_o) and physical (m, r_c, I_c)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, skew, unvec, vec

# d vec(I)/dr of the Steiner term is assembled from these: E_k = d[r]x / dr_k.
_GENERATORS = skew(np.eye(3))
_IDENTITY = np.eye(10)
_COM = np.arange(1, 4)


def physical(standard: Array) -> Array:
    """Return (m, r_c, I_c) of standard parameters: CoM in the link frame, inertia about it in link axes.

    Parameters
    ----------
    standard : (..., 10) (m, h, I_o): kg, kg m, kg m^2

    Returns
    -------
    (..., 10) array: kg, m, kg m^2; NaN where the mass is zero
    """
    mass = standard[..., :1]
    with np.errstate(divide='ignore', invalid='ignore'):
        com = np.where(mass != 0.0, standard[..., 1:4] / mass, np.nan)
    lever = skew(com)
    # I_c = I_o + m [r_c]x [r_c]x
    about_com = standard[..., 4:] + mass * vec(lever @ lever)
    return np.concatenate((mass, com, about_com), axis=-1)


def standard(physical_parameters: Array) -> Array:
    """Return (m, h, I_o) of (m, r_c, I_c); the inverse of `physical`."""
    mass, com = physical_parameters[..., :1], physical_parameters[..., 1:4]
    lever = skew(com)
    return np.concatenate((mass, mass * com, physical_parameters[..., 4:] - mass * vec(lever @ lever)), axis=-1)


def physical_jacobian(standard_parameters: Array) -> Array:
    """Return d(m, r_c, I_c) / d(m, h, I_o), (..., 10, 10), at (..., 10) standard parameters; NaN for a zero mass."""
    mass = standard_parameters[..., :1]
    with np.errstate(divide='ignore', invalid='ignore'):
        inverse = np.where(mass != 0.0, 1.0 / mass, np.nan)
    com = standard_parameters[..., 1:4] * inverse
    lever = skew(com)
    jacobian = np.zeros((*standard_parameters.shape, 10))
    jacobian[..., :, :] = _IDENTITY
    jacobian[..., 1:4, 0] = -com * inverse
    jacobian[..., _COM, _COM] = inverse
    # I_c = I_o + [h]x[h]x / m, so dI_c = ([dh]x[c]x + [c]x[dh]x) - dm [c]x[c]x
    jacobian[..., 4:, 0] = -vec(lever @ lever)
    lever = lever[..., None, :, :]
    jacobian[..., 4:, 1:4] = np.swapaxes(vec(_GENERATORS @ lever + lever @ _GENERATORS), -1, -2)
    return jacobian


def pseudo_inertia(standard_parameters: Array) -> Array:
    """Return the (..., 4, 4) pseudo-inertia matrix; it is positive definite exactly for a real body.

    [[tr(I_o)/2 1 - I_o, h], [h^T, m]]
    """
    inertia = unvec(standard_parameters[..., 4:])
    matrix = np.empty((*standard_parameters.shape[:-1], 4, 4))
    matrix[..., :3, :3] = 0.5 * np.trace(inertia, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - inertia
    matrix[..., :3, 3] = matrix[..., 3, :3] = standard_parameters[..., 1:4]
    matrix[..., 3, 3] = standard_parameters[..., 0]
    return matrix


@dataclass(frozen=True)
class Principal:
    """The principal axes of an inertia.

    Attributes
    ----------
    moments : (3,) kg m^2, ascending
    axes : (3, 3) rotation whose columns are the axes, in the link's frame
    """

    moments: Array
    axes: Array


def principal(parameters: Array) -> Principal:
    """Return the principal axes of (10,) parameters (m, r_c, I_c), right-handed.

    Each axis points to where its largest component is positive, so that small changes do not flip it; the third
    completes the other two.
    """
    moments, axes = np.linalg.eigh(unvec(parameters[4:]))
    largest = axes[np.argmax(np.abs(axes), axis=0), np.arange(3)]
    axes = axes * np.where(largest < 0.0, -1.0, 1.0)
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return Principal(moments, axes)


def ellipsoid_radii(mass: float, moments: Array) -> Array:
    """Return the (3,) semi-axes, m, of the uniform solid ellipsoid of a mass with the principal moments.

    Of an ellipsoid, I_x = m (b^2 + c^2) / 5; a body flatter than flat has a radius of 0.
    """
    return np.sqrt(5.0 * _second_moments(moments) / mass)


def box_sizes(mass: float, moments: Array) -> Array:
    """Return the (3,) edges, m, of the uniform solid box of a mass with the principal moments.

    Of a box, I_x = m (b^2 + c^2) / 12; a body flatter than flat has an edge of 0.
    """
    return np.sqrt(12.0 * _second_moments(moments) / mass)


def _second_moments(moments: Array) -> Array:
    """Return the integrals of x^2, y^2, z^2 over the mass: (I_y + I_z - I_x) / 2 and so on."""
    return np.maximum(0.5 * np.sum(moments) - moments, 0.0)
