"""Poses that are told again: no new measurement, unless the base stands still."""

from __future__ import annotations

from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbaid_ros.core.samples import BaseStream, Stamps
from mbaid_ros.core.sensors.outliers import REPEATED_POSE, Repeats
from measured import base_stream, piece

SECOND = 1_000_000_000


def told_again(plateaus: list[int], step: int = 10_000_000) -> tuple[BaseStream, Stamps]:
    """Return odometry of which each pose comes so many times, every step (ns), and where each comes first."""
    source = np.repeat(np.cumsum([0, *plateaus[:-1]]), plateaus)
    stamps = 1_700_000_000 * SECOND + step * np.arange(len(source))
    moving = base_stream(stamps)
    held = {item.name: getattr(moving, item.name)[source] for item in fields(BaseStream) if item.name != 'stamp'}
    return BaseStream(stamp=stamps, **held), np.unique(source)


def passed(base: BaseStream, cuts: list[int]) -> tuple[Stamps, int]:
    """Return the stamps of what passes, handed over in pieces, and how many are dropped."""
    repeats = Repeats()
    ends = [0, *sorted(cuts), len(base.stamp)]
    parts = [repeats.push(piece(base, begin, end)) for begin, end in pairwise(ends)]
    stamps = [part.stamp for part in parts if part is not None]
    return np.concatenate([np.zeros(0, dtype=np.int64), *stamps]), repeats.dropped[REPEATED_POSE]


def test_only_the_first_of_equal_poses_counts() -> None:
    base, first = told_again([1, 5, 3, 1, 1, 7, 1])
    stamps, dropped = passed(base, [])
    np.testing.assert_array_equal(stamps, base.stamp[first])
    assert dropped == len(base.stamp) - len(first)


def test_a_base_that_stands_still_goes_on() -> None:
    base, _ = told_again([5, 101, 3])
    stamps, dropped = passed(base, [])
    # The one of five and the one of three, and the second at rest from its begin on.
    np.testing.assert_array_equal(stamps, base.stamp[[0, *range(5, 107)]])
    assert dropped == 4  # the last two are not known yet to be repeated or at rest


def test_a_pose_that_lasts_nearly_a_second_is_repeated() -> None:
    base, first = told_again([100, 100, 1])
    stamps, _ = passed(base, [])
    np.testing.assert_array_equal(stamps, base.stamp[first])


@pytest.mark.parametrize('name', ['position', 'rotation'])
def test_a_change_of_either_part_is_another_pose(name: str) -> None:
    base, _ = told_again([4])
    getattr(base, name)[2:] += 1e-9
    np.testing.assert_array_equal(passed(base, [])[0], base.stamp[[0, 2]])


@given(
    plateaus=st.lists(st.integers(1, 60), min_size=1, max_size=8),
    cuts=st.lists(st.integers(0, 200), max_size=12),
)
@settings(max_examples=100, deadline=None, derandomize=True)
def test_pieces_do_not_matter(plateaus: list[int], cuts: list[int]) -> None:
    base, _ = told_again(plateaus, step=40_000_000)
    whole, dropped = passed(base, [])
    pieces, dropped_of_pieces = passed(base, [min(cut, len(base.stamp)) for cut in cuts])
    np.testing.assert_array_equal(pieces, whole)
    assert dropped_of_pieces == dropped
