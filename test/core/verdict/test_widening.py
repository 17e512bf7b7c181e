"""What data would gain by less certainty, against the data themselves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.verdict.widening import gain, likely_size

NUMBERS, MEASURED = 4, 6


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
    most, factor = gain(*posterior(rows, data), 10.0)
    assert factor == max(expected, key=lambda each: expected[each])
    assert most == pytest.approx(expected[factor], rel=1e-9)


def test_what_is_as_large_as_declared_stays() -> None:
    sizes = [likely_size(*drawn(seed, 1.0, 10.0))[0] for seed in range(500)]
    assert np.median(sizes) < 1.05
    assert np.mean(np.array(sizes) > 1.5) < 0.03


@pytest.mark.parametrize('size', [3.0, 6.0])
def test_what_is_larger_is_found_to_be(size: float) -> None:
    found = np.array([likely_size(*drawn(seed, size, 10.0)) for seed in range(200)])
    assert 0.7 * size < np.median(found[:, 0]) < 1.3 * size
    assert np.median(found[:, 1]) > 0.9


def test_numbers_that_data_say_nothing_of_stay_as_declared() -> None:
    mean, covariance = drawn(0, 3.0, 1e-6)
    assert likely_size(mean, covariance) == pytest.approx((1.0, 0.0), abs=1e-3)
    assert likely_size(np.zeros(NUMBERS), np.eye(NUMBERS)) == (1.0, 0.0)
