"""Monte Carlo over cases, methods and seeds, spread over processes: each run is one pass, read off several times."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.data import Case, kernel, momentum_of, motion, moved, observed
from benchmarks.driver import driving
from benchmarks.methods import METHODS, Identification
from benchmarks.store import Runs
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.sensors.levels import CHANNELS
from mbaid_ros.replay.campaigns.monte_carlo import nees


@dataclass(frozen=True)
class Outcome(Runs):
    """What one method, or many runs of it, said at T times.

    Attributes
    ----------
    parameters : (..., T, 10); NaN where not determined
    std : (..., T, 10), one standard deviation as reported; NaN where none is
    error_norm : (..., T) squared error in the metric of the reported covariance, a parameter (1 expected)
    converged : (..., T) 1 where that is the status
    alarms, estimates : (..., T) how many estimates up to then were `inconsistent`, and how many there were
    noise : (..., T, 6) that is found of each sensor over the true one; NaN where none is
    """

    parameters: Array
    std: Array
    error_norm: Array
    converged: Array
    alarms: Array
    estimates: Array
    noise: Array

    def at(self, time: int) -> Outcome:
        """Return what was said at one of the times, whose axis is the second one."""
        return Outcome.of(lambda name: getattr(self, name)[:, time])


@dataclass(frozen=True)
class Job:
    """What is wanted of one case.

    Attributes
    ----------
    times : s, at which the estimates are read off
    seeds : number of runs, with seeds from 0
    """

    times: tuple[float, ...]
    seeds: int


@dataclass(frozen=True)
class _Run:
    case: Case
    method: str
    seed: int
    times: tuple[float, ...]
    truth: Array  # (10,) physical parameters


def monte_carlo(
    plan: dict[Case, Job], truths: dict[str, Array], methods: tuple[str, ...], processes: int, store: Path | None
) -> dict[Case, dict[str, Outcome]]:
    """Run every case with every method and seed.

    Parameters
    ----------
    plan : cases and what is wanted of them
    truths : (10,) true physical parameters of each robot
    methods : names in the registry
    processes : that work at the same time
    store : folder that keeps the outcome of every case and method; the runs that it holds are not made again

    Returns
    -------
    By case and method an Outcome with leading axes (runs, times)
    """
    # Simulated here, once; the workers inherit it.
    for robot in truths:
        motion(robot)
    wanted = {
        (case, method): [
            _Run(case, method, seed, job.times, truths[case.robot])
            for seed in range(METHODS[method].runs(job.seeds, plain=case.plain))
        ]
        for case, job in plan.items()
        for method in methods
        if METHODS[method].takes(case)
    }
    results: dict[Case, dict[str, Outcome]] = {case: {} for case in plan}
    total = sum(len(runs) for runs in wanted.values())
    with driving(total, processes, store) as driver:
        for (case, method), runs in wanted.items():
            results[case][method] = driver.completed(Outcome, _file_name(case, method), runs, _outcome)
    return results


def _file_name(case: Case, method: str) -> str:
    return f'{case.name}-{method}'.replace(' ', '_').replace('/', '_per_')


def _outcome(run: _Run) -> Outcome:
    truth = moved(motion(run.case.robot), run.case)
    last = int(np.searchsorted(truth.time, max(run.times) + 1e-9))
    truth = truth[:last]
    streams = observed(truth, run.case, run.seed)
    task = Identification(kernel(run.case.robot), run.case.noise, momentum_of(run.case.robot, truth))
    return _read_off(task.estimates(run.method, *streams), run)


def _read_off(history: list[Estimate], run: _Run) -> Outcome:
    """Return what the last estimate before each of the times says."""
    places = np.searchsorted([estimate.time for estimate in history], np.array(run.times) - 1e-9) - 1
    chosen = [history[place] for place in places]
    alarms = np.cumsum([estimate.status == 'inconsistent' for estimate in history])
    return Outcome(
        parameters=np.array([estimate.parameters for estimate in chosen]),
        std=np.array([estimate.std for estimate in chosen]),
        error_norm=np.array([nees(estimate, run.truth) for estimate in chosen]),
        converged=np.array([estimate.status == 'converged' for estimate in chosen], dtype=float),
        alarms=alarms[places].astype(float),
        estimates=1.0 + places,
        noise=np.array([_found(estimate) / _levels(run.case) for estimate in chosen]),
    )


def _found(estimate: Estimate) -> Array:
    return np.full(len(CHANNELS), np.nan) if estimate.noise is None else estimate.noise.found


def _levels(case: Case) -> Array:
    return np.array([getattr(case.noise, channel) for channel in CHANNELS])
