"""Checks of windows before any identification: a base that is held, and joint velocities that are no rates."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from mbaid_ros.core.diagnosis.rate_checks import twist_check
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.window_checks import HELD, HeldBase, JointRates, WindowChecks
from observed import HIGH, MID, configured_motion, kernel, observe, windows
from simulated import robot

RANDOM = np.random.default_rng(4)


@cache
def measured(name: str, noise: str = 'mid') -> Samples:
    truth = configured_motion(name, 15.0, 50.0)
    return observe(truth, {'mid': MID, 'high': HIGH}[noise], 1)


def reasons(samples: Samples, name: str) -> tuple[list[str], list[Samples]]:
    """Return what the checks find in all windows of a robot, and the windows that they pass on."""
    checks = WindowChecks([twist_check(), HeldBase(kernel(name))], JointRates(robot(name).joint_names))
    passed = checks.applied(windows(samples))
    return [each.text for each in checks.reasons(passed[-1].time[-1])], passed


@pytest.mark.parametrize('name', ['servicer7', 'table1'])
@pytest.mark.parametrize('noise', ['mid', 'high'])
def test_clean_windows_show_nothing_and_keep_their_velocities(name: str, noise: str) -> None:
    found, passed = reasons(measured(name, noise), name)
    assert found == []
    assert all(np.isfinite(window.joint_velocity).all() for window in passed)


@pytest.mark.parametrize('name', ['servicer7', 'table1'])
@pytest.mark.parametrize('noise', [0.0, 1e-4, 1e-3])
def test_a_base_that_is_held_is_told(name: str, noise: float) -> None:
    samples = measured(name)
    held = replace(
        samples, base_position=np.array([1.0, -2.0, 0.5]) + noise * RANDOM.standard_normal((len(samples), 3))
    )
    assert reasons(held, name)[0] == [HELD]


def test_a_base_that_is_held_is_told_after_thrust_too() -> None:
    samples = measured('servicer7')
    pushed = np.where(samples.time[:, None] > 3.0, np.arange(6.0), 0.0)
    place = np.full((len(samples), 3), 0.3)
    held = replace(samples, base_position=place + 1e-3 * RANDOM.standard_normal(place.shape), impulse=pushed)
    assert reasons(held, 'servicer7')[0] == [HELD]
    assert reasons(replace(samples, impulse=pushed), 'servicer7')[0] == []


def test_a_heavy_arm_in_the_robot_description_is_no_held_base() -> None:
    # The base reacts by a thousandth of what such links would make it.
    described = kernel('servicer7')
    change = 999.0 * described.known
    change[0] = 0.0
    held = HeldBase(described.corrected(change))
    assert [held.update(each) for each in windows(measured('servicer7'))] == [None] * 30


@pytest.mark.parametrize(
    ('change', 'how'),
    [
        ((0.0, 0.0, 0.0), 'zero while the positions change'),
        ((0.3, 0.0, 0.0), 'no rates of the positions'),
        ((0.0, 2.0, 0.0), 'no rates of the positions'),
        ((0.0, 0.0, 57.3), 'no rates of the positions'),
        ((0.0, 0.0, -1.0), 'no rates of the positions'),
    ],
    ids=['zero', 'constant', 'proportional', 'degrees', 'turned round'],
)
@pytest.mark.parametrize('joint', [0, 4])
def test_velocities_that_are_no_rates_are_left_out(change: tuple[float, float, float], how: str, joint: int) -> None:
    samples = measured('servicer7')
    velocity = samples.joint_velocity.copy()
    constant, of_position, of_velocity = change
    velocity[:, joint] = constant + of_position * samples.joint_position[:, joint] + of_velocity * velocity[:, joint]
    found, passed = reasons(replace(samples, joint_velocity=velocity), 'servicer7')
    assert found == [
        f'the velocities of joint{joint + 1} are {how}: velocities are taken from the positions; correct the driver'
    ]
    # At once where the joint moves, and all along from the third window on.
    assert all(np.isnan(window.joint_velocity).all() for window in passed[6:])
