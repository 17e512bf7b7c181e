"""What an estimate rests on that its motion cannot check: what is wrong there shows in no residual, so it is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.momentum import physical
from observed import MID, configured_motion, estimator, kernel, observe, windows

DECLARED = {
    'known_links__relative_std': 0.01,
    'known_joints__zero_std': 1e-3,
    'known_joints__origin_std': 1e-3,
    'known_joints__axis_std': 1e-3,
}


def identified(joint: int, off: float, **parameters: object) -> Estimate:
    """Return the last estimate of a servicer of which one joint is read with an offset, rad."""
    robot = kernel('servicer7')
    samples = observe(configured_motion('servicer7', 30.0, 20.0, 0.05), MID)
    position = samples.joint_position.copy()
    position[:, joint] += off
    samples = replace(samples, joint_position=position)
    return estimator(robot, MID, method='trajectory', **parameters).update(windows(samples), 0)[-1]


def far(estimate: Estimate) -> float:
    """Return the largest error in standard deviations."""
    error = estimate.parameters - physical(kernel('servicer7').target.parameters)
    return float(np.max(np.abs(error / estimate.std)))


def test_the_zero_of_the_last_joint_is_named_as_nothing_shows_that_it_is_wrong() -> None:
    wrong = identified(6, 0.05, **{**DECLARED, 'known_joints__zero_std': 5e-3})
    assert wrong.budget is not None
    assert 'zero of joint7 (' in wrong.budget.resting()
    assert wrong.status != 'inconsistent'  # ten times as far off as declared, and nothing contradicts it
    assert far(wrong) > 5.0


def test_what_the_data_see_is_not_named() -> None:
    right = identified(6, 0.0, **DECLARED)
    assert right.budget is not None
    assert far(right) < 4.0
    # The first joint's zero turns the whole arm against the base: that shows.
    assert 'joint1' not in right.budget.resting()
    assert 'sensor noise' not in right.budget.resting()


def test_an_estimate_of_a_robot_that_is_exact_rests_on_nothing() -> None:
    exact = identified(6, 0.0)
    assert exact.budget is not None
    assert exact.budget.resting() == ''


@pytest.mark.parametrize('std', [1e-4, 1e-2])
def test_what_is_declared_to_be_uncertain_enough_has_a_larger_share(std: float) -> None:
    told = identified(6, 0.0, **{**DECLARED, 'known_joints__zero_std': std}).budget
    assert told is not None
    assert ('zero of joint7' in told.resting()) == (std > 1e-3)
