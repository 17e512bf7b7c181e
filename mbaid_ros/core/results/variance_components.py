"""Numbers beside their prior, once data have been seen: whether what was declared of them was too certain.

Of n numbers with a prior of unit variance about zero, the posterior has the mean m and the covariance P. If the prior
is right, m varies about zero with S = 1 - P (its prior predictive distribution), and m^T S^-1 m is chi-square
distributed; if the numbers are k times as far off, with S + (k^2 - 1) S^2. With k times the standard deviation, prior
information falls by D = 1 - 1/k^2, and the log-likelihood of the data grows by (docs/trajectory.md, eq. 8)

    1/2 m^T (1/D - P)^-1 m  -  1/2 log|1 - D P|  -  n log k

Both follow from the estimate alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mbaid_ros.core.geometry import Array

# Of a standard deviation, which a cause is tried with: the likelihood is flat enough for steps of three.
_FACTORS = (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
# Times a standard deviation, among which the likeliest is looked for: finer than for causes, as intervals depend on
# it.
_SIZES = (1.25, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0)
# Of the prior's variance, which data have to take off a direction for it to be seen: quotients of less are rounding.
_SEEN = 0.01


class LikelyScale(NamedTuple):
    """How many times as far from zero as declared numbers are.

    Attributes
    ----------
    factor : at least one
    chance : that it is more than one
    gain : of log-likelihood, by the likeliest factor
    """

    factor: float
    chance: float
    gain: float


AS_DECLARED = LikelyScale(1.0, 0.0, 0.0)


class Distance(NamedTuple):
    """How far from zero the data see numbers.

    Attributes
    ----------
    square : chi-square distributed if the numbers are as declared
    twice : the same if they are twice as far off, which a careful engineer's are at times
    degrees : of freedom
    """

    square: float
    twice: float
    degrees: int


@dataclass(frozen=True, eq=False)
class PriorComparison:
    """Numbers of unit variance beforehand, in the directions that the data know independently.

    Attributes
    ----------
    mean, variance : (..., n) along these directions; any groups of as many numbers side by side
    """

    mean: Array
    variance: Array

    @staticmethod
    def of(mean: Array, covariance: Array) -> PriorComparison:
        """Return numbers by their mean (..., n) and covariance (..., n, n)."""
        variance, directions = np.linalg.eigh(covariance)
        along = (np.swapaxes(directions, -1, -2) @ mean[..., None])[..., 0]
        return PriorComparison(along, np.clip(variance, 0.0, 1.0))

    @property
    def distances(self) -> tuple[Array, Array, Array]:
        """How far the data see each group from zero: (...) each of what `Distance` has."""
        seen = 1.0 - self.variance
        enough = seen > _SEEN
        squares = np.where(enough, self.mean**2, 0.0) / np.where(enough, seen, 1.0)
        twice = squares / (1.0 + 3.0 * seen)
        return np.add.reduce(squares, axis=-1), np.add.reduce(twice, axis=-1), np.add.reduce(enough, axis=-1)

    def gain(self, most: float) -> tuple[Array, Array]:
        """Return the largest gains of log-likelihood (...), and the factors of the standard deviations that do it.

        Parameters
        ----------
        most : largest factor that is plausible
        """
        return self._largest([factor for factor in _FACTORS if factor <= most])

    def likely_sizes(self, too_small: float, doubt: float) -> tuple[Array, Array, Array]:
        """Return how many times as far from zero each group is as declared: (...) each of what `LikelyScale` has.

        The root mean square of one and the likeliest factor, by the chance of either; data that say nothing of the
        numbers leave it at one.

        Parameters
        ----------
        too_small : chance that they are declared too certain, before the data are asked
        doubt : chance afterwards up to which that counts for nothing
        """
        # What is known of them should be about as large as it is known, or a factor could gain nothing.
        larger = np.add.reduce(self.mean**2, axis=-1) > np.add.reduce(1.0 - self.variance, axis=-1)
        if not larger.any():
            nothing = np.zeros(larger.shape)
            return nothing + 1.0, nothing, nothing
        most, factor = self._largest(_SIZES)
        odds = too_small * np.exp(np.minimum(most, 100.0))
        chance = np.maximum(0.0, (odds / (1.0 - too_small + odds) - doubt) / (1.0 - doubt))
        chance = np.where(larger, chance, 0.0)
        return np.sqrt(1.0 + chance * (factor**2 - 1.0)), chance, np.where(larger, np.maximum(most, 0.0), 0.0)

    def _largest(self, factors: Sequence[float]) -> tuple[Array, Array]:
        k = np.array(factors)[:, None]
        less = 1.0 - k**-2
        mean, left = self.mean[..., None, :], 1.0 - less * self.variance[..., None, :]
        gains = 0.5 * np.add.reduce(less * mean**2 / left - np.log(left) - 2.0 * np.log(k), axis=-1)
        return np.asarray(gains.max(axis=-1)), k[gains.argmax(axis=-1), 0]
