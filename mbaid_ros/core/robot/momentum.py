"""A body's ten parameters and its momentum, linear in the standard ones (m, h, I_o); physical ones are (m, r_c, I_c).

Momentum is (P, L_b): linear, and angular about the origin of the base link, in odometry axes. About the odometry origin
L = L_b + p x P with p the position of the base link. Everything works on batches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, bracket, cross, rotate, rotate_back, skew, unvec, vec
from mbaid_ros.core.linear_algebra import is_positive
from mbaid_ros.core.robot.model import Link, express
from mbaid_ros.core.samples import Samples

# d vec(I)/dr of the Steiner term is assembled from these: E_k = d[r]x / dr_k.
_GENERATORS = skew(np.eye(3))
_IDENTITY = np.eye(10)
_COM = np.arange(1, 4)
THRUSTER_ERRORS = 5  # errors of a thruster: scale, turn about three axes, delay


def physical(standard: Array) -> Array:
    """Return (m, r_c, I_c) (..., 10), CoM in the link frame, inertia about it in link axes, of (m, h, I_o) (..., 10).

    kg, m, kg m^2 from kg, kg m, kg m^2; NaN where the mass is zero.
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


def physical_shift(body: Array, step: Array, shift: Array) -> Array:
    """Return a shift (10,) of standard parameters as that of mass, CoM and inertia is, linearised a step away.

    The moment about a distant point is of second order in the CoM; that about the CoM need not be.
    """
    there = body + step
    moved = physical(there) + physical_jacobian(there) @ (shift - step) - physical(body)
    return np.asarray(np.linalg.solve(physical_jacobian(body), moved))


