"""The error budget, ratios of inertia, nonlinearity, rounded numbers; and the budget in JSON, text and report."""

from __future__ import annotations

import math
import pickle
import re
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from checked import central_difference
from documents import ROOT
from made_runs import budget, estimate, planar, run
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.geometry import Array, Flags, unvec
from mbaid_ros.core.results.estimate import PARAMETERS, SENSOR_NOISE, DeferredBudget, ErrorBudget, Estimate, rounded
from mbaid_ros.core.results.verdict import Nonlinearity
from mbaid_ros.core.robot.body import inertia_ratios, physical, physical_jacobian, physical_shift
from mbaid_ros.core.robot.body import standard as standard_of
from mbaid_ros.parameters import build
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.json_output import as_json
from mbaid_ros.replay.one_bag import replay_bag
from mbaid_ros.replay.report.page import html
from mbaid_ros.replay.text import summary
from simulated import robot

CAUSES = (SENSOR_NOISE, 'link:base_link', 'zero:joint6')
STD = np.array([0.5, 1e-3, 2e-3, 1e-3, *[0.1] * 6])


def known_budget() -> ErrorBudget:
    """Return one whose y of the centre of mass the zero of a joint makes, and whose mass a link."""
    shares = np.tile([0.6, 0.3, 0.1], (10, 1))
    shares[0] = [0.0996, 0.9, 0.0004]
    shares[2] = [0.1, 0.05, 0.85]
    return ErrorBudget(CAUSES, shares)


def test_the_shares_of_a_parameter_come_the_largest_first_without_the_least() -> None:
    assert known_budget().shares_of('mass') == {'link:base_link': 0.9, SENSOR_NOISE: 0.0996}
    assert list(known_budget().shares_of('com_y')) == ['zero:joint6', SENSOR_NOISE, 'link:base_link']


def test_a_deferred_budget_is_computed_once_when_it_is_read_and_leaves_its_process_as_numbers() -> None:
    calls = []

    def compute() -> tuple[Array, Flags]:
        calls.append(1)
        return known_budget().shares, np.ones((10, 3), dtype=bool)

    deferred = DeferredBudget(CAUSES, compute)
    assert (deferred.causes, calls) == (CAUSES, [])
    assert deferred.shares_of('mass') == known_budget().shares_of('mass')
    assert deferred.unobserved.all()
    sent = pickle.loads(pickle.dumps(deferred))
    assert type(sent) is ErrorBudget
    np.testing.assert_array_equal(sent.shares, deferred.shares)
    assert calls == [1]


def test_a_group_counts_its_elements_by_their_variances() -> None:
    centre = known_budget().grouped(STD)['centre of mass']
    # Variances of 1, 4 and 1 mm^2.
    assert centre['zero:joint6'] == pytest.approx((0.1 + 4 * 0.85 + 0.1) / 6.0)
    assert sum(centre.values()) == pytest.approx(1.0)


def test_a_declaration_dominates_a_group_with_more_than_half_of_its_variance() -> None:
    """Sensor noise is none."""
    centre = (0.1 + 4 * 0.85 + 0.1) / 6.0
    assert known_budget().dominant(STD) == {
        'link:base_link': {'mass': pytest.approx(0.9)},
        'zero:joint6': {'centre of mass': pytest.approx(centre)},
    }


def test_what_is_not_determined_counts_nowhere() -> None:
    known = np.isin(np.arange(10), [0, 1, 9])
    shares, std = known_budget().shares.copy(), np.where(known, STD, np.nan)
    shares[~known] = np.nan
    planar = ErrorBudget(CAUSES, shares)
    assert planar.shares_of('com_y') == {}
    assert planar.grouped(std)['centre of mass'] == pytest.approx(
        {SENSOR_NOISE: 0.6, 'link:base_link': 0.3, 'zero:joint6': 0.1}
    )
    nothing = ErrorBudget(CAUSES, np.full((10, 3), np.nan))
    assert (nothing.main_causes(STD), nothing.dominant(STD), nothing.grouped(STD)) == ('', {}, {})


