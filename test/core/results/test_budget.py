"""The error budget: what is said of shares of variances."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.results.budget import SENSOR_NOISE, ErrorBudget, described, short

CAUSES = (SENSOR_NOISE, 'link:base_link', 'zero:joint6')
STD = np.array([0.5, 1e-3, 2e-3, 1e-3, *[0.1] * 6])


def budget() -> ErrorBudget:
    """Return one whose y of the centre of mass the zero of a joint makes, and whose mass a link."""
    shares = np.tile([0.6, 0.3, 0.1], (10, 1))
    shares[0] = [0.0996, 0.9, 0.0004]
    shares[2] = [0.1, 0.05, 0.85]
    return ErrorBudget(CAUSES, shares)


def test_the_shares_of_a_parameter_come_the_largest_first_without_the_least() -> None:
    assert budget().of('mass') == {'link:base_link': 0.9, SENSOR_NOISE: 0.0996}
    assert list(budget().of('com_y')) == ['zero:joint6', SENSOR_NOISE, 'link:base_link']


def test_a_group_counts_its_elements_by_their_variances() -> None:
    centre = budget().grouped(STD)['centre of mass']
    # Variances of 1, 4 and 1 mm^2.
    assert centre['zero:joint6'] == pytest.approx((0.1 + 4 * 0.85 + 0.1) / 6.0)
    assert sum(centre.values()) == pytest.approx(1.0)


def test_what_is_not_determined_counts_nowhere() -> None:
    known = np.isin(np.arange(10), [0, 1, 9])
    shares, std = budget().shares.copy(), np.where(known, STD, np.nan)
    shares[~known] = np.nan
    planar = ErrorBudget(CAUSES, shares)
    assert planar.of('com_y') == {}
    assert planar.grouped(std)['centre of mass'] == pytest.approx(
        {SENSOR_NOISE: 0.6, 'link:base_link': 0.3, 'zero:joint6': 0.1}
    )
    nothing = ErrorBudget(CAUSES, np.full((10, 3), np.nan))
    assert (nothing.told(STD), nothing.dominant(STD), nothing.grouped(STD)) == ('', {}, {})


def test_the_main_causes_in_a_line() -> None:
    told = budget().told(STD)
    assert (
        told == 'link base_link (90 % of mass), zero of joint6 (60 % of centre of mass), sensor noise (60 % of inertia)'
    )
    alone = ErrorBudget((SENSOR_NOISE,), np.ones((10, 1)))
    assert alone.told(STD) == 'sensor noise (100 % of mass, 100 % of centre of mass, 100 % of inertia)'


def test_a_cause_dominates_from_half_of_a_group_on_and_sensor_noise_never() -> None:
    found = budget().dominant(STD)
    assert list(found) == ['link:base_link', 'zero:joint6']
    assert found['link:base_link'] == {'mass': 0.9}
    assert found['zero:joint6'] == pytest.approx({'centre of mass': 0.6})


@pytest.mark.parametrize(
    ('cause', 'few', 'help_'),
    [
        ('link:a:b', 'link a:b', 'how well link a:b is known: weigh it, or calibrate before the capture (known_links)'),
        ('zero:joint6', 'zero of joint6', 'the zero of joint6: calibrate it (known_joints)'),
        ('mount', 'mount', 'where the odometry is mounted: measure it (odometry_mount)'),
        ('time offset', 'time offset', 'the offset between the stamps: more motion tells it'),
        ('something else', 'something else', 'something else'),
    ],
)
def test_causes_in_words(cause: str, few: str, help_: str) -> None:
    assert (short(cause), described(cause)) == (few, help_)


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
    shares = budget().shares
    unchecked = (shares > 0.2) & [False, True, True]
    found = ErrorBudget(CAUSES, shares, unchecked).resting()
    link = 'link base_link (90 % of mass, 30 % of centre of mass, 30 % of inertia)'
    assert found == f'{link}, zero of joint6 (85 % of centre of mass)'
    assert budget().resting() == ''
