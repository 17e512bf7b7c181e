"""Principal axes of a body, and the uniform bodies that have its inertia."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, unvec


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
