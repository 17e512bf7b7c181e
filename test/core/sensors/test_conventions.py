"""Which frame, axes and units a twist is in, by poses and twists alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from mbaid_ros.core.diagnosis.rate_checks import TwistFrame
from mbaid_ros.core.diagnosis.twist_conventions import twist_convention_error
from mbaid_ros.core.filter.knots import AFTER, BEFORE, averages
from mbaid_ros.core.filter.window import Window, window_noises, without_twist
from mbaid_ros.core.geometry import Array, cross, exp, rotate, rotate_back
from mbaid_ros.core.samples import Samples
from mbaid_ros.simulation.simulation import Truth
from observed import MID, configured_motion, observe, windows


@cache
def motion(robot: str, seconds: float) -> Truth:
    return configured_motion(robot, seconds, 100.0)


def verdict(declared: str, samples: Samples) -> TwistFrame:
    judge = TwistFrame(declared)
    for window in windows(samples):
        judge.update([window])
    judge.run_slice()
    return judge


def misread(samples: Samples, declared: str) -> Samples:
    """Return the samples as they are when the twist was meant in the frame that is not the declared one."""
    turn = rotate if declared == 'child' else rotate_back
    return replace(
        samples,
        base_linear_velocity=turn(samples.base_rotation, samples.base_linear_velocity),
        base_angular_velocity=turn(samples.base_rotation, samples.base_angular_velocity),
    )


@pytest.mark.parametrize('declared', ['child', 'inertial'])
@pytest.mark.parametrize('robot', ['servicer7', 'table1'])
@pytest.mark.parametrize('seed', range(3))
def test_a_wrong_declaration_is_told_and_a_right_one_is_not(robot: str, declared: str, seed: int) -> None:
    samples = observe(motion(robot, 20.0), MID, seed + 1)
    right, wrong = verdict(declared, samples), verdict(declared, misread(samples, declared))
    other = 'inertial' if declared == 'child' else 'child'
    assert right.contradiction == ''
    assert wrong.contradiction.endswith(f'if so, set twist_frame: {other}')
    for judge, share in ((right, 0.0), (wrong, 1.0)):
        # The derivatives of the poses have a bias of their own, of a hundredth of what is to be told apart.
        assert judge.share[0] == pytest.approx(share, abs=5.0 * judge.share[1] + 0.01)


@pytest.mark.parametrize('seed', range(3))
def test_a_resting_base_decides_nothing(seed: int) -> None:
    samples = observe(motion('servicer7', 20.0), MID, seed + 1)
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
    assert verdict('child', still).contradiction == ''
    assert verdict('child', misread(still, 'child')).contradiction == ''


SPACING, COUNT = 0.05, 10  # s, of knots, and how many there are in a window
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


def knot_windows(samples: Samples, declared: float = 1.0) -> list[Window]:
    """Return the knot_windows of samples, the noise of the base in which is so many times what it is declared to be."""
    rows = [samples[place * 50 : place * 50 + (COUNT + BEFORE + AFTER) * 5] for place in range(36)]
    noises = window_noises([each[: 5 * COUNT] for each in rows], MID)
    own = slice(BEFORE, BEFORE + COUNT)
    return [
        Window(
            averages([each], each.time[:1], SPACING, COUNT + BEFORE + AFTER, np.zeros(3)),
            *(own, SPACING, replace(noise, pose=noise.pose / declared**2, twist=noise.twist / declared**2)),
            *(float(each.time[0]), False),
        )
        for each, noise in zip(rows, noises, strict=True)
    ]


def read(samples: Samples, reading: Callable[[Array, Array, Array], tuple[Array, Array]]) -> Samples:
    linear, angular = reading(samples.base_rotation, samples.base_linear_velocity, samples.base_angular_velocity)
    return replace(samples, base_linear_velocity=linear, base_angular_velocity=angular)


@pytest.mark.parametrize('name', READINGS)
@pytest.mark.parametrize('seed', range(3))
def test_a_twist_that_is_read_otherwise_is_told(name: str, seed: int) -> None:
    assert name in twist_convention_error(knot_windows(read(seen(seed=seed), READINGS[name])))


@pytest.mark.parametrize('seed', range(3))
def test_a_twist_of_another_point_tells_which(seed: int) -> None:
    def reading(rotation: Array, linear: Array, angular: Array) -> tuple[Array, Array]:
        return linear + cross(angular, rotation @ np.array([0.3, -0.2, 0.1])), angular

    told = twist_convention_error(knot_windows(read(seen(seed=seed), reading)))
    assert 'that of a point' in told
    found = [float(each) for each in told.partition('(')[2].partition(')')[0].split(',')]
    np.testing.assert_allclose(found, [300.0, -200.0, 100.0], atol=20.0)


@pytest.mark.parametrize('degrees', [20.0, 90.0, 170.0])
def test_a_twist_in_turned_axes_tells_how_they_are_turned(degrees: float) -> None:
    def reading(rotation: Array, linear: Array, angular: Array) -> tuple[Array, Array]:
        linear, angular = (rotate(rotation, rotate_back(rotation, each) @ turn) for each in (linear, angular))
        return linear, angular

    turn = exp(np.deg2rad(degrees) * np.array([0.0, 1.0, 0.0]))
    told = twist_convention_error(knot_windows(read(seen(), reading)))
    assert f'turned by {degrees:.0f} degrees about (' in told
    axis = [float(each) for each in told.partition('(')[2].partition(')')[0].split(',')]
    np.testing.assert_allclose(axis, [0.0, 1.0, 0.0], atol=0.05)


@pytest.mark.parametrize('robot', ['servicer7', 'table1'])
@pytest.mark.parametrize('declared', [1.0, 10.0])
def test_the_rate_of_the_poses_is_no_other_however_noisy(robot: str, declared: float) -> None:
    for seed in range(5):
        assert twist_convention_error(knot_windows(seen(robot, seed), declared)) == ''


def test_poses_alone_are_no_twist() -> None:
    wrong = knot_windows(read(seen(), READINGS['wrong sign']))
    assert twist_convention_error([without_twist(each) for each in wrong]) == ''
    assert twist_convention_error(wrong[:3]) == ''