@pytest.mark.parametrize('times', [2.0, 10.0, 1e3])
def test_more_data_leave_at_least_what_is_said(times: float) -> None:
    """Random linear problems with a prior and data, whose variances with more data are computed as such."""
    rng, closest = np.random.default_rng(3), np.inf
    for _ in range(200):
        rows = rng.normal(size=(rng.integers(10, 30), 14)) * 10.0 ** rng.uniform(-1.0, 1.0, 14)
        prior, data = np.diag(10.0 ** rng.uniform(-2.0, 1.0, 14)), rows.T @ rows
        covariance = np.linalg.inv(prior + data)
        variance = np.diag(covariance)[:10]
        noise = np.diag(covariance @ data @ covariance)[:10] / variance
        said = ErrorBudget((SENSOR_NOISE, 'mount'), np.column_stack((noise, 1.0 - noise))).left_of_std(times)
        left = np.sqrt(np.diag(np.linalg.inv(prior + times * data))[:10] / variance)
        assert np.all(left > said - 1e-9)
        closest = min(closest, float(np.min(left / said)))
    assert closest < 1.01


def test_what_an_estimate_rests_on_comes_by_the_parameter_it_matters_most_for() -> None:
    shares = known_budget().shares
    unchecked = (shares > 0.2) & [False, True, True]
    found = ErrorBudget(CAUSES, shares, unchecked).unobservable()
    link = 'link base_link (90 % of mass, 30 % of centre of mass, 30 % of inertia)'
    assert found == f'{link}, zero of joint6 (85 % of centre of mass)'
    assert known_budget().unobservable() == ''


BODY = np.array([0.28, 1e-3, -2e-3, 3e-3, 2.2e-4, 1e-5, -2e-5, 3.1e-4, 1.5e-5, 4e-4])


def test_standard_deviations_are_those_of_the_derivatives() -> None:
    rng = np.random.default_rng(0)
    root = 1e-6 * rng.normal(size=(10, 10))
    covariance = root @ root.T
    found = inertia_ratios(BODY, covariance)

    def elements(body: Array) -> Array:
        return np.asarray(body[4:] / np.trace(unvec(body[4:])))

    def principal(body: Array) -> Array:
        return np.asarray(np.linalg.eigvalsh(unvec(elements(body))))

    for values, stds, function in (
        (found.elements, found.std, elements),
        (found.principal, found.principal_std, principal),
    ):
        slope = central_difference(function, BODY, np.maximum(1e-4 * np.abs(BODY), 1e-9))
        assert values == pytest.approx(function(BODY))
        assert stds == pytest.approx(np.sqrt(np.diag(slope @ covariance @ slope.T)), rel=1e-4)


def test_a_common_factor_is_none_of_them() -> None:
    direction = np.concatenate((np.zeros(4), BODY[4:]))
    known, open_ = np.diag((1e-4 * BODY) ** 2), 0.04 * np.outer(direction, direction)
    found = inertia_ratios(BODY, known + open_)
    assert found.scale_std == pytest.approx(0.2, rel=1e-3)
    assert found.std == pytest.approx(inertia_ratios(BODY, known).std)
    assert found.clearer
    assert not inertia_ratios(BODY, known).clearer


MASS, IXX = 0, 4


def curvature(shift: float, place: int) -> Nonlinearity:
    shifts = np.zeros((3, 10))
    shifts[1, place] = shift
    return Nonlinearity(shifts, np.diag(np.arange(1.0, 11.0) ** 2))


def test_numbers_that_mix_parameters_are_judged_by_their_own_deviation() -> None:
    mixed = np.eye(10)
    mixed[IXX, MASS] = 100.0  # I_xx about a distant point: its deviation is the mass's
    assert curvature(-3.0, IXX).is_linear(mixed).all()


def test_a_moment_about_the_centre_of_mass_is_near_linear_wherever_that_is() -> None:
    """Data that determine mass and central moments leave the centre of mass as it was linearised."""
    away = np.array([0.0, 0.5, -0.3, 0.2, *np.zeros(6)])
    there = standard_of(physical(BODY) + away)
    solved = there - np.linalg.solve(physical_jacobian(there), away)  # to first order the body itself
    assert abs((solved - BODY)[4]) > 100.0 * BODY[4]  # far off about the link's origin
    np.testing.assert_allclose(physical_shift(BODY, there - BODY, solved - BODY), 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ('value', 'std', 'shown'),
    [
        (162.0, 0.03, ('162.000', '0.059')),
        (934.4470123, 0.117, ('934.45', '0.23')),
        (2.3, 8e-5, ('2.300000', '0.000157')),
        (0.099, 0.0996, ('0.10', '0.20')),
        (12345.678, 1234.0, ('12300', '2400')),
        (-1e-9, 0.01, ('0.000', '0.020')),
        (1e-6, 1.2e-9, ('1.0000e-06', '2.4e-09')),
        (-3.2e9, 4.5e7, ('-3.200e+09', '8.8e+07')),
        (1e-12, 1e-9, ('0', '2.0e-09')),
        (1.0, 0.0, ('1', '0')),
        (162.0, math.nan, ('162', '-')),
        (math.nan, 1.0, ('-', '-')),
        (math.inf, 1.0, ('-', '-')),
    ],
)
def test_two_digits_of_the_standard_deviation_decide(value: float, std: float, shown: tuple[str, str]) -> None:
    assert rounded(value, std, '-') == shown


