"""Statistics of Monte Carlo runs."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from benchmarks.runs import Outcome
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import PARAMETERS
from mbaid_ros.replay.campaigns.statistics import QUANTILE

_BAND = 0.95


@dataclass(frozen=True)
class Summary:
    """One method in one case at one time.

    Attributes
    ----------
    rmse : (10,) of the parameters; NaN for those that the motion leaves open
    ratio : (10,) the same over the bound
    determined : smallest share of the runs in which a parameter was published
    coverage : (10,) share of the reported 95 % intervals that hold the truth; NaN where none are reported
    nees : mean squared error in the metric of the reported covariance, a parameter
    nees_band : that 95 % of such means lie in if the covariance is right
    """

    rmse: Array
    ratio: Array
    determined: float
    coverage: Array
    nees: float
    nees_band: tuple[float, float]

    @property
    def median(self) -> float:
        """Median over the parameters of RMSE over bound."""
        return float(np.nanmedian(self.ratio)) if np.any(np.isfinite(self.ratio)) else np.nan

    @property
    def worst(self) -> float:
        """Largest RMSE over bound."""
        return float(np.nanmax(self.ratio)) if np.any(np.isfinite(self.ratio)) else np.nan

    @property
    def worst_name(self) -> str:
        """Name of the parameter with the largest RMSE over bound."""
        return PARAMETERS[int(np.nanargmax(self.ratio))] if np.any(np.isfinite(self.ratio)) else ''

    @property
    def reports_std(self) -> bool:
        """Whether the method says how uncertain it is."""
        return bool(np.any(np.isfinite(self.coverage)))


def summarise(outcome: Outcome, truth: Array, bounds: Array) -> list[Summary]:
    """Return the statistics at each time.

    Parameters
    ----------
    outcome : of all seeds, (seeds, T, ...)
    truth : (10,)
    bounds : (T, 10)
    """
    return [
        _summary(outcome.parameters[:, row] - truth, outcome.std[:, row], outcome.error_norm[:, row], bounds[row])
        for row in range(len(bounds))
    ]


def _summary(error: Array, std: Array, error_norm: Array, bound: Array) -> Summary:
    free = np.isfinite(bound)
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', RuntimeWarning)  # nothing but NaN: no run has determined it
        rmse = np.where(free, np.sqrt(np.nanmean(error**2, axis=0)), np.nan)
        inside = np.where(np.isfinite(std) & np.isfinite(error), np.abs(error) < QUANTILE * std, np.nan)
        coverage = np.where(free, np.nanmean(inside, axis=0), np.nan)
        nees = float(np.nanmean(error_norm))
    runs = int(np.sum(np.isfinite(error_norm)))
    freedom = runs * int(np.sum(free))
    tails = (0.5 * (1.0 - _BAND), 0.5 * (1.0 + _BAND))
    low, high = (float(chi2.ppf(tail, freedom)) / freedom if freedom else np.nan for tail in tails)
    return Summary(
        rmse=rmse,
        ratio=rmse / bound,
        determined=float(np.min(np.mean(np.isfinite(error[:, free]), axis=0))),
        coverage=coverage,
        nees=nees,
        nees_band=(low, high),
    )
