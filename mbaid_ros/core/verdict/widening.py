"""What data would gain if something were less certain than declared: a likelihood ratio from its estimate alone.

Of n numbers with a prior of unit variance about zero, the posterior has the mean m and the covariance P. With k times
the standard deviation, prior information grows by D = (1/k^2 - 1), and the log-likelihood of the data by

    1/2 m^T ((1 - 1/k^2)^-1 - P)^-1 m  -  1/2 log|1 + D P|  -  n log k
"""

from __future__ import annotations

import math

import numpy as np

from mbaid_ros.core.geometry import Array

_FACTORS = (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)


def gain(mean: Array, covariance: Array, most: float) -> tuple[float, float]:
    """Return the largest gain of log-likelihood, and the factor of the standard deviations with which it is reached.

    Parameters
    ----------
    mean, covariance : (n,), (n, n) of numbers of unit variance beforehand
    most : largest factor that is plausible
    """
    return max((_gain(mean, covariance, factor), factor) for factor in _FACTORS if factor <= most)


def _gain(mean: Array, covariance: Array, factor: float) -> float:
    less = 1.0 - factor**-2
    left = np.eye(len(mean)) - less * covariance
    sign, logarithm = np.linalg.slogdet(left)
    if sign <= 0.0:  # rounding: the data say nothing of it
        return 0.0
    quadratic = less * float(mean @ np.linalg.solve(left, mean))
    return 0.5 * quadratic - 0.5 * float(logarithm) - len(mean) * math.log(factor)
