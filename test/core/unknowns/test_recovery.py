"""Robots that are off as much as is declared: followed, they are found within what is reported; ignored, far off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import chi2

from floating import float_freely, make, normalised
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.simulation.motion import Sinusoids
from mbaid_ros.core.trajectory.state import BODY
from mbaid_ros.core.unknowns.catalogue import catalogue
from observed import MID, observe, windows
from wrong_robots import DECLARED, LINKS, Wrong

SEEDS = range(3)
SECONDS = 25.0
# Ten parameters, one run in a thousand.
LIMIT = float(chi2.isf(1e-3, 10))


@dataclass(frozen=True)
class Run:
    """The last estimate of a run, and the errors of the unknowns' numbers (e,) with their covariance (e, e)."""

    samples: Samples
    last: Estimate
    error: Array
    covariance: Array


@pytest.fixture(scope='module')
def runs(servicer7: MomentumKernel, joints: Sinusoids, start: Array) -> list[Run]:
    return [_run(servicer7, joints, start, seed) for seed in SEEDS]


def _run(robot: MomentumKernel, joints: Sinusoids, start: Array, seed: int) -> Run:
    unknowns = catalogue(robot, DECLARED)
    rng = np.random.default_rng([seed, 3])
    numbers = tuple(rng.normal(size=unknown.count) for unknown in unknowns)
    wrong = Wrong.by(unknowns, numbers, robot.model.joints)
    samples = observe(wrong.read(float_freely(wrong.robot(robot), joints, start, SECONDS)), MID, seed)
    estimator = make(robot, MID, known_std=LINKS, uncertainty=DECLARED)
    last = estimator.update(windows(samples), 0)[-1]
    assert estimator._tracker is not None
    moments = estimator._tracker.moments()
    # The catalogue's order is that of the state: what is only read comes last in both.
    found, factor = moments.mean[BODY.stop :], moments.factor[BODY.stop :]
    return Run(samples, last, found - np.concatenate(numbers), factor @ factor.T)


def test_the_target_is_found_within_what_is_reported(runs: list[Run], servicer7: MomentumKernel) -> None:
    for run in runs:
        assert normalised(run.last, servicer7) < LIMIT
        assert run.last.status in {'estimating', 'converged'}
        assert not run.last.warnings
    # Of ten parameters each.
    low, high = chi2.interval(0.998, 10 * len(runs))
    assert low < sum(normalised(run.last, servicer7) for run in runs) < high


def test_the_innovations_are_as_large_as_they_should_be(runs: list[Run]) -> None:
    assert 0.9 < np.mean([run.last.residual**2 for run in runs]) < 1.15


def test_the_unknowns_are_found_within_what_is_reported(runs: list[Run]) -> None:
    for run in runs:
        low, high = chi2.interval(0.998, len(run.error))
        assert low < float(run.error @ np.linalg.solve(run.covariance, run.error)) < high
        # Some are learnt to a tenth of what was declared, and none is less known than before.
        deviation = np.sqrt(np.diag(run.covariance))
        assert deviation.min() < 0.12
        assert deviation.max() < 1.0 + 1e-9


def test_taken_for_exact_they_lead_far_astray_which_shows(runs: list[Run], servicer7: MomentumKernel) -> None:
    for run in runs:
        exact = make(servicer7, MID).update(windows(run.samples), 0)[-1]
        assert normalised(exact, servicer7) > 20.0 * LIMIT
        assert exact.status == 'inconsistent'
