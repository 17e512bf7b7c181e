"""Momentum of rigid bodies and its regressor, in standard parameters, for batches.

Momentum is (P, L_b): linear, and angular about the origin of the base link, in odometry axes. About the odometry origin
L = L_b + p x P with p the position of the base link.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mbaid_ros.core.geometry import Array, bracket, cross, rotate, rotate_back, skew, unvec
from mbaid_ros.core.robot.model import Link


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


@dataclass(frozen=True, eq=False)
class Storage:
    """What stores momentum, each with a reading of its own: c of them.

    Attributes
    ----------
    bodies : (c,) indices of the moving bodies that they are in
    axes : (c, 3) unit vectors in the axes of these bodies
    inertias : (c,) kg m^2 about these axes, of what is read as a speed (rad/s); 1 of what is read as momentum (N m s)
    noises : (c,) standard deviation of one reading
    names : c, of each
    """

    bodies: tuple[int, ...] = ()
    axes: Array = field(default_factory=lambda: np.zeros((0, 3)))
    inertias: Array = field(default_factory=lambda: np.zeros(0))
    noises: Array = field(default_factory=lambda: np.zeros(0))
    names: tuple[str, ...] = ()

    @staticmethod
    def wheels(link: Link, names: Sequence[str], axes: Array, inertias: Sequence[float], noise: float) -> Storage:
        """Return wheels with (w, 3) unit axes in a link's frame, whose speeds are read with a noise (rad/s)."""
        bodies, noises = (link.body,) * len(names), np.full(len(names), noise)
        return Storage(bodies, axes @ link.rotation.T, np.array(inertias, dtype=float), noises, tuple(names))

    @staticmethod
    def told(link: Link, noise: float) -> Storage:
        """Return what is read as a momentum in the axes of a link's frame, with a noise (N m s)."""
        return Storage((link.body,) * 3, link.rotation.T.copy(), np.ones(3), np.full(3, noise), ('x', 'y', 'z'))

    def __add__(self, other: Storage) -> Storage:
        """Return both, one after the other."""
        return Storage(
            self.bodies + other.bodies,
            np.concatenate((self.axes, other.axes)),
            np.concatenate((self.inertias, other.inertias)),
            np.concatenate((self.noises, other.noises)),
            self.names + other.names,
        )

    @property
    def count(self) -> int:
        """Number c."""
        return len(self.bodies)

    def changed(self, inertias: Array) -> Storage:
        """Return the same with spin inertias that differ by (c,)."""
        return replace(self, inertias=self.inertias + inertias)

    def directions(self, rotation: Array) -> Array:
        """Return the (N, c, 3) axes in odometry axes, of bodies with (N, n + 1, 3, 3) axes."""
        return rotate(rotation[:, list(self.bodies)], self.axes)

    def columns(self, rotation: Array) -> Array:
        """Return what a reading of one makes of the momentum, (N, 6, c)."""
        columns = np.zeros((len(rotation), 6, self.count))
        columns[:, 3:] = np.swapaxes(self.inertias[:, None] * self.directions(rotation), 1, 2)
        return columns

    def momenta(self, rotation: Array, readings: Array) -> Array:
        """Return the angular momentum that is stored in each body, (N, n + 1, 3) N m s, odometry axes.

        Parameters
        ----------
        rotation : (N, n + 1, 3, 3) of all bodies
        readings : (N, c)
        """
        stored = np.zeros(rotation.shape[:-1])
        each = (self.inertias * readings)[..., None] * self.directions(rotation)
        for place, body in enumerate(self.bodies):
            stored[:, body] += each[:, place]
        return stored
