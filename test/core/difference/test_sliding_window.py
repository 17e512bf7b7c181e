"""A sliding window solved again, older windows marginalised, and tests of a constant momentum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from derivatives import central_difference
from linear_problems import (
    EQUATIONS,
    TRUE,
    UNKNOWNS,
    linear_blocks,
    noise_information,
    noisy_blocks,
)
from mbaid_ros.core.difference import errors_in_variables as eiv
from mbaid_ros.core.difference.conservation import Conservation, momentum_jumps, noise_covariance
from mbaid_ros.core.difference.errors_in_variables import Blocks, Linearisation, Sums
from mbaid_ros.core.difference.sliding_window import MarginalisedPrior, SlidingWindow
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


MOMENTUM = slice(2, UNKNOWNS)
JUMP = np.array([1.0, -0.7])
LOOSE = 1e-6 * np.eye(UNKNOWNS)


def after_tests(blocks: Blocks, length: int, columns: Array | None = None) -> tuple[SlidingWindow, Conservation]:
    """Return what becomes of all blocks, which are half a second long."""
    columns = np.zeros((len(blocks), EQUATIONS, 0)) if columns is None else columns
    window = SlidingWindow(LOOSE, length, np.full(UNKNOWNS, 10.0), columns.shape[-1])
    test = Conservation(MOMENTUM)
    for k in range(len(blocks)):
        window.add(blocks[k : k + 1], columns[k : k + 1])
        covariance = noise_covariance(window.linear.information)
        test.update(window, 0.5 * k, covariance, window.cross_information.surplus(covariance))
    return window, test


def jumped(blocks: Blocks, place: int, jump: Array) -> Blocks:
    """Return the blocks with a momentum that jumps before one of them."""
    change = (np.arange(len(blocks)) >= place)[:, None] * jump
    offset = blocks.offset - (blocks.rows[..., MOMENTUM] @ change[..., None])[..., 0]
    return Blocks(blocks.rows, offset, blocks.noise, blocks.noise_rows)


def cost(rows: Array, offset: Array, noise: Array) -> tuple[float, Array]:
    """Return the least weighted sum of squares of linear equations, with the prior, and where it is."""
    white = np.linalg.inv(np.linalg.cholesky(noise @ np.swapaxes(noise, 1, 2)))
    unknowns = rows.shape[-1]
    flat, right = (white @ rows).reshape(-1, unknowns), -(white @ offset[..., None]).reshape(-1)
    information = flat.T @ flat + 1e-6 * np.diag(np.arange(unknowns) < UNKNOWNS)
    x = np.linalg.solve(information, flat.T @ right)
    return float(right @ right - x @ information @ x), x


@pytest.mark.parametrize('length', [20, 100])
def test_falls_and_jumps_are_those_of_a_solution_with_a_jump(length: int) -> None:
    blocks = jumped(linear_blocks(40, 1), 30, JUMP)
    window, _ = after_tests(blocks, length)
    falls, changes = momentum_jumps(window, MOMENTUM, noise_covariance(window.linear.information))
    plain, _ = cost(blocks.rows, blocks.offset, blocks.noise)
    first = len(blocks) - len(window.windows)
    for place in (first + 1, 30, 39):
        after = (np.arange(len(blocks)) >= place)[:, None, None] * blocks.rows[..., MOMENTUM]
        with_jump, x = cost(np.concatenate((blocks.rows, after), axis=2), blocks.offset, blocks.noise)
        assert falls[place - first - 1] == pytest.approx(plain - with_jump, rel=1e-5)
        assert changes[place - first - 1] == pytest.approx(x[UNKNOWNS:], rel=1e-5)


def test_a_jump_is_found_at_once_where_and_how_large_it_is() -> None:
    blocks = jumped(linear_blocks(60, 2), 30, 3.0 * JUMP)
    assert after_tests(blocks[:30], 20)[1].jump is None
    at_once, later = after_tests(blocks[:32], 20)[1].jump, after_tests(blocks, 20)[1].jump
    assert at_once is not None
    assert later is not None
    assert later.time == 15.0
    assert later.value == pytest.approx(3.0 * JUMP, abs=0.2)


def test_a_small_jump_is_found_afterwards() -> None:
    blocks = jumped(linear_blocks(70, 5), 35, 0.2 * JUMP)
    _, test = after_tests(blocks, 100)
    assert test.jump is not None
    assert test.jump.time == pytest.approx(17.5, abs=2.5)


@pytest.mark.parametrize('seed', range(10, 14))
def test_nothing_is_found_where_nothing_is(seed: int) -> None:
    _, test = after_tests(noisy_blocks(200, seed, 0.2, 0.05), 30)
    assert test.jump is None
    assert not test.excessive
    # The windows' normalised innovations squared: 190 of them, of two numbers each.
    assert test.mean == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 380.0))


def test_innovations_that_noise_does_not_explain() -> None:
    blocks = linear_blocks(100, 3)
    noise = blocks.offset + blocks.rows @ TRUE
    louder = Blocks(blocks.rows, blocks.offset + noise, blocks.noise, blocks.noise_rows)
    _, test = after_tests(louder, 30)
    assert test.excessive
    assert test.mean == pytest.approx(4.0, abs=1.0)
    # Louder everywhere is no jump.
    assert test.jump is None


def test_what_consider_parameters_may_do_is_no_jump() -> None:
    """An uncertain parameter whose column is the momentum's own from half-way on."""
    blocks = jumped(linear_blocks(60, 4), 30, JUMP)
    after = (np.arange(60) >= 30)[:, None, None] * blocks.rows[..., MOMENTUM]
    assert after_tests(blocks, 40)[1].jump is not None
    assert after_tests(blocks, 40, after)[1].jump is None


def test_the_falls_are_chi_square_whatever_the_units() -> None:
    rng = np.random.default_rng(1)
    falls: list[float] = []
    for exponent in range(-4, 5):
        size = 10.0 ** rng.uniform(-2.0, 2.0, UNKNOWNS) * 10.0**exponent
        blocks = linear_blocks(30, exponent + 10)
        scaled = Blocks(blocks.rows * size, blocks.offset, blocks.noise, blocks.noise_rows * size)
        window = SlidingWindow(np.diag(1e-8 * size**2), 50, 1e3 / size)
        for k in range(len(scaled)):
            window.add(scaled[k : k + 1])
        found, _ = momentum_jumps(window, MOMENTUM, noise_covariance(window.linear.information))
        assert np.all(np.isfinite(found))
        falls.extend(found[5:])
    assert np.mean(falls) == pytest.approx(2.0, abs=1.0)
    assert max(falls) < chi2.isf(1e-5, 2)
