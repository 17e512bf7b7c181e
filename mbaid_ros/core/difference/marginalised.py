"""The windows that have left the sliding window, as one quadratic form: information, right side and constant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from mbaid_ros.core.difference.errors_in_variables import Linearisation
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.linear_algebra import inverse_root, is_positive


class MarginalisedPrior:
    """A quadratic cost: (x - x_m)^T N (x - x_m) + const, where N holds what is known beyond the noise.

    The sum may be negative in directions that the data do not excite, since the noise's own information is taken off in
    expectation: such directions are left out of N.

    Parameters
    ----------
    floor : (u, u) positive definite information too small to count

    Attributes
    ----------
    information : (u, u) N
    right_side : (u,) N x_m
    noise_information : (u, u) what noise alone would have brought
    equations : number of equations
    """

    def __init__(self, floor: Array) -> None:
        self._floor = floor
        self._sum: Array = np.zeros_like(floor)
        self._sum_right: Array = np.zeros(len(floor))
        self._constant = 0.0
        self._windows = 0
        self.information: Array = self._sum
        self.right_side: Array = self._sum_right
        self.noise_information: Array = np.zeros_like(floor)
        self.equations = 0

    def __len__(self) -> int:
        """Return the number of windows taken."""
        return self._windows

    def add(self, linear: Linearisation, noise_information: Array, x: Array) -> None:
        """Take a quadratic form around x (u,), without the noise's own information (u, u), and that by itself."""
        # docs/method.md, eq. 7: cost(x') = c + 2 g (x' - x) + (x' - x) N (x' - x)
        self._sum = self._sum + linear.information
        self._sum_right = self._sum_right + linear.information @ x - linear.gradient
        self._constant += linear.cost - 2.0 * float(linear.gradient @ x) + float(x @ linear.information @ x)
        self.noise_information = self.noise_information + noise_information
        self.equations += linear.equations
        self._windows += 1
        self._settle()

    def cost(self, x: Array) -> float:
        """Return the cost at x, (u,)."""
        return float(x @ self.information @ x - 2.0 * self.right_side @ x) + self._constant

    def gradient(self, x: Array) -> Array:
        """Return half the derivative of the cost at x, (u,)."""
        return self.information @ x - self.right_side

    def _settle(self) -> None:
        """Work out what is known beyond the noise."""
        idle = self.noise_information + self._floor
        self.information, self.right_side = self._sum, self._sum_right
        if is_positive(self._sum - idle):
            return
        known, ratio = _beyond(self._sum, idle)
        if len(ratio) < len(idle):
            mapped = idle @ known
            self.information = (mapped * ratio) @ mapped.T
            self.right_side = mapped @ (known.T @ self._sum_right)


def _beyond(information: Array, idle: Array) -> tuple[Array, Array]:
    """Return the directions (u, k) with more information than `idle`, orthonormal in it, and how many times more."""
    size = 1.0 / np.sqrt(np.diag(idle))
    ratio, vectors = scipy.linalg.eigh(information * size * size[:, None], idle * size * size[:, None])
    known = ratio > 1.0
    return size[:, None] * vectors[:, known], ratio[known]


@dataclass(frozen=True)
class Regularised:
    """What data say of unknowns that are held within their typical sizes.

    Attributes
    ----------
    signal : (u, u) information of the data; not positive where they say nothing
    typical : (u,) sizes
    """

    signal: Array
    typical: Array

    def solution(self, x: Array) -> tuple[Array, Array]:
        """Return a (u,) solution and a factor of its covariance, both held within the sizes."""
        size = self.typical
        values, vectors = np.linalg.eigh(self.signal * size * size[:, None])
        values = np.maximum(values, 0.0)
        vectors = size[:, None] * vectors
        coordinates = np.linalg.solve(vectors, x)
        return vectors @ (values / (values + 1.0) * coordinates), vectors / np.sqrt(values + 1.0)

    @property
    def covariance(self) -> Array:
        """The (u, u) covariance of which `solution` returns a factor."""
        root = inverse_root(self.signal + np.diag(self.typical**-2.0)) if is_positive(self.signal) else None
        factor = self.solution(np.zeros(len(self.typical)))[1] if root is None else root.T
        return np.asarray(factor @ factor.T)
