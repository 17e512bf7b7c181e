"""The maximum of a growing likelihood: a sliding window solved again, older ones marginalised, at bounded cost."""

from __future__ import annotations

import numpy as np
import pytest

from linear_problems import TRUE, UNKNOWNS, linear_blocks, noise_information, noisy_blocks
from mbaid_ros.core.difference import errors_in_variables as eiv
from mbaid_ros.core.difference.errors_in_variables import Blocks, Sums
from mbaid_ros.core.difference.sliding_window import SlidingWindow
from mbaid_ros.core.geometry import Array

PRIOR = 1e-6 * np.eye(UNKNOWNS)
TYPICAL = np.full(UNKNOWNS, 10.0)


def slid(blocks: Blocks, length: int) -> SlidingWindow:
    likelihood = SlidingWindow(PRIOR, length, TYPICAL)
    for k in range(len(blocks)):
        likelihood.add(blocks[k : k + 1])
    return likelihood


def maximum(blocks: Blocks) -> Array:
    """Return the maximum of the likelihood with the prior, by many full steps from the truth."""
    x = TRUE
    for _ in range(30):
        linear = eiv.maximum_likelihood(blocks, x)
        x = x - np.linalg.solve(linear.information + PRIOR, linear.gradient + PRIOR @ x)
    return x


def deviations(error: Array, information: Array) -> float:
    return float(np.sqrt(error @ information @ error))


def test_all_windows_lead_to_the_maximum() -> None:
    blocks = noisy_blocks(30, 0)
    likelihood = slid(blocks, 100)
    best = maximum(blocks)
    information = eiv.maximum_likelihood(blocks, best).information
    # Steps end at a thousandth of a standard deviation.
    assert deviations(likelihood.x - best, information) < 2e-3


@pytest.mark.parametrize('length', [2, 5, 20])
def test_marginalising_a_linear_problem_changes_nothing(length: int) -> None:
    blocks = linear_blocks(40, 1)
    likelihood = slid(blocks, length)
    information, right_side = Sums(blocks, TRUE).weighted(compensate=False)
    assert likelihood.x == pytest.approx(np.linalg.solve(information + PRIOR, right_side), rel=1e-7)
    # Its form around the solution is that of all windows.
    linear = likelihood.add(linear_blocks(1, 2))
    both = eiv.maximum_likelihood(Blocks.concatenate([blocks, linear_blocks(1, 2)]), likelihood.x)
    assert linear.information == pytest.approx(both.information + PRIOR, rel=1e-6)
    assert linear.cost == pytest.approx(both.cost, rel=1e-6)
    assert linear.equations == both.equations


@pytest.mark.parametrize('length', [5, 10, 20])
def test_marginalised_windows_cost_little_accuracy(length: int) -> None:
    blocks = noisy_blocks(80, 3, 0.2, 0.05)
    best = maximum(blocks)
    information = eiv.maximum_likelihood(blocks, best).information
    assert deviations(slid(blocks, length).x - best, information) < 0.1


def test_the_window_is_bounded() -> None:
    blocks = noisy_blocks(60, 4)
    likelihood = SlidingWindow(PRIOR, 7, TYPICAL)
    for k in range(len(blocks)):
        likelihood.add(blocks[k : k + 1])
        assert len(likelihood.windows) == min(k + 1, 7)
        assert likelihood.marginalised == max(k - 6, 0)


def test_the_noise_of_all_windows_is_counted() -> None:
    blocks = noisy_blocks(20, 5)
    likelihood = slid(blocks, 50)
    assert likelihood.noise_information == pytest.approx(noise_information(blocks, likelihood.windows.x), rel=1e-9)
    # Marginalised windows keep what they had where they were linearised: near the same.
    few = slid(blocks, 10)
    whole = noise_information(blocks, few.x)
    assert few.noise_information == pytest.approx(whole, rel=0.05, abs=0.05 * np.abs(whole).max())


def test_an_unidentifiable_direction_stays_at_the_prior() -> None:
    blocks = noisy_blocks(30, 8)
    # The third unknown appears in no equation.
    rows, noise_rows = blocks.rows.copy(), blocks.noise_rows.copy()
    rows[..., 2], noise_rows[..., 2] = 0.0, 0.0
    likelihood = slid(Blocks(rows, blocks.offset, blocks.noise, noise_rows), 10)
    assert np.isfinite(likelihood.x).all()
    assert likelihood.x[2] == pytest.approx(0.0, abs=1e-9)


def test_a_start_from_few_poor_windows_is_guarded() -> None:
    # Noise as large as the coefficients: single windows say nothing, or anything.
    blocks = noisy_blocks(150, 9, 1.0, 0.5)
    likelihood = SlidingWindow(PRIOR, 40, TYPICAL)
    for k in range(len(blocks)):
        linear = likelihood.add(blocks[k : k + 1])
        assert np.isfinite(likelihood.x).all()
        assert np.isfinite(linear.cost)
    own = linear.information - likelihood.noise_information
    assert deviations(likelihood.x - TRUE, own) < 5.0
