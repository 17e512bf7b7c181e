"""Symmetric systems, some of whose directions may be empty, and limits of the chi-square distribution."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtri
from scipy.special import chdtri

from mbaid_ros.core.geometry import Array

# Part of the largest eigenvalue (all unknowns scaled to unit diagonal) that double precision can still separate from 0.
_RESOLUTION = 1e-13
_DOUBTFUL = 1e-9  # part of an unknown's information that others leave of it, below which directions may be empty


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


_LEAST = 1e-12  # information in units of a reference, which stands for none


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
