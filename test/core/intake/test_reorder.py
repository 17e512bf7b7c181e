"""Streams put in order: whatever the order of arrival, however they are cut."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbaid_ros.core.samples import JointStream
from mbaid_ros.core.sensors.streams import LATE, REPEATED, Reorder

LIMIT = 50
stamp_lists = st.lists(st.integers(0, 300), min_size=1, max_size=60)


def stream(stamps: list[int]) -> JointStream:
    values = np.array(stamps, dtype=float)[:, None]
    return JointStream(np.array(stamps, dtype=np.int64), values, np.arange(len(stamps))[:, None] * 1.0)


def released(stamps: list[int], cuts: list[int]) -> tuple[list[int], dict[str, int], int]:
    """Return the stamps in the order of release when the stream is cut at some places."""
    reorder, result = Reorder[JointStream](LIMIT), []
    whole = stream(stamps)
    edges = [0, *sorted(min(cut, len(stamps)) for cut in cuts), len(stamps)]
    for begin, end in itertools.pairwise(edges):
        part = JointStream(whole.stamp[begin:end], whole.position[begin:end], whole.velocity[begin:end])
        ordered = reorder.push(part)
        if ordered is not None:
            assert np.array_equal(ordered.position[:, 0], ordered.stamp)
            result += ordered.stamp.tolist()
    return result, dict(reorder.dropped), reorder.hold


@settings(max_examples=200, deadline=None)
@given(stamp_lists, st.lists(st.integers(0, 60), max_size=6))
def test_the_result_is_increasing_and_the_same_however_it_is_cut(stamps: list[int], cuts: list[int]) -> None:
    whole, dropped, hold = released(stamps, [])
    assert whole == sorted(set(whole))
    assert hold <= LIMIT
    assert len(whole) + sum(dropped.values()) <= len(stamps)
    assert released(stamps, cuts) == (whole, dropped, hold)


def test_in_order_nothing_waits() -> None:
    assert released([10, 20, 30], [1, 2]) == ([10, 20, 30], {}, 0)


def test_after_the_first_late_one_others_as_late_are_waited_for() -> None:
    stamps = [10, 20, 30, 15, 40, 50, 60, 70, 55, 80, 90, 100, 92, 110, 120, 130, 140]
    result, dropped, hold = released(stamps, [])
    assert dropped == {LATE: 1}
    assert hold == round(1.5 * 15)
    assert result == [stamp for stamp in sorted(stamps) if stamp != 15 and stamp <= 140 - hold]


def test_what_is_too_late_makes_nothing_wait() -> None:
    assert released([100, 200, 130, 210], []) == ([100, 200, 210], {LATE: 1}, 0)


@pytest.mark.parametrize('cuts', [[], [1], [1, 2, 3, 4]])
def test_repeated_stamps_count_once(cuts: list[int]) -> None:
    assert released([10, 10, 20, 20, 30], cuts) == ([10, 20, 30], {REPEATED: 2}, 0)