def pseudo_inertia(standard_parameters: Array) -> Array:
    """Return the (..., 4, 4) pseudo-inertia [[tr(I_o)/2 1 - I_o, h], [h^T, m]], positive definite for a real body."""
    inertia = unvec(standard_parameters[..., 4:])
    matrix = np.empty((*standard_parameters.shape[:-1], 4, 4))
    matrix[..., :3, :3] = 0.5 * np.trace(inertia, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - inertia
    matrix[..., :3, 3] = matrix[..., 3, :3] = standard_parameters[..., 1:4]
    matrix[..., 3, 3] = standard_parameters[..., 0]
    return matrix


def is_physical(standard_parameters: Array) -> bool:
    """Return whether (10,) standard parameters (m, h, I_o) belong to a real body."""
    return bool(are_physical(standard_parameters[None])[0])


def are_physical(standard_parameters: Array) -> Flags:
    """Return which of (N, 10) standard parameters belong to a real body."""
    finite = np.all(np.isfinite(standard_parameters), axis=1)
    matrices = pseudo_inertia(np.where(finite[:, None], standard_parameters, 0.0))
    return np.array([is_positive(each) for each in matrices])


@dataclass(frozen=True)
class Principal:
    """Principal moments (3,) kg m^2, ascending, and axes: columns of a (3, 3) rotation in the link's frame."""

    moments: Array
    axes: Array


def principal(parameters: Array) -> Principal:
    """Return the principal axes of (10,) parameters (m, r_c, I_c), right-handed.

    The largest component of an axis is positive, so that small changes do not flip it; the third completes the others.
    """
    moments, axes = np.linalg.eigh(unvec(parameters[4:]))
    largest = axes[np.argmax(np.abs(axes), axis=0), np.arange(3)]
    axes = axes * np.where(largest < 0.0, -1.0, 1.0)
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return Principal(moments, axes)


def ellipsoid_radii(mass: float, moments: Array) -> Array:
    """Return the (3,) semi-axes, m, of the uniform ellipsoid with principal moments I_x = m (b^2 + c^2) / 5.

    A body flatter than flat has a radius of 0.
    """
    return np.sqrt(5.0 * _second_moments(moments) / mass)


def box_sizes(mass: float, moments: Array) -> Array:
    """Return the (3,) edges, m, of the uniform box with principal moments I_x = m (b^2 + c^2) / 12; 0 at least."""
    return np.sqrt(12.0 * _second_moments(moments) / mass)


def _second_moments(moments: Array) -> Array:
    """Return the integrals of x^2, y^2, z^2 over the mass: (I_y + I_z - I_x) / 2 and so on."""
    return np.maximum(0.5 * np.sum(moments) - moments, 0.0)


def momentum(parameters: Array, twist: Array) -> Array:
    """Return the momentum (..., 6) of bodies: kg m/s, kg m^2/s.

    Parameters
    ----------
    parameters : (..., 10) (m, h, I_o) about the base origin in odometry axes
    twist : (..., 6) (u, w) at the base origin
    """
    mass, first_moment, inertia = parameters[..., :1], parameters[..., 1:4], unvec(parameters[..., 4:])
    linear, angular = twist[..., :3], twist[..., 3:]
    # P = m u + w x h;  L_b = h x u + I_o w
    p = mass * linear + cross(angular, first_moment)
    return np.concatenate((p, cross(first_moment, linear) + rotate(inertia, angular)), axis=-1)


def inertia_matrix(parameters: Array) -> Array:
    """Return the (..., 6, 6) spatial inertia M with momentum = M twist, of (..., 10) (m, h, I_o) about the base."""
    matrix = np.zeros((*parameters.shape[:-1], 6, 6))
    first = skew(parameters[..., 1:4])
    matrix[..., :3, :3] = parameters[..., :1, None] * np.eye(3)
    matrix[..., :3, 3:] = -first
    matrix[..., 3:, :3] = first
    matrix[..., 3:, 3:] = unvec(parameters[..., 4:])
    return matrix


def regressor(rotation: Array, position: Array, twist: Array) -> Array:
    """Return Y (..., 6, 10) with momentum = Y (m, h, I_o) for a link's parameters in its own frame.

    Linear in all ten parameters: the inertia is about the link's origin, not the CoM as in the paper's eqs. 9 and 14.

    Parameters
    ----------
    rotation, position : (..., 3, 3), (..., 3) m, the link's frame: R, and r relative to the base origin
    twist : (..., 6) of the link (u, w) at the base origin
    """
    angular = twist[..., 3:]
    velocity = twist[..., :3] + cross(angular, position)  # v, of the link's origin
    shape = np.broadcast_shapes(rotation.shape[:-2], twist.shape[:-1])
    matrix = np.zeros((*shape, 6, 10))
    # P = m v + [w]x R h (method.md, eq. 1)
    first = skew(angular) @ rotation
    matrix[..., :3, 0] = velocity
    matrix[..., :3, 1:4] = first
    # L_b = m r x v + ([r]x [w]x R - [v]x R) h + R bracket(R^T w) vec(I_o) (eq. 2, about the base's origin)
    matrix[..., 3:, 0] = cross(position, velocity)
    matrix[..., 3:, 1:4] = skew(position) @ first - skew(velocity) @ rotation
    matrix[..., 3:, 4:] = rotation @ bracket(rotate_back(rotation, angular))
    return matrix


def body_sizes(parameters: Array) -> Array:
    """Return the reference sizes of relative errors of a body's (10,) standard parameters.

    The mass; the mass times the larger of CoM distance and radius of gyration; the mean moment of inertia.
    """
    mass, mean = parameters[0], float(parameters[[4, 7, 9]].sum()) / 3.0
    return np.concatenate(([mass], np.full(3, mass * body_length(parameters)), np.full(6, mean)))


def body_length(parameters: Array) -> float:
    """Return the larger of a body's distance of the CoM from its frame and radius of gyration about that, m."""
    gyration = np.sqrt(max(float(parameters[[4, 7, 9]].sum()) / 3.0 / parameters[0], 0.0))
    return max(float(np.linalg.norm(physical(parameters)[1:4])), float(gyration))


@dataclass(frozen=True, eq=False)
class Storage:
    """Angular momentum stored inside bodies, with c readings."""

    bodies: tuple[int, ...] = ()  # (c,) indices of the moving bodies that hold it
    axes: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (c, 3) unit vectors in the axes of these bodies
    # (c,) kg m^2 about these axes, of a reading that is a speed (rad/s); 1 of a momentum (N m s)
    inertias: Array = field(default_factory=lambda: np.zeros(0))
    noises: Array = field(default_factory=lambda: np.zeros(0))  # (c,) standard deviation of one reading
    names: tuple[str, ...] = ()  # c, of each

    @staticmethod
    def from_wheels(link: Link, names: Sequence[str], axes: Array, inertias: Sequence[float], noise: float) -> Storage:
        """Return wheels with (w, 3) unit axes in a link's frame, whose speeds are read with a noise (rad/s)."""
        bodies, noises = (link.body,) * len(names), np.full(len(names), noise)
        return Storage(bodies, axes @ link.rotation.T, np.array(inertias, dtype=float), noises, tuple(names))

    @staticmethod
    def from_published(link: Link, noise: float) -> Storage:
        """Return a momentum that is published in the axes of a link's frame, with a noise (N m s)."""
        return Storage((link.body,) * 3, link.rotation.T.copy(), np.ones(3), np.full(3, noise), ('x', 'y', 'z'))

    def __add__(self, other: Storage) -> Storage:
        """Return the storage of both, concatenated."""
        axes, inertias, noises = (
            np.concatenate((getattr(self, name), getattr(other, name))) for name in ('axes', 'inertias', 'noises')
        )
        return Storage(self.bodies + other.bodies, axes, inertias, noises, self.names + other.names)

    @property
    def count(self) -> int:
        """Number c."""
        return len(self.bodies)

    def with_inertia_changes(self, inertias: Array) -> Storage:
        """Return the storage with spin inertias changed by (c,)."""
        return replace(self, inertias=self.inertias + inertias)

    def axes_in_odometry(self, rotation: Array) -> Array:
        """Return the (N, c, 3) axes in odometry axes, of bodies with (N, n + 1, 3, 3) axes."""
        return rotate(rotation[:, list(self.bodies)], self.axes)

    def jacobian(self, rotation: Array) -> Array:
        """Return the derivative of the momentum by each reading, (N, 6, c)."""
        columns = np.zeros((len(rotation), 6, self.count))
        columns[:, 3:] = np.swapaxes(self.inertias[:, None] * self.axes_in_odometry(rotation), 1, 2)
        return columns

    def momenta(self, rotation: Array, readings: Array) -> Array:
        """Return the stored momentum of each body, (N, n + 1, 3) N m s, odometry axes, for (N, c) readings."""
        stored = np.zeros(rotation.shape[:-1])
        each = (self.inertias * readings)[..., None] * self.axes_in_odometry(rotation)
        for place, body in enumerate(self.bodies):
            stored[:, body] += each[:, place]
        return stored


def about_points(changes: Array, position: Array, numbers: int = 10) -> Array:
    """Return changes (N, 6 numbers b) of (P, L) about the origin as (N, b, 6, numbers) about (N, 3) points."""
    columns = changes.reshape(len(changes), changes.shape[1] // (6 * numbers), 6, numbers).copy()
    if not columns.size:
        return columns
    columns[..., 3:, :] -= skew(position)[:, None] @ columns[..., :3, :]
    return columns


def link_columns(columns: Array, link: Link) -> Array:
    """Return the (N, 6, 10) columns of a link's standard parameters in its own frame, from those of all bodies."""
    to_body = express(np.eye(10), link.rotation, link.position).T
    return np.asarray(columns[:, link.body] @ to_body)


def summed_over_bodies(columns: Array, parameters: Array) -> Array:
    """Return the (N, 6) sum of columns times (n + 1, 10) standard parameters of all bodies, each in its own frame."""
    return np.asarray(np.einsum('nbij,bj->ni', columns, parameters))


def momentum_change(samples: Samples, parameters: Array) -> Array:
    """Return the change of (P, L) by thrust and orbit until the last sample, (6,), about the odometry's origin.

    `parameters` (n + 1, 10) are the standard ones of all bodies, each in its own frame.
    """
    impulse = samples.impulse[-1]
    if not samples.tide.shape[1]:
        return impulse
    return np.asarray(impulse + summed_over_bodies(about_points(samples.tide[-1:], np.zeros((1, 3))), parameters)[0])
