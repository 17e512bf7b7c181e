"""The Kalman filter over windows: least squares, done one window at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mbaid_ros.core.trajectory.steps import Step, prepare
from scipy.stats import multivariate_normal

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.trajectory import filter as kalman
from mbaid_ros.core.trajectory.belief import Belief, Beliefs, Coordinates
from mbaid_ros.core.trajectory.chain import ANGULAR, BODY, FORCE, LINEAR, WindowModel
from mbaid_ros.core.trajectory.filter import Walk, jolted, unlinked

STATE = 29
STILL = Walk('nothing drifts')


def variables(rng: np.random.Generator) -> Coordinates:
    scale = rng.uniform(0.5, 2.0, STATE)
    return Coordinates(np.eye(STATE), scale, np.eye(6), np.diag(rng.uniform(1.0, 2.0, STATE)))


def positive(rng: np.random.Generator, size: float = 1.0) -> Array:
    root = rng.normal(size=(6, 8))
    return size * root @ root.T


def window(rng: np.random.Generator, process: float = 0.0) -> WindowModel:
    turn = 0.1 * rng.normal(size=(6, STATE))
    turn[:, :6] += np.eye(6)
    turn[:, FORCE] = 0.0
    return WindowModel(
        *(rng.normal(size=6), rng.normal(size=(6, STATE)), positive(rng)),
        *(rng.normal(size=6), rng.normal(size=(6, STATE)), positive(rng)),
        transition=turn,
        drift=rng.normal(size=6),
        process=np.sqrt(process) * rng.normal(size=(6, 8)),
        joints=rng.normal(size=(6, 3)),
        joints_by_parameters=rng.normal(size=(6, 10, 3)),
        joints_in_twist=np.array(rng.uniform(0.5, 2.0)),
        length=np.array(0.5),
        rotation=np.eye(3),
        position=rng.normal(size=3),
    )


def update(belief: Belief, step: Step) -> Belief:
    return kalman.update(Beliefs.of([belief]), step)[0]


def advance(belief: Belief, step: Step, coordinates: Coordinates, walk: Walk) -> Belief:
    return kalman.advance(Beliefs.of([belief]), step, coordinates, [walk])[0]


def batch(models: list[WindowModel], coordinates: Coordinates) -> tuple[Array, Array, float, Array]:
    """Return the least-squares state at the last window's end, its covariance, and the log-likelihood of all values.

    All values as one linear function of the first state, without process noise. And last by what the joints' noise
    moves that state on average, as it is in the rows too.
    """
    rows, values, noise = [], [], []
    score: Array = np.zeros(STATE)
    whole: Array = np.eye(STATE)
    constant: Array = np.zeros(STATE)
    for model in models:
        for value, part, covariance in (
            (model.pose_value, model.pose_rows, model.pose_covariance),
            (model.twist_value, model.twist_rows, model.twist_covariance),
        ):
            rows.append(part @ whole)
            values.append(value - part @ constant)
            noise.append(covariance)
        for covariance, size in ((model.pose_covariance, 1.0), (model.twist_covariance, model.joints_in_twist)):
            # E[(d rows)^T covariance^-1 (d value)] of an error e of the joints, with unit covariance: d value is
            # joints e, d rows is the same of their derivative.
            weighed = np.linalg.solve(covariance, model.joints)
            score[BODY] += size * np.einsum('aun,an->u', model.joints_by_parameters, weighed)
        step = np.eye(STATE)
        step[:6] = model.transition
        whole, constant = step @ whole, step @ constant
        constant[:6] += model.drift
    matrix, value = np.concatenate(rows), np.concatenate(values)
    sigma = np.zeros((len(value), len(value)))
    for index, covariance in enumerate(noise):
        sigma[6 * index : 6 * index + 6, 6 * index : 6 * index + 6] = covariance
    prior = coordinates.open_variance.copy()
    prior[FORCE] = 0.0
    total = (matrix * prior) @ matrix.T + sigma
    gain = np.linalg.solve(total, matrix * prior).T
    mean, covariance = gain @ value, np.diag(prior) - gain @ (matrix * prior)
    likelihood = float(multivariate_normal(np.zeros(len(value)), total).logpdf(value))
    likelihood += 0.5 * len(value) * np.log(2.0 * np.pi)
    return whole @ mean + constant, whole @ covariance @ whole.T, likelihood, whole @ covariance @ score


@pytest.mark.parametrize('seed', range(3))
def test_the_filter_is_least_squares(seed: int) -> None:
    rng = np.random.default_rng(seed)
    coordinates = variables(rng)
    models = [window(rng) for _ in range(4)]
    belief = coordinates.open()
    for model in models:
        step = prepare(model, coordinates)
        belief = advance(update(belief, step), step, coordinates, STILL)
    mean, covariance, likelihood, shift = batch(models, coordinates)
    spread = coordinates.spread
    assert spread @ belief.means[:, 0] == pytest.approx(mean, rel=1e-8, abs=1e-8)
    assert spread @ belief.covariance @ spread.T == pytest.approx(covariance, rel=1e-8, abs=1e-8)
    assert belief.evidence == pytest.approx(likelihood, rel=1e-9)
    assert belief.measured == 48
    assert spread @ belief.shift == pytest.approx(shift, rel=1e-8, abs=1e-8)
    state = coordinates.state(belief)
    assert state[0] == pytest.approx(mean + shift, rel=1e-8, abs=1e-8)


def test_an_unmeasured_twist_is_left_out() -> None:
    rng = np.random.default_rng(0)
    coordinates = variables(rng)
    model = window(rng)
    step = prepare(replace(model, twist_value=np.full(6, np.nan)), coordinates)
    assert len(step.value) == 6
    assert step.log_noise == pytest.approx(np.linalg.slogdet(model.pose_covariance)[1])


def test_a_constant_force_moves_the_momentum() -> None:
    rng = np.random.default_rng(1)
    coordinates = variables(rng)
    model = replace(window(rng), rotation=np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    step = prepare(model, coordinates)
    state = rng.normal(size=STATE)
    belief = Belief(np.column_stack((coordinates.gather @ state, np.zeros(STATE))), np.eye(STATE), STATE)
    force, torque = state[FORCE][:3], state[FORCE][3:]
    turned = model.rotation @ force
    acting = {
        'inertial': (force, torque),
        'body': (turned, model.rotation @ torque + np.cross(model.position, turned)),
    }
    for walk in (Walk('', force='inertial'), Walk('', force='body')):
        after = coordinates.spread @ advance(belief, step, coordinates, walk).mean
        linear, angular = acting[walk.force]
        assert after[LINEAR] == pytest.approx(state[LINEAR] + 0.5 * linear)
        assert after[ANGULAR] == pytest.approx(state[ANGULAR] + 0.5 * angular)
    assert np.all(coordinates.open(force=True).covariance[FORCE, FORCE].diagonal() > 0.0)
    assert np.all(coordinates.open().covariance[FORCE, FORCE] == 0.0)


def test_walks_add_their_variance() -> None:
    rng = np.random.default_rng(2)
    coordinates = variables(rng)
    step = prepare(window(rng), coordinates)
    belief = coordinates.open()
    spread = coordinates.spread
    still, walked = (
        spread @ advance(belief, step, coordinates, walk).covariance @ spread.T
        for walk in (STILL, Walk('', momentum=3.0, position=2.0, orientation=1.0))
    )
    expected = np.zeros(STATE)
    expected[:3], expected[3:6], expected[6:12] = 0.5, 2.0, 4.5
    assert walked - still == pytest.approx(np.diag(expected), abs=1e-9)


def test_a_broken_chain_keeps_momentum_and_body() -> None:
    rng = np.random.default_rng(3)
    coordinates = variables(rng)
    step = prepare(window(rng), coordinates)
    belief = update(coordinates.open(), step)
    broken = unlinked(belief, coordinates)
    assert np.array_equal(broken.means[6:], belief.means[6:])
    assert broken.covariance[6:, 6:] == pytest.approx(belief.covariance[6:, 6:], rel=1e-9, abs=1e-12)
    assert np.all(broken.means[:6] == 0.0)
    assert broken.covariance[:6, 6:] == pytest.approx(np.zeros((6, STATE - 6)), abs=1e-12)
    assert broken.covariance[:6, :6] == pytest.approx(coordinates.open().covariance[:6, :6], abs=1e-12)


def test_a_jolt_loosens_the_momentum_and_the_pose_it_moved() -> None:
    rng = np.random.default_rng(4)
    coordinates = variables(rng)
    model = window(rng)
    belief = update(coordinates.open(), prepare(model, coordinates))
    sizes = np.arange(1.0, 7.0)
    after = jolted(belief, prepare(model, coordinates), coordinates, sizes)
    spread = coordinates.spread
    added = spread @ (after.covariance - belief.covariance) @ spread.T
    assert np.array_equal(after.means, belief.means)
    assert added[6:12, 6:12] == pytest.approx(np.diag(sizes**2), abs=1e-9)
    # It may have come at any time of the window: uniform, with a mean of a half and a mean square of a third.
    moved = model.transition[:, 6:12] * sizes
    assert added[:6, 6:12] == pytest.approx(0.5 * moved * sizes, abs=1e-9)
    assert added[:6, :6] == pytest.approx(moved @ moved.T / 3.0, abs=1e-9)
    assert added[12:] == pytest.approx(np.zeros((STATE - 12, STATE)), abs=1e-9)


def test_covariances_stay_symmetric_and_positive() -> None:
    rng = np.random.default_rng(5)
    coordinates = variables(rng)
    models = [window(rng, 1e-4) for _ in range(20)]
    # A chain that neither grows nor dies: what it brings along decays a little.
    steps = [prepare(replace(model, transition=0.9 * model.transition), coordinates) for model in models]
    belief = coordinates.open(force=True)
    for number in range(3000):
        step = steps[number % len(steps)]
        belief = advance(update(belief, step), step, coordinates, Walk('', force='inertial'))
    assert np.array_equal(belief.covariance, belief.covariance.T)
    values = np.linalg.eigvalsh(belief.covariance)
    assert values.min() > 0.0
    assert np.all(np.diag(belief.covariance) > 0.0)


def test_a_variance_may_shrink_by_more_than_double_precision_tells() -> None:
    """What is measured 1e-9 as well as it was known stays known, and known to be: as a covariance it would be lost."""
    rng = np.random.default_rng(6)
    coordinates = Coordinates(np.eye(STATE), np.ones(STATE), np.eye(6), np.eye(STATE))
    model = window(rng)
    sharp = 1e-18
    model = replace(
        model, pose_covariance=sharp * model.pose_covariance, twist_covariance=sharp * model.twist_covariance
    )
    step = prepare(model, coordinates)
    belief = update(coordinates.open(force=True), step)
    spread = np.sum((step.rows @ belief.factor) ** 2, axis=1)
    assert spread == pytest.approx(np.ones(12), rel=1e-5)


def test_hypotheses_side_by_side_are_those_one_by_one() -> None:
    rng = np.random.default_rng(7)
    coordinates = variables(rng)
    walks = [STILL, Walk('', force='inertial'), Walk('', force='body'), Walk('', momentum=0.3), Walk('', position=0.2)]
    alone = [coordinates.open(force=walk.force != 'none') for walk in walks]
    together = Beliefs.of(alone)
    for model in [window(rng, 1e-2) for _ in range(4)]:
        step = prepare(model, coordinates)
        together = kalman.advance(kalman.update(together, step), step, coordinates, walks)
        alone = [advance(update(each, step), step, coordinates, walk) for each, walk in zip(alone, walks, strict=True)]
    for index, each in enumerate(alone):
        assert together[index].means == pytest.approx(each.means, rel=1e-10, abs=1e-10)
        assert together[index].covariance == pytest.approx(each.covariance, rel=1e-10, abs=1e-12)
        assert together[index].evidence == pytest.approx(each.evidence, rel=1e-12)
        assert together[index].last_surprise == pytest.approx(each.last_surprise, rel=1e-10)
