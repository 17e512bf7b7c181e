"""What is believed of the state, in scaled variables, with the covariance as a factor; also of several hypotheses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.trajectory.chain import BODY, FORCE

_NEAR = 0.1  # standard deviation of a mass that is given, relative


@dataclass(frozen=True)
class Belief:
    """Mean and covariance of the state, in scaled variables, and how well the measurements have agreed with it.

    Attributes
    ----------
    means : (v, 2) the mean, and beside it what is to be added to that: by so much has noise that rows and values share
        moved it the other way on average; innovations are those of the mean itself
    factor : (v, c) of the covariance, which is factor factor^T; a lower triangle after an update, wider after a step
    free : number of the first variables that may differ from zero
    surprise, measured : sum of the normalised innovations squared, and how many there were
    last_surprise, last_measured : the same of the last update
    evidence : log-likelihood of all measurements, up to a constant
    """

    means: Array
    factor: Array
    free: int
    surprise: float = 0.0
    measured: int = 0
    last_surprise: float = 0.0
    last_measured: int = 0
    evidence: float = 0.0

    @property
    def mean(self) -> Array:
        """The mean, without what noise has moved it by, (v,)."""
        return np.asarray(self.means[:, 0] + self.means[:, 1])

    @property
    def shift(self) -> Array:
        """What is added to the least squares' mean for that, (v,)."""
        return np.asarray(self.means[:, 1])

    @property
    def covariance(self) -> Array:
        """The (v, v) covariance."""
        return np.asarray(self.factor @ self.factor.T)


@dataclass(frozen=True, eq=False)
class Beliefs:
    """The beliefs of h hypotheses that have met the same measurements, side by side: see `Belief`.

    Attributes
    ----------
    columns : (h, v, 2 + c) the means, and beside them the factor: what is linear moves both alike
    free : (h,) numbers of variables
    surprises, last_surprises, evidences : (h,)
    measured, last_measured : of all alike
    """

    columns: Array
    free: tuple[int, ...]
    surprises: Array
    measured: int
    last_surprises: Array
    last_measured: int
    evidences: Array

    @staticmethod
    def of(beliefs: Sequence[Belief]) -> Beliefs:
        """Return beliefs side by side."""
        first = beliefs[0]
        most = max(each.factor.shape[1] for each in beliefs)
        columns = np.zeros((len(beliefs), len(first.means), 2 + most))
        for column, each in zip(columns, beliefs, strict=True):
            column[:, :2] = each.means
            column[:, 2 : 2 + each.factor.shape[1]] = each.factor
        return Beliefs(
            columns,
            tuple(each.free for each in beliefs),
            np.array([each.surprise for each in beliefs]),
            first.measured,
            np.array([each.last_surprise for each in beliefs]),
            first.last_measured,
            np.array([each.evidence for each in beliefs]),
        )

    def moved(self, columns: Array) -> Beliefs:
        """Return the beliefs with other means and factors."""
        known = (self.free, self.surprises, self.measured, self.last_surprises, self.last_measured, self.evidences)
        return Beliefs(columns, *known)

    def only(self, index: int) -> Beliefs:
        """Return one of them, still as if beside others."""
        part = slice(index, index + 1)
        return Beliefs(
            self.columns[part],
            self.free[part],
            self.surprises[part],
            self.measured,
            self.last_surprises[part],
            self.last_measured,
            self.evidences[part],
        )

    def __len__(self) -> int:
        """Return how many hypotheses there are."""
        return len(self.free)

    def __getitem__(self, index: int) -> Belief:
        """Return the belief of one of them."""
        return Belief(
            self.columns[index, :, :2],
            self.columns[index, :, 2:],
            self.free[index],
            float(self.surprises[index]),
            self.measured,
            float(self.last_surprises[index]),
            self.last_measured,
            float(self.evidences[index]),
        )


@dataclass(frozen=True, eq=False)
class Coordinates:
    """The variables of the filter: state = basis (scale * variables).

    Attributes
    ----------
    basis : (s, v) orthonormal columns; fewer than s for a planar motion. Pose errors are first, what only some
        hypotheses have is last
    scale : (v,) typical size of each variable
    measured : (k, 6) the combinations of a window's six pose or twist measurements that hold
    open_factor : (s, f) of the covariance of the state when nothing has been measured
    """

    basis: Array
    scale: Array
    measured: Array
    open_factor: Array

    @cached_property
    def open_variance(self) -> Array:
        """Of the state when nothing has been measured, (s,)."""
        return np.asarray(np.sum(self.open_factor**2, axis=1))

    @cached_property
    def spread(self) -> Array:
        """The (s, v) matrix from variables to state."""
        return self.basis * self.scale

    @cached_property
    def gather(self) -> Array:
        """The (v, s) matrix from state to variables."""
        return self.basis.T / self.scale[:, None]

    def state(self, belief: Belief) -> tuple[Array, Array]:
        """Return the mean (s,) and covariance (s, s) in SI units, open in what the variables leave out."""
        factor = self.spread @ belief.factor
        return self.spread @ belief.mean, factor @ factor.T + self._outside

    @cached_property
    def _outside(self) -> Array:
        """The (s, s) covariance of what the variables leave out."""
        outside = np.eye(len(self.basis)) - self.basis @ self.basis.T
        return np.asarray((outside * self.open_variance) @ outside.T)

    def moments(self, belief: Belief) -> tuple[Array, Array]:
        """Return the mean (s,) and the standard deviations (s,) in SI units."""
        variance = np.add.reduce((self.spread @ belief.factor) ** 2, axis=1) + self._outside.diagonal()
        return self.spread @ belief.mean, np.sqrt(variance)

    def open(self, *, force: bool = False, mass: float | None = None) -> Belief:
        """Return the belief before the first measurement, with or without a force that may act, or a mass it is near.

        The evidence is then that of bodies of about that mass among all.
        """
        factor, mean, evidence = self.open_factor.copy(), np.zeros(len(self.basis)), 0.0
        if not force:
            factor[FORCE] = 0.0
        if mass is not None:
            deviation = _NEAR * mass
            evidence = float(np.log(deviation / factor[BODY.start, BODY.start]))
            mean[BODY.start], factor[BODY.start, BODY.start] = mass, deviation
        means = np.column_stack((self.gather @ mean, np.zeros(len(self.scale))))
        square = _compressed(self.gather @ factor)
        free = int(np.flatnonzero(np.any(square != 0.0, axis=1))[-1]) + 1
        return Belief(means, square, free, evidence=evidence)


def _compressed(columns: Array) -> Array:
    """Return a square factor of the covariance columns columns^T."""
    return np.asarray(np.linalg.qr(columns.T, mode='r')).T
