"""First solutions of equations with noisy coefficients, from nothing: where the search for the maximum begins."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.difference.errors_in_variables import Blocks, square, whitener_of
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.symmetric import solve_symmetric, square_root


def first_solutions(blocks: Blocks, information: Array, right_side: Array) -> list[Array]:
    """Return solutions to begin with: weighted solves, some of which compensate the noise, each for the next's weights.

    Parameters
    ----------
    blocks : Blocks
    information, right_side : (u, u), (u,) of what is known besides
    """
    x: Array = np.zeros(len(right_side))
    found = []
    for compensate in (False, False, True, True):
        try:
            found.append(total_least_squares(blocks, x, information, right_side))
            own, right = weighted(blocks, x, compensate=compensate)
        except FloatingPointError:
            break
        candidate = solve_symmetric(own + information, right + right_side)
        # Compensation goes astray where the noise is less than it is said to be.
        if compensate and (candidate[0] <= 0.0 < x[0] or not np.all(np.isfinite(candidate))):
            break
        x = candidate
        found.append(x)
    return found


def weighted(blocks: Blocks, x: Array, *, compensate: bool) -> tuple[Array, Array]:
    """Return information and right side of the weighted least squares with the weights of x.

    Parameters
    ----------
    blocks : Blocks
    x : (u,) for the weights
    compensate : subtract what the noise in the rows adds in expectation, to first order

    Returns
    -------
    (u, u) information and (u,) right side

    Raises
    ------
    FloatingPointError
        The covariance of a block is not positive definite at this x.
    """
    noise = blocks.noise + blocks.noise_rows @ x
    whitener = whitener_of(noise)
    white_rows = whitener @ blocks.rows
    white_offset = (whitener @ blocks.offset[..., None])[..., 0]
    information = square(white_rows)
    right_side = -np.tensordot(white_rows, white_offset, axes=((0, 1), (0, 1)))
    if compensate:
        count, equations, _, unknowns = blocks.noise_rows.shape
        white = (whitener @ blocks.noise_rows.reshape(count, equations, -1)).reshape(-1, unknowns)
        white_known = (whitener @ blocks.noise).reshape(-1)
        information = information - square(white)
        right_side = right_side + white.T @ white_known
    return information, right_side


def total_least_squares(blocks: Blocks, x: Array, information: Array, right_side: Array) -> Array:
    """Return what explains the equations with the smallest errors in coefficients and offsets alike.

    It minimises z^T M z / z^T N z over z = (x', 1), M the sum of the squared equations and N what noise adds to it in
    expectation (renormalisation; Kanatani 1994), which has one solution, however little the data say.

    Parameters
    ----------
    blocks : Blocks
    x : (u,) for the weights
    information, right_side : (u, u), (u,) of what is known besides

    Raises
    ------
    FloatingPointError
        The covariance of a block is not positive definite at this x, or nothing is noisy.
    """
    whitener = whitener_of(blocks.noise + blocks.noise_rows @ x)
    equations = square(whitener @ np.concatenate((blocks.rows, blocks.offset[..., None]), axis=-1))
    equations[:-1, :-1] += information
    equations[:-1, -1] -= right_side
    equations[-1, :-1] -= right_side
    noise = np.concatenate((blocks.noise_rows, blocks.noise[..., None]), axis=-1)
    count, rows, _, unknowns = noise.shape
    added = square((whitener @ noise.reshape(count, rows, -1)).reshape(-1, unknowns))
    root = square_root(equations)
    direction = root @ np.linalg.eigh(root.T @ added @ root)[1][:, -1]
    if direction[-1] == 0.0:
        raise FloatingPointError('the equations leave no noise to explain')
    return np.asarray(direction[:-1] / direction[-1])
