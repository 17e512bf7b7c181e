"""One run of a robot that is not its URDF, and what many of them come to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from benchmarks.data import DURATION, MAXIMUM_GAP, RATE, Case, kernel, motion, observed
from benchmarks.model_errors.bound import Attainable, attainable
from benchmarks.model_errors.variant import LEVEL, Variant, settings
from benchmarks.store import Runs
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.identifier import Identifier
from mbaid_ros.core.results.budget import ErrorBudget
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.parameters import BAND, PARAMETERS
from mbaid_ros.core.robot.model_errors import ModelErrors
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.replay.campaigns.monte_carlo import nees
from mbaid_ros.session import make_estimator
from mbaid_ros.simulation.simulation import Truth
from mbaid_ros.simulation.true_robot import ErrorSizes


@dataclass(frozen=True)
class Said:
    """What a run of a minute said at its end.

    Attributes
    ----------
    status : of the estimate
    error, std : (10,) of the parameters; NaN where not published
    bound, robots_own : (10,) as `Attainable` has them, std and error; NaN where there is none to be compared with
    error_norm : squared error in the metric of the reported covariance, a parameter
    nis : mean normalised innovation squared
    words : its warnings but those of the error budget
    """

    status: str
    error: Array
    std: Array
    bound: Array
    robots_own: Array
    error_norm: float
    nis: float
    words: str


@dataclass(frozen=True)
class Outcome(Runs):
    """What the runs of a variant said: as in Said, with a leading axis."""

    status: Array
    error: Array
    std: Array
    bound: Array
    robots_own: Array
    error_norm: Array
    nis: Array
    words: Array

    @property
    def z(self) -> Array:
        """Errors over standard deviations, (S, 10)."""
        return np.asarray(self.error / self.std)

    @property
    def coverage(self) -> Array:
        """Share of the 95 % intervals that hold the truth, of each parameter, (10,); NaN where none is published."""
        return _mean(np.where(np.isfinite(self.z), np.abs(self.z) < BAND, np.nan))

    @property
    def over_bound(self) -> Array:
        """RMSE over the root mean square of the bounds of the same runs, (10,)."""
        return self._over_bound(self.error)

    @property
    def drawn_over_bound(self) -> Array:
        """The same of what the robots make by themselves to first order, (10,)."""
        return self._over_bound(self.robots_own)

    def _over_bound(self, error: Array) -> Array:
        there = np.isfinite(error) & np.isfinite(self.bound)
        squares = [_mean(np.where(there, values**2, np.nan)) for values in (error, self.bound)]
        return np.asarray(np.sqrt(squares[0] / squares[1]))

    @property
    def nees(self) -> tuple[float, float, float]:
        """Mean squared error in the metric of the covariance, a parameter, and the band that holds 95 % of such."""
        there = np.isfinite(self.error_norm)
        freedom = float(np.sum(np.isfinite(self.z[there])))
        if not freedom:
            return np.nan, np.nan, np.nan
        weight = np.sum(np.isfinite(self.z[there]), axis=1)
        low, high = (float(chi2.ppf(tail, freedom)) / freedom for tail in (0.025, 0.975))
        return float(np.sum(weight * self.error_norm[there]) / freedom), low, high

    @property
    def largest(self) -> tuple[float, str, int]:
        """Largest |error| in standard deviations, whose parameter it is of, and the seed."""
        size = np.where(np.isfinite(self.z), np.abs(self.z), -1.0)
        seed, place = np.unravel_index(int(np.argmax(size)), size.shape)
        return float(size[seed, place]), PARAMETERS[int(place)], int(seed)


def run(work: tuple[Variant, int, bool]) -> Said:
    """Draw a robot, move it, and identify what it holds.

    Parameters
    ----------
    work : a variant, the seed of robot and noise, and whether its bound is wanted
    """
    variant, seed, bounded = work
    errors = variant.errors(seed)
    moved = motion(variant.robot, RATE, errors)
    estimate = _estimates(variant, seed, errors, moved)[-1]
    truth = physical(kernel(variant.robot).target.parameters)
    best = attainable(variant.robot, moved, errors, variant.sizes) if bounded else Attainable(*np.full((2, 10), np.nan))
    words = '; '.join(estimate.warnings)
    return Said(
        estimate.status,
        estimate.parameters - truth,
        estimate.std,
        best.std,
        best.error,
        nees(estimate, truth),
        estimate.residual**2,
        words,
    )


def estimates(variant: Variant, seed: int) -> list[Estimate]:
    """Return all estimates of a run."""
    errors = variant.errors(seed)
    return _estimates(variant, seed, errors, motion(variant.robot, RATE, errors))


def _estimates(variant: Variant, seed: int, errors: ModelErrors, truth: Truth) -> list[Estimate]:
    truth = truth[: int(np.searchsorted(truth.time, DURATION + 1e-9))]
    streams = observed(truth, Case(variant.robot, LEVEL), seed, errors)
    return identifier(variant.robot, variant.told).push(*streams)


def identifier(robot: str, told: ErrorSizes) -> Identifier:
    """Return the default method, told how robots are drawn; default parameters otherwise."""
    config = build(EstimatorConfig, settings(told))
    return Identifier(make_estimator(config, kernel(robot)), config.window, MAXIMUM_GAP)


def budget(variant: Variant, seed: int) -> ErrorBudget:
    """Return the error budget at the end of a run.

    Raises
    ------
    ValueError
        The run has come to none.
    """
    found = estimates(variant, seed)[-1].budget
    if found is None:
        raise ValueError(f'no error budget of {variant.robot} with seed {seed}')
    return found


def _mean(values: Array) -> Array:
    """Return the means of columns without their NaN; NaN where there is nothing else."""
    count = np.sum(np.isfinite(values), axis=0)
    return np.where(count > 0, np.nansum(values, axis=0) / np.maximum(count, 1), np.nan)
