"""Unit quaternions (x, y, z, w) in batches, element by element.

Matrix products round differently for different batch sizes; these functions do not, so that a run is the same to the
last bit in any batches.
"""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array, cross


def product(left: Array, right: Array) -> Array:
    """Return the products (..., 4) of quaternions (..., 4), of unit length or not."""
    a, w = left[..., :3], left[..., 3:]
    b, s = right[..., :3], right[..., 3:]
    imaginary: Array = w * b + s * a + cross(a, b)
    return np.concatenate((imaginary, w * s - _dot(a, b)), axis=-1)


def conjugate(quaternion: Array) -> Array:
    """Return the inverses of unit quaternions (..., 4)."""
    return np.concatenate((-quaternion[..., :3], quaternion[..., 3:]), axis=-1)


def pure(vector: Array) -> Array:
    """Return vectors (..., 3) as quaternions (..., 4) without real part."""
    return np.concatenate((vector, np.zeros((*vector.shape[:-1], 1))), axis=-1)


def rotate(quaternion: Array, vector: Array) -> Array:
    """Return vectors (..., 3) turned by unit quaternions (..., 4)."""
    imaginary, real = quaternion[..., :3], quaternion[..., 3:]
    twice = 2.0 * cross(imaginary, vector)
    return vector + real * twice + cross(imaginary, twice)


def exp(rotation_vector: Array) -> Array:
    """Return the unit quaternions (..., 4) of rotation vectors (..., 3) in rad."""
    half = 0.5 * np.sqrt(_dot(rotation_vector, rotation_vector))
    return np.concatenate((0.5 * np.sinc(half / np.pi) * rotation_vector, np.cos(half)), axis=-1)


def normalised(quaternion: Array) -> Array:
    """Return quaternions (..., 4) scaled to unit length."""
    square = _dot(quaternion[..., :3], quaternion[..., :3]) + quaternion[..., 3:] ** 2
    return quaternion / np.sqrt(square)


def _dot(left: Array, right: Array) -> Array:
    """Return the scalar products (..., 1) of vectors (..., 3), summed in one order for any layout in memory."""
    parts = left * right
    total: Array = parts[..., 0:1] + parts[..., 1:2] + parts[..., 2:3]
    return total
