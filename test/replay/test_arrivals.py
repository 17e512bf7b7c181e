"""What is told of the arrival of messages."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mbaid_ros.replay.arrivals import Arrivals

SECOND = 1_000_000_000


def arrivals(times: list[float]) -> Arrivals:
    made = Arrivals()
    made.add(np.array([round(time * SECOND) for time in times], dtype=np.int64))
    return made


def test_rate_and_course_of_a_steady_topic() -> None:
    topic = arrivals([5.0 + 0.01 * index for index in range(1001)]).statistics('/a', 'x', 1001, 5 * SECOND)
    assert topic.rate == pytest.approx(100.0)
    assert topic.gaps == ()
    assert [rate for _, rate in topic.course[:-1]] == pytest.approx([100.0] * (len(topic.course) - 1))
    assert topic.course[0][0] == pytest.approx(10.0 / len(topic.course) / 2, rel=0.1)


def test_a_gap_is_told_with_its_place_and_length() -> None:
    times = [0.01 * index for index in range(1001) if not 300 < index < 350]
    topic = arrivals(times).statistics('/a', 'x', len(times), 0)
    assert np.array(topic.gaps) == pytest.approx(np.array([[3.0, 0.5]]))


def test_only_the_longest_gaps_are_kept_in_order() -> None:
    times, now = [], 0.0
    for block in range(40):
        times += [now + 0.01 * index for index in range(20)]
        now += 1.0 + 0.01 * block
    gaps = arrivals(times).statistics('/a', 'x', len(times), 0).gaps
    assert len(gaps) == 20
    assert list(gaps) == sorted(gaps)
    assert min(length for _, length in gaps) > 0.98


@pytest.mark.parametrize('times', [[], [1.0], [1.0, 1.0]])
def test_too_little_to_tell_a_rate(times: list[float]) -> None:
    topic = arrivals(times).statistics('/a', 'x', len(times), 0)
    assert math.isnan(topic.rate)
    assert topic.course == ()
