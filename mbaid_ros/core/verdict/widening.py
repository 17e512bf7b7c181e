"""What data would gain if something were less certain than declared: a likelihood ratio from its estimate alone.

Of n numbers with a prior of unit variance about zero, the posterior has the mean m and the covariance P. With k times
the standard deviation, prior information falls by D = 1 - 1/k^2, and the log-likelihood of the data grows by

    1/2 m^T (1/D - P)^-1 m  -  1/2 log|1 - D P|  -  n log k
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbaid_ros.core.geometry import Array

_FACTORS = (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
_SIZES = (1.25, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0)
# Of what is declared, so much is too small: before the data are asked.
_TOO_SMALL = 0.05


def gain(mean: Array, covariance: Array, most: float) -> tuple[float, float]:
    """Return the largest gain of log-likelihood, and the factor of the standard deviations with which it is reached.

    Parameters
    ----------
    mean, covariance : (n,), (n, n) of numbers of unit variance beforehand
    most : largest factor that is plausible
    """
    return _largest(mean, covariance, [factor for factor in _FACTORS if factor <= most])


def likely_size(mean: Array, covariance: Array) -> tuple[float, float]:
    """Return how many times as far from zero numbers are as declared, at least one, and the chance that it is more.

    The root mean square of one and the likeliest factor, by the chance of either; data that say nothing of the numbers
    leave it at one.

    Parameters
    ----------
    mean, covariance : (n,), (n, n) of numbers of unit variance beforehand
    """
    # What is known of them should be about as large as it is known, or a factor could gain nothing.
    if float(mean @ mean) <= len(mean) - float(np.trace(covariance)):
        return 1.0, 0.0
    most, factor = _largest(mean, covariance, _SIZES)
    odds = _TOO_SMALL * np.exp(min(most, 100.0))
    chance = max(0.0, (odds / (1.0 - _TOO_SMALL + odds) - _TOO_SMALL) / (1.0 - _TOO_SMALL))
    return float(np.sqrt(1.0 + chance * (factor**2 - 1.0))), float(chance)


def _largest(mean: Array, covariance: Array, factors: Sequence[float]) -> tuple[float, float]:
    known, directions = np.linalg.eigh(covariance)
    k = np.array(factors)[:, None]
    less = 1.0 - k**-2
    left = 1.0 - less * np.clip(known, 0.0, 1.0)
    gains = 0.5 * np.sum(less * (directions.T @ mean) ** 2 / left - np.log(left) - 2.0 * np.log(k), axis=1)
    place = int(np.argmax(gains))
    return float(gains[place]), float(factors[place])
