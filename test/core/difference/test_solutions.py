"""What the weighted difference form knows, by what it publishes: as wide as it has to be, and no wider."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.stats import chi2

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.simulation.simulation import Truth, total_momentum
from observed import HIGH, MID, estimator, kernel, observe, windows


def identified(name: str, truth: Truth, noise: SensorNoise, seed: int, **parameters: object) -> Estimate:
    return estimator(kernel(name), noise, **parameters).update(windows(observe(truth, noise, seed)), 0)[-1]


def squared(error: Array, covariance: Array) -> float:
    """Return the squared Mahalanobis distance."""
    size = np.sqrt(np.diag(covariance))
    return float(error / size @ np.linalg.solve(covariance / size / size[:, None], error / size))


@pytest.mark.parametrize(('name', 'numbers'), [('servicer7', 16), ('table1', 7)])
def test_the_truth_is_as_far_as_the_covariance_says(spatial: Truth, planar: Truth, name: str, numbers: int) -> None:
    truth = spatial if name == 'servicer7' else planar
    robot = kernel(name)
    body, momentum = physical(robot.target.parameters), total_momentum(robot.model, truth[:1])[0]
    bodies, momenta = [], []
    for seed in range(5):
        found = identified(name, truth, MID, seed)
        told, moves = found.identifiable, np.diag(found.momentum_covariance) < 1e7
        assert told.sum() + moves.sum() == numbers
        bodies.append(squared((found.parameters - body)[told], found.covariance[np.ix_(told, told)]))
        momenta.append(squared((found.momentum - momentum)[moves], found.momentum_covariance[np.ix_(moves, moves)]))
    for squares, count in ((bodies, told.sum()), (momenta, moves.sum())):
        assert sum(squares) < 1.25 * chi2.isf(1e-3, 5 * count)
        # The momentum of a planar motion is better known than is told: half its standard deviation.
        if numbers == 16 or squares is bodies:
            assert chi2.ppf(1e-3, 5 * count) < sum(squares)


def test_two_runs_agree_within_both_covariances(spatial: Truth) -> None:
    one, other = (identified('servicer7', spatial, MID, seed) for seed in (1, 2))
    apart, both = other.parameters - one.parameters, one.covariance + other.covariance
    assert chi2.ppf(1e-3, 10) < squared(apart, both) < 1.25 * chi2.isf(1e-3, 10)
    # Another body is another one.
    apart[0] += 20.0 * np.sqrt(both[0, 0])
    assert squared(apart, both) > 300.0


def test_little_data_do_not_determine_a_body(spatial: Truth) -> None:
    assert not identified('servicer7', spatial[:40], HIGH, 0).identifiable.all()


def test_known_bodies_in_doubt_widen_the_estimate_and_the_worst_is_told(spatial: Truth) -> None:
    wider, exact = (
        identified('servicer7', spatial, MID, 0, known_links__relative_std=known_std) for known_std in (0.01, 0.0)
    )
    assert np.all(np.diag(wider.covariance) > np.diag(exact.covariance))
    (told,) = (line for line in wider.warnings if 'of the variance is due' in line)
    whole, own = (int(share) for share in re.findall(r'(\d+) %', told))
    assert 50 < own <= whole <= 100
    assert told.endswith('to link:base_link alone')
    assert not any('of the variance is due' in line for line in exact.warnings)
