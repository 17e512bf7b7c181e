"""Monte Carlo over cases, methods and seeds, spread over processes: each run is one pass, read off several times."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks.data import Case, kernel, momentum_of, motion, moved, observed
from benchmarks.methods import METHODS, Identification
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.replay.campaigns.make import nees


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

    def followed_by(self, other: Outcome) -> Outcome:
        """Return these runs and other ones."""
        pairs = ((getattr(self, field.name), getattr(other, field.name)) for field in fields(self))
        return Outcome(*(np.concatenate(pair) for pair in pairs))

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
            _Run(case, method, seed, job.times, truths[case.robot]) for seed in range(METHODS[method].runs(job.seeds))
        ]
        for case, job in plan.items()
        for method in methods
        if case.plain or case.drift or case.offset or not METHODS[method].papers
    }
    results: dict[Case, dict[str, Outcome]] = {case: {} for case in plan}
    total = sum(len(runs) for runs in wanted.values())
    with (
        tqdm(total=total, unit=' runs', disable=None, leave=False) as bar,
        ProcessPoolExecutor(processes) as pool,
    ):
        for (case, method), runs in wanted.items():
            outcome = _stored(store, case, method)
            done = 0 if outcome is None else min(len(outcome.parameters), len(runs))
            bar.update(done)
            if done < len(runs):
                rest = Outcome.stack([_counted(item, bar) for item in pool.map(_outcome, runs[done:], chunksize=2)])
                outcome = rest if outcome is None else outcome.followed_by(rest)
                _keep(store, case, method, outcome)
            if outcome is not None:
                results[case][method] = outcome.first(len(runs))
    return results


def _counted(outcome: Outcome, bar: Any) -> Outcome:
    bar.update(1)
    return outcome


def _file(store: Path, case: Case, method: str) -> Path:
    return store / f'{case.name}-{method}.npz'.replace(' ', '_').replace('/', '_per_')


def _stored(store: Path | None, case: Case, method: str) -> Outcome | None:
    """Return what a store holds of a case."""
    if store is None or not _file(store, case, method).is_file():
        return None
    with np.load(_file(store, case, method)) as arrays:
        return Outcome(*(arrays[field.name] for field in fields(Outcome)))


def _keep(store: Path | None, case: Case, method: str, outcome: Outcome) -> None:
    if store is not None:
        store.mkdir(parents=True, exist_ok=True)
        np.savez(_file(store, case, method), **{field.name: getattr(outcome, field.name) for field in fields(Outcome)})


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
    return Outcome(
        parameters=np.array([estimate.parameters for estimate in chosen]),
        std=np.array([estimate.std for estimate in chosen]),
        error_norm=np.array([nees(estimate, run.truth) for estimate in chosen]),
    )
