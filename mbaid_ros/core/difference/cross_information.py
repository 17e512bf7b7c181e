"""What ties consider parameters to the unknowns in the normal equations: summed over windows like the information.

Consider parameters e of variance one add E e to the equations. With the unknowns' information N, the cross-information
C and their own information D the normal equations are [[N, C], [C^T, D]]: one standard deviation of e moves the
solution by -N^-1 C.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array


@dataclass(frozen=True)
class CrossInformation:
    """The parts of the normal equations that e consider parameters bring.

    Attributes
    ----------
    cross : (u, e) C
    own : (e,) diagonal of D
    """

    cross: Array
    own: Array

    @staticmethod
    def nothing(unknowns: int, parameters: int) -> CrossInformation:
        """Return what no data say."""
        return CrossInformation(np.zeros((unknowns, parameters)), np.zeros(parameters))

    @staticmethod
    def of(rows: Array, columns: Array) -> CrossInformation:
        """Return the sums over whitened rows (K, r, u) and columns (K, r, e)."""
        flat = rows.reshape(-1, rows.shape[-1])
        by_parameter = columns.reshape(len(flat), columns.shape[-1])
        return CrossInformation(flat.T @ by_parameter, np.sum(by_parameter**2, axis=0))

    def __add__(self, other: CrossInformation) -> CrossInformation:
        """Return the sums over the windows of both."""
        return CrossInformation(self.cross + other.cross, self.own + other.own)

    def forget(self, root: Array, factor: float) -> CrossInformation:
        """Return the past discounted like an information N that becomes root^T N root, (u, u), by up to a factor."""
        return CrossInformation(np.sqrt(factor) * root.T @ self.cross, factor * self.own)

    def surplus(self, covariance: Array) -> float:
        """Return what the parameters, of variance one, add to the sum of squared residuals in expectation.

        Parameters
        ----------
        covariance : (u, u) of the unknowns without them
        """
        left = self.own - np.sum(self.cross * (covariance @ self.cross), axis=0)
        return float(np.sum(np.maximum(left, 0.0)))
