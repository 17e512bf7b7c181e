"""From one window to the next: forces, random walks, gaps and jumps of the momentum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbaid_ros.core.contracts import UNDISTURBED, Axes, Hypothesis
from mbaid_ros.core.filter.gaussian import SquareRootInformation, update
from mbaid_ros.core.filter.hypotheses import HypothesisFilter
from mbaid_ros.core.filter.linearise import WhitenedWindow
from mbaid_ros.core.filter.posterior import MeanAndCovariance
from mbaid_ros.core.filter.time_update import (
    advance,
    at_window_start,
    momentum_change,
    momentum_inflation,
    pose_reset,
)
from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.state import ANGULAR, LINEAR, Variables
from mbaid_ros.core.windows import AFTER, BEFORE
from windowed import STATE, UNKNOWNS, covariance_of, joint_window, prepare, variables, window


def test_a_constant_force_moves_the_momentum() -> None:
    rng = np.random.default_rng(1)
    space = variables(rng)
    model = replace(window(rng), rotation=np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    white = prepare(model, space)
    state, wrench = rng.normal(size=STATE), rng.normal(size=6)
    known = np.concatenate((space.from_state @ state, np.linalg.solve(space.force, wrench)))
    known_force = np.column_stack((np.eye(6), np.zeros(6), known[STATE:]))
    force, torque = wrench[:3], wrench[3:]
    turned = model.rotation @ force
    acting: dict[Axes, tuple[Array, Array]] = {
        'inertial': (force, torque + np.cross(model.centre, force)),
        'inertial on the base': (force, torque + np.cross(model.position, force)),
        'body': (turned, model.rotation @ torque + np.cross(model.position, turned)),
    }
    for axes, (linear, angular) in acting.items():
        prior = SquareRootInformation.from_root(np.eye(STATE), known[:STATE], (axes,), space)[0]
        gaussian = replace(prior, force=known_force)
        after = MeanAndCovariance.from_gaussian(advance(gaussian, white, space, Hypothesis('', force=axes)), space)
        assert after.mean[LINEAR] == pytest.approx(state[LINEAR] + 0.5 * linear)
        assert after.mean[ANGULAR] == pytest.approx(state[ANGULAR] + 0.5 * angular)
        assert after.force == pytest.approx(wrench)
        brought = after.impulse_of_force(white.force_impulse(axes))
        assert brought == pytest.approx(np.concatenate((0.5 * linear, 0.5 * angular)))
    acts, none = (
        MeanAndCovariance.from_gaussian(each, space) for each in SquareRootInformation.priors(space, ('body', 'none'))
    )
    assert acts.force_factor @ acts.force_factor.T == pytest.approx(space.force @ space.force.T)
    assert np.all(none.force == 0.0)
    assert np.all(none.impulse_of_force(white.force_impulse('body')) == 0.0)
    assert np.all(none.force_factor == 0.0)


def test_walks_add_their_variance() -> None:
    rng = np.random.default_rng(2)
    space = variables(rng)
    white = prepare(window(rng), space)
    gaussian = SquareRootInformation.prior(space)
    still, walked = (
        covariance_of(advance(gaussian, white, space, hypothesis), space)
        for hypothesis in (UNDISTURBED, Hypothesis('', momentum=3.0, position=2.0))
    )
    expected = np.zeros(STATE)
    expected[3:6], expected[6:12] = 2.0, 4.5
    assert walked - still == pytest.approx(np.diag(expected), abs=1e-9)


def test_a_broken_chain_keeps_momentum_and_body() -> None:
    rng = np.random.default_rng(3)
    space = variables(rng)
    gaussian = update(SquareRootInformation.prior(space), prepare(window(rng), space))
    broken = pose_reset(gaussian, space)
    before, after, prior = (
        MeanAndCovariance.from_gaussian(each, space) for each in (gaussian, broken, SquareRootInformation.prior(space))
    )
    assert np.array_equal(after.mean[6:], before.mean[6:])
    covariance = covariance_of(broken, space)
    assert covariance[6:, 6:] == pytest.approx(covariance_of(gaussian, space)[6:, 6:], rel=1e-9, abs=1e-12)
    assert np.all(after.mean[:6] == 0.0)
    assert covariance[:6, 6:] == pytest.approx(np.zeros((6, STATE - 6)), abs=1e-12)
    assert covariance[:6, :6] == pytest.approx(np.diag(prior.variance[:6]), abs=1e-12)


def test_the_momentum_changes_over_a_gap() -> None:
    rng = np.random.default_rng(3)
    space = variables(rng)
    white = prepare(window(rng), space)
    gaussian = update(SquareRootInformation.prior(space), white)
    rest = len(space.scale) - space.moving
    brought = np.concatenate((np.zeros((6, space.moving)), rng.normal(size=(6, rest))), axis=1)
    change = momentum_change(brought, 1.0, 1.0, space)
    still, after = (pose_reset(gaussian, space, each) for each in (None, change))
    expected = np.eye(len(space.scale))
    expected[space.pose_size : space.moving] += brought
    assert after.mean_and_shift()[0] == pytest.approx(expected @ still.mean_and_shift()[0], rel=1e-9, abs=1e-9)
    assert after.factor @ after.factor.T == pytest.approx(
        expected @ still.factor @ still.factor.T @ expected.T, rel=1e-8, abs=1e-8
    )


@pytest.mark.parametrize('seconds', [2.0, 50.0])
def test_a_process_pushes_over_a_gap_as_its_course_does(seconds: float) -> None:
    rng = np.random.default_rng(5)
    time = 20.0  # s, of the last of the unknowns
    space = replace(variables(rng), time_constants=np.append(np.full(UNKNOWNS - 1, np.inf), time))
    white = prepare(window(rng), space)
    gaussian = update(SquareRootInformation.prior(space), white)
    brought = np.zeros((space.pose_size, len(space.scale)))
    brought[:, -1] = rng.normal(size=space.pose_size)  # a second
    after = pose_reset(gaussian, space, momentum_change(brought, 1.0, seconds, space))
    # In many small steps, each of a constant and of noise at its end.
    count, own = 4000, space.pose_size
    step = seconds / count
    kept = np.exp(-step / time)
    through = np.eye(len(space.scale))
    through[own : space.moving, -1] = step * brought[:, -1]
    through[-1, -1] = kept
    still = pose_reset(gaussian, replace(space, time_constants=np.zeros(0))).factor
    still = still @ still.T
    covariance = still
    for _ in range(count):
        covariance = through @ covariance @ through.T
        covariance[-1, -1] += 1.0 - kept**2
    added = covariance - still
    assert after.factor @ after.factor.T - still == pytest.approx(added, abs=2e-3 * np.max(np.abs(added)))


def test_a_jump_loosens_the_momentum_and_the_pose_it_moved() -> None:
    rng = np.random.default_rng(4)
    space = variables(rng)
    model = window(rng)
    gaussian = update(SquareRootInformation.prior(space), prepare(model, space))
    sizes = np.arange(1.0, 7.0)
    loose = momentum_inflation(gaussian, prepare(model, space), space, sizes)
    added = covariance_of(loose, space) - covariance_of(gaussian, space)
    assert MeanAndCovariance.from_gaussian(loose, space).mean == pytest.approx(
        MeanAndCovariance.from_gaussian(gaussian, space).mean, abs=1e-9
    )
    assert added[6:12, 6:12] == pytest.approx(np.diag(sizes**2), abs=1e-9)
    # It may have come at any time of the window: uniform, with a mean of a half and a mean square of a third.
    moved = model.transition[:, 6:12] * sizes
    assert added[:6, 6:12] == pytest.approx(0.5 * moved * sizes, abs=1e-9)
    assert added[:6, :6] == pytest.approx(moved @ moved.T / 3.0, abs=1e-9)
    assert added[12:] == pytest.approx(np.zeros((STATE - 12, STATE)), abs=1e-9)


def walking(seed: int) -> tuple[Variables, WhitenedWindow, SquareRootInformation]:
    """Return variables of which two walk, a window, and the gaussian updated by it."""
    rng = np.random.default_rng(seed)
    walks = np.zeros((UNKNOWNS, 2))
    walks[:2] = rng.normal(size=(2, 2))
    space = replace(variables(rng), random_walk=walks)
    white = prepare(window(rng), space)
    return space, white, update(SquareRootInformation.prior(space), white)


def test_what_walks_is_less_certain_after_a_window_and_nothing_else_is() -> None:
    space, white, before = walking(4)
    walks = space.random_walk
    still, after = (
        advance(before, white, each, UNDISTURBED) for each in (replace(space, random_walk=np.zeros((0, 0))), space)
    )
    more: Array = np.zeros((STATE, STATE))
    more[-UNKNOWNS:, -UNKNOWNS:] = 0.5 * walks @ walks.T  # in half a second
    assert covariance_of(after, space) == pytest.approx(covariance_of(still, space) + more, rel=1e-8, abs=1e-8)
    assert after.least_squares == pytest.approx(still.least_squares, rel=1e-8, abs=1e-8)
    assert np.all(np.tril(after.root[:, :-2], -1) == 0.0)


@pytest.mark.parametrize('gap', [0.0, 8.0])
def test_what_walks_goes_on_walking_in_a_gap(gap: float) -> None:
    space, white, before = walking(6)
    walks = space.random_walk
    coming = joint_window(np.zeros((BEFORE + 10 + AFTER, 2)), 0.0)
    after = at_window_start(before, replace(coming, after_gap=True, gap=gap), white, space, UNDISTURBED)
    resting = replace(space, random_walk=np.zeros((0, 0)))
    still = at_window_start(before, replace(coming, after_gap=True, gap=gap), white, resting, UNDISTURBED)
    more: Array = np.zeros((STATE, STATE))
    more[-UNKNOWNS:, -UNKNOWNS:] = gap * walks @ walks.T
    assert covariance_of(after, space) == pytest.approx(covariance_of(still, space) + more, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize('gap', [0.0, 3.0])
@pytest.mark.parametrize('axes', ['inertial', 'inertial on the base', 'body'])
def test_a_constant_force_acts_on_in_a_gap(axes: Axes, gap: float) -> None:
    """Half a second of it is one window's: the momentum, given the force, changes by as many of these as fit in."""
    rng = np.random.default_rng(7)
    space = variables(rng)
    white = prepare(window(rng), space)
    state, wrench = rng.normal(size=STATE), rng.normal(size=6)
    known_force = np.column_stack((np.eye(6), np.zeros(6), np.linalg.solve(space.force, wrench)))
    prior = SquareRootInformation.from_root(np.eye(STATE), space.from_state @ state, (axes,), space)[0]
    hypothesis = Hypothesis('', force=axes)
    coming = replace(joint_window(np.zeros((BEFORE + 10 + AFTER, 2)), 0.0), after_gap=True, gap=gap)
    found = at_window_start(replace(prior, force=known_force), coming, white, space, hypothesis)
    after = MeanAndCovariance.from_gaussian(found, space)
    change = gap / 0.5 * after.impulse_of_force(white.force_impulse(axes))
    assert after.mean[6:12] == pytest.approx(state[6:12] + change)
    filtered = HypothesisFilter(hypothesis, found, force_impulse=white.force_impulse(axes))
    assert after.impulse_of_force(filtered.after_gap(coming, white).force_impulse) == pytest.approx(
        (1.0 + gap / 0.5) * after.impulse_of_force(white.force_impulse(axes))
    )


