"""A twist that is integrated links each window to the next one: least squares all the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drawn_windows import STATE, positive, prepare, variables, window
from mbaid_ros.core.filter.gaussian import MeanAndCovariance, SquareRootInformation
from mbaid_ros.core.filter.integrated_twist import IntegratedTwist
from mbaid_ros.core.filter.square_root import advance, update
from mbaid_ros.core.filter.variables import OPEN_LENGTH
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.unknowns.hypotheses import UNDISTURBED


def test_the_linked_filter_is_least_squares() -> None:  # noqa: PLR0915
    rng = np.random.default_rng(0)
    space, count = variables(rng), 3
    models = []
    for _ in range(count):
        way = rng.normal(size=6), rng.normal(size=(6, STATE)), rng.normal(size=6), rng.normal(size=(6, STATE))
        twist = IntegratedTwist(*way, 0.1 * positive(rng), np.array(0.45), np.array(0.08), np.array(0.7))
        model = window(rng)
        common = model.joints @ model.joints.T
        several = np.empty((), dtype=object)
        several[()] = twist
        covariance = positive(rng) + common
        models.append((replace(model, pose_covariance=covariance, integrated=several), twist, common))
    belief = SquareRootInformation.prior(space)
    for model, _, _ in models:
        white = prepare(model, space)
        belief = advance(update(belief, white), white, space, UNDISTURBED)
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
        rows = (model.pose_rows - twist.change * twist.way_rows) @ whole - twist.change * noise
        of_mean = twist.mean_rows @ whole + carried + twist.share * noise
        values = model.pose_value - twist.change * twist.way_value, twist.mean_value - carried_constant
        values = (
            values[0] - (model.pose_rows - twist.change * twist.way_rows) @ constant,
            (values[1] - twist.mean_rows @ constant),
        )
        covariance = np.block([[model.pose_covariance, common], [common, common + twist.left * twist.white]])
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
    moments = MeanAndCovariance.of(belief, space)
    assert space.spread @ belief.least_squares == pytest.approx(whole @ (solved @ right) + constant, rel=1e-6, abs=1e-6)
    assert moments.factor @ moments.factor.T == pytest.approx(whole @ solved @ whole.T, rel=1e-6, abs=1e-6)
