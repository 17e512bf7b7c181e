"""Errors in variables: what noise in the rows feigns, and how much wider an interval is without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drawn_windows import prepare, variables, window
from mbaid_ros.core.filter.gaussian import MeanAndCovariance, SquareRootInformation
from mbaid_ros.core.filter.joint_noise import InformationCorrection
from mbaid_ros.core.filter.square_root import update
from mbaid_ros.core.filter.state import BODY, BODY_PLACES
from mbaid_ros.core.geometry import Array


@pytest.mark.parametrize('seed', range(3))
def test_noise_in_rows_feigns_the_information_that_it_has_on_average(seed: int) -> None:
    rng = np.random.default_rng(seed)
    space, model = variables(rng), window(rng)
    slope = np.einsum('aun,ub->abn', model.joints_by_unknowns[:, :10], space.spread[BODY, BODY])
    information = np.zeros((10, 10))
    for covariance, size in ((model.pose_covariance, 1.0), (model.twist_covariance, model.joints_in_twist)):
        # E[(d rows)^T covariance^-1 (d rows)] of an error of the joints with unit covariance.
        information += size * np.einsum('abn,ac,cdn->bd', slope, np.linalg.inv(covariance), slope)
    at = information @ (space.gather[BODY, BODY] @ model.body)
    assert prepare(model, space).feigned == pytest.approx(np.column_stack((information, at)), rel=1e-8)


def test_what_is_feigned_adds_up_and_widens_the_body_and_what_goes_with_it() -> None:
    rng = np.random.default_rng(4)
    space = variables(rng)
    white = [prepare(window(rng), space) for _ in range(2)]
    belief = SquareRootInformation.prior(space)
    for each in white:
        belief = update(belief, each)
    assert belief.feigned == pytest.approx(white[0].feigned + white[1].feigned)
    moments = MeanAndCovariance.of(belief, space)
    rows = np.arange(6, BODY.stop)  # momentum and body
    covariance = moments.covariance(rows)
    information = np.zeros((len(rows), len(rows)))
    gather = space.gather[BODY, BODY]
    # Of these drawn windows' information, what is left of a hundredth of the joints' noise.
    small = MeanAndCovariance.of(replace(belief, feigned=1e-4 * belief.feigned), space)
    information[6:, 6:] = 1e-4 * gather.T @ belief.feigned[:, :-1] @ gather
    expected = np.linalg.inv(np.eye(len(rows)) - covariance @ information)
    for which in (rows, BODY_PLACES):
        times = small.amplification(small.factor_of(space.spread[which]), which)
        assert times == pytest.approx(expected[-len(which) :, -len(which) :], rel=1e-7, abs=1e-9)


def test_intervals_hold_where_much_of_what_seems_known_is_noise() -> None:
    """Thousands of fits of y = x h, h measured with a known noise: the spread of x is that of the wider interval."""
    rng = np.random.default_rng(0)
    runs, count, truth, noise, of_row = 4000, 200, 1.0, 0.5, 0.5
    motion = 0.6 * rng.standard_normal(count)
    rows = motion + of_row * rng.standard_normal((runs, count))
    values = truth * motion + noise * rng.standard_normal((runs, count))
    # The residual y - x h has the rows' noise, too, as its part of the noise: S = noise^2 + x^2 of_row^2.
    size = noise**2 + truth**2 * of_row**2
    feigned = count * of_row**2 / size

    def step(x: Array) -> Array:
        residual = values - x[:, None] * rows
        score = np.sum(rows * residual, axis=1) / size + x * feigned  # on average zero at the truth
        return np.asarray(x + score / (np.sum(rows**2, axis=1) / size))

    found: Array = np.full(runs, 0.7)
    for _ in range(200):
        found = step(found)
    information = np.mean(np.sum(rows**2, axis=1)) / size
    seems = np.sqrt(1.0 / information)
    found_of = InformationCorrection.of(np.array([[1.0 / information]]), np.array([[feigned, feigned]]), np.ones(1))
    wider = np.hypot(1.0 + found_of.gain[0, 0] / information, found_of.score[0, 0] / np.sqrt(information))
    assert feigned / information == pytest.approx(0.41, abs=0.05)
    assert np.mean(found) == pytest.approx(truth, abs=0.02)
    assert np.std(found) > 1.3 * seems
    assert np.std(found) == pytest.approx(wider * seems, rel=0.08)


def test_what_is_all_noise_is_known_a_hundred_times_less_well() -> None:
    times = 1.0 + InformationCorrection.of(np.array([[2.0]]), np.array([[5.0, 0.0]]), np.zeros(1)).gain[0, 0] * 2.0
    assert times == pytest.approx(100.0)
