"""Joints whose reading jumps once and stays off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.trajectory.knots import AFTER, BEFORE, Knots
from mbaid_ros.core.trajectory.slipped_readings import slipped_readings
from mbaid_ros.core.trajectory.window_noise import WindowNoise
from mbaid_ros.core.trajectory.windows import Window

SPACING, COUNT = 0.05, 10  # s, of knots, and how many there are in a window
JOINTS = ('shoulder', 'elbow', 'wrist')
NUMBER = 24  # windows


def positions(seed: int, step: float, time: float, joint: int = 1) -> Array:
    """Return joints that swing, with noise of 0.05 mrad, and that one of them reads off from a time (s) on."""
    rng = np.random.default_rng(seed)
    times = SPACING * (np.arange(BEFORE + NUMBER * COUNT + AFTER) - BEFORE)[:, None]
    swings = 0.3 * np.sin(rng.uniform(0.3, 1.0, 3) * times + rng.uniform(0.0, 6.0, 3))
    swings[:, joint] += step * (times[:, 0] >= time)
    return swings + 5e-5 * rng.normal(size=swings.shape)


def windows(values: Array) -> list[Window]:
    """Return windows of joints at positions, and nothing else of note."""
    length = BEFORE + COUNT + AFTER
    there, nothing, times = np.zeros((length, 3)), np.zeros((length, 0)), np.zeros(length)
    turns, twist = np.broadcast_to(np.eye(3), (length, 3, 3)), np.zeros((length, 6))
    rest = (turns, there, twist, times, times, twist, nothing, nothing, nothing, there, nothing)
    noise = WindowNoise(50, 1e-4, np.eye(6), np.eye(6))
    return [
        Window(
            Knots(values[place * COUNT : place * COUNT + length], *rest),
            *(slice(BEFORE, BEFORE + COUNT), SPACING, noise, place * COUNT * SPACING, False),
        )
        for place in range(NUMBER)
    ]


@pytest.mark.parametrize('seed', range(4))
@pytest.mark.parametrize('step', [-3e-3, 1e-2, 0.5])
@pytest.mark.parametrize('time', [5.0, 6.2, 7.49])
def test_a_jump_is_told_by_joint_size_and_time_and_taken_off(seed: int, step: float, time: float) -> None:
    first, *_ = slipped_readings(windows(positions(seed, step, time)), JOINTS)
    assert first.text.startswith('the reading of elbow jumps by ')
    assert float(first.text.split()[6]) == pytest.approx(1e3 * step, rel=0.02, abs=0.5)
    assert float(first.text.split('at ')[1].split()[0]) == pytest.approx(time, abs=0.15)
    right = {each.start: each.knots.joint_position for each in windows(positions(seed, 0.0, time))}
    assert NUMBER - 3 == len(first.windows) == len(first.as_read)
    assert [each.fresh for each in first.windows].count(True) == 1
    for mended, read in zip(first.windows, first.as_read, strict=True):
        np.testing.assert_allclose(mended.knots.joint_position, right[mended.start], atol=5e-4)
        off = read.knots.joint_position[:, 1] - right[read.start][:, 1]
        np.testing.assert_allclose(off, step if read.start > time else 0.0, atol=1e-12)


def test_nothing_jumps_in_a_smooth_motion_nor_at_rest() -> None:
    for seed in range(4):
        assert slipped_readings(windows(positions(seed, 0.0, 5.0)), JOINTS) == []
    assert slipped_readings(windows(np.ones((BEFORE + NUMBER * COUNT + AFTER, 3))), JOINTS) == []


def test_knots_that_are_empty_are_no_jump() -> None:
    first, *others = windows(positions(1, 0.0, 5.0))
    lost = first.knots.joint_position.copy()
    lost[5:8] = np.nan
    assert slipped_readings([replace(first, knots=replace(first.knots, joint_position=lost)), *others], JOINTS) == []
