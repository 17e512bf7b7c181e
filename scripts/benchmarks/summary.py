"""Statistics of Monte Carlo runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.runs import Outcome
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.parameters import PARAMETERS
from mbaid_ros.replay.campaigns.monte_carlo import coverage, mean, nees_band, rmse


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
    converged : share of the runs with that status
    alarms, estimates : of all runs up to then, how many estimates were `inconsistent`, and how many there were
    noise : (runs, 6) that was found of each sensor over the true one
    """

    rmse: Array
    ratio: Array
    determined: float
    coverage: Array
    nees: float
    nees_band: tuple[float, float]
    converged: float
    alarms: int
    estimates: int
    noise: Array

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
    return [_summary(outcome.at(time), truth, bound) for time, bound in enumerate(bounds)]


def _summary(said: Outcome, truth: Array, bound: Array) -> Summary:
    """Return the statistics of what all runs said at one time."""
    error, free = said.parameters - truth, np.isfinite(bound)
    size = np.where(free, rmse(error), np.nan)
    runs = int(np.sum(np.isfinite(said.error_norm)))
    return Summary(
        rmse=size,
        ratio=size / bound,
        determined=float(np.min(np.mean(np.isfinite(error[:, free]), axis=0))),
        coverage=np.where(free, coverage(error, said.std), np.nan),
        nees=float(mean(said.error_norm)),
        nees_band=nees_band(runs * int(np.sum(free))),
        converged=float(np.mean(said.converged)),
        alarms=int(np.sum(said.alarms)),
        estimates=int(np.sum(said.estimates)),
        noise=said.noise,
    )
