"""Symmetric systems, some of whose directions may be empty."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array

# Part of the largest eigenvalue (all unknowns scaled to unit diagonal) that double precision can still tell from 0.
_RESOLUTION = 1e-13


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


def square_root(information: Array) -> Array:
    """Return R (u, k) with R^T information R = 1, over the k directions that have information to double precision."""
    values, vectors = _directions(information)
    return np.asarray(vectors / np.sqrt(values))


def is_positive(matrix: Array) -> bool:
    """Return whether a symmetric (..., u, u) matrix, or each of several, is positive definite."""
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True


def _directions(information: Array) -> tuple[Array, Array]:
    """Return information (k,) and directions (u, k), scaled to unit diagonal, that double precision can tell from 0."""
    size = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(information)), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(information * size * size[:, None])
    usable = values > _RESOLUTION * values[-1]
    return values[usable], size[:, None] * vectors[:, usable]
