"""The methods compared, their runs over cases and seeds, and their statistics beside the bounds."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from benchmarks.data import MAXIMUM_GAP, Case, kernel, momentum_of, motion, observed, target
from benchmarks.frame import Frame, Runs, declared
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.noise import CHANNELS, NoiseEstimator
from mbaid_ros.core.pipeline import Identifier
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.samples import BaseStream, JointStream, SensorNoise
from mbaid_ros.parameters import build
from mbaid_ros.replay.campaigns.statistics import coverage, mean, nees, nees_band, rmse
from mbaid_ros.session.methods import make_estimator


@dataclass(frozen=True)
class Method:
    """A method: its parameters, and for which cases and how many seeds it runs."""

    settings: Mapping[str, object]
    share: float = 1.0  # of the seeds
    fewest: int = 0  # seeds at least, if there are so many
    papers: bool = False  # a method of the paper takes all velocities, and reports no uncertainty
    finds_noise: bool = False  # the noise is estimated, not declared

    def runs(self, case: Case, seeds: int) -> int:
        """Return for how many of a case's seeds it runs; cases that are not plain have few, and run all or none."""
        if case.plain:
            return max(round(self.share * seeds), min(self.fewest, seeds))
        return 0 if self.finds_noise or self.papers else seeds


METHODS = {
    'difference': Method({'method': 'difference'}),
    'trajectory': Method({'method': 'trajectory'}, 0.5, 100),
    'trajectory, noise found': Method({'method': 'trajectory'}, 0.5, 100, finds_noise=True),
    'paper_main': Method({'method': 'paper_main'}, 0.05, 10, papers=True),
    'paper_difference previous': Method(
        {'method': 'paper_difference', 'paper.reference': 'previous'}, 0.05, 10, papers=True
    ),
    'paper_difference first': Method({'method': 'paper_difference', 'paper.reference': 'first'}, 0.05, 10, papers=True),
}


def estimates(
    robot: str, noise: SensorNoise, momentum: Array, method: str, read: tuple[JointStream, BaseStream]
) -> list[Estimate]:
    """Return all estimates of one run of a robot that is exactly its URDF; paper_main is given its momentum (6,)."""
    given = {'paper.total_angular_momentum': momentum[3:].tolist(), **METHODS[method].settings}
    config = build(EstimatorConfig, {**EXACT, **declared(noise), **given})
    found = NoiseEstimator(noise, kernel(robot).model.joints, estimate=METHODS[method].finds_noise)
    return Identifier(make_estimator(config, kernel(robot)), config.window, MAXIMUM_GAP, noise=found).push(*read)


Times = tuple[float, ...]


@dataclass(frozen=True)
class Outcome(Runs):
    """Estimates of one method at T times."""

    parameters: Array  # (..., T, 10); NaN where not determined
    std: Array  # (..., T, 10); NaN where not reported
    error_norm: Array  # (..., T) NEES, a parameter
    converged: Array  # (..., T) whether that is the status
    alarms: Array  # (..., T) estimates until then with the status `inconsistent`
    estimates: Array  # (..., T) estimates until then
    noise: Array  # (..., T, 6) estimated over true, by sensor channel

    def at(self, time: int) -> 'Outcome':
        """Return the estimates at one of the times, whose axis is the second one."""
        return Outcome.of(lambda name: getattr(self, name)[:, time])


def run(row: tuple[Case, str, Times], seed: int) -> Outcome:
    """Return the last estimates of a case and a method before some times."""
    case, method, times = row
    truth = motion(case.robot)
    truth = truth[: int(np.searchsorted(truth.time, max(times) + 1e-9))]
    history = estimates(case.robot, case.noise, momentum_of(case.robot, truth), method, observed(truth, case, seed))
    places = np.searchsorted([estimate.time for estimate in history], np.array(times) - 1e-9) - 1
    chosen = [history[place] for place in places]
    alarms = np.cumsum([estimate.status == 'inconsistent' for estimate in history])
    levels, nothing = np.array([getattr(case.noise, channel) for channel in CHANNELS]), np.full(len(CHANNELS), np.nan)
    return Outcome(
        parameters=np.array([estimate.parameters for estimate in chosen]),
        std=np.array([estimate.std for estimate in chosen]),
        error_norm=np.array([nees(estimate, target(case.robot)) for estimate in chosen]),
        converged=np.array([estimate.status == 'converged' for estimate in chosen], dtype=float),
        alarms=alarms[places].astype(float),
        estimates=1.0 + places,
        noise=np.array([(nothing if each.noise is None else each.noise.estimated) / levels for each in chosen]),
    )


def monte_carlo(frame: Frame, plan: dict[Case, tuple[Times, int]]) -> dict[Case, dict[str, Outcome]]:
    """Return the outcomes by case and method; the plan has times and number of seeds of each case."""
    for case in plan:
        motion(case.robot)  # simulated here once; the workers inherit it
    counts = {
        (case, name, times): method.runs(case, seeds)
        for case, (times, seeds) in plan.items()
        for name, method in METHODS.items()
        if method.runs(case, seeds)
    }
    files = {row: f'{row[0].name}-{row[1]}' for row in counts}
    results: dict[Case, dict[str, Outcome]] = {case: {} for case in plan}
    for (case, method, _), outcome in frame.outcomes(Outcome, run, files, counts):
        results[case][method] = outcome
    return results


@dataclass(frozen=True)
class Summary:
    """Statistics of one method in one case at one time."""

    rmse: Array  # (10,) NaN for what the motion leaves open
    ratio: Array  # (10,) the same over the bound
    determined: float  # smallest share of the runs in which a parameter was published
    coverage: Array  # (10,) share of the 95 % intervals that hold the truth; NaN where none are reported
    nees: float  # mean, a parameter
    nees_band: tuple[float, float]  # of 95 % of such means if the covariance is right
    converged: float  # share of the runs
    alarms: int  # estimates of all runs until then with the status `inconsistent`
    estimates: int
    noise: Array  # (runs, 6)


def summarise(found: Outcome, truth: Array, bound: Array) -> Summary:
    """Return the statistics at one time; truth and bound (10,)."""
    error, free = found.parameters - truth, np.isfinite(bound)
    size = np.where(free, rmse(error), np.nan)
    runs = int(np.sum(np.isfinite(found.error_norm)))
    return Summary(
        rmse=size,
        ratio=size / bound,
        determined=float(np.min(np.mean(np.isfinite(error[:, free]), axis=0))),
        coverage=np.where(free, coverage(error, found.std), np.nan),
        nees=float(mean(found.error_norm)),
        nees_band=nees_band(runs * int(np.sum(free))),
        converged=float(np.mean(found.converged)),
        alarms=int(np.sum(found.alarms)),
        estimates=int(np.sum(found.estimates)),
        noise=found.noise,
    )
