"""The trajectory filter from a cold start: what it finds lies where its covariance says."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from floating import errors, follow, normalised, true_momentum
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.unknowns.catalogue import Uncertainty
from mbaid_ros.session.known_robot import KnownRobot
from mbaid_ros.session.methods import make_estimator
from mbaid_ros.simulation.simulation import Truth
from observed import HIGH, MID, kernel, observe, windows


def until(samples: Samples, seconds: float) -> Samples:
    return samples[: int(np.searchsorted(samples.time, seconds - 1e-9))]


def covered(surprises: list[float], freedom: int) -> bool:
    """Return whether errors are as large as covariances say: their sum within 99.8 % of chi-square."""
    low, high = chi2.interval(0.998, freedom * len(surprises))
    return bool(low < sum(surprises) < high)


@pytest.mark.parametrize(
    ('case', 'seeds'),
    [
        ('servicer', 2),
        ('satellite', 2),
        *(pytest.param(case, 4, marks=pytest.mark.long) for case in ('servicer', 'satellite')),
    ],
)
def test_a_cold_start(case: str, seeds: int, servicer: Truth, satellite: Truth) -> None:
    truth, robot = (servicer, kernel('servicer7')) if case == 'servicer' else (satellite, kernel('ets7'))
    total = true_momentum(robot, observe(truth, MID))[0]
    surprises, momenta = [], []
    for seed in range(1, 1 + seeds):
        last = follow(robot, until(observe(truth, MID, seed), 10.0), MID)[-1]
        assert last.status in {'estimating', 'converged'}
        assert np.all(last.identifiable)
        assert np.all(np.abs(errors(last, robot)) < 4.5 * last.std)
        surprises.append(normalised(last, robot))
        change = last.momentum - total
        momenta.append(float(change @ np.linalg.solve(last.momentum_covariance, change)))
        # Of 220 or so normalised innovations: four standard deviations.
        assert last.residual**2 == pytest.approx(1.0, abs=0.4)
    assert covered(surprises, 10)
    assert covered(momenta, 6)


def test_a_robot_without_unknowns_is_followed_without_a_word_on_the_terminal(
    robot: MomentumKernel, servicer: Truth, capfd: pytest.CaptureFixture[str]
) -> None:
    estimator = make_estimator(build(EstimatorConfig, EXACT), robot, KnownRobot(robot, Uncertainty()))
    last = estimator.update(windows(until(observe(servicer, MID, 1), 6.0)), 0)[-1]
    assert last.status in {'estimating', 'converged'}
    assert capfd.readouterr() == ('', '')


def test_knots_follow_data_better_than_any_sensor_s(robot: MomentumKernel, servicer: Truth) -> None:
    finest = SensorNoise(*(1e-3 * np.array([1e-4, 1e-3, 1e-3, 1e-4, 1e-3, 1e-4])))
    history = follow(robot, until(observe(servicer, finest, 1), 15.0), finest)
    assert not any(each.status == 'inconsistent' or each.events for each in history)
    assert np.all(np.abs(errors(history[-1], robot)) < 4.5 * history[-1].std)


def test_a_guess_that_leads_astray_does_not_end_the_run(robot: MomentumKernel, servicer: Truth) -> None:
    # From the heaviest guess the passes over this draw lead to a robot that turns a thousand times a second.
    last = follow(robot, until(observe(servicer, HIGH, 3), 8.0), HIGH)[-1]
    assert last.status == 'estimating'
    assert normalised(last, robot) < chi2.isf(1e-3, 10)


def test_a_gap_of_several_seconds(robot: MomentumKernel, servicer: Truth) -> None:
    samples = observe(servicer, MID, 3)
    later = samples[int(np.searchsorted(samples.time, 12.1)) :]
    out = follow(robot, Samples.concatenate([until(samples, 8.3), later]), MID)
    last = out[-1]
    assert normalised(last, robot) < chi2.isf(1e-3, 10)
    assert not last.events
    assert last.residual**2 == pytest.approx(1.0, abs=0.3)
    # What was learnt before the gap still counts.
    after = follow(robot, until(observe(servicer, MID, 3), 8.0), MID)[-1]
    assert np.all(last.std < after.std)
