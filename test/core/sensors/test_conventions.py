"""Which frame, axes and units a twist is in, by poses and twists alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from mbaid_ros.core.diagnosis.rate_checks import twist_check
from mbaid_ros.core.geometry import Array, cross, exp, rotate, rotate_back
from mbaid_ros.core.samples import Samples
from mbaid_ros.simulation.simulation import Truth
from observed import MID, configured_motion, observe, windows

READINGS: dict[str, Callable[[Array, Array, Array], tuple[Array, Array]]] = {
    'degrees a second': lambda _turn, v, w: (v, np.rad2deg(w)),
    'millimetres a second': lambda _turn, v, w: (1e3 * v, w),
    'wrong sign': lambda _turn, v, w: (-v, -w),
    'set twist_frame: inertial': lambda turn, v, w: (rotate(turn, v), rotate(turn, w)),
    'set twist_frame: child': lambda turn, v, w: (rotate_back(turn, v), rotate_back(turn, w)),
    'is zero while its poses move': lambda _turn, v, w: (0.0 * v, 0.0 * w),
}


@cache
def moved(robot: str) -> Truth:
    return configured_motion(robot, 20.0, 100.0)


def seen(robot: str = 'servicer7', seed: int = 1) -> Samples:
    return observe(moved(robot), MID, seed)


def read(samples: Samples, reading: Callable[[Array, Array, Array], tuple[Array, Array]]) -> Samples:
    linear, angular = reading(samples.base_rotation, samples.base_linear_velocity, samples.base_angular_velocity)
    return replace(samples, base_linear_velocity=linear, base_angular_velocity=angular)


def findings(samples: Samples, declared: float = 1.0) -> list[str]:
    """Return the finding of the check after each window; the noise of the base is so many times the declared one."""
    check = twist_check()
    found = []
    for window in windows(samples):
        pose, twist = (each / declared**2 for each in (window.pose_covariance, window.twist_covariance))
        reason = check.update(replace(window, pose_covariance=pose, twist_covariance=twist))
        found.append(reason.text if reason else '')
    return found


def last_finding(samples: Samples) -> str:
    return findings(samples)[-1]


@pytest.mark.parametrize('robot', ['servicer7', 'table1'])
@pytest.mark.parametrize('other', ['child', 'inertial'])
@pytest.mark.parametrize('seed', range(3))
def test_a_wrong_declaration_is_found(robot: str, other: str, seed: int) -> None:
    samples = observe(moved(robot), MID, seed + 1)
    assert last_finding(read(samples, READINGS[f'set twist_frame: {other}'])).endswith(f'set twist_frame: {other}')


@pytest.mark.parametrize('seed', range(3))
def test_a_resting_base_decides_nothing(seed: int) -> None:
    samples = observe(moved('servicer7'), MID, seed + 1)
    noise = np.random.default_rng(seed)
    count = len(samples)
    still = replace(
        samples,
        # At a large angle, where the two readings are far apart.
        base_rotation=np.broadcast_to(samples.base_rotation[-1] @ np.diag([-1.0, -1.0, 1.0]), (count, 3, 3)),
        base_position=1e-3 * noise.standard_normal((count, 3)),
        base_linear_velocity=1e-3 * noise.standard_normal((count, 3)),
        base_angular_velocity=1e-4 * noise.standard_normal((count, 3)),
    )
    assert not any(findings(still))
    assert not any(findings(read(still, READINGS['set twist_frame: inertial'])))


@pytest.mark.parametrize('name', READINGS)
@pytest.mark.parametrize('seed', range(3))
def test_a_twist_that_is_read_otherwise_is_found(name: str, seed: int) -> None:
    assert name in last_finding(read(seen(seed=seed), READINGS[name]))


@pytest.mark.parametrize('seed', range(3))
def test_a_twist_of_another_point_is_found_with_the_point(seed: int) -> None:
    def reading(rotation: Array, linear: Array, angular: Array) -> tuple[Array, Array]:
        return linear + cross(angular, rotation @ np.array([0.3, -0.2, 0.1])), angular

    found = last_finding(read(seen(seed=seed), reading))
    assert 'that of a point' in found
    place = [float(each) for each in found.partition('(')[2].partition(')')[0].split(',')]
    np.testing.assert_allclose(place, [300.0, -200.0, 100.0], atol=20.0)


@pytest.mark.parametrize('degrees', [20.0, 90.0, 170.0])
def test_a_twist_in_turned_axes_is_found_with_the_turn(degrees: float) -> None:
    def reading(rotation: Array, linear: Array, angular: Array) -> tuple[Array, Array]:
        linear, angular = (rotate(rotation, rotate_back(rotation, each) @ turn) for each in (linear, angular))
        return linear, angular

    turn = exp(np.deg2rad(degrees) * np.array([0.0, 1.0, 0.0]))
    found = last_finding(read(seen(), reading))
    assert f'turned by {degrees:.0f} degrees about (' in found
    axis = [float(each) for each in found.partition('(')[2].partition(')')[0].split(',')]
    np.testing.assert_allclose(axis, [0.0, 1.0, 0.0], atol=0.05)


@pytest.mark.parametrize('robot', ['servicer7', 'table1'])
@pytest.mark.parametrize('declared', [1.0, 10.0])
def test_the_rate_of_the_poses_is_no_other_however_noisy(robot: str, declared: float) -> None:
    for seed in range(5):
        assert not any(findings(seen(robot, seed), declared))


def test_poses_alone_are_no_twist() -> None:
    wrong = read(seen(), READINGS['wrong sign'])
    assert last_finding(replace(wrong, base_linear_velocity=np.full_like(wrong.base_linear_velocity, np.nan))) == ''
    assert last_finding(wrong[:350]) == ''  # seven windows
