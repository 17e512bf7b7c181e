"""Physical consistency: the nearest real body to an estimate, in the metric of its information.

Ten numbers are a rigid body's exactly when the pseudo-inertia matrix is positive definite (Wensing, Kim, Slotine 2018).
Early estimates are not; the projection moves them least where the data are surest.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares

from mbaid_ros.core.geometry import Array, vec
from mbaid_ros.core.robot.inertia import from_pseudo_inertia, pseudo_inertia, standard
from mbaid_ros.core.robot.planar import Plane

# Smallest eigenvalue of a projected pseudo-inertia (in a plane: mass and moment), in units of `scale`: a boundary body
# would be flat, and no simulator accepts it.
_FLOOR = 1e-9
# Directions that the data leave open (standard deviations beyond ten typical sizes) are drawn, with next to no weight,
# towards a ball of the same mass.
_OPEN = 1e-2
_DRAW = 1e-3
_EVALUATIONS = 50
_TRIANGLE = np.tril_indices(4)
_DIAGONAL = np.flatnonzero(_TRIANGLE[0] == _TRIANGLE[1])
_UNIT_LOWER = np.zeros((10, 4, 4))
_UNIT_LOWER[np.arange(10), _TRIANGLE[0], _TRIANGLE[1]] = 1.0
_LARGEST_EXPONENT = 20.0


def is_physical(standard_parameters: Array) -> bool:
    """Return whether (10,) standard parameters (m, h, I_o) belong to a real body."""
    if not np.all(np.isfinite(standard_parameters)):
        return False
    try:
        np.linalg.cholesky(pseudo_inertia(standard_parameters))
    except np.linalg.LinAlgError:
        return False
    return True


def project(standard_parameters: Array, covariance: Array, scale: Array) -> tuple[Array, float]:
    """Return the real body nearest to an estimate and how far away it is.

    Parameters
    ----------
    standard_parameters : (10,) (m, h, I_o)
    covariance : (10, 10) of them, positive definite: its inverse is the metric
    scale : (10,) typical size of each parameter, to condition the search

    Returns
    -------
    (10,) standard parameters with positive definite pseudo-inertia, and the distance in standard deviations
    (0 where the estimate is physical already)
    """
    if is_physical(standard_parameters):
        return standard_parameters, 0.0
    ball = _ball(standard_parameters, scale)
    metric = _metric(covariance, scale)
    rows = np.concatenate((metric, np.diag(_DRAW / scale)))
    offset = np.concatenate((metric @ standard_parameters, _DRAW / scale * ball))
    # Lengths in the unit that makes mass and second moment of the same size.
    length = np.sqrt(scale[4] / scale[0])
    unit = np.sqrt(scale[0]) * np.array([length, length, length, 1.0])
    unit = unit * unit[:, None]

    def body(log_cholesky: Array) -> Array:
        lower = _lower(log_cholesky)
        return from_pseudo_inertia((lower @ lower.T + _FLOOR * np.eye(4)) * unit)

    def slope(log_cholesky: Array) -> Array:
        lower = _lower(log_cholesky)
        change = _UNIT_LOWER @ lower.T
        change[_DIAGONAL] *= lower[range(4), range(4)][:, None, None]
        return rows @ from_pseudo_inertia((change + np.swapaxes(change, 1, 2)) * unit).T

    start = _log_cholesky(pseudo_inertia(ball) / unit)
    nearest = body(_least_squares(lambda coordinates: rows @ body(coordinates) - offset, slope, start))
    return nearest, float(np.linalg.norm(metric @ (nearest - standard_parameters)))


def project_planar(standard_parameters: Array, covariance: Array, scale: Array, plane: Plane) -> tuple[Array, float]:
    """Return a real body for an estimate from planar motion, which leaves six directions open.

    What a planar motion tells, (m, h in the plane, the moment about its normal), belongs to a real body exactly when
    mass and the moment about the CoM are positive. The open directions are filled in like a ball's.

    Parameters
    ----------
    standard_parameters, covariance, scale : as for `project`
    plane : of the motion, in the link's frame

    Returns
    -------
    as for `project`
    """
    basis, across = plane.basis, plane.across.T
    about = float(np.linalg.norm(vec(plane.normal[:, None] * plane.normal)))

    def positive(coordinates: Array) -> tuple[float, float]:
        """Return mass and moment about the CoM of (ln mass, CoM in the plane, ln moment), both off their limit."""
        mass, moment = np.exp(np.clip(coordinates[[0, 3]], -50.0, 50.0)) + _FLOOR * scale[[0, 4]]
        return float(mass), float(moment)

    def planar(coordinates: Array) -> Array:
        """Return the (4,) parameters."""
        mass, moment = positive(coordinates)
        com = coordinates[1:3]
        return np.concatenate(([mass], mass * com, [(moment + mass * float(com @ com)) * about]))

    estimate = basis.T @ standard_parameters
    mass, com = estimate[0], estimate[1:3] / estimate[0]
    moment = estimate[3] / about - mass * float(com @ com)
    distance = 0.0
    if not (mass > 0.0 and moment > 0.0):
        size = np.abs(basis.T) @ scale
        metric = _metric(basis.T @ covariance @ basis, size)
        mass = max(mass, 1e-3 * scale[0])
        com = np.clip(estimate[1:3] / mass, -scale[1] / scale[0], scale[1] / scale[0])
        start = np.concatenate(([np.log(mass)], com, [np.log(1e-3 * mass * scale[4] / scale[0])]))
        found = _least_squares(lambda coordinates: metric @ (planar(coordinates) - estimate), '2-point', start)
        distance = float(np.linalg.norm(metric @ (planar(found) - estimate)))
        com = found[1:3]
        mass, moment = positive(found)
    ball = np.array([moment, 0.0, 0.0, moment, 0.0, moment])
    return standard(np.concatenate(([mass], across @ com, ball))), distance


def _least_squares(residual: Callable[[Array], Array], slope: Callable[[Array], Array] | str, start: Array) -> Array:
    solution = least_squares(residual, start, jac=slope, method='trf', x_scale='jac', max_nfev=_EVALUATIONS)
    return np.asarray(solution.x)


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
    weight = np.where(values < 1.0 / _OPEN, 1.0 / np.sqrt(np.maximum(values, np.finfo(float).tiny)), 0.0)
    return np.asarray(weight[:, None] * vectors.T / scale)


def _log_cholesky(matrix: Array) -> Array:
    lower = np.linalg.cholesky(matrix)[_TRIANGLE]
    lower[_DIAGONAL] = np.log(lower[_DIAGONAL])
    return np.asarray(lower)


def _lower(log_cholesky: Array) -> Array:
    elements = log_cholesky.copy()
    # Bounded: the boundary of the cone lies at minus infinity.
    elements[_DIAGONAL] = np.exp(np.clip(elements[_DIAGONAL], -_LARGEST_EXPONENT, _LARGEST_EXPONENT))
    lower = np.zeros((4, 4))
    lower[_TRIANGLE] = elements
    return lower
