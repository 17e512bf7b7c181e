"""Steps of linear equations whose coefficients change slowly: an exponential Runge-Kutta method (appendages.md)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm

from mbaid_ros.core.geometry import Array


def steps_of(mean: Array, by_state: Array, driven: Array, spacing: float) -> tuple[Array, Array]:
    """Return, from each instant to the next, (2 f, 2 f) and (2 f, c) of x' = onward x + gain.

    Exponential Runge-Kutta method of order 4 (Cox and Matthews 2002): the mean (2 f, 2 f) of the derivatives exactly,
    and slow forces by polynomials. A joint that is pushed slowly stays in equilibrium however stiff its spring.
    """
    rest, size, count = by_state - mean, len(mean), driven.shape[-1]
    between, pushed = _midway(rest), _midway(driven)
    half, within, _, _ = _exponentials(0.5 * spacing * mean)
    whole, once, twice, thrice = _exponentials(spacing * mean)
    within *= 0.5 * spacing
    identity: Array = np.zeros((*between.shape[:-2], size, size + count))
    identity[..., :size] = np.eye(size)

    def rate(jacobian: Array, push: Array, at: Array) -> Array:
        slope = jacobian @ at
        slope[..., size:] += push
        return np.asarray(slope)

    first = rate(rest[:-1], driven[:-1], identity)
    early = half @ identity + within @ first
    second = rate(between, pushed, early)
    third = rate(between, pushed, half @ identity + within @ second)
    last = rate(rest[1:], driven[1:], half @ early + within @ (2.0 * third - first))
    forces = (once - 3.0 * twice + 4.0 * thrice) @ first + (2.0 * twice - 4.0 * thrice) @ (second + third)
    after = whole @ identity + spacing * (forces + (4.0 * thrice - twice) @ last)
    return after[..., :size], after[..., size:]


def _midway(values: Array) -> Array:
    """Return the values between neighbours along the first axis, cubic; at the ends quadratic."""
    middle = np.empty((len(values) - 1, *values.shape[1:]))
    middle[1:-1] = (9.0 * (values[1:-2] + values[2:-1]) - values[:-3] - values[3:]) / 16.0
    middle[0] = (3.0 * values[0] + 6.0 * values[1] - values[2]) / 8.0
    middle[-1] = (3.0 * values[-1] + 6.0 * values[-2] - values[-3]) / 8.0
    return middle


def _exponentials(matrix: Array) -> Sequence[Array]:
    """Return exp A and the functions phi_1, phi_2, phi_3 of A (n, n): phi_k = (phi_(k-1) - 1 / (k - 1)!) / A."""
    size = len(matrix)
    blocks = np.kron(np.eye(4, k=1), np.eye(size))
    blocks[:size, :size] = matrix
    return np.split(expm(blocks)[:size], 4, axis=1)
