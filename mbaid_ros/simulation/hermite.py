"""A smooth motion between the steps of an integrator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array

# Quintic Hermite polynomials on [0, 1] in rising powers: factors of y1 - y0, y0', y0'', y1'', y1'.
_BASIS = np.array(
    [
        [0.0, 0.0, 0.0, 10.0, -15.0, 6.0],
        [0.0, 1.0, 0.0, -6.0, 8.0, -3.0],
        [0.0, 0.0, 0.5, -1.5, 1.5, -0.5],
        [0.0, 0.0, 0.0, 0.5, -1.0, 0.5],
        [0.0, 0.0, 0.0, -4.0, 7.0, -3.0],
    ]
)
_SLOPES = _BASIS[:, 1:] * np.arange(1.0, 6.0)


@dataclass(frozen=True)
class HermiteSpline:
    """A curve known at equally spaced nodes with its first two derivatives.

    Attributes
    ----------
    step : s between nodes
    value, rate, curvature : (K, d) the curve and its derivatives by time
    """

    step: float
    value: Array
    rate: Array
    curvature: Array

    def at(self, interval: Array, fraction: Array) -> tuple[Array, Array]:
        """Return the curve and its rate inside intervals, of order 6 and 5 in the step; exact at the nodes.

        Parameters
        ----------
        interval : (N,) integers, the node before each instant
        fraction : (N,) in [0, 1), of the step past that node

        Returns
        -------
        (N, d), (N, d)
        """
        before, after = self.value[interval], self.value[interval + 1]
        scale = self.step * self.step
        parts = (
            after - before,
            self.step * self.rate[interval],
            scale * self.curvature[interval],
            scale * self.curvature[interval + 1],
            self.step * self.rate[interval + 1],
        )
        return before + _sum(_BASIS, fraction, parts), _sum(_SLOPES, fraction, parts) / self.step


def _sum(polynomials: Array, argument: Array, parts: tuple[Array, ...]) -> Array:
    """Return the sum of parts (N, d), each times its polynomial; element by element, so that no batch differs."""
    total = np.zeros_like(parts[0])
    for coefficients, part in zip(polynomials, parts, strict=True):
        factor = np.zeros_like(argument)
        for coefficient in coefficients[::-1]:
            factor = factor * argument + coefficient
        total += factor[:, None] * part
    return total
