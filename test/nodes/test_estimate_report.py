"""What the estimator's diagnostics say of an estimate."""

from __future__ import annotations

import numpy as np

from made_runs import budget, estimate
from mbaid_ros.core.sensors.levels import SensorLevels
from mbaid_ros.nodes.reports import ERROR, OK, WARN, RunState, estimate_report


def test_the_main_causes_of_the_variance_are_told_and_warn_of_nothing() -> None:
    level, text, values = estimate_report(
        RunState(estimate=estimate(method='trajectory', stage='difference', budget=budget()))
    )
    told = dict(values)
    assert (level, text) == (OK, 'converged')
    assert told['stage'] == 'difference'
    assert str(told['main causes of the variance']).startswith('link base_link (71 % of mass), zero of joint6 (60 % ')
    assert told['mass (kg)'] == '162.000 +- 0.059 (95 %)'
    assert told['com_x (m)'] == '0.33000 +- 0.00020 (95 %)'


def test_without_a_budget_the_causes_are_empty() -> None:
    level, _, values = estimate_report(RunState(estimate=estimate(warnings=('wrong',))))
    assert level == WARN
    assert dict(values)['main causes of the variance'] == ''


def test_the_likeliest_cause_of_a_contradiction_comes_first() -> None:
    causes = tuple((f'cause {number}', 50.0 - number) for number in range(5))
    level, text, values = estimate_report(
        RunState(estimate=estimate(status='inconsistent', warnings=('w',), causes=causes))
    )
    assert (level, text) == (ERROR, 'inconsistent: likely cause: cause 0')
    assert [value for key, value in values if key.startswith('likely cause')] == ['cause 0', 'cause 1', 'cause 2']
    _, text, values = estimate_report(RunState(estimate=estimate(warnings=('w',), causes=causes)))
    assert text == 'converged: w'
    assert not any(key.startswith('likely cause') for key, _ in values)


def test_the_motion_that_was_planned_is_told_with_what_it_comes_to() -> None:
    told = dict(estimate_report(RunState(estimate=estimate(), plan=(False, 'out of reach')))[2])
    assert (told['plan reaches what is wanted'], told['plan']) == (False, 'out of reach')


def test_the_noise_that_counts_is_told_first() -> None:
    levels = SensorLevels(
        declared=np.array([1e-4, np.nan, 1e-3, np.nan, 1e-3, 1e-4]),
        found=np.array([2e-4, 1e-3, np.nan, np.nan, 1e-3, 1e-4]),
        assumed=np.array([np.nan, np.nan, np.nan, 1e-4, np.nan, np.nan]),
        correlation_time=0.0,
        used=np.array([False, True, False, False, True, False]),
    )
    told = dict(estimate_report(RunState(estimate=estimate(noise=levels)))[2])
    assert told['noise of joint position (rad)'] == '0.0001 declared, 0.0002 found'
    assert told['noise of joint velocity (rad/s)'] == '0.001 found'
    assert told['noise of base position (m)'] == '0.001 declared'
    assert told['noise of base orientation (rad)'] == '0.0001 assumed'
    assert told['noise of base linear velocity (m/s)'] == '0.001 found, 0.001 declared'
