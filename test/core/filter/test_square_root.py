"""The information filter over windows: least squares, one window at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from mbaid_ros.core.filter.chain import WindowModel
from mbaid_ros.core.filter.measured_window import IntegratedTwist, Measurement
from mbaid_ros.core.filter.square_root import MeanAndCovariance, SquareRootInformation, update
from mbaid_ros.core.filter.state import ANGULAR, BODY, LINEAR
from mbaid_ros.core.filter.time_update import (
    UNDISTURBED,
    Hypothesis,
    advance,
    momentum_change,
    momentum_inflation,
    pose_reset,
)
from mbaid_ros.core.filter.variables import OPEN_LENGTH, Variables
from mbaid_ros.core.filter.whitened import Axes
from mbaid_ros.core.geometry import Array
from windowed import NUMBERS, STATE, UNKNOWNS, positive, prepare, variables, window


def covariance_of(gaussian: SquareRootInformation, space: Variables) -> Array:
    """Return the covariance of the state."""
    factor = MeanAndCovariance.of(gaussian, space).factor
    return np.asarray(factor @ factor.T)


def batch(models: list[WindowModel], space: Variables) -> tuple[Array, Array, float, Array]:
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
            (model.pose.value, model.pose.rows, model.pose.covariance),
            (model.twist.value, model.twist.rows, model.twist.covariance),
        ):
            rows.append(part @ whole)
            values.append(value - part @ constant)
            noise.append(covariance)
        for covariance, size in ((model.pose.covariance, 1.0), (model.twist.covariance, model.joints_in_twist)):
            # E[(d rows)^T covariance^-1 (d value)] of an error e of the joints, with unit covariance: d value is
            # joints e, d rows is the same of their derivative.
            weighed = np.linalg.solve(covariance, model.noise.pose)
            score[BODY.start : BODY.start + NUMBERS] += size * np.einsum('aun,an->u', model.noise.by_unknowns, weighed)
        step = np.eye(STATE)
        step[:6] = model.transition
        whole, constant = step @ whole, step @ constant
        constant[:6] += model.drift
    matrix, value = np.concatenate(rows), np.concatenate(values)
    sigma = np.zeros((len(value), len(value)))
    for index, covariance in enumerate(noise):
        sigma[6 * index : 6 * index + 6, 6 * index : 6 * index + 6] = covariance
    prior = np.diag(space.factor) ** 2
    total = (matrix * prior) @ matrix.T + sigma
    gain = np.linalg.solve(total, matrix * prior).T
    mean = space.mean + gain @ (value - matrix @ space.mean)
    covariance = np.diag(prior) - gain @ (matrix * prior)
    likelihood = float(multivariate_normal(matrix @ space.mean, total).logpdf(value))
    likelihood += 0.5 * len(value) * np.log(2.0 * np.pi)
    return whole @ mean + constant, whole @ covariance @ whole.T, likelihood, whole @ covariance @ score


@pytest.mark.parametrize('seed', range(3))
def test_the_filter_is_least_squares(seed: int) -> None:
    rng = np.random.default_rng(seed)
    space = variables(rng)
    models = [window(rng) for _ in range(4)]
    gaussian = SquareRootInformation.prior(space)
    for model in models:
        white = prepare(model, space)
        gaussian = advance(update(gaussian, white), white, space, UNDISTURBED)
    mean, covariance, likelihood, shift = batch(models, space)
    distribution = MeanAndCovariance.of(gaussian, space)
    assert space.spread @ gaussian.least_squares == pytest.approx(mean, rel=1e-8, abs=1e-8)
    assert covariance_of(gaussian, space) == pytest.approx(covariance, rel=1e-8, abs=1e-8)
    assert distribution.variance == pytest.approx(np.diag(covariance), rel=1e-8, abs=1e-8)
    assert gaussian.log_likelihood == pytest.approx(likelihood, rel=1e-9)
    assert gaussian.measured == 48
    assert distribution.shift == pytest.approx(shift, rel=1e-8, abs=1e-8)
    assert distribution.mean == pytest.approx(mean + shift, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize('force', ['none', 'inertial'])
def test_innovations_are_those_of_each_measurement_given_those_before(force: Axes) -> None:
    rng = np.random.default_rng(7)
    space = variables(rng)
    first, second = (prepare(window(rng), space) for _ in range(2))
    before = update(SquareRootInformation.prior(space, force), first)
    after = update(before, second)
    count = len(space.scale)
    covariance = before.factor[:count] @ before.factor[:count].T
    innovation = second.value - second.rows @ before.least_squares[:count]
    whole = second.rows @ covariance @ second.rows.T + np.eye(len(innovation))
    expected = np.linalg.solve(np.linalg.cholesky(whole), innovation)
    assert after.innovations.previous[second.places] == pytest.approx(expected, rel=1e-8)
    assert after.last_nis == pytest.approx(innovation @ np.linalg.solve(whole, innovation), rel=1e-8)
    assert np.all(np.tril(after.root[:, :-2], -1) == 0.0)


@pytest.mark.parametrize('force', ['none', 'inertial'])
def test_a_window_without_a_measurement_leaves_the_gaussian_as_it_was(force: Axes) -> None:
    rng = np.random.default_rng(8)
    space = variables(rng)
    white = prepare(window(rng), space)
    nothing = replace(white, value=white.value[:0], rows=white.rows[:0], places=white.places[:0], log_noise=0.0)
    before = update(SquareRootInformation.prior(space, force), white)
    after = update(before, nothing)
    root = np.sign(after.root.diagonal())[:, None] * after.root
    assert root == pytest.approx(np.sign(before.root.diagonal())[:, None] * before.root, rel=1e-12, abs=1e-12)
    assert after.log_likelihood == pytest.approx(before.log_likelihood)
    assert after.last_nis == 0.0


def test_a_constant_force_moves_the_momentum() -> None:
    rng = np.random.default_rng(1)
    space = variables(rng)
    model = replace(window(rng), rotation=np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    white = prepare(model, space)
    state, wrench = rng.normal(size=STATE), rng.normal(size=6)
    known = np.concatenate((space.gather @ state, np.linalg.solve(space.force, wrench)))
    known_force = np.column_stack((np.eye(6), np.zeros(6), known[STATE:]))
    force, torque = wrench[:3], wrench[3:]
    turned = model.rotation @ force
    acting: dict[Axes, tuple[Array, Array]] = {
        'inertial': (force, torque + np.cross(model.centre, force)),
        'inertial on the base': (force, torque + np.cross(model.position, force)),
        'body': (turned, model.rotation @ torque + np.cross(model.position, turned)),
    }
    for axes, (linear, angular) in acting.items():
        prior = SquareRootInformation.of(np.eye(STATE), known[:STATE], (axes,), space)[0]
        gaussian = replace(prior, force=known_force)
        after = MeanAndCovariance.of(advance(gaussian, white, space, Hypothesis('', force=axes)), space)
        assert after.mean[LINEAR] == pytest.approx(state[LINEAR] + 0.5 * linear)
        assert after.mean[ANGULAR] == pytest.approx(state[ANGULAR] + 0.5 * angular)
        assert after.force == pytest.approx(wrench)
    acts, none = (MeanAndCovariance.of(each, space) for each in SquareRootInformation.priors(space, ('body', 'none')))
    assert acts.force_factor @ acts.force_factor.T == pytest.approx(space.force @ space.force.T)
    assert np.all(none.force == 0.0)
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
        MeanAndCovariance.of(each, space) for each in (gaussian, broken, SquareRootInformation.prior(space))
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
    rest = len(space.scale) - space.head
    brought = np.concatenate((np.zeros((6, space.head)), rng.normal(size=(6, rest))), axis=1)
    change = momentum_change(brought, 1.0, 1.0, space)
    still, after = (pose_reset(gaussian, space, each) for each in (None, change))
    expected = np.eye(len(space.scale))
    expected[space.poses : space.head] += brought
    assert after.mean_and_shift()[0] == pytest.approx(expected @ still.mean_and_shift()[0], rel=1e-9, abs=1e-9)
    assert after.factor @ after.factor.T == pytest.approx(
        expected @ still.factor @ still.factor.T @ expected.T, rel=1e-8, abs=1e-8
    )


@pytest.mark.parametrize('seconds', [2.0, 50.0])
def test_a_process_pushes_over_a_gap_as_its_course_does(seconds: float) -> None:
    rng = np.random.default_rng(5)
    time = 20.0  # s, of the last of the unknowns
    space = replace(variables(rng), times=np.append(np.full(UNKNOWNS - 1, np.inf), time))
    white = prepare(window(rng), space)
    gaussian = update(SquareRootInformation.prior(space), white)
    brought = np.zeros((space.poses, len(space.scale)))
    brought[:, -1] = rng.normal(size=space.poses)  # a second
    after = pose_reset(gaussian, space, momentum_change(brought, 1.0, seconds, space))
    # In many small steps, each of a constant and of noise at its end.
    count, own = 4000, space.poses
    step = seconds / count
    kept = np.exp(-step / time)
    through = np.eye(len(space.scale))
    through[own : space.head, -1] = step * brought[:, -1]
    through[-1, -1] = kept
    still = pose_reset(gaussian, replace(space, times=np.zeros(0))).factor
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
    assert MeanAndCovariance.of(loose, space).mean == pytest.approx(
        MeanAndCovariance.of(gaussian, space).mean, abs=1e-9
    )
    assert added[6:12, 6:12] == pytest.approx(np.diag(sizes**2), abs=1e-9)
    # It may have come at any time of the window: uniform, with a mean of a half and a mean square of a third.
    moved = model.transition[:, 6:12] * sizes
    assert added[:6, 6:12] == pytest.approx(0.5 * moved * sizes, abs=1e-9)
    assert added[:6, :6] == pytest.approx(moved @ moved.T / 3.0, abs=1e-9)
    assert added[12:] == pytest.approx(np.zeros((STATE - 12, STATE)), abs=1e-9)


def test_a_variance_may_shrink_by_more_than_double_precision_tells() -> None:
    """What is measured 1e-9 as well as it was known stays known, and known to be: as a covariance it would be lost."""
    rng = np.random.default_rng(6)
    unit = np.ones(STATE)
    space = Variables(
        np.eye(STATE), unit, np.eye(6), np.eye(6), 0.0 * unit, np.eye(STATE), np.eye(UNKNOWNS), np.ones(6)
    )
    model = window(rng)
    sharp = 1e-18
    model = replace(
        model,
        pose=replace(model.pose, covariance=sharp * model.pose.covariance),
        twist=replace(model.twist, covariance=sharp * model.twist.covariance),
    )
    white = prepare(model, space)
    factor = update(SquareRootInformation.prior(space, 'inertial'), white).factor
    spread = np.sum((white.rows @ factor[:STATE]) ** 2, axis=1)
    assert spread == pytest.approx(np.ones(12), rel=1e-5)


def test_what_walks_is_less_certain_after_a_window_and_nothing_else_is() -> None:
    rng = np.random.default_rng(4)
    walks = np.zeros((UNKNOWNS, 2))
    walks[:2] = rng.normal(size=(2, 2))
    space = replace(variables(rng), walks=walks)
    white = prepare(window(rng), space)
    before = update(SquareRootInformation.prior(space), white)
    still, after = (
        advance(before, white, each, UNDISTURBED) for each in (replace(space, walks=np.zeros((0, 0))), space)
    )
    more: Array = np.zeros((STATE, STATE))
    more[-UNKNOWNS:, -UNKNOWNS:] = 0.5 * walks @ walks.T  # in half a second
    assert covariance_of(after, space) == pytest.approx(covariance_of(still, space) + more, rel=1e-8, abs=1e-8)
    assert after.least_squares == pytest.approx(still.least_squares, rel=1e-8, abs=1e-8)
    assert np.all(np.tril(after.root[:, :-2], -1) == 0.0)


def test_a_gyro_and_a_twist_have_the_joints_noise_in_common() -> None:
    rng = np.random.default_rng(5)
    space = variables(rng)
    model = window(rng)
    root = rng.normal(size=(9, 12))
    model = replace(model, twist=Measurement(rng.normal(size=9), rng.normal(size=(9, STATE)), root @ root.T))
    white = prepare(model, space)
    assert white.places.tolist() == list(range(15))
    rows = white.rows[6:] / space.scale
    expected = model.twist.rows.T @ np.linalg.solve(model.twist.covariance, model.twist.rows)
    assert rows.T @ rows == pytest.approx(expected)
    unmeasured = model.twist.value.copy()
    unmeasured[:6] = np.nan
    alone = prepare(replace(model, twist=replace(model.twist, value=unmeasured)), space)
    assert alone.places.tolist() == [*range(6), 12, 13, 14]
    expected = model.twist.rows[6:].T @ np.linalg.solve(model.twist.covariance[6:, 6:], model.twist.rows[6:])
    rows = alone.rows[6:] / space.scale
    assert rows.T @ rows == pytest.approx(expected)


def test_the_linked_filter_is_least_squares() -> None:  # noqa: PLR0915
    rng = np.random.default_rng(0)
    space, count = variables(rng), 3
    models = []
    for _ in range(count):
        way = rng.normal(size=6), rng.normal(size=(6, STATE)), rng.normal(size=6), rng.normal(size=(6, STATE))
        share, left, change = np.array(0.45), np.array(0.08), np.array(0.7)
        twist = IntegratedTwist(np.array(object=True), *way, 0.1 * positive(rng), share, left, change)
        model = window(rng)
        common = model.noise.pose @ model.noise.pose.T
        covariance = positive(rng) + common
        models.append(
            (replace(model, pose=replace(model.pose, covariance=covariance), integrated=twist), twist, common)
        )
    gaussian = SquareRootInformation.prior(space)
    for model, _, _ in models:
        white = prepare(model, space)
        gaussian = advance(update(gaussian, white), white, space, UNDISTURBED)
    # All at once, over the first state, c, and the noise q of each window's way.
    size = STATE + 6 + 6 * count
    whole: Array = np.eye(STATE, size)
    carried: Array = np.zeros((6, size))
    carried[:, STATE : STATE + 6] = np.eye(6)
    constant: Array = np.zeros(STATE)
    carried_constant: Array = np.zeros(6)
    deviation = np.concatenate((np.diag(space.factor), np.full(6, OPEN_LENGTH), np.ones(6 * count)))
    information = np.diag(deviation**-2.0)
    right = information @ np.concatenate((space.mean, np.zeros(size - STATE)))
    for place, (model, twist, common) in enumerate(models):
        noise = np.zeros((6, size))
        noise[:, STATE + 6 + 6 * place : STATE + 12 + 6 * place] = np.linalg.cholesky(twist.white)
        rows = (model.pose.rows - twist.change * twist.way_rows) @ whole - twist.change * noise
        of_mean = twist.mean_rows @ whole + carried + twist.share * noise
        values = model.pose.value - twist.change * twist.way_value, twist.mean_value - carried_constant
        values = (
            values[0] - (model.pose.rows - twist.change * twist.way_rows) @ constant,
            (values[1] - twist.mean_rows @ constant),
        )
        covariance = np.block([[model.pose.covariance, common], [common, common + twist.left * twist.white]])
        both = np.concatenate((rows, of_mean))
        information += both.T @ np.linalg.solve(covariance, both)
        right += both.T @ np.linalg.solve(covariance, np.concatenate(values))
        carried = carried + noise + twist.way_rows @ whole
        carried_constant = carried_constant - twist.way_value + twist.way_rows @ constant
        step = np.eye(STATE)
        step[:6] = model.transition
        whole, constant = step @ whole, step @ constant
        constant[:6] += model.drift
    solved = np.linalg.inv(information)
    distribution = MeanAndCovariance.of(gaussian, space)
    assert space.spread @ gaussian.least_squares == pytest.approx(
        whole @ (solved @ right) + constant, rel=1e-6, abs=1e-6
    )
    assert distribution.factor @ distribution.factor.T == pytest.approx(whole @ solved @ whole.T, rel=1e-6, abs=1e-6)
