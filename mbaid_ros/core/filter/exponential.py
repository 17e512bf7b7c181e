"""Steps of linear equations whose coefficients change slowly: an exponential Runge-Kutta method (appendages.md)."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from mbaid_ros.core.geometry import Array


def transition_steps(mean: Array, by_state: Array, driven: Array, spacing: float) -> tuple[Array, Array]:
    """Return, from each instant to the next, (2 f, 2 f) and (2 f, c) of x' = onward x + gain.

    Exponential Runge-Kutta method of order 4 (Cox and Matthews 2002): the mean (2 f, 2 f) of the derivatives exactly,
    and slow forces by polynomials. A joint that is pushed slowly stays in equilibrium however stiff its spring.
    """
    rest, size = by_state - mean, len(mean)
    halfway = _exponential(0.5 * spacing, mean)
    half, within, _, _ = np.split(halfway[:size], 4, axis=1)
    whole, once, twice, thrice = np.split((halfway @ halfway)[:size], 4, axis=1)
    twice, thrice = twice / spacing, thrice / spacing**2
    identity: Array = np.zeros((size, 4 * size))  # by x, and by its rates at x = 0 here, midway and at the next instant
    identity[:, :size] = np.eye(size)

    def rate(jacobian: Array, at: Array, instant: int) -> Array:
        slope = jacobian @ at
        slope[..., instant * size : (instant + 1) * size] += np.eye(size)
        return np.asarray(slope)

    between = _midway(rest)
    first = rate(rest[:-1], identity, 1)
    early = half @ identity + within @ first
    second = rate(between, early, 2)
    third = rate(between, half @ identity + within @ second, 2)
    last = rate(rest[1:], half @ early + within @ (2.0 * third - first), 3)
    forces = (once - 3.0 * twice + 4.0 * thrice) @ first + (2.0 * twice - 4.0 * thrice) @ (second + third)
    after = whole @ identity + forces + (4.0 * thrice - twice) @ last
    onward, here, midway, there = np.split(after, 4, axis=-1)
    return onward, here @ driven[:-1] + midway @ _midway(driven) + there @ driven[1:]


def _midway(values: Array) -> Array:
    """Return the values between neighbours along the first axis, cubic; at the ends quadratic."""
    middle = np.empty((len(values) - 1, *values.shape[1:]))
    middle[1:-1] = (9.0 * (values[1:-2] + values[2:-1]) - values[:-3] - values[3:]) / 16.0
    middle[0] = (3.0 * values[0] + 6.0 * values[1] - values[2]) / 8.0
    middle[-1] = (3.0 * values[-1] + 6.0 * values[-2] - values[-3]) / 8.0
    return middle


def _exponential(time: float, matrix: Array) -> Array:
    """Return a matrix (4 n, 4 n) whose first rows are exp(t A), t phi_1(t A), t^2 phi_2(t A), t^3 phi_3(t A), A (n, n).

    phi_k (z) = (phi_(k-1) (z) - 1 / (k - 1)!) / z, and phi_0 the exponential.
    """
    size = len(matrix)
    blocks: Array = np.eye(4 * size, k=size)
    blocks[:size, :size] = matrix
    return np.asarray(expm(time * blocks))
