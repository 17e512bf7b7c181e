"""Which frame the twist is in, as the poses say."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from mbaid_ros.core.geometry import rotate, rotate_back
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.sensors.rates import TwistFrame
from mbaid_ros.simulation.simulation import Truth
from observed import MID, configured_motion, observe, windows


@cache
def motion(robot: str, seconds: float) -> Truth:
    return configured_motion(robot, seconds, 100.0, 0.02)


def verdict(declared: str, samples: Samples) -> TwistFrame:
    judge = TwistFrame(declared)
    for window in windows(samples):
        judge.update([window])
    judge.work_off()
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


def test_poses_without_a_twist_decide_nothing() -> None:
    samples = observe(motion('servicer7', 20.0)[:500], MID, 1)
    silent = replace(samples, base_linear_velocity=samples.base_linear_velocity * np.nan)
    assert verdict('child', silent).share == (0.0, np.inf)


@pytest.mark.parametrize('seed', range(3))
def test_windows_at_once_say_what_they_say_one_by_one(seed: int) -> None:
    samples = misread(observe(motion('servicer7', 20.0), MID, seed + 1), 'child')
    random = np.random.default_rng(seed)
    # Unequal lengths, and five samples so close together that no polynomial of degree 4 can be fitted to.
    kept = np.flatnonzero(random.random(len(samples)) > 0.02)
    samples = Samples.concatenate([samples[place : place + 1] for place in kept])
    cut = [*windows(samples), replace(samples[-6:], time=30.0 + np.array([0.0, 1e-9, 2e-9, 3e-9, 4e-9, 1.0]))]
    singly, together, in_parts, at_leisure = (TwistFrame('child') for _ in range(4))
    told = [singly.update([window])[0] for window in cut]
    assert together.update(cut) == told
    assert in_parts.update(cut[:7]) + in_parts.update([]) + in_parts.update(cut[7:]) == told
    for window, expected in zip(cut, told, strict=True):
        assert at_leisure.update([window]) == [expected]
        at_leisure.work_off()
    judges = (singly, together, in_parts, at_leisure)
    for judge in judges:
        judge.work_off()
    assert len({judge.share for judge in judges}) == 1
    assert [contradiction for contradiction, _ in told[:2]] == ['', '']
    contradiction, gain = told[-1]
    assert contradiction
    assert gain > 0.0