def test_a_hypothesis_walks_on_in_a_gap() -> None:
    space, white, before = walking(8)
    hypothesis = Hypothesis('', momentum=2.0)
    coming = replace(joint_window(np.zeros((BEFORE + 10 + AFTER, 2)), 0.0), after_gap=True, gap=3.0)
    still, after = (at_window_start(before, coming, white, space, each) for each in (UNDISTURBED, hypothesis))
    more = 3.0 * hypothesis.random_walk @ hypothesis.random_walk.T
    moved = covariance_of(after, space) - covariance_of(still, space)
    assert moved[6:12, 6:12] == pytest.approx(more[6:12, 6:12], rel=1e-6, abs=1e-6)


def in_another_frame(momentum: Array, place: Array, error: Array) -> Array:
    """Return (P, L) where poses of a base at a place are turned there by an error (rad), and displaced by it (m)."""
    turned, linear = exp(error[:3]), momentum[:3]
    about_base = turned @ (momentum[3:] - np.cross(place, linear))
    return np.concatenate((turned @ linear, about_base + np.cross(place + error[3:], turned @ linear)))


def test_the_error_of_a_correction_of_the_poses_turns_and_moves_the_momentum() -> None:
    space, white, before = walking(9)
    place, thrust, frame = (
        np.array([0.7, -0.4, 1.1]),
        np.array([0.3, 0.1, -0.2, 0.5, -0.6, 0.2]),
        np.array([0.04, 0.09]),
    )
    coming = joint_window(np.zeros((BEFORE + 10 + AFTER, 2)), 0.0)
    count = len(coming.knots)
    knots = replace(coming.knots, base_position=np.tile(place, (count, 1)), impulse=np.tile(thrust, (count, 1)))
    coming = replace(coming, knots=knots, after_gap=True)
    still, after = (
        at_window_start(before, replace(coming, frame=each), white, space, UNDISTURBED) for each in (np.zeros(2), frame)
    )
    momentum = space.to_state[6:12] @ before.least_squares[:STATE] + thrust
    assert np.linalg.norm(momentum) > 0.5
    slopes = [
        (in_another_frame(momentum, place, each) - in_another_frame(momentum, place, -each)) / 2e-5
        for each in 1e-5 * np.eye(6)
    ]
    factor = np.transpose(slopes) * np.repeat(np.sqrt(frame), 3)
    more: Array = np.zeros((STATE, STATE))
    more[6:12, 6:12] = factor @ factor.T
    assert covariance_of(after, space) == pytest.approx(covariance_of(still, space) + more, rel=1e-6, abs=1e-6)
    assert after.least_squares == pytest.approx(still.least_squares, rel=1e-8, abs=1e-8)
