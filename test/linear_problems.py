"""Random linear equations whose coefficients carry noise: what the likelihood is tested on."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.difference_solver import Blocks, row_noise_information, whitened
from mbaid_ros.core.geometry import Array

TRUE = np.array([2.0, -1.0, 0.5, 1.5])
EQUATIONS, SOURCES, UNKNOWNS = 3, 5, len(TRUE)


def exact_blocks(count: int, seed: int, noise: float, row_noise: float) -> Blocks:
    """Return blocks without errors whose solution is TRUE, with the derivatives by unit errors given."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(count, EQUATIONS, UNKNOWNS))
    return Blocks(
        rows,
        -rows @ TRUE,
        noise * rng.normal(size=(count, EQUATIONS, SOURCES)),
        row_noise * rng.normal(size=(count, EQUATIONS, SOURCES, UNKNOWNS)),
    )


def with_errors(exact: Blocks, rng: np.random.Generator) -> Blocks:
    """Return the blocks as measured: every source has an error of unit variance."""
    error = rng.normal(size=(len(exact), 1, SOURCES))
    return Blocks(
        exact.rows + (error[:, :, None] @ exact.noise_rows)[:, :, 0],
        exact.offset + np.sum(exact.noise * error, axis=2),
        exact.noise,
        exact.noise_rows,
    )


def noisy_blocks(count: int, seed: int, noise: float = 0.1, row_noise: float = 0.1) -> Blocks:
    """Return measured blocks."""
    return with_errors(exact_blocks(count, seed, noise, row_noise), np.random.default_rng([seed, 1]))


def linear_blocks(count: int, seed: int) -> Blocks:
    """Return measured blocks whose coefficients are exact: the likelihood is quadratic."""
    return noisy_blocks(count, seed, row_noise=0.0)


def noise_information(blocks: Blocks, x: Array) -> Array:
    """Return the (u, u) part of the likelihood's information at x that the noise in the rows brings in expectation."""
    return np.asarray(np.sum(row_noise_information(blocks, whitened(blocks, x)), axis=0))
