"""The information filter over windows: least squares, one window at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from mbaid_ros.core.contracts import UNDISTURBED, Axes
from mbaid_ros.core.filter.gaussian import SquareRootInformation, update
from mbaid_ros.core.filter.linearise import WindowModel
from mbaid_ros.core.filter.posterior import MeanAndCovariance
from mbaid_ros.core.filter.time_update import advance
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.gyro import IMU, GyroSensor
from mbaid_ros.core.odometry.model import IntegratedTwist, Measurement
from mbaid_ros.core.state import BODY, OPEN_LENGTH, Variables
from windowed import NUMBERS, STATE, UNKNOWNS, covariance_of, positive, prepare, variables, window


def onward(model: WindowModel, whole: Array, constant: Array) -> tuple[Array, Array]:
    """Return how the state after a window depends on the first one, (s, s) and (s,)."""
    step = np.eye(STATE)
    step[:6] = model.transition
    return step @ whole, step @ constant + np.append(model.drift, np.zeros(STATE - 6))


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
            (model.rates.value, model.rates.rows, model.rates.covariance),
        ):
            rows.append(part @ whole)
            values.append(value - part @ constant)
            noise.append(covariance)
        for covariance, size in ((model.pose.covariance, 1.0), (model.rates.covariance, model.joints_in_twist)):
            # E[(d rows)^T covariance^-1 (d value)] of an error e of the joints, with unit covariance: d value is
            # joints e, d rows is the same of their derivative.
            weighed = np.linalg.solve(covariance, model.noise.pose)
            score[BODY.start : BODY.start + NUMBERS] += size * np.einsum('aun,an->u', model.noise.by_unknowns, weighed)
        whole, constant = onward(model, whole, constant)
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
    distribution = MeanAndCovariance.from_gaussian(gaussian, space)
    assert space.to_state @ gaussian.least_squares == pytest.approx(mean, rel=1e-8, abs=1e-8)
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
def test_the_mean_of_some_variables_given_all_others(force: Axes) -> None:
    """It is their mean and the regression on the deviation of the others."""
    rng = np.random.default_rng(4)
    space = variables(rng)
    gaussian = SquareRootInformation.prior(space, force)
    for model in (window(rng), window(rng)):
        gaussian = update(gaussian, prepare(model, space))
    mean, covariance = gaussian.mean_and_shift()[0], gaussian.factor @ gaussian.factor.T
    free = np.array([2, 7, len(space.scale) - 1])
    others = np.setdiff1d(np.arange(len(mean)), free)
    away = 0.1 * rng.normal(size=len(mean)) * np.sqrt(np.diag(covariance))
    regression = covariance[np.ix_(free, others)] @ np.linalg.inv(covariance[np.ix_(others, others)])
    assert gaussian.given(mean + away, free) == pytest.approx(mean[free] + regression @ away[others], rel=1e-5)


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


def test_a_variance_may_shrink_by_more_than_double_precision() -> None:
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
        rates=replace(model.rates, covariance=sharp * model.rates.covariance),
    )
    white = prepare(model, space)
    factor = update(SquareRootInformation.prior(space, 'inertial'), white).factor
    spread = np.sum((white.rows @ factor[:STATE]) ** 2, axis=1)
    assert spread == pytest.approx(np.ones(12), rel=1e-5)


GYRO = GyroSensor(IMU, 0.0, slice(0, 3))


def test_a_gyro_and_a_twist_have_the_joints_noise_in_common() -> None:
    rng = np.random.default_rng(5)
    space = variables(rng)
    model = window(rng)
    root = rng.normal(size=(9, 12))
    rates = Measurement(rng.normal(size=9), rng.normal(size=(9, STATE)), root @ root.T)
    model, space = replace(model, rates=rates, joints_in_rates=np.zeros((9, 3))), replace(space, sensors=(GYRO,))
    white = prepare(model, space)
    assert white.places.tolist() == list(range(15))
    rows = white.rows[6:] / space.scale
    expected = model.rates.rows.T @ np.linalg.solve(model.rates.covariance, model.rates.rows)
    assert rows.T @ rows == pytest.approx(expected)
    unmeasured = model.rates.value.copy()
    unmeasured[:6] = np.nan
    alone = prepare(replace(model, rates=replace(model.rates, value=unmeasured)), space)
    assert alone.places.tolist() == [*range(6), 12, 13, 14]
    expected = model.rates.rows[6:].T @ np.linalg.solve(model.rates.covariance[6:, 6:], model.rates.rows[6:])
    rows = alone.rows[6:] / space.scale
    assert rows.T @ rows == pytest.approx(expected)


def test_the_linked_filter_is_least_squares() -> None:
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
        rows = (model.pose.rows - twist.change * twist.integral_rows) @ whole - twist.change * noise
        of_mean = twist.mean_rows @ whole + carried + twist.share * noise
        values = model.pose.value - twist.change * twist.integral_value, twist.mean_value - carried_constant
        values = (
            values[0] - (model.pose.rows - twist.change * twist.integral_rows) @ constant,
            (values[1] - twist.mean_rows @ constant),
        )
        covariance = np.block([[model.pose.covariance, common], [common, common + twist.left * twist.white]])
        both = np.concatenate((rows, of_mean))
        information += both.T @ np.linalg.solve(covariance, both)
        right += both.T @ np.linalg.solve(covariance, np.concatenate(values))
        carried = carried + noise + twist.integral_rows @ whole
        carried_constant = carried_constant - twist.integral_value + twist.integral_rows @ constant
        whole, constant = onward(model, whole, constant)
    solved = np.linalg.inv(information)
    distribution = MeanAndCovariance.from_gaussian(gaussian, space)
    assert space.to_state @ gaussian.least_squares == pytest.approx(
        whole @ (solved @ right) + constant, rel=1e-6, abs=1e-6
    )
    assert distribution.factor @ distribution.factor.T == pytest.approx(whole @ solved @ whole.T, rel=1e-6, abs=1e-6)
