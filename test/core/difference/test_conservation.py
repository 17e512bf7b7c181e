"""The tests of a momentum that is taken for constant, on linear problems."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from linear_problems import EQUATIONS, TRUE, UNKNOWNS, linear_blocks, noisy_blocks
from mbaid_ros.core.difference.conservation import Conservation, momentum_jumps, noise_covariance
from mbaid_ros.core.difference.errors_in_variables import Blocks
from mbaid_ros.core.difference.sliding_window import SlidingWindow
from mbaid_ros.core.geometry import Array

MOMENTUM = slice(2, UNKNOWNS)
JUMP = np.array([1.0, -0.7])
PRIOR = 1e-6 * np.eye(UNKNOWNS)


def slid(blocks: Blocks, length: int, columns: Array | None = None) -> tuple[SlidingWindow, Conservation]:
    """Return what becomes of all blocks, which are half a second long."""
    columns = np.zeros((len(blocks), EQUATIONS, 0)) if columns is None else columns
    window = SlidingWindow(PRIOR, length, np.full(UNKNOWNS, 10.0), columns.shape[-1])
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
    window, _ = slid(blocks, length)
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
    assert slid(blocks[:30], 20)[1].jump is None
    at_once, later = slid(blocks[:32], 20)[1].jump, slid(blocks, 20)[1].jump
    assert at_once is not None
    assert later is not None
    assert later.time == 15.0
    assert later.value == pytest.approx(3.0 * JUMP, abs=0.2)


def test_a_small_jump_is_found_afterwards() -> None:
    blocks = jumped(linear_blocks(70, 5), 35, 0.2 * JUMP)
    _, test = slid(blocks, 100)
    assert test.jump is not None
    assert test.jump.time == pytest.approx(17.5, abs=2.5)


@pytest.mark.parametrize('seed', range(10, 14))
def test_nothing_is_found_where_nothing_is(seed: int) -> None:
    _, test = slid(noisy_blocks(200, seed, 0.2, 0.05), 30)
    assert test.jump is None
    assert not test.excessive
    # The windows' normalised innovations squared: 190 of them, of two numbers each.
    assert test.mean == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 380.0))


def test_innovations_that_noise_does_not_explain() -> None:
    blocks = linear_blocks(100, 3)
    noise = blocks.offset + blocks.rows @ TRUE
    louder = Blocks(blocks.rows, blocks.offset + noise, blocks.noise, blocks.noise_rows)
    _, test = slid(louder, 30)
    assert test.excessive
    assert test.mean == pytest.approx(4.0, abs=1.0)
    # Louder everywhere is no jump.
    assert test.jump is None


def test_what_consider_parameters_may_do_is_no_jump() -> None:
    """An uncertain parameter whose column is the momentum's own from half-way on."""
    blocks = jumped(linear_blocks(60, 4), 30, JUMP)
    after = (np.arange(60) >= 30)[:, None, None] * blocks.rows[..., MOMENTUM]
    assert slid(blocks, 40)[1].jump is not None
    assert slid(blocks, 40, after)[1].jump is None


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
