"""A sliding window solved again, older windows marginalised, and tests of a constant momentum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from checked import generic
from linear_problems import EQUATIONS, TRUE, UNKNOWNS, linear_blocks, noisy_blocks
from mbaid_ros.core import difference_solver
from mbaid_ros.core.difference import Conservation, momentum_jumps, noise_covariance
from mbaid_ros.core.difference_solver import (
    Blocks,
    CrossInformation,
    Linearisation,
    MarginalisedPrior,
    NormalSums,
    SlidingWindow,
    first_solutions,
    maximum_likelihood,
)
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
        linear = maximum_likelihood(blocks, x)
        x = x - np.linalg.solve(linear.information + PRIOR, linear.gradient + PRIOR @ x)
    return x


def deviations(error: Array, information: Array) -> float:
    return float(np.sqrt(error @ information @ error))


def test_all_windows_lead_to_the_maximum() -> None:
    blocks = noisy_blocks(30, 0)
    likelihood = slid(blocks, 100)
    best = maximum(blocks)
    information = maximum_likelihood(blocks, best).information
    # Steps end at a thousandth of a standard deviation.
    assert deviations(likelihood.x - best, information) < 2e-3


@pytest.mark.parametrize('length', [2, 5, 20])
def test_marginalising_a_linear_problem_changes_nothing(length: int) -> None:
    blocks = linear_blocks(40, 1)
    likelihood = slid(blocks, length)
    assert len(likelihood.windows) == length
    information, right_side = NormalSums(blocks, TRUE).weighted(compensate=False)
    assert likelihood.x == pytest.approx(np.linalg.solve(information + PRIOR, right_side), rel=1e-7)
    # Its form around the solution is that of all windows.
    linear = likelihood.add(linear_blocks(1, 2))
    both = maximum_likelihood(Blocks.concatenate([blocks, linear_blocks(1, 2)]), likelihood.x)
    assert linear.information == pytest.approx(both.information + PRIOR, rel=1e-6)
    assert linear.cost == pytest.approx(both.cost, rel=1e-6)
    assert linear.equations == both.equations


def test_an_unidentifiable_direction_stays_at_the_prior() -> None:
    blocks = noisy_blocks(30, 8)
    # The third unknown appears in no equation.
    rows, noise_rows = blocks.rows.copy(), blocks.noise_rows.copy()
    rows[..., 2], noise_rows[..., 2] = 0.0, 0.0
    likelihood = slid(Blocks(rows, blocks.offset, blocks.noise, noise_rows), 10)
    assert np.isfinite(likelihood.x).all()
    assert likelihood.x[2] == pytest.approx(0.0, abs=1e-9)


def test_directions_without_data_are_of_typical_size() -> None:
    """As with a prior of that size about zero, beside the information beyond the noise."""
    size, rows, x = np.array([10.0, 2.0, 0.5, 7.0]), generic(1, 3, UNKNOWNS), generic(2, UNKNOWNS)
    likelihood = SlidingWindow(PRIOR, 5, size)
    likelihood._signal = rows.T @ rows
    found, factor = likelihood._regularised(x)
    covariance = np.linalg.inv(rows.T @ rows + np.diag(size**-2.0))
    assert factor @ factor.T == pytest.approx(covariance)
    assert found == pytest.approx(covariance @ rows.T @ rows @ x)
    likelihood._signal = -rows.T @ rows  # noise that is compensated for may leave less than nothing
    found, factor = likelihood._regularised(x)
    assert found == pytest.approx(np.zeros(UNKNOWNS))
    assert factor @ factor.T == pytest.approx(np.diag(size**2))


NOTHING = np.zeros((UNKNOWNS, UNKNOWNS))
FLOOR = 1e-9 * np.eye(UNKNOWNS)


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


def test_a_jump_that_the_momentum_itself_explains_is_none() -> None:
    """Where no window before it shows the momentum, rounding alone distinguishes the two."""
    blocks = linear_blocks(20, 4)
    rows = blocks.rows.copy()
    rows[:10, :, MOMENTUM] = 0.0
    window, _ = after_tests(Blocks(1e5 * rows, 1e5 * blocks.offset, blocks.noise, blocks.noise_rows), 20)
    falls, changes = momentum_jumps(window, MOMENTUM, noise_covariance(window.linear.information))
    assert np.all(falls >= 0.0)
    assert changes[9] == pytest.approx(np.zeros(2), abs=1e-3)


def test_total_least_squares_explain_equations_and_a_prior_by_the_smallest_errors() -> None:
    blocks, information, right_side = noisy_blocks(10, 5), np.diag([5.0, 20.0, 10.0, 15.0]), 10.0 * generic(3, UNKNOWNS)
    found = NormalSums(blocks, TRUE).total_least_squares(information, right_side)
    noise = blocks.noise + blocks.noise_rows @ TRUE
    white = np.linalg.inv(np.linalg.cholesky(noise @ np.swapaxes(noise, 1, 2)))

    def quotient(x: Array) -> float:
        errors = white @ (blocks.noise + blocks.noise_rows @ x)
        residuals = (white @ (blocks.rows @ x + blocks.offset)[..., None])[..., 0]
        explained = np.sum(residuals**2) + x @ information @ x - 2.0 * right_side @ x
        return float(explained / np.sum(errors**2))

    rng = np.random.default_rng(0)
    for size in (1e-3, 1e-1, 10.0):
        assert all(quotient(found) < quotient(found + size * rng.normal(size=UNKNOWNS)) for _ in range(20))


@pytest.mark.parametrize(('windows', 'length'), [(17, 30), (18, 30), (17, 5), (18, 5)])
def test_a_last_solution_is_started_from_if_it_explains_enough_equations(
    windows: int, length: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More than 50 of them beyond the unknowns, those of windows that have left included."""
    likelihood, searched = slid(linear_blocks(windows, 6), length), list[int]()
    likelihood.x = last = maximum(linear_blocks(windows, 6))

    def search(blocks: Blocks, *_: Array) -> list[Array]:
        searched.append(len(blocks))
        return []

    monkeypatch.setattr(difference_solver, 'first_solutions', search)
    likelihood.windows.linearise(np.ones(UNKNOWNS))
    likelihood._start()
    assert np.array_equal(likelihood.windows.x, last)
    assert len(searched) == (windows < 18)
    likelihood.x = last + 5.0 * np.eye(UNKNOWNS)[0]  # explains nothing
    likelihood._start()
    assert len(searched) == (windows < 18) + 1


