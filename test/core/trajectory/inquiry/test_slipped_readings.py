"""Joints whose reading jumps once and stays off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from joint_windows import SPACING, joint_window
from mbaid_ros.core.diagnosis.encoders import slipped_readings
from mbaid_ros.core.filter.knots import AFTER, BEFORE
from mbaid_ros.core.filter.window import Window
from mbaid_ros.core.geometry import Array

COUNT = 10  # knots of a window
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
    """Return windows of joints at positions."""
    length = BEFORE + COUNT + AFTER
    starts = [place * COUNT for place in range(NUMBER)]
    return [joint_window(values[start : start + length], start * SPACING) for start in starts]


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
