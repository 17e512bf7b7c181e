"""Recursive least squares with forgetting factor, step by step."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array

# The covariance of what is not excited grows without limit: it is held at this many times the initial one. What is
# excited, however weakly, stays below: differenced rows at 100 Hz bring Izz of the paper's case to 2e4 times.
_LARGEST_GROWTH = 1e6


class RecursiveLeastSquares:
    """Least squares with exponential forgetting, a block of equations a step.

    Parameters
    ----------
    unknowns : int
    forgetting_factor : float
        Weight of each step relative to the next one, 0 < factor <= 1 (paper: 0.99).
    initial_covariance : float
        Variance of each unknown at the start, about the estimate 0 (paper: 1e6).

    Attributes
    ----------
    estimate : (unknowns,)
    covariance : (unknowns, unknowns)
    remaining : (unknowns, unknowns) what is left of the start: without noise the error is this times the first one
    """

    def __init__(self, unknowns: int, forgetting_factor: float, initial_covariance: float) -> None:
        self._forgetting_factor = forgetting_factor
        self._largest_variance = _LARGEST_GROWTH * initial_covariance
        self.estimate: Array = np.zeros(unknowns)
        self.covariance: Array = np.eye(unknowns) * initial_covariance
        self.remaining: Array = np.eye(unknowns)

    def step(self, rows: Array, right_side: Array) -> Array:
        """Take one block of equations rows @ x = right_side and return the new estimate.

        Parameters
        ----------
        rows : (k, unknowns)
        right_side : (k,)
        """
        # K = P A^T (lambda 1 + A P A^T)^-1,  P <- (1 - K A) P / lambda, in Joseph's form: symmetric, positive
        spread = self.covariance @ rows.T
        innovation = rows @ spread
        innovation[np.diag_indices_from(innovation)] += self._forgetting_factor
        gain = np.linalg.solve(innovation, spread.T).T
        self.estimate = self.estimate + gain @ (right_side - rows @ self.estimate)
        contraction = np.eye(len(self.estimate)) - gain @ rows
        self.remaining = contraction @ self.remaining
        covariance = (contraction @ self.covariance @ contraction.T) / self._forgetting_factor + gain @ gain.T
        largest = np.diag(covariance)
        if np.any(largest > self._largest_variance):
            scale = np.sqrt(np.minimum(1.0, self._largest_variance / np.maximum(largest, 1e-300)))
            covariance = covariance * scale * scale[:, None]
        self.covariance = covariance
        return self.estimate
