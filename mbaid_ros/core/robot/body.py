"""The ten inertial parameters of a rigid body: their forms, which bodies can exist, and the nearest one that can."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, inverse_factor, is_positive, skew, solve_definite, unvec, vec
from mbaid_ros.core.robot.model import Plane

_COM = np.arange(1, 4)
# Smallest eigenvalue of a projected pseudo-inertia (in a plane: mass and moment), in units of `scale`: a boundary body
# would be flat, and no simulator accepts it.
_FLOOR = 1e-9
# Inverse variance, in typical sizes, below which data leave a direction open (ten sizes): it is drawn, with next to
# no weight, towards a ball of the same mass.
_OPEN = 1e-2
_DRAW = 1e-3  # standard deviations that a typical size is worth where the data leave a direction open: next to none
_SMALLEST = 1e-24  # variance, in units of `scale` squared, that stands for none: a quotient by it stays finite
# Of the weight of the boundary: at the last, an estimate is within a hundredth of a standard deviation of the nearest.
_LEAST_WEIGHT = 1e-6
_FALL = 0.03  # of the weight of the boundary, from one minimum to the next: a few steps of Newton's each
_INTERIOR = 0.9  # of the way to the boundary that a step may go: beyond it there is no logarithm
_STEPS = 100  # at most, of Newton's: a few for each weight
_TRACE = np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0])  # of (ixx, ixy, ixz, iyy, iyz, izz)
_CLEARER = 5.0  # times as well known as the scale, from which ratios are known where the moments are not
LENGTH = 1.0  # m, that the standard deviation of the centre of mass is relative to, of a body that is not smaller
# d vec(I)/dr of the Steiner term is assembled from these: E_k = d[r]x / dr_k.
_GENERATORS = skew(np.eye(3))
_IDENTITY = np.eye(10)


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


_PSEUDO_INERTIAS = np.array([pseudo_inertia(parameters) for parameters in np.eye(10)])


def is_physical(standard_parameters: Array) -> bool:
    """Return whether (10,) standard parameters (m, h, I_o) belong to a real body."""
    return bool(are_physical(standard_parameters[None])[0])


def are_physical(standard_parameters: Array) -> Flags:
    """Return which of (N, 10) standard parameters belong to a real body."""
    finite = np.all(np.isfinite(standard_parameters), axis=1)
    matrices = pseudo_inertia(np.where(finite[:, None], standard_parameters, 0.0))
    return np.array([is_positive(each) for each in matrices])


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


def project(standard_parameters: Array, covariance: Array, scale: Array) -> tuple[Array, float]:
    """Return the real body nearest to (10,) standard parameters, and its distance in standard deviations, 0 if itself.

    Parameters
    ----------
    standard_parameters, covariance : (10,), (10, 10) positive definite: its inverse is the metric
    scale : (10,) typical size of each parameter, to condition the search
    """
    if is_physical(standard_parameters):
        return standard_parameters, 0.0
    return _projected(
        standard_parameters, covariance, scale, _PSEUDO_INERTIAS, _units(scale, 3), _ball(standard_parameters, scale)
    )


def project_planar(standard_parameters: Array, covariance: Array, scale: Array, plane: Plane) -> tuple[Array, float]:
    """Return the same as `project` for planar motion, in a plane in the link's frame, which leaves six directions open.

    The parameters of a planar motion, (m, h in the plane, the moment I about its normal), belong to a real body exactly
    when its planar pseudo-inertia [[I 1, h], [h^T, m]] is positive definite: mass and the moment about the CoM are
    positive. The open directions are filled in like a ball's.
    """
    basis, across = plane.basis, plane.axes.T
    about = float(np.linalg.norm(vec(plane.normal[:, None] * plane.normal)))
    found: Array = basis.T @ standard_parameters
    distance = 0.0
    if not _moment(found, about) > 0.0:
        matrices = np.zeros((4, 3, 3))
        matrices[0, 2, 2] = matrices[1, 0, 2] = matrices[1, 2, 0] = matrices[2, 1, 2] = matrices[2, 2, 1] = 1.0
        matrices[3, :2, :2] = np.eye(2) / about
        planar, size = basis.T @ covariance @ basis, np.abs(basis.T) @ scale
        start = basis.T @ _ball(standard_parameters, scale)
        found, distance = _projected(found, planar, size, matrices, _units(scale, 2), start)
    moment = _moment(found, about)
    ball = np.array([moment, 0.0, 0.0, moment, 0.0, moment])
    return standard(np.concatenate((found[:1], across @ found[1:3] / found[0], ball))), distance


def _moment(planar: Array, about: float) -> float:
    """Return the moment about the CoM of (4,) planar parameters, negative for a mass that is none."""
    mass, moment, first = planar[0], planar[3] / about, planar[1:3]
    return float(moment - first @ first / mass) if mass > 0.0 else -1.0


def _units(scale: Array, dimensions: int) -> Array:
    """Return the units of the rows of a pseudo-inertia, in which mass and second moment are of the same size."""
    return np.sqrt(scale[0]) * np.array([np.sqrt(scale[4] / scale[0])] * dimensions + [1.0])


def _projected(
    parameters: Array, covariance: Array, size: Array, matrices: Array, unit: Array, start: Array
) -> tuple[Array, float]:
    """Return the nearest (k,) parameters of a positive definite pseudo-inertia, and their distance.

    Parameters
    ----------
    parameters, covariance, size, start : (k,), (k, k), typical sizes (k,), a body (k,)
    matrices : (k, d, d) pseudo-inertias of unit parameters
    unit : (d,) of their rows
    """
    metric, draw = _metric(covariance, size), _DRAW / size
    rows, offset = np.concatenate((metric, np.diag(draw))), np.concatenate((metric @ parameters, draw * start))
    units = matrices * size[:, None, None] / (unit * unit[:, None])
    nearest = size * _nearest(rows * size, offset, units, start / size)
    return nearest, float(np.linalg.norm(metric @ (nearest - parameters)))


def _nearest(rows: Array, offset: Array, units: Array, start: Array) -> Array:
    """Return the x with the least |A x - b| for which the pseudo-inertia, linear in x, exceeds the floor.

    Newton's steps on 1/2 |A x - b|^2 - w ln det(pseudo-inertia - floor), with w falling to next to nothing (Boyd,
    Vandenberghe, Convex Optimization, 2004, chapter 11). There is one minimum only, mostly on the boundary, where
    coordinates that cannot leave the cone would never arrive. (r, k) rows A of full rank, (r,) offset b, (k, d, d)
    pseudo-inertias of unit x, a start inside the cone.
    """
    orthonormal, triangle = np.linalg.qr(rows)
    back = np.linalg.inv(triangle)  # z = R x, in which |A x - b| is the distance from a point
    target = orthonormal.T @ offset
    inside = x = start
    weight = max(0.25 * float(np.sum((target - triangle @ x) ** 2)), _LEAST_WEIGHT)
    side = units.shape[-1]
    identity, floor, flat = np.eye(len(x)), _FLOOR * np.eye(side), units.reshape(len(x), -1)
    for _ in range(_STEPS):
        whiten = inverse_factor((x @ flat).reshape(side, side) - floor)
        if whiten is None:  # the boundary is nearer than rounding
            return inside
        inside = x
        barrier = back.T @ (whiten @ units @ whiten.T).reshape(len(x), -1)
        slope = target - triangle @ x + weight * barrier[:, :: side + 1].sum(axis=1)
        step = solve_definite(identity + weight * (barrier @ barrier.T), slope)
        change = step @ barrier
        size = float(change @ change)
        # No eigenvalue of the change is larger than its norm.
        shrinking = 0.0 if size <= _INTERIOR**2 else -float(np.linalg.eigvalsh(change.reshape(side, side))[0])
        x = x + min(1.0, _INTERIOR / max(shrinking, 1e-300)) * (back @ step)
        if float(step @ step) / weight + size < 1.0:  # close to this weight's minimum
            if weight == _LEAST_WEIGHT:
                break
            weight = max(_FALL * weight, _LEAST_WEIGHT)
    return inside


def _ball(standard_parameters: Array, scale: Array) -> Array:
    """Return a ball with the estimate's mass, CoM and mean moment of inertia, as far as those are physical."""
    mass = max(standard_parameters[0], 1e-3 * scale[0])
    com = standard_parameters[1:4] / mass
    com = com * min(1.0, scale[1] / scale[0] / max(float(np.linalg.norm(com)), 1e-300))
    inertia = standard_parameters[[4, 7, 9]].sum() / 3.0 - 2.0 / 3.0 * mass * float(com @ com)
    moment = max(inertia, 1e-3 * mass * scale[4] / scale[0])
    about_com = np.array([moment, 0.0, 0.0, moment, 0.0, moment])
    return standard(np.concatenate(([mass], com, about_com)))


