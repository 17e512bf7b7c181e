"""Statistics of many runs: how large errors are, and whether the reported uncertainties hold what they promise."""

from __future__ import annotations

import warnings

import numpy as np
from scipy.special import chdtri, ndtri

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate

BAND = 0.95
QUANTILE = float(ndtri(0.5 * (1.0 + BAND)))  # standard deviations either side that hold 95 %


def mean(values: Array) -> Array:
    """Return the means over the runs, the first axis, of what is no NaN; NaN where nothing is."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', RuntimeWarning)  # a column of nothing but NaN
        return np.asarray(np.nanmean(values, axis=0)) if len(values) else np.full(values.shape[1:], np.nan)


def rmse(error: Array) -> Array:
    """Return the root mean square over the runs, the first axis, of errors that are no NaN."""
    return np.sqrt(mean(error**2))


def coverage(error: Array, std: Array) -> Array:
    """Return the share of the runs, the first axis, with the truth within the 95 % interval, where there is one."""
    known = np.isfinite(error) & np.isfinite(std)
    return mean(np.where(known, np.abs(error) < QUANTILE * std, np.nan))


def nees(estimate: Estimate, truth: Array) -> float:
    """Return the squared error of an estimate in the metric of its covariance, a parameter: 1 is expected.

    Parameters
    ----------
    estimate : Estimate
    truth : (10,) in the order of PARAMETERS

    Returns
    -------
    The normalised estimation error squared, over the number of parameters that are determined; NaN if none is.
    """
    known = np.isfinite(estimate.std) & np.isfinite(estimate.parameters)
    if not np.any(known):
        return np.nan
    deviation = estimate.std[known]
    error = (estimate.parameters - truth)[known] / deviation
    correlation = estimate.covariance[np.ix_(known, known)] / deviation / deviation[:, None]
    return float(error @ np.linalg.solve(correlation, error)) / len(error)


def nees_band(freedom: int) -> tuple[float, float]:
    """Return what 95 % of the mean NEES lie in if the covariances are right.

    Parameters
    ----------
    freedom : number of parameters that were determined, of all runs together
    """
    # chdtri: quantiles of the chi-square distribution from above.
    tails = (0.5 * (1.0 + BAND), 0.5 * (1.0 - BAND))
    low, high = (float(chdtri(freedom, tail)) / freedom if freedom else np.nan for tail in tails)
    return low, high
