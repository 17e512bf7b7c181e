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

_FACTORS = (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
_SIZES = (1.25, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0)
_SEEN = 0.01  # of the prior's variance, which data have to take off a direction for it to be seen


class LikelySize(NamedTuple):
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
class BesidePrior:
    """Numbers of unit variance beforehand, in the directions that the data know independently.

    Attributes
    ----------
    mean, variance : (n,) along these directions
    """

    mean: Array
    variance: Array

    @staticmethod
    def of(mean: Array, covariance: Array) -> BesidePrior:
        """Return numbers by their mean (n,) and covariance (n, n)."""
        if len(mean) == 1:
            return BesidePrior(mean, np.clip(covariance[0], 0.0, 1.0))
        variance, directions = np.linalg.eigh(covariance)
        return BesidePrior(directions.T @ mean, np.clip(variance, 0.0, 1.0))

    @property
    def distance(self) -> Distance:
        """How far the data see them from zero."""
        seen = 1.0 - self.variance
        enough = seen > _SEEN
        squares, seen = self.mean[enough] ** 2 / seen[enough], seen[enough]
        return Distance(float(np.sum(squares)), float(np.sum(squares / (1.0 + 3.0 * seen))), len(squares))

    def gain(self, most: float) -> tuple[float, float]:
        """Return the largest gain of log-likelihood, and the factor of the standard deviations that leads to it.

        Parameters
        ----------
        most : largest factor that is plausible
        """
        return self._largest([factor for factor in _FACTORS if factor <= most])

    def likely_size(self, too_small: float, doubt: float) -> LikelySize:
        """Return how many times as far from zero they are as declared.

        The root mean square of one and the likeliest factor, by the chance of either; data that say nothing of the
        numbers leave it at one.

        Parameters
        ----------
        too_small : chance that they are declared too certain, before the data are asked
        doubt : chance afterwards up to which that counts for nothing
        """
        # What is known of them should be about as large as it is known, or a factor could gain nothing.
        if float(self.mean @ self.mean) <= float(np.sum(1.0 - self.variance)):
            return LikelySize(1.0, 0.0, 0.0)
        most, factor = self._largest(_SIZES)
        odds = too_small * np.exp(min(most, 100.0))
        chance = max(0.0, (odds / (1.0 - too_small + odds) - doubt) / (1.0 - doubt))
        return LikelySize(float(np.sqrt(1.0 + chance * (factor**2 - 1.0))), float(chance), max(most, 0.0))

    def _largest(self, factors: Sequence[float]) -> tuple[float, float]:
        k = np.array(factors)[:, None]
        less = 1.0 - k**-2
        left = 1.0 - less * self.variance
        gains = 0.5 * np.sum(less * self.mean**2 / left - np.log(left) - 2.0 * np.log(k), axis=1)
        place = int(np.argmax(gains))
        return float(gains[place]), float(factors[place])