def _metric(covariance: Array, scale: Array) -> Array:
    """Return M with M^T M the inverse of the covariance, without the directions that are open."""
    values, vectors = np.linalg.eigh(covariance / scale / scale[:, None])
    # Beside variances that are far larger, small ones are rounding, of either sign.
    least = max(float(np.finfo(float).eps * values[-1]), _SMALLEST)
    weight = np.where(values < 1.0 / _OPEN, 1.0 / np.sqrt(np.maximum(values, least)), 0.0)
    return np.asarray(weight[:, None] * vectors.T / scale)


@dataclass(frozen=True)
class InertiaRatios:
    """Inertia about the centre of mass over its trace, with one standard deviation each."""

    elements: Array  # (6,) (ixx, ixy, ixz, iyy, iyz, izz)
    std: Array  # (6,) (ixx, ixy, ixz, iyy, iyz, izz)
    principal: Array  # (3,) principal moments, the smallest first
    principal_std: Array  # (3,) principal moments, the smallest first
    scale_std: float  # relative, of the trace

    @property
    def clearer(self) -> bool:
        """Whether the ratios are known far better than the scale is."""
        return bool(self.scale_std > _CLEARER * float(np.max(self.principal_std / self.principal)))


def inertia_ratios(parameters: Array, covariance: Array) -> InertiaRatios:
    """Return the ratios of (10,) physical parameters with their covariance, to first order."""
    inertia, of_inertia = parameters[4:], covariance[4:, 4:]
    trace = float(_TRACE @ inertia)
    elements = inertia / trace
    slope = (np.eye(6) - np.outer(elements, _TRACE)) / trace
    ratios = slope @ of_inertia @ slope.T
    principal, axes = np.linalg.eigh(unvec(elements))
    # A principal moment changes by the change along its axis: v^T dI v.
    x, y, z = axes
    along = np.stack((x * x, 2.0 * x * y, 2.0 * x * z, y * y, 2.0 * y * z, z * z), axis=1)
    variance = np.diag(along @ ratios @ along.T)
    return InertiaRatios(
        elements=elements,
        std=np.sqrt(np.maximum(np.diag(ratios), 0.0)),
        principal=principal,
        principal_std=np.sqrt(np.maximum(variance, 0.0)),
        scale_std=float(np.sqrt(max(_TRACE @ of_inertia @ _TRACE, 0.0))) / trace,
    )


def body_size(parameters: Array) -> float:
    """Return the size of a body, m, at most LENGTH: twice the radius of gyration about the CoM, a cube's side.

    Moments that are not known (NaN) count as the largest that is; without any, the size is LENGTH.

    Parameters
    ----------
    parameters : (10,) physical parameters
    """
    moments = parameters[[4, 7, 9]]
    trace = np.sum(np.where(np.isfinite(moments), moments, np.nan_to_num(moments).max()))
    square = 2.0 * trace / parameters[0] if parameters[0] > 0.0 else 0.0
    return min(float(np.sqrt(square)), LENGTH) if square > 0.0 else LENGTH


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
