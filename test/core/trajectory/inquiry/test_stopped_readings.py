"""Joints whose reading stands still in some windows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from joint_windows import joint_window
from mbaid_ros.core.diagnosis.encoders import stopped_readings
from mbaid_ros.core.filter.knots import AFTER, BEFORE
from mbaid_ros.core.filter.window import Window
from mbaid_ros.core.geometry import Flags

COUNT = BEFORE + 20 + AFTER
JOINTS = ('shoulder', 'elbow', 'wrist')


def windows(still: Flags) -> list[Window]:
    """Return windows in which joints stand still or not, (W, 3)."""
    moving = np.random.default_rng(4).normal(size=(len(still), COUNT, 3))
    positions = np.where(still[:, None], moving[:, :1], moving)
    return [joint_window(each, float(start)) for start, each in enumerate(positions)]


def test_windows_in_which_one_joint_stands_still_and_their_neighbours_are_left_out() -> None:
    still = np.zeros((9, 3), dtype=bool)
    still[3:5, 1] = True
    (found,) = stopped_readings(windows(still), JOINTS)
    assert found.text.startswith('the reading of elbow stands still from 3.0 to 5.0 s')
    assert [each.start for each in found.windows] == [0.0, 1.0, 6.0, 7.0, 8.0]
    assert [each.fresh for each in found.windows] == [False, False, True, False, False]


def test_the_joint_that_stands_still_longest_comes_first_and_few_times_are_told() -> None:
    still = np.zeros((12, 3), dtype=bool)
    still[::2, 2], still[4, 0] = True, True
    found = stopped_readings(windows(still), JOINTS)
    assert [each.text.split()[3] for each in found] == ['wrist', 'shoulder']
    assert found[0].text.count(' to ') == 3
    assert 'and more' in found[0].text


@pytest.mark.parametrize('still', [np.zeros((5, 3), dtype=bool), np.ones((5, 3), dtype=bool)])
def test_nothing_is_found_where_all_move_or_all_rest(still: Flags) -> None:
    assert stopped_readings(windows(still), JOINTS) == []


def test_a_reading_that_is_missing_does_not_stand_still() -> None:
    (first, *others) = windows(np.zeros((5, 3), dtype=bool))
    positions = first.knots.joint_position.copy()
    positions[:, 0] = np.nan
    lost = replace(first, knots=replace(first.knots, joint_position=positions))
    assert stopped_readings([lost, *others], JOINTS) == []