def test_consider_parameters_leave_in_the_residuals_what_the_unknowns_do_not_explain() -> None:
    """For parameters of variance one, the squared residuals of their columns' fit by the unknowns' rows."""
    rng = np.random.default_rng(11)
    rows, columns = rng.normal(size=(5, 3, UNKNOWNS)), rng.normal(size=(5, 3, 2))
    flat, each = rows.reshape(-1, UNKNOWNS), columns.reshape(-1, 2)
    cross = CrossInformation.from_rows(rows, columns)
    left = np.linalg.lstsq(flat, each, rcond=None)[1]
    assert cross.surplus(np.linalg.inv(flat.T @ flat)) == pytest.approx(np.sum(left))
    both = cross + CrossInformation.from_rows(2.0 * rows, 3.0 * columns)
    assert both.cross == pytest.approx(7.0 * flat.T @ each)
    assert both.diagonal == pytest.approx(10.0 * np.sum(each**2, axis=0))


def test_a_window_that_leaves_before_the_solution_is_known_counts_once() -> None:
    """And no other window with it."""
    blocks = noisy_blocks(12, 5, 0.1, 0.5)
    likelihood, columns = SlidingWindow(PRIOR, 3, TYPICAL, 1), np.ones((1, EQUATIONS, 1))
    for k in range(len(blocks)):
        likelihood.add(blocks[k : k + 1], columns)
        assert not likelihood._converged
        assert likelihood.linear.equations == (k + 1) * EQUATIONS


def test_first_solutions_are_compensated_unless_that_makes_the_mass_negative() -> None:
    """Noise in the rows makes plain solutions too small; of noise declared four times too large nothing is left."""
    blocks, nothing = noisy_blocks(300, 0, 0.1, 0.3), np.zeros(UNKNOWNS)
    *_, plain, _, _, _, compensated = first_solutions(blocks, PRIOR, nothing)
    assert compensated == pytest.approx(TRUE, abs=0.1)
    assert plain[0] < 0.95 * TRUE[0]
    louder = replace(blocks, noise_rows=4.0 * blocks.noise_rows)
    found = first_solutions(louder, PRIOR, nothing)
    assert len(found) == 5  # two plain ones, and by total least squares one more
    assert all(x[0] > 0.0 for x in found)
