"""What data would gain by less certainty, against the data themselves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import chdtri
from scipy.stats import multivariate_normal

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.variance_components import PriorComparison

NUMBERS, MEASURED = 4, 6
BEFORE = 0.05  # chance that they are declared too certain


def posterior(rows: Array, data: Array) -> tuple[Array, Array]:
    """Return mean and covariance of numbers of unit variance after data = rows numbers + noise of unit variance."""
    covariance = np.linalg.inv(np.eye(rows.shape[1]) + rows.T @ rows)
    return covariance @ rows.T @ data, covariance


def drawn(seed: int, size: float, seen: float) -> tuple[Array, Array]:
    """Return the posterior of numbers that are so many times as large as declared."""
    random = np.random.default_rng(seed)
    rows = seen * random.normal(size=(MEASURED, NUMBERS))
    return posterior(rows, rows @ (size * random.normal(size=NUMBERS)) + random.normal(size=MEASURED))


@pytest.mark.parametrize('seed', range(5))
def test_the_gain_is_that_of_the_likelihood_of_the_data(seed: int) -> None:
    random = np.random.default_rng(seed)
    rows, data = random.normal(size=(MEASURED, NUMBERS)), 5.0 * random.normal(size=MEASURED)

    def likelihood(factor: float) -> float:
        covariance = np.eye(MEASURED) + factor**2 * rows @ rows.T
        return float(multivariate_normal(np.zeros(MEASURED), covariance).logpdf(data))

    expected = {factor: likelihood(factor) - likelihood(1.0) for factor in (3.0, 10.0)}
    most, factor = PriorComparison.of(*posterior(rows, data)).gain(10.0)
    assert factor == max(expected, key=lambda each: expected[each])
    assert most == pytest.approx(expected[float(factor)], rel=1e-9)


def test_what_is_as_large_as_declared_stays() -> None:
    sizes = [PriorComparison.of(*drawn(seed, 1.0, 10.0)).likely_sizes(BEFORE, BEFORE)[0] for seed in range(500)]
    assert np.median(sizes) < 1.05
    assert np.mean(np.array(sizes) > 1.5) < 0.03


@pytest.mark.parametrize('size', [3.0, 6.0])
def test_what_is_larger_is_found_to_be(size: float) -> None:
    found = np.array(
        [PriorComparison.of(*drawn(seed, size, 10.0)).likely_sizes(BEFORE, BEFORE)[:2] for seed in range(200)]
    )
    assert 0.7 * size < np.median(found[:, 0]) < 1.3 * size
    assert np.median(found[:, 1]) > 0.9


def test_numbers_that_data_say_nothing_of_stay_as_declared() -> None:
    mean, covariance = drawn(0, 3.0, 1e-6)
    assert PriorComparison.of(mean, covariance).likely_sizes(BEFORE, BEFORE)[:2] == pytest.approx((1.0, 0.0), abs=1e-3)
    assert [*PriorComparison.of(np.zeros(NUMBERS), np.eye(NUMBERS)).likely_sizes(BEFORE, BEFORE)] == [1.0, 0.0, 0.0]


@pytest.mark.parametrize('seen', [0.5, 10.0])
def test_what_is_as_declared_is_as_far_from_its_prior_as_chance_has_it(seen: float) -> None:
    """Also where data see little of the numbers: what is left at the prior is no evidence for it."""
    square, _, degrees = np.transpose([PriorComparison.of(*drawn(seed, 1.0, seen)).distances for seed in range(500)])
    assert np.mean(square > chdtri(degrees, 0.05)) == pytest.approx(0.05, abs=0.03)
    assert np.mean(square) == pytest.approx(np.mean(degrees), rel=0.1)
    _, twice, degrees = np.transpose([PriorComparison.of(*drawn(seed, 2.0, seen)).distances for seed in range(500)])
    assert np.mean(twice) == pytest.approx(np.mean(degrees), rel=0.1)


def test_what_no_data_see_is_at_no_distance() -> None:
    assert [*PriorComparison.of(np.zeros(NUMBERS), np.eye(NUMBERS)).distances] == [0.0, 0.0, 0]


def test_groups_side_by_side_are_as_each_by_itself() -> None:
    drawings = [drawn(seed, 3.0, 2.0) for seed in range(5)]
    together = PriorComparison.of(*map(np.array, zip(*drawings, strict=True)))
    for place, each in enumerate(PriorComparison.of(*drawing) for drawing in drawings):
        assert [part[place] for part in together.likely_sizes(BEFORE, BEFORE)] == [*each.likely_sizes(BEFORE, BEFORE)]
        assert [part[place] for part in together.distances] == [*each.distances]
        assert [part[place] for part in together.gain(30.0)] == [*each.gain(30.0)]
