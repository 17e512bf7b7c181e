"""Consider parameters that change the momentum as time goes by, and windows thinned to the samples they need."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from checked import generic
from mbaid_ros.core.difference import ConsiderParameters, _thinned, concatenated, mean_of_each, momentum_jumps
from mbaid_ros.core.forces import DisturbanceModel, disturbances
from mbaid_ros.core.geometry import Array, rotate
from mbaid_ros.core.odometry.model import odometry_mount
from mbaid_ros.core.robot.model import express
from mbaid_ros.core.samples import Samples
from mbaid_ros.simulation.simulation import Truth
from observed import MID, drifting, kernel, observe, windows

BODY = kernel('servicer7').target.parameters
FORCE, TORQUE = generic(0, 3), generic(1, 3)


def brought(samples: Samples) -> Array:
    """Return the momentum about the base that a force at the centre of mass and a torque have brought, (N, 6)."""
    servicer, start = kernel('servicer7'), samples.base_position[0]
    states = servicer.states(samples)
    bodies = express(servicer.body_parameters(BODY), states.configuration.rotation, states.configuration.position)
    total = np.sum(bodies, axis=1)
    centre = samples.base_position - start + total[:, 1:4] / total[:, :1]
    momentum: Array = np.zeros((len(samples), 6))
    for place in range(1, len(samples)):
        step = samples.time[place] - samples.time[place - 1]
        lever = 0.5 * (centre[place] + centre[place - 1])
        change = step * np.concatenate((FORCE, np.cross(lever, FORCE) + TORQUE))
        momentum[place] = momentum[place - 1] + change
    momentum[:, 3:] -= np.cross(samples.base_position - start, momentum[:, :3])
    return momentum


def cut(samples: Samples, pieces: int) -> list[list[Samples]]:
    """Return windows in so many calls."""
    every = windows(samples)
    return [[every[place] for place in part] for part in np.array_split(np.arange(len(every)), pieces)]


@pytest.mark.parametrize('pieces', [1, 3])
def test_a_push_is_taken_off_that_it_has_brought_until_then(spatial: Truth, drift: Array, pieces: int) -> None:
    samples = observe(drifting(spatial, 0.3 * drift, np.array([0.3, -0.2, 0.5])), MID)[:60]
    push = DisturbanceModel(0.5, 0.0, 'inertial')
    consider = ConsiderParameters(kernel('servicer7'), disturbances(push, push))
    found = np.concatenate([consider.columns(part, BODY) for part in cut(samples, pieces)])
    _, counts = concatenated(windows(samples))
    expected = -mean_of_each(brought(samples), counts)
    numbers = np.concatenate((TORQUE, FORCE)) / 0.5  # in units of their prior
    assert found @ numbers == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


def test_a_push_counts_each_sample_of_a_window_that_is_thinned(spatial: Truth) -> None:
    """In one window of 150 samples the equations of 50 stand for all; the momentum of a push adds up all of them."""
    samples = observe(spatial, MID)[:150]
    push = DisturbanceModel(0.5, 0.0, 'inertial')
    consider = ConsiderParameters(kernel('servicer7'), disturbances(push, push))
    found = consider.columns([samples], BODY)[0] @ np.concatenate((TORQUE, FORCE)) / 0.5
    assert found == pytest.approx(-np.mean(brought(samples), axis=0), rel=1e-9)


def test_unknowns_side_by_side_have_the_columns_of_each_alone(spatial: Truth) -> None:
    samples = observe(spatial, MID)[:150]
    push = DisturbanceModel(0.5, 0.0, 'inertial')
    unknowns = [odometry_mount(1.0, 1.0), *disturbances(push, push)]
    together, *alone = (
        ConsiderParameters(kernel('servicer7'), some).columns([samples], BODY)
        for some in (unknowns, *([each] for each in unknowns))
    )
    np.testing.assert_array_equal(together, np.concatenate(alone, axis=2))


def test_thinned_samples_are_spread_evenly_over_their_window(spatial: Truth) -> None:
    samples = observe(spatial, MID)
    counts = np.array([100, 30, 200])
    few, kept = _thinned(samples[:330], counts)
    assert kept.tolist() == [50, 30, 50]
    first, second, third = np.split(few.time, [50, 80])
    assert np.mean(first) == pytest.approx(np.mean(samples.time[:100]), abs=0.03)
    assert np.array_equal(second, samples.time[100:130])
    assert np.mean(third) == pytest.approx(np.mean(samples.time[130:330]), abs=0.03)
    assert np.diff(third) == pytest.approx(np.full(49, 0.2))
    same, all_of_them = _thinned(samples[:80], np.array([50, 30]))
    assert same.time is not None
    assert all_of_them.tolist() == [50, 30]
    assert len(same) == 80


def test_a_force_in_base_axes_turns_with_the_base(spatial: Truth) -> None:
    samples = observe(spatial, MID)[:2]
    push = DisturbanceModel(1.0, 0.0, 'body')
    consider = ConsiderParameters(kernel('servicer7'), disturbances(push, push))
    found = consider.columns([samples[:1], samples[1:]], BODY)[1] @ np.concatenate((np.zeros(3), FORCE))
    step = samples.time[1] - samples.time[0]
    mean = 0.5 * step * np.sum(rotate(samples.base_rotation, np.tile(FORCE, (2, 1))), axis=0)
    assert found[:3] == pytest.approx(-mean)


WINDOWS, ROWS, NUMBERS, CONSIDERED = 9, 6, 7, 3  # of a sliding window of linear equations
MOMENTUM_PLACES = slice(4, 7)


def sliding(residual: Array, columns: Array, at: Array, seed: int = 1) -> Any:
    """Return a sliding window of equations with residuals (K, r) at a point, and columns (K, r, e), seen from another.

    The solution is `at`, for which the cost need not be least.
    """
    rows = np.random.default_rng(seed).normal(size=(len(residual), ROWS, NUMBERS))
    begin = np.zeros(NUMBERS)
    there = residual + np.einsum('krn,n->kr', rows, at)
    white = SimpleNamespace(rows=rows, residual=residual)
    return SimpleNamespace(
        x=at,
        windows=SimpleNamespace(white=white, columns=columns, x=begin),
        linear=SimpleNamespace(gradient=np.einsum('krn,kr->n', rows, there)),
        cross_information=SimpleNamespace(cross=np.einsum('krn,kre->ne', rows, columns)),
    )


def test_a_jump_of_the_momentum_lowers_the_cost_as_one_more_unknown_does() -> None:
    """Each before another window, with all unknowns solved anew."""
    residual, at = np.random.default_rng(2).normal(size=(WINDOWS, ROWS)), generic(3, NUMBERS)
    residual[5:] += 3.0
    window = sliding(residual, np.zeros((WINDOWS, ROWS, 0)), at)
    rows = window.windows.white.rows
    covariance = np.linalg.inv(np.einsum('krn,krm->nm', rows, rows))
    falls, changes = momentum_jumps(window, MOMENTUM_PLACES, covariance)
    whole, right = rows.reshape(-1, NUMBERS), -residual.ravel()

    def cost(matrix: Array) -> tuple[float, Array]:
        found = np.linalg.lstsq(matrix, right, rcond=None)[0]
        return float(np.sum((matrix @ found - right) ** 2)), found

    without, _ = cost(whole)
    for place in range(1, WINDOWS):
        later = np.where(np.arange(WINDOWS)[:, None, None] >= place, rows[..., MOMENTUM_PLACES], 0.0)
        least, found = cost(np.hstack((whole, later.reshape(len(whole), -1))))
        assert falls[place - 1] == pytest.approx(without - least, rel=1e-6)
        assert changes[place - 1] == pytest.approx(found[NUMBERS:], rel=1e-6)
    assert falls.shape == (WINDOWS - 1,)


def test_jumps_by_consider_parameters_are_as_large_as_chance_has_them() -> None:
    """Without a jump the cost falls by a chi-square of three, however strong the parameters of unit variance are."""
    rng = np.random.default_rng(4)
    columns = 2.0 * rng.normal(size=(WINDOWS, ROWS, CONSIDERED))
    found = []
    for _ in range(400):
        residual = columns @ rng.normal(size=CONSIDERED) + rng.normal(size=(WINDOWS, ROWS))
        window = sliding(residual, columns, np.zeros(NUMBERS))
        rows = window.windows.white.rows
        found.append(momentum_jumps(window, MOMENTUM_PLACES, np.linalg.inv(np.einsum('krn,krm->nm', rows, rows)))[0])
    assert np.mean(found, axis=0) == pytest.approx(np.full(WINDOWS - 1, 3.0), rel=0.2)
