"""First solutions of equations with noisy coefficients, from nothing: where the search for the maximum begins."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from mbaid_ros.core.difference.errors_in_variables import (
    Blocks,
    noise_at,
    square,
    whitener_of,
)
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.linear_algebra import solve_symmetric, square_root


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
            sums = Sums(blocks, x)
            found.append(sums.total_least_squares(information, right_side))
        except FloatingPointError:
            break
        own, right = sums.weighted(compensate=compensate)
        candidate = solve_symmetric(own + information, right + right_side)
        # Compensation goes astray where the noise is less than it is said to be.
        if compensate and (candidate[0] <= 0.0 < x[0] or not np.all(np.isfinite(candidate))):
            break
        x = candidate
        found.append(x)
    return found


class Sums:
    """The squares of equations A x + y over z = (x, 1), with the weights of one x, added up.

    Parameters
    ----------
    blocks : Blocks
    x : (u,) for the weights

    Attributes
    ----------
    equations : (u + 1, u + 1) M, z^T M z is the sum of the squared residuals

    Raises
    ------
    FloatingPointError
        The covariance of a block is not positive definite at this x.
    """

    def __init__(self, blocks: Blocks, x: Array) -> None:
        self._blocks = blocks
        self._whitener = whitener_of(noise_at(blocks, x))
        self.equations = square(self._whitener @ np.concatenate((blocks.rows, blocks.offset[..., None]), axis=-1))

    @cached_property
    def noise(self) -> Array:
        """(u + 1, u + 1) N: what noise adds to M in expectation."""
        blocks = self._blocks
        noise = np.concatenate((blocks.noise_rows, blocks.noise[..., None]), axis=-1)
        return square((self._whitener @ noise.reshape(*noise.shape[:2], -1)).reshape(noise.shape))

    def weighted(self, *, compensate: bool) -> tuple[Array, Array]:
        """Return (u, u) information and (u,) right side of the weighted least squares.

        Parameters
        ----------
        compensate : subtract what the noise in the rows adds in expectation, to first order
        """
        sums = self.equations - self.noise if compensate else self.equations
        return sums[:-1, :-1], -sums[:-1, -1]

    def total_least_squares(self, information: Array, right_side: Array) -> Array:
        """Return the (u,) that explains the equations with the smallest errors in coefficients and offsets alike.

        It minimises z^T M z / z^T N z (renormalisation; Kanatani 1994), which has one solution, however little the
        data say.

        Parameters
        ----------
        information, right_side : (u, u), (u,) of what is known besides

        Raises
        ------
        FloatingPointError
            Nothing is noisy.
        """
        equations = self.equations.copy()
        equations[:-1, :-1] += information
        equations[:-1, -1] -= right_side
        equations[-1, :-1] -= right_side
        root = square_root(equations)
        direction = root @ np.linalg.eigh(root.T @ self.noise @ root)[1][:, -1]
        if direction[-1] == 0.0:
            raise FloatingPointError('the equations leave no noise to explain')
        return np.asarray(direction[:-1] / direction[-1])
