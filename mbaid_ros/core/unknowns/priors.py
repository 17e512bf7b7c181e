"""The joint prior of all unknowns, with the correlations that a calibration leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.unknowns.declaration import NominalModel, Unknown

# Part of the largest standard deviation (all numbers in units of their own) up to which one is rounding.
_NEGLIGIBLE = 1e-8


@dataclass(frozen=True, eq=False)
class UnknownsPrior:
    """A Gaussian of the catalogue's independent numbers, correlated after a calibration."""

    mean: Array  # (e,)
    factor: Array  # (e, w) of their covariance

    @staticmethod
    def standard_normal(numbers: int) -> UnknownsPrior:
        """Return the prior of so many numbers before anything is measured."""
        return UnknownsPrior(np.zeros(numbers), np.eye(numbers))

    @cached_property
    def independent(self) -> bool:
        """Whether the numbers are independent, each of unit variance."""
        return np.array_equal(self.factor, np.eye(len(self.mean)))

    @cached_property
    def whitening(self) -> Array:
        """The (e, e) matrix W that makes W (numbers - mean) independent, of unit variance, each near its own number."""
        size = np.sqrt(np.sum(self.factor**2, axis=1))
        size[size == 0.0] = 1.0  # a planar motion does not depend on it
        left, values, _ = np.linalg.svd(self.factor / size[:, None], full_matrices=False)
        values = np.maximum(values, _NEGLIGIBLE * values.max(initial=0.0))
        return np.asarray((left / values) @ left.T / size)

    @cached_property
    def triangle(self) -> Array:
        """The (e, e) upper triangular square root of the information."""
        return np.asarray(np.linalg.qr(self.whitening, mode='r'))

    def extended(self, count: int, *, before: int) -> UnknownsPrior:
        """Return this prior with `count` more independent numbers of unit variance after the first `before`."""
        if not count:
            return self
        rows = np.arange(len(self.mean))
        place = np.where(rows < before, rows, rows + count)
        width = self.factor.shape[1]
        factor = np.zeros((len(rows) + count, width + count))
        factor[place, :width] = self.factor
        factor[before : before + count, width:] = np.eye(count)
        return UnknownsPrior(np.insert(self.mean, before, np.zeros(count)), factor)

    def drawn_anew(self, which: Flags) -> UnknownsPrior:
        """Return the prior with some of the numbers, (e,) of them True, independent and of unit variance again."""
        if not which.any():
            return self
        mean, factor = np.where(which, 0.0, self.mean), np.where(which[:, None], 0.0, self.factor)
        return UnknownsPrior(mean, np.concatenate((factor, np.eye(len(mean))[:, which]), axis=1))

    def of(self, maps: Sequence[Array]) -> UnknownsPrior:
        """Return the prior of the numbers that linear maps, one for each unknown, make of these."""
        together = block_diag(*maps)
        return UnknownsPrior(together @ self.mean, together @ self.factor)

    def nominal_model(self, kernel: MomentumKernel, unknowns: Sequence[Unknown]) -> NominalModel:
        """Return the nominal model at the mean of the unknowns' numbers."""
        side, place = NominalModel.nominal(kernel), 0
        for unknown in unknowns:
            side = unknown.applied_to(side, unknown.factor @ self.mean[place : place + unknown.count])
            place += unknown.count
        return side


def in_plane_map(unknown: Unknown, in_plane: Unknown) -> Array:
    """Return how the independent numbers of an unknown as a planar motion depends on it follow from its own, (p, e)."""
    if in_plane is unknown:
        return np.eye(unknown.count)
    return np.asarray(np.linalg.pinv(in_plane.factor, rcond=1e-12) @ unknown.factor)
