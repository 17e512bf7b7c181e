"""Monte Carlo runs over cases and seeds, spread over processes: each run is one pass, read off at several times."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, fields

import numpy as np
from tqdm import tqdm

from benchmarks.data import Case, kernel, momentum_of, motion, moved, readings
from benchmarks.methods import METHODS, Identification
from mbaid_ros.core.estimate import Estimate
from mbaid_ros.core.geometry import Array


@dataclass(frozen=True)
class Outcome:
    """What one method, or many runs of it, said at T times.

    Attributes
    ----------
    parameters : (..., T, 10); NaN where not determined
    std : (..., T, 10), one standard deviation as reported; NaN where none is
    error_norm : (..., T) squared error in the metric of the reported covariance, a parameter (1 expected)
    """

    parameters: Array
    std: Array
    error_norm: Array

    def first(self, runs: int) -> Outcome:
        """Return the first of many runs."""
        return Outcome(*(getattr(self, field.name)[:runs] for field in fields(self)))

    @staticmethod
    def stack(outcomes: Sequence[Outcome]) -> Outcome:
        """Return the outcomes of several runs with a leading axis."""
        return Outcome(*(np.array([getattr(outcome, field.name) for outcome in outcomes]) for field in fields(Outcome)))


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
    seed: int
    methods: tuple[str, ...]
    times: tuple[float, ...]
    truth: Array  # (10,) physical parameters


def monte_carlo(
    plan: dict[Case, Job], truths: dict[str, Array], methods: tuple[str, ...], processes: int
) -> dict[Case, dict[str, Outcome]]:
    """Run every case with every seed.

    Parameters
    ----------
    plan : cases and what is wanted of them
    truths : (10,) true physical parameters of each robot
    methods : names in the registry
    processes : that work at the same time

    Returns
    -------
    By case and method an Outcome with leading axes (runs, times)
    """
    runs = [
        _Run(case, seed, chosen, job.times, truths[case.robot])
        for case, job in plan.items()
        for seed in range(job.seeds)
        if (chosen := tuple(name for name in methods if seed % METHODS[name].every == 0))
    ]
    # Simulated here, once; the workers inherit it.
    for robot in truths:
        motion(robot)
    results = list(tqdm(_outcomes(runs, processes), total=len(runs), unit=' runs', disable=None, leave=False))
    found = list(zip(runs, results, strict=True))
    return {
        case: {
            method: Outcome.stack([result[method] for run, result in found if run.case == case and method in result])
            for method in methods
        }
        for case in plan
    }


def _outcomes(runs: list[_Run], processes: int) -> Iterator[dict[str, Outcome]]:
    if processes == 1:
        yield from map(_outcome, runs)
        return
    with ProcessPoolExecutor(processes) as pool:
        yield from pool.map(_outcome, runs, chunksize=2)


def _outcome(run: _Run) -> dict[str, Outcome]:
    truth = moved(motion(run.case.robot), run.case)
    last = int(np.searchsorted(truth.time, max(run.times) + 1e-9))
    truth = truth[:last]
    streams = readings(truth, run.case.noise, run.seed)
    task = Identification(kernel(run.case.robot), run.case.noise, momentum_of(run.case.robot, truth))
    return {method: _read_off(task.estimates(method, *streams), run) for method in run.methods}


def _read_off(history: list[Estimate], run: _Run) -> Outcome:
    """Return what the last estimate before each of the times says."""
    places = np.searchsorted([estimate.time for estimate in history], np.array(run.times) - 1e-9) - 1
    chosen = [history[place] for place in places]
    return Outcome(
        parameters=np.array([estimate.parameters for estimate in chosen]),
        std=np.array([estimate.std for estimate in chosen]),
        error_norm=np.array([_error_norm(estimate, run.truth) for estimate in chosen]),
    )


def _error_norm(estimate: Estimate, truth: Array) -> float:
    known = np.isfinite(estimate.std) & np.isfinite(estimate.parameters)
    if not np.any(known):
        return np.nan
    deviation = estimate.std[known]
    error = (estimate.parameters - truth)[known] / deviation
    correlation = estimate.covariance[np.ix_(known, known)] / deviation / deviation[:, None]
    return float(error @ np.linalg.solve(correlation, error)) / len(error)
