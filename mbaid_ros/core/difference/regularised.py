"""A regularised estimate, for while the data determine little: then the solution itself may be anywhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.symmetric import inverse_root, is_positive


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
