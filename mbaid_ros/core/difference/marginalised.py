"""The prior of the windows that have left the sliding window, and the cross-information of consider parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from mbaid_ros.core.difference.errors_in_variables import Linearisation
from mbaid_ros.core.geometry import Array


@dataclass(frozen=True)
class CrossInformation:
    """The parts of the normal equations by e consider parameters: C (u, e), and the diagonal (e,) of their own."""

    cross: Array
    diagonal: Array

    @staticmethod
    def from_rows(rows: Array, columns: Array) -> CrossInformation:
        """Return the sums over whitened rows (K, r, u) and columns (K, r, e)."""
        flat = rows.reshape(-1, rows.shape[-1])
        by_parameter = columns.reshape(len(flat), columns.shape[-1])
        return CrossInformation(flat.T @ by_parameter, np.sum(by_parameter**2, axis=0))

    def __add__(self, other: CrossInformation) -> CrossInformation:
        """Return the sums over the windows of both."""
        return CrossInformation(self.cross + other.cross, self.diagonal + other.diagonal)

    def surplus(self, covariance: Array) -> float:
        """Return the expected part of the parameters, of variance one, in the sum of squared residuals.

        `covariance` (u, u) is that of the unknowns by noise alone.
        """
        left = self.diagonal - np.sum(self.cross * (covariance @ self.cross), axis=0)
        return float(np.sum(np.maximum(left, 0.0)))


class MarginalisedPrior:
    """The windows that have left: a quadratic cost (x - x_m)^T N (x - x_m) + const (method.md, eq. 7).

    N holds information beyond the noise. The sum over windows may be negative in directions that the data do not
    excite, since the noise's own information is subtracted in expectation: N leaves such directions out.

    Parameters
    ----------
    floor : (u, u) positive definite information too small to count

    Attributes
    ----------
    information, right_side : (u, u) N, (u,) N x_m
    noise_information : (u, u) expected information by noise alone
    equations : number of equations
    """

    def __init__(self, floor: Array) -> None:
        self._floor = floor
        self._constant = 0.0
        self._sum: Array = np.zeros_like(floor)
        self._sum_right: Array = np.zeros(len(floor))
        self.information: Array = self._sum
        self.right_side: Array = self._sum_right
        self.noise_information: Array = np.zeros_like(floor)
        self.equations = 0

    def add(self, linear: Linearisation, noise_information: Array, x: Array) -> None:
        """Add a quadratic form around x (u,), without the noise's own information (u, u), and that by itself."""
        # cost(x') = c + 2 g (x' - x) + (x' - x) N (x' - x)
        self._sum = self._sum + linear.information
        self._sum_right = self._sum_right + linear.information @ x - linear.gradient
        self._constant += linear.cost - 2.0 * float(linear.gradient @ x) + float(x @ linear.information @ x)
        self.noise_information = self.noise_information + noise_information
        self.equations += linear.equations
        idle = self.noise_information + self._floor
        self.information, self.right_side = self._sum, self._sum_right
        # Directions with more information than `idle`, orthonormal in it, and the ratio of both.
        size = 1.0 / np.sqrt(np.diag(idle))
        ratio, vectors = scipy.linalg.eigh(self._sum * size * size[:, None], idle * size * size[:, None])
        excited = ratio > 1.0
        if not np.all(excited):
            known = size[:, None] * vectors[:, excited]
            mapped = idle @ known
            self.information = (mapped * ratio[excited]) @ mapped.T
            self.right_side = mapped @ (known.T @ self._sum_right)

    def cost(self, x: Array) -> float:
        """Return the cost at x, (u,)."""
        return float(x @ self.information @ x - 2.0 * self.right_side @ x) + self._constant

    def gradient(self, x: Array) -> Array:
        """Return half the derivative of the cost at x, (u,)."""
        return self.information @ x - self.right_side