def final(link: str = 'base_link', **changes: Any) -> Estimate:
    return estimate(method='trajectory', stage='trajectory', budget=budget(link), **changes)


def planar_final() -> Estimate:
    known = planar()
    shares = np.where(known.identifiable[:, None], budget().shares, np.nan)
    return replace(known, method='trajectory', stage='trajectory', budget=ErrorBudget(budget().causes, shares))


def section(text: str) -> ET.Element:
    """Return the section on the budget, parsed."""
    found = re.search(r'<h3>Error budget</h3>(.*?)<h3>', text, re.DOTALL)
    assert found
    return ET.fromstring(f'<div>{found[1]}</div>')


def test_a_robot_known_as_well_as_by_default_is_limited_by_that_and_no_warning_says_so() -> None:
    config = build(EstimatorConfig, {'target_link': 'link7', 'method': 'trajectory'})
    made = replay_bag(str(ROOT / 'bags' / 'servicer7_mid'), config, robot('servicer7').urdf, Inputs(end=18.0))
    last = made.final
    assert last.budget is not None
    assert last.stage == 'trajectory'
    assert last.warnings == ()
    np.testing.assert_allclose(last.budget.shares.sum(axis=1), 1.0)
    assert last.budget.shares.min() > -1e-9
    # A satellite of half a tonne that is known to 1 %: worth more than all of the sensor noise.
    shares = last.budget.shares_of('mass')
    assert max(shares, key=lambda cause: shares[cause]) == 'link:base_link'
    assert shares[SENSOR_NOISE] < 0.3 * shares['link:base_link']
    assert 'All of the variance' not in html([made])
    assert re.fullmatch(
        r'best single joint: joint\d, [\d.]+ deg there and back in 10 s reduce i[xyz]{2} .* to .* %', made.advice
    )
    assert f'next: {made.advice}\n' in f'{summary(made)}\n'
    assert as_json(made)['advice'] == made.advice
    assert f'The motion that would help most: {made.advice}.' in html([made])


def test_the_json_has_stage_and_shares() -> None:
    result = as_json(run(final()))
    assert result['stage'] == 'trajectory'
    assert list(result['error_budget']) == list(PARAMETERS)
    mass = result['error_budget']['mass']
    assert list(mass)[:2] == ['link:base_link', 'mount']
    assert mass['link:base_link'] == pytest.approx(0.71)
    assert sum(mass.values()) == pytest.approx(1.0)
    assert list(mass.values()) == sorted(mass.values(), reverse=True)


def test_what_is_not_known_is_null_in_the_json() -> None:
    result = as_json(run())
    assert (result['stage'], result['error_budget']) == (None, None)
    assert as_json(run(planar_final()))['error_budget']['com_z'] is None


def test_the_report_has_a_bar_a_parameter_and_the_same_figures() -> None:
    part = section(html([run(final())]))
    bars = part.findall(".//div[@class='bar']")
    assert len(bars) == len(PARAMETERS)
    for bar in bars:
        widths = [float(re.findall(r'width:([\d.]+)%', piece.get('style', ''))[0]) for piece in bar]
        assert sum(widths) == pytest.approx(100.0, abs=0.1)
    assert (bars[0].get('aria-label') or '').startswith('mass: sensor noise 2 %, 1 link base_link 71 %, ')
    rows = [[cell.text for cell in row] for row in part.find(".//div[@class='shares']").iter('tr')]  # type: ignore[union-attr]
    assert rows[0] == ['share [%]', *PARAMETERS]
    assert rows[1][:2] == ['sensor noise', '2.0']
    assert rows[2][:2] == ['1 link base_link', '71.0']
    assert np.array([[float(cell or '') for cell in row[1:]] for row in rows[1:9]]).sum(axis=0) == pytest.approx(
        100.0, abs=0.5
    )
