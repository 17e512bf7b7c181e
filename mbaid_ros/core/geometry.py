"""Three-dimensional geometry for batches: any number of leading axes, the last one or two hold the vector or matrix."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

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
