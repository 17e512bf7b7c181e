"""Vectors, rotations and small linear algebra, for stacks with leading axes."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg.lapack import dpotrf, dtrtri
from scipy.special import chdtri

Array = npt.NDArray[np.floating[Any]]
Flags = npt.NDArray[np.bool_]
Integers = npt.NDArray[np.int64]
# Order of the six independent elements of a symmetric matrix (paper, definition 1).
_ROWS = np.array([0, 0, 0, 1, 1, 2])
_COLUMNS = np.array([0, 1, 2, 1, 2, 2])
# Cyclic neighbours of the three axes, and the number of elements up to which a batch is short.
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
_SHORT = 1500  # numbers, below which few calls of numpy count for more than gathering
_IDENTITY = np.eye(3)
_TINY = 1e-300  # instead of 0 in a denominator
# Of an angle of two radians: beyond, the antisymmetric part of a rotation fades, and the symmetric one gives the axis.
_COSINE_OF_LARGE = -0.4
# Part of the largest eigenvalue (all unknowns scaled to unit diagonal) that double precision can still separate from 0.
_RESOLUTION = 1e-13
_DOUBTFUL = 1e-9  # part of an unknown's information that others leave of it, below which directions may be empty
_LEAST = 1e-12  # information in units of a reference, which stands for none


def crossed(vector: Array) -> Array:
    """Return X(a) (..., 3, 3), skew(a) without its signs: X(a) b = X(b) a, a symmetric cross product."""
    return skew(vector) * skew(np.ones(3))


def skew(vector: Array) -> Array:
    """Return [a]x (..., 3, 3) of (..., 3) with [a]x b = a x b (paper, definition 5)."""
    matrix = np.zeros((*vector.shape, 3))
    matrix[..., 0, 1] = -vector[..., 2]
    matrix[..., 0, 2] = vector[..., 1]
    matrix[..., 1, 0] = vector[..., 2]
    matrix[..., 1, 2] = -vector[..., 0]
    matrix[..., 2, 0] = -vector[..., 1]
    matrix[..., 2, 1] = vector[..., 0]
    return matrix


def cross(left: Array, right: Array) -> Array:
    """Return left x right along the last axis, with broadcasting.

    One product in two arrangements: few numpy calls for short batches, no gathering for long ones.
    """
    if left.size < _SHORT and right.size < _SHORT:
        after, before = left.take(_NEXT, -1), left.take(_LAST, -1)
        return np.asarray(after * right.take(_LAST, -1) - before * right.take(_NEXT, -1))
    product = np.empty(np.broadcast_shapes(left.shape, right.shape))
    a, b, c = left[..., 0], left[..., 1], left[..., 2]
    x, y, z = right[..., 0], right[..., 1], right[..., 2]
    product[..., 0] = b * z - c * y
    product[..., 1] = c * x - a * z
    product[..., 2] = a * y - b * x
    return product


def rotate(rotation: Array, vector: Array) -> Array:
    """Return R a for batches of (..., 3, 3) and (..., 3)."""
    return np.matmul(rotation, vector[..., None])[..., 0]


def rotate_back(rotation: Array, vector: Array) -> Array:
    """Return R^T a for batches of (..., 3, 3) and (..., 3)."""
    return np.matmul(vector[..., None, :], rotation)[..., 0, :]


def bracket(vector: Array) -> Array:
    """Return the 3x6 matrix with I a = bracket(a) vec(I) (paper, definition 6)."""
    matrix = np.zeros((*vector.shape, 6))
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    matrix[..., 0, 0] = matrix[..., 1, 1] = matrix[..., 2, 2] = x
    matrix[..., 0, 1] = matrix[..., 1, 3] = matrix[..., 2, 4] = y
    matrix[..., 0, 2] = matrix[..., 1, 4] = matrix[..., 2, 5] = z
    return matrix


def vec(matrix: Array) -> Array:
    """Return (xx, xy, xz, yy, yz, zz) of a symmetric (..., 3, 3) matrix (paper, definition 1)."""
    return matrix[..., _ROWS, _COLUMNS]


def unvec(elements: Array) -> Array:
    """Return the symmetric (..., 3, 3) matrix of (..., 6) elements (xx, xy, xz, yy, yz, zz)."""
    matrix = np.empty((*elements.shape[:-1], 3, 3))
    matrix[..., _ROWS, _COLUMNS] = elements
    matrix[..., _COLUMNS, _ROWS] = elements
    return matrix


def exp(rotation_vector: Array) -> Array:
    """Return the rotation matrices (..., 3, 3) of (..., 3) rotation vectors, rad, exact to rounding (Rodrigues)."""
    half = np.maximum(0.5 * np.sqrt(np.add.reduce(rotation_vector**2, axis=-1))[..., None, None], _TINY)
    # With s = sin(a / 2) / (a / 2): sin(a) / a = s cos(a / 2), (1 - cos(a)) / a^2 = s^2 / 2.
    sine = np.sin(half) / half
    generator = skew(rotation_vector)
    square = np.matmul(generator, generator)
    return _IDENTITY + sine * np.cos(half) * generator + 0.5 * sine**2 * square


def mirror(rotation: Array, axis: int) -> Array:
    """Return rotations (..., 3, 3) as they are with one axis of both frames reversed."""
    signs = np.where(np.arange(3) == axis, -1.0, 1.0)
    return np.asarray(signs[:, None] * rotation * signs)


def log(rotation: Array) -> Array:
    """Return the rotation vector of a rotation matrix, well conditioned at every angle.

    Up to two radians from the antisymmetric part, which is its axis times the angle's sine; beyond, where that fades,
    by way of the quaternion.

    Parameters
    ----------
    rotation : (..., 3, 3) array

    Returns
    -------
    (..., 3) array, rad, of length at most pi
    """
    axial = 0.5 * (rotation - np.swapaxes(rotation, -1, -2))[..., _LAST, _NEXT]
    sine = np.sqrt(np.add.reduce(axial**2, axis=-1))
    cosine = 0.5 * (rotation[..., 0, 0] + rotation[..., 1, 1] + rotation[..., 2, 2] - 1.0)
    # At angle zero the ratio angle / sine tends to 1.
    ratio = np.where(sine > 1e-12, np.arctan2(sine, cosine) / np.maximum(sine, _TINY), 1.0)
    vector = np.asarray(ratio[..., None] * axial)
    large = cosine < _COSINE_OF_LARGE
    if large.any():
        vector[large] = _log_of_large(rotation[large])
    return vector


def _log_of_large(rotation: Array) -> Array:
    """Return the rotation vectors of (N, 3, 3) turns by large angles."""
    quaternion = quaternion_from_rotation(rotation)
    quaternion = np.where(quaternion[..., 3:] < 0.0, -quaternion, quaternion)
    imaginary = quaternion[..., :3]
    length = np.sqrt(np.sum(imaginary**2, axis=-1))
    angle = 2.0 * np.arctan2(length, quaternion[..., 3])
    return (angle / length)[..., None] * imaginary


def rotation_from_quaternion(quaternion: Array) -> Array:
    """Return the rotation matrices (..., 3, 3) of (..., 4) quaternions in ROS order (x, y, z, w), normalised here."""
    unit = quaternion / np.sqrt(np.sum(quaternion**2, axis=-1))[..., None]
    imaginary, real = unit[..., :3], unit[..., 3]
    generator = skew(imaginary)
    return np.eye(3) + 2.0 * (real[..., None, None] * generator + np.matmul(generator, generator))


def mounted_base(rotation: Array, linear: Array, angular: Array, mount: Array) -> tuple[Array, Array, Array]:
    """Return R Exp(mu_R), the displacement R mu_p (m), and the linear velocity there, of a base mounted at mu.

    Parameters
    ----------
    rotation, linear, angular : (..., 3, 3), (..., 3) m/s, (..., 3) rad/s, of the measured frame
    mount : (6,) mu, the base's frame in it: rotation vector (rad), position (m)
    """
    away = rotation @ mount[3:]
    return rotation @ exp(mount[:3]), away, linear + cross(angular, away)


def quaternion_from_rotation(rotation: Array) -> Array:
    """Return the unit quaternions (x, y, z, w) of (..., 3, 3), from their largest component (Shepperd)."""
    xx, yy, zz = rotation[..., 0, 0], rotation[..., 1, 1], rotation[..., 2, 2]
    # Outer product 4 q q^T: its row of the largest diagonal element, normalised, is q.
    outer = np.empty((*rotation.shape[:-2], 4, 4))
    outer[..., 0, 0] = 1.0 + xx - yy - zz
    outer[..., 1, 1] = 1.0 - xx + yy - zz
    outer[..., 2, 2] = 1.0 - xx - yy + zz
    outer[..., 3, 3] = 1.0 + xx + yy + zz
    for row, column in ((0, 1), (0, 2), (1, 2)):
        outer[..., row, column] = outer[..., column, row] = rotation[..., row, column] + rotation[..., column, row]
    for axis, (row, column) in enumerate(((2, 1), (0, 2), (1, 0))):
        outer[..., axis, 3] = outer[..., 3, axis] = rotation[..., row, column] - rotation[..., column, row]
    largest = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    chosen = np.take_along_axis(outer, largest[..., None, None], axis=-2)[..., 0, :]
    return chosen / np.sqrt(np.sum(chosen**2, axis=-1))[..., None]


def solve_symmetric(information: Array, right_side: Array) -> Array:
    """Solve a symmetric system; directions without information to double precision are left at zero.

    Parameters
    ----------
    information : (u, u)
    right_side : (u,) or (u, k)

    Returns
    -------
    (u,) or (u, k) array
    """
    values, vectors = _directions(information)
    return np.asarray(vectors @ ((vectors.T @ right_side).T / values).T)


def solve_definite(information: Array, right_side: Array) -> Array:
    """Return the same (n,) in less time where every direction has information (n, n) enough."""
    root = inverse_root(information)
    return solve_symmetric(information, right_side) if root is None else np.asarray(root.T @ (root @ right_side))


def square_root(information: Array) -> Array:
    """Return R (u, k) with R^T information R = 1, over the k directions that have information to double precision."""
    values, vectors = _directions(information)
    return np.asarray(vectors / np.sqrt(values))


def inverse_root(matrix: Array) -> Array | None:
    """Return R (u, u) with R^T R the inverse of a symmetric (u, u) matrix; None where it may be singular."""
    # LAPACK itself, for so small a matrix: numpy's own calls take several times as long.
    factor, failed = dpotrf(matrix, lower=True)
    if failed:
        return None
    # The square of a pivot: the information of an unknown that remains once those before it are known.
    left, enough = factor.diagonal() ** 2, _DOUBTFUL * matrix.diagonal()
    return np.asarray(dtrtri(factor, lower=True)[0]) if (left > enough).all() else None


def inverse_factor(matrix: Array) -> Array | None:
    """Return the inverse of the Cholesky factor of a symmetric (u, u) matrix; None where it has none."""
    factor, failed = dpotrf(matrix, lower=True)
    return None if failed or not np.isfinite(factor).all() else np.asarray(dtrtri(factor, lower=True)[0])


def inverse_factors(matrices: Array) -> Array | None:
    """Return those of K symmetric matrices (K, u, u), to the last bit the same in any batch.

    None where one has none.
    """
    try:
        factors = np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        return None
    return np.asarray(np.linalg.inv(factors)) if np.isfinite(factors).all() else None


def is_positive(matrix: Array) -> bool:
    """Return whether a symmetric (u, u) matrix is positive definite."""
    return not dpotrf(matrix)[1]


def _directions(information: Array) -> tuple[Array, Array]:
    """Return information (k,) and directions (u, k), scaled to unit diagonal, that double precision resolves."""
    size = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(information)), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(information * size * size[:, None])
    usable = values > _RESOLUTION * values[-1]
    return values[usable], size[:, None] * vectors[:, usable]


def inverse(reference: Array, matrix: Array) -> Array:
    """Return the inverse of a symmetric (u, u) matrix, conditioned by the diagonal of a definite reference (u, u).

    Directions in which the matrix is not positive (noise was all there was) get a variance of 1e12 times that of the
    reference's diagonal.
    """
    size, root = 1.0 / np.sqrt(np.diag(reference)), inverse_root(matrix)
    # No direction has as much variance where the sum of all has less.
    if root is not None and np.sum((root / size) ** 2) < 1.0 / _LEAST:
        return np.asarray(root.T @ root)
    values, vectors = np.linalg.eigh(matrix * size * size[:, None])
    inverted = (vectors / np.maximum(values, _LEAST)) @ vectors.T
    return np.asarray(0.5 * (inverted + inverted.T) * size * size[:, None])


@lru_cache(maxsize=1024)  # asked for many times a window, of few degrees
def chi_square_limit(chance: float, degrees: int) -> float:
    """Return the value that a chi-square variable of some degrees of freedom exceeds with a given probability."""
    return float(chdtri(degrees, chance))


def composed(transition: Array, gain: Array) -> Array:
    """Return x at all m + 1 instants, (m + 1, B, s, s + c), by the first x and c numbers: x' = transition x + gain.

    Parameters
    ----------
    transition, gain : (m, B, s, s), (m, B, s, c)
    """
    count, windows, size, _ = transition.shape
    steps: Array = np.zeros((count + 1, windows, size, size + gain.shape[-1]))
    steps[0, ..., :size] = np.eye(size)
    for index in range(count):
        np.matmul(transition[index], steps[index], out=steps[index + 1])
        steps[index + 1, ..., size:] += gain[index]
    return steps
