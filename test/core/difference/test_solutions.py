"""What a second stage takes over from the weighted difference form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from mbaid_ros.core.difference.estimator import DifferenceEstimator
from mbaid_ros.core.difference.solutions import DifferenceSolution
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.core.simulation.run import Truth, total_momentum
from observed import HIGH, MID, estimator, kernel, observe, windows


def identified(name: str, truth: Truth, noise: SensorNoise, seed: int, **parameters: object) -> DifferenceEstimator:
    found = estimator(kernel(name), noise, **parameters)
    assert isinstance(found, DifferenceEstimator)
    assert found.solution is None
    assert found.shares == {}
    found.update(windows(observe(truth, noise, seed)), 0)
    return found


def solution(name: str, truth: Truth, noise: SensorNoise, seed: int, **parameters: object) -> DifferenceSolution:
    found = identified(name, truth, noise, seed, **parameters).solution
    assert found is not None
    return found


def true_solution(name: str, truth: Truth) -> Array:
    """Return the true x with the angular momentum about the odometry's origin."""
    robot = kernel(name)
    return np.concatenate((robot.target.parameters, total_momentum(robot.model, truth[:1])[0]))


@pytest.mark.parametrize(('name', 'numbers'), [('servicer7', 16), ('table1', 7)])
def test_the_truth_is_as_far_as_the_covariance_says(spatial: Truth, planar: Truth, name: str, numbers: int) -> None:
    truth = spatial if name == 'servicer7' else planar
    exact, none = true_solution(name, truth), np.zeros((16, 16))
    squares = []
    for seed in range(5):
        found = solution(name, truth, MID, seed).about(np.zeros(3))
        assert found.determined
        assert found.planar == (name == 'table1')
        squares.append(found.distance(exact, none))
    assert chi2.ppf(1e-3, 5 * numbers) < sum(squares) < 1.25 * chi2.isf(1e-3, 5 * numbers)


def test_two_runs_agree_within_both_covariances(spatial: Truth) -> None:
    one, other = (solution('servicer7', spatial, MID, seed).about(np.ones(3)) for seed in (1, 2))
    square = one.distance(other.x, other.covariance)
    assert square == pytest.approx(other.distance(one.x, one.covariance), rel=1e-6)
    assert chi2.ppf(1e-3, 16) < square < 1.25 * chi2.isf(1e-3, 16)
    # Another body is another one.
    heavier = other.x.copy()
    heavier[0] += 20.0 * np.sqrt(one.covariance[0, 0] + other.covariance[0, 0])
    assert one.distance(heavier, other.covariance) > 300.0


def test_another_origin_and_back(spatial: Truth) -> None:
    found = solution('servicer7', spatial, MID, 3)
    origin = found.origin + np.array([1.0, -2.0, 0.5])
    moved = found.about(origin)
    assert moved.x[13:] == pytest.approx(found.x[13:] - np.cross(origin - found.origin, found.x[10:13]))
    back = moved.about(found.origin)
    assert back.x == pytest.approx(found.x, rel=1e-12)
    assert back.covariance == pytest.approx(found.covariance, rel=1e-9, abs=1e-12)


def test_little_data_do_not_determine_a_body(spatial: Truth) -> None:
    assert not solution('servicer7', spatial[:40], HIGH, 0).determined


def test_shares_of_the_known_bodies(spatial: Truth) -> None:
    found = identified('servicer7', spatial, MID, 0, known_links__relative_std=0.01)
    shares = found.shares
    assert max(shares, key=lambda label: shares[label]) == 'link:base_link'
    assert all(0.0 <= share <= 1.0 for share in shares.values())
    exact = solution('servicer7', spatial, MID, 0)
    wider = found.solution
    assert wider is not None
    assert np.all(np.diag(wider.covariance) > np.diag(exact.covariance))
