"""Marginalised windows: the quadratic cost of windows that are no longer solved again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from derivatives import central_difference
from linear_problems import TRUE, UNKNOWNS, linear_blocks, noise_information, noisy_blocks
from mbaid_ros.core.difference import errors_in_variables as eiv
from mbaid_ros.core.difference.errors_in_variables import Linearisation
from mbaid_ros.core.difference.sliding_window import MarginalisedPrior

NOTHING = np.zeros((UNKNOWNS, UNKNOWNS))
FLOOR = 1e-9 * np.eye(UNKNOWNS)


def marginalised_from(seed: int, steps: int = 6) -> MarginalisedPrior:
    """Return a cost marginalised window by window, each linearised somewhere else."""
    rng = np.random.default_rng(seed)
    past = MarginalisedPrior(FLOOR)
    for index in range(steps):
        x = TRUE + 0.1 * rng.normal(size=UNKNOWNS)
        blocks = noisy_blocks(3, 10 * seed + index)
        linear, own = eiv.maximum_likelihood(blocks, x), noise_information(blocks, x)
        past.add(replace(linear, information=linear.information - own), own, x)
    return past


@pytest.mark.parametrize('seed', range(3))
def test_gradient_and_information_are_the_derivatives_of_the_cost(seed: int) -> None:
    past = marginalised_from(seed)
    x = np.random.default_rng(seed).normal(size=UNKNOWNS)
    expected = 0.5 * central_difference(lambda at: np.array(past.cost(at)), x, 1e-4)
    assert past.gradient(x) == pytest.approx(expected, rel=1e-6)
    assert central_difference(past.gradient, x, 1e-2) == pytest.approx(past.information, rel=1e-9)


def test_a_marginalised_linear_problem_is_the_problem() -> None:
    blocks = linear_blocks(12, 0)
    past = MarginalisedPrior(FLOOR)
    rng = np.random.default_rng(1)
    for k in range(len(blocks)):
        x = rng.normal(size=UNKNOWNS)
        past.add(eiv.maximum_likelihood(blocks[k : k + 1], x), NOTHING, x)
    for _ in range(5):
        x = 3.0 * rng.normal(size=UNKNOWNS)
        whole = eiv.maximum_likelihood(blocks, x)
        assert past.cost(x) == pytest.approx(whole.cost, rel=1e-9)
        assert past.gradient(x) == pytest.approx(whole.gradient, rel=1e-8, abs=1e-8 * np.abs(whole.gradient).max())
    assert past.equations == whole.equations
    assert len(past) == 12


def test_linearised_windows_have_their_cost_and_slope_where_they_were_marginalised() -> None:
    x = TRUE + 0.05
    linear = eiv.maximum_likelihood(noisy_blocks(4, 3), x)
    past = MarginalisedPrior(FLOOR)
    past.add(linear, NOTHING, x)
    assert past.cost(x) == pytest.approx(linear.cost, rel=1e-9)
    assert past.gradient(x) == pytest.approx(linear.gradient, rel=1e-8)


def test_what_is_less_than_the_noise_does_not_count() -> None:
    """Compensated sums may be negative where nothing is excited: no cost may fall without limit there."""
    past = MarginalisedPrior(FLOOR)
    signal, own = np.diag([100.0, 10.0, 0.5, -3.0]), np.diag([1.0, 1.0, 1.0, 5.0])
    best = np.array([1.0, 2.0, 3.0, 4.0])
    past.add(Linearisation(cost=7.0, gradient=-signal @ best, information=signal, equations=6), own, np.zeros(4))
    assert past.information == pytest.approx(np.diag([100.0, 10.0, 0.0, 0.0]), abs=1e-9)
    assert past.right_side == pytest.approx([100.0, 20.0, 0.0, 0.0], abs=1e-9)
    assert past.cost(np.array([1.0, 2.0, 1e9, -1e9])) == past.cost(np.array([1.0, 2.0, 0.0, 0.0]))
    # It is not lost either: with more of it, it counts.
    past.add(
        Linearisation(cost=0.0, gradient=-9.5 * best, information=9.5 * np.eye(4), equations=6), NOTHING, NOTHING[0]
    )
    assert np.diag(past.information)[:3] == pytest.approx([109.5, 19.5, 10.0])
