"""Marginalised windows: a quadratic cost that forgets what is renewed, and only that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from derivatives import central_difference
from linear_problems import TRUE, UNKNOWNS, linear_blocks, noise_information, noisy_blocks, quadratic
from mbaid_ros.core.difference import errors_in_variables as eiv
from mbaid_ros.core.difference.errors_in_variables import Linearisation
from mbaid_ros.core.difference.marginalised import MarginalisedPrior
from mbaid_ros.core.geometry import Array

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


def minimum(past: MarginalisedPrior) -> Array:
    return np.asarray(np.linalg.solve(past.information, past.right_side))


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


def test_what_is_excited_is_forgotten() -> None:
    past = marginalised_from(4)
    information, best, noise = past.information.copy(), minimum(past), past.noise_information.copy()
    least = past.cost(best)
    # The recent windows say something of everything, little as it may be beside the past.
    past.forget(0.9, 0.01 * information, 1e-6 * np.eye(UNKNOWNS))
    assert past.information == pytest.approx(0.9 * information, rel=1e-9)
    assert past.noise_information == pytest.approx(0.9 * noise, rel=1e-9)
    assert minimum(past) == pytest.approx(best, rel=1e-9)
    assert past.cost(minimum(past)) == pytest.approx(0.9 * least, rel=1e-6)


def marginal(information: Array) -> float:
    """Return what is known of the last unknown, whatever the others are."""
    others = information[:-1, :-1]
    return float(information[-1, -1] - information[-1, :-1] @ np.linalg.solve(others, information[:-1, -1]))


def test_what_is_not_excited_is_kept_however_long() -> None:
    past = marginalised_from(5)
    best, information, noise = minimum(past), past.information.copy(), past.noise_information.copy()
    known = marginal(information)
    # The recent windows know nothing of the last unknown, and something of the others.
    recent, idle = np.diag([*np.full(UNKNOWNS - 1, 1.0), 0.5]), np.diag([*np.full(UNKNOWNS - 1, 0.1), 1.0])
    for step in range(2000):
        past.forget(0.9, recent, idle)
        if step == 20:
            assert marginal(past.information) == pytest.approx(known, rel=1e-6)
            assert minimum(past) == pytest.approx(best, rel=1e-6)
            assert past.information[0, 0] == pytest.approx(0.9**21 * information[0, 0], rel=1e-6)
    # Of the others nothing is left after so many steps; of the last unknown everything (but for the floor, which counts
    # once the others have faded down to it), and its value.
    assert past.information[-1, -1] == pytest.approx(known, rel=1e-3)
    assert past.information[:-1, :-1] == pytest.approx(NOTHING[:-1, :-1], abs=1e-9 * known)
    assert past.right_side[-1] / past.information[-1, -1] == pytest.approx(best[-1], rel=1e-3)
    # So is what noise had brought of it: else it would pass for signal.
    apart = np.append(-np.linalg.solve(information[:-1, :-1], information[:-1, -1]), 1.0)
    assert past.noise_information[-1, -1] == pytest.approx(quadratic(noise, apart), rel=2e-2)
    assert known == pytest.approx(quadratic(information, apart), rel=1e-9)


@pytest.mark.parametrize('seed', range(3))
def test_forgetting_some_directions_keeps_the_minimum(seed: int) -> None:
    past = marginalised_from(seed)
    best, before = minimum(past), past.information.copy()
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(UNKNOWNS, 2))
    past.forget(0.7, factor @ factor.T, 1e-3 * np.eye(UNKNOWNS))
    assert past.information == pytest.approx(past.information.T)
    assert minimum(past) == pytest.approx(best, rel=1e-8)
    # Less is known than before in two directions, as much in the others.
    ratio = np.sort(np.linalg.eigvals(np.linalg.solve(before, past.information)).real)
    assert ratio == pytest.approx([0.7, 0.7, 1.0, 1.0], rel=1e-8)


def test_steady_excitation_is_worth_what_the_factor_says() -> None:
    blocks = linear_blocks(3, 6)
    linear = eiv.maximum_likelihood(blocks, TRUE)
    past = MarginalisedPrior(FLOOR)
    for _ in range(300):
        past.forget(0.95, 4.0 * linear.information, 1e-6 * np.eye(UNKNOWNS))
        past.add(linear, NOTHING, TRUE)
    # 1 + 0.95 + 0.95^2 + ... = 20 windows.
    assert past.information == pytest.approx(20.0 * linear.information, rel=1e-5)


def test_what_is_less_than_the_noise_does_not_count() -> None:
    """Compensated sums may be negative where nothing is excited: no cost may fall without limit there."""
    past = MarginalisedPrior(FLOOR)
    signal, own = np.diag([100.0, 10.0, 0.5, -3.0]), np.diag([1.0, 1.0, 1.0, 5.0])
    best = np.array([1.0, 2.0, 3.0, 4.0])
    past.add(Linearisation(cost=7.0, gradient=-signal @ best, information=signal, equations=6), own, np.zeros(4))
    assert past.information == pytest.approx(np.diag([100.0, 10.0, 0.0, 0.0]), abs=1e-9)
    assert past.right_side == pytest.approx([100.0, 20.0, 0.0, 0.0], abs=1e-9)
    assert past.cost(np.array([1.0, 2.0, 1e9, -1e9])) == past.cost(np.array([1.0, 2.0, 0.0, 0.0]))
    # It is not forgotten either: with more of it, it counts.
    past.add(
        Linearisation(cost=0.0, gradient=-9.5 * best, information=9.5 * np.eye(4), equations=6), NOTHING, NOTHING[0]
    )
    assert np.diag(past.information)[:3] == pytest.approx([109.5, 19.5, 10.0])


def test_nothing_marginalised_has_nothing_to_forget() -> None:
    past = MarginalisedPrior(FLOOR)
    past.forget(0.5, np.eye(UNKNOWNS), 0.1 * np.eye(UNKNOWNS))
    assert not past.information.any()
    assert past.cost(TRUE) == 0.0
