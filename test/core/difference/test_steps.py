"""Jumps and constant forces in a linear problem, where what the likelihood must say is known exactly."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from linear_problems import EQUATIONS, TRUE, UNKNOWNS, linear_blocks, noisy_blocks
from mbaid_ros.core.difference import errors_in_variables as eiv
from mbaid_ros.core.difference import monitor, steps
from mbaid_ros.core.difference.coupling import Coupling, bordered
from mbaid_ros.core.difference.disturbances import Uncertain, Watched
from mbaid_ros.core.difference.effects import AXES, Kind
from mbaid_ros.core.difference.errors_in_variables import Blocks
from mbaid_ros.core.difference.first_solutions import Sums
from mbaid_ros.core.difference.monitor import Nuisance
from mbaid_ros.core.difference.rolling import RollingLikelihood
from mbaid_ros.core.difference.steps import SteppedLikelihood
from mbaid_ros.core.geometry import Array

PRIOR = 1e-6 * np.eye(UNKNOWNS)
MOMENTUM = slice(2, 4)
JUMP = np.array([0.7, -0.4])
NOBODY = Uncertain(np.zeros(0, dtype=np.int64), np.zeros(0))
NOTHING = Watched({}, {})


def likelihood(kept: int, effects: int = 0, watched: Watched = NOTHING) -> SteppedLikelihood:
    rolling = RollingLikelihood(PRIOR, kept, 1.0, np.full(UNKNOWNS, 10.0), effects)
    return SteppedLikelihood(rolling, MOMENTUM, PRIOR, NOBODY, watched)


def follow(blocks: Blocks, kept: int, columns: Array | None = None, watched: Watched = NOTHING) -> SteppedLikelihood:
    """Return the likelihood of all blocks, which are half a second long."""
    columns = np.zeros((len(blocks), EQUATIONS, 0)) if columns is None else columns
    run = likelihood(kept, columns.shape[-1], watched)
    for k in range(len(blocks)):
        run.add(blocks[k : k + 1], columns[k : k + 1], (0.5 * k, 0.5 * k + 0.49))
    return run


def changed(blocks: Blocks, change: Array) -> Blocks:
    """Return the blocks with (K, 2) changes of the momentum on what was measured."""
    offset = blocks.offset - (blocks.rows[..., MOMENTUM] @ change[..., None])[..., 0]
    return Blocks(blocks.rows, offset, blocks.noise, blocks.noise_rows)


def after(count: int, places: list[int]) -> Array:
    """Return (count,) how many of the jumps have happened by each block."""
    return np.sum(np.arange(count)[:, None] >= np.array(places), axis=1)


def with_jump_columns(blocks: Blocks, places: list[int]) -> Blocks:
    """Return the blocks with two more unknowns a jump: what came before has the momentum less it."""
    earlier = (np.arange(len(blocks))[:, None] < np.array(places)).astype(float)
    columns = [-earlier[:, index, None, None] * blocks.rows[..., MOMENTUM] for index in range(len(places))]
    return blocks.widened(np.concatenate(columns, axis=-1))


@pytest.mark.parametrize(('kept', 'places'), [(8, [25]), (8, [25, 40]), (25, [25, 40]), (100, [25, 40])])
def test_a_jump_is_the_same_as_two_constants(kept: int, places: list[int]) -> None:
    blocks = linear_blocks(60, 1)
    blocks = changed(blocks, after(60, places)[:, None] * JUMP)
    run = follow(blocks, kept)
    assert [jump.start for jump in run.jumps] == [0.5 * place for place in places]
    information, right_side = Sums(with_jump_columns(blocks, places), np.zeros(4 + 2 * len(places))).weighted(
        compensate=False
    )
    expected = np.linalg.solve(information + 1e-6 * np.eye(len(right_side)), right_side)
    # Also once the jumps have been folded and minimised over.
    assert run.likelihood.x[:UNKNOWNS] == pytest.approx(expected[:UNKNOWNS], abs=1e-5)
    covariance = np.linalg.inv(information)[:UNKNOWNS, :UNKNOWNS]
    assert monitor.inverse(run.likelihood.information)[:4, :4] == pytest.approx(covariance, rel=1e-3, abs=1e-7)
    for index, jump in enumerate(run.jumps):
        error = jump.value - JUMP
        assert float(error @ np.linalg.solve(jump.covariance, error)) < chi2.isf(1e-3, 2), index
    # The body's parameters come through, and so does the latest momentum.
    latest = TRUE + np.concatenate((np.zeros(2), len(places) * JUMP))
    error = run.likelihood.x[:UNKNOWNS] - latest
    assert float(error @ np.linalg.solve(covariance, error)) < chi2.isf(1e-4, UNKNOWNS)


def test_the_unknowns_are_as_many_as_before_once_a_jump_is_past() -> None:
    run = follow(changed(linear_blocks(60, 2), after(60, [20])[:, None] * JUMP), 8)
    assert len(run.likelihood.x) == UNKNOWNS
    assert len(run.jumps) == 1


def test_a_window_that_jumps_halfway_is_given_up() -> None:
    change = after(60, [31])[:, None] * JUMP
    change[30] = 0.5 * JUMP
    run = follow(changed(linear_blocks(60, 3), change), 100)
    (jump,) = run.jumps
    assert jump.start == 15.0
    assert jump.end >= 15.5
    assert len(run.likelihood) == 59
    assert jump.value == pytest.approx(JUMP, abs=0.1)


def test_a_push_that_lasts_is_one_jump() -> None:
    change = np.clip((np.arange(80) - 30) / 10.0, 0.0, 1.0)[:, None] * 20.0 * JUMP
    run = follow(changed(linear_blocks(80, 4), change), 100)
    (jump,) = run.jumps
    assert jump.start == pytest.approx(15.5, abs=0.5)
    assert jump.end == pytest.approx(20.0, abs=1.0)
    assert jump.value == pytest.approx(20.0 * JUMP, abs=0.1)


def test_a_small_jump_is_found_afterwards() -> None:
    blocks = noisy_blocks(70, 5, 1.0, 0.0)
    run = follow(changed(blocks, after(70, [35])[:, None] * 1.5 * JUMP), 100)
    (jump,) = run.jumps
    assert jump.start == pytest.approx(17.5, abs=2.5)


def test_more_jumps_than_there_is_room_for_are_said() -> None:
    places = list(range(30, 60, 4))
    run = follow(changed(linear_blocks(70, 6), after(70, places)[:, None] * JUMP), 100)
    assert run.too_many
    assert len(run.jumps) == 4


@pytest.mark.parametrize('seed', range(10, 13))
def test_nothing_is_found_where_nothing_is(seed: int) -> None:
    run = follow(noisy_blocks(60, seed, 0.2, 0.05), 30)
    assert run.ready
    assert not run.jumps


@pytest.mark.parametrize('places', [[], [25], [25, 60]])
def test_the_tests_wait_only_while_they_can_find_nothing(monkeypatch: pytest.MonkeyPatch, places: list[int]) -> None:
    # Small jumps, that no window tells by itself.
    blocks = changed(noisy_blocks(90, 5, 0.3, 0.0), after(90, places)[:, None] * 0.5 * JUMP)
    made: list[float] = []
    exact = monitor.jumps

    def counted(*arguments: Any) -> Array:
        made.append(float(np.max(exact(*arguments), initial=0.0)))
        return exact(*arguments)

    monkeypatch.setattr(monitor, 'jumps', counted)
    waiting = follow(blocks, 20)
    few = len(made)
    monkeypatch.setattr(steps, '_SUSPICIOUS', -1.0)
    always = follow(blocks, 20)
    assert 0 < few < 0.8 * (len(made) - few)
    assert [jump.start for jump in waiting.jumps] == [jump.start for jump in always.jumps]
    assert np.array_equal(waiting.likelihood.x, always.likelihood.x)


@pytest.mark.parametrize('kept', [10, 100])
def test_a_constant_force_is_found_and_solved_for(kept: int) -> None:
    blocks = linear_blocks(80, 7)
    gain = 0.5 * np.arange(80)[:, None, None] * blocks.rows[..., MOMENTUM]
    other = np.cos(np.arange(80))[:, None, None] * gain
    force = np.array([0.08, 0.04])
    pushed = Blocks(blocks.rows, blocks.offset - gain @ force, blocks.noise, blocks.noise_rows)
    watched = Watched({'inertial': slice(0, 2), 'body': slice(2, 4)}, dict.fromkeys(AXES, np.full(2, 1e-6)))
    run = follow(pushed, kept, np.concatenate((gain, other), axis=-1), watched)
    (found,) = run.found
    assert found.kind == 'inertial'
    assert not run.jumps
    information, right_side = Sums(pushed.widened(gain), np.zeros(6)).weighted(compensate=False)
    expected = np.linalg.solve(information + 1e-6 * np.eye(6), right_side)
    assert run.likelihood.x == pytest.approx(expected, rel=1e-6, abs=1e-8)
    assert run.part(found.place)[0] == pytest.approx(force, abs=2e-3)


def test_the_statistics_are_what_the_cost_would_fall_by() -> None:
    blocks = linear_blocks(20, 8)
    information, right_side = Sums(blocks, TRUE).weighted(compensate=False)
    x = np.linalg.solve(information, right_side)
    white = eiv.whitened(blocks, x)
    nuisance = Nuisance.of(information, np.zeros(UNKNOWNS), np.zeros((UNKNOWNS, 0)), np.zeros(0))
    rows = bordered(white, np.zeros((20, EQUATIONS, 0)))
    fall = monitor.jumps(rows, np.zeros(UNKNOWNS), MOMENTUM, np.zeros(0, dtype=np.int64), nuisance)
    for place in (3, 10, 19):
        wider = with_jump_columns(blocks, [place])
        more, right = Sums(wider, np.zeros(6)).weighted(compensate=False)
        best = eiv.cost(wider, np.linalg.solve(more, right))
        assert fall[place] == pytest.approx(eiv.cost(blocks, x) - best, rel=1e-6)
    columns = np.random.default_rng(8).normal(size=(20, EQUATIONS, 2))
    coupling = Coupling.of(eiv.square(bordered(white, white.whitener @ columns)), x)
    more, right = Sums(blocks.widened(columns), np.zeros(6)).weighted(compensate=False)
    best = eiv.cost(blocks.widened(columns), np.linalg.solve(more, right))
    acting: dict[Kind, tuple[slice, Array]] = {'inertial': (slice(0, 2), np.eye(2))}
    found = monitor.falls(coupling, x, acting, np.zeros(0, dtype=np.int64), nuisance)
    assert found['inertial'] == pytest.approx(eiv.cost(blocks, x) - best, rel=1e-6)


@pytest.mark.parametrize('kept', [10, 100])
def test_uncertain_effects_widen_by_what_they_do_to_the_solution(kept: int) -> None:
    blocks, size = linear_blocks(60, 9), np.array([0.3, 0.1])
    columns = np.random.default_rng(9).normal(size=(60, EQUATIONS, 2))
    rolling = RollingLikelihood(PRIOR, kept, 1.0, np.full(UNKNOWNS, 10.0), 2)
    uncertain = SteppedLikelihood(rolling, MOMENTUM, PRIOR, Uncertain(np.arange(2), size), NOTHING)
    for k in range(60):
        linear = uncertain.add(blocks[k : k + 1], columns[k : k + 1], (0.5 * k, 0.5 * k + 0.49))
    spread = np.linalg.inv(linear.information) @ uncertain.uncertain_cross
    for index in range(2):
        offset = blocks.offset + columns[..., index] * size[index]
        moved_blocks = Blocks(blocks.rows, offset, blocks.noise, blocks.noise_rows)
        information, right_side = Sums(moved_blocks, TRUE).weighted(compensate=False)
        moved = np.linalg.solve(information + PRIOR, right_side)
        assert rolling.x - moved == pytest.approx(spread[:, index], rel=1e-4, abs=1e-7)
    assert not uncertain.jumps
