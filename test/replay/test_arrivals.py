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


def test_of_a_long_run_the_same_is_told_in_bounded_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    generator = np.random.default_rng(0)
    intervals = np.round(1e7 + 1e5 * generator.standard_normal(20_000)).astype(np.int64)
    intervals[[70, 5_000, 19_000]] *= 50
    times = np.cumsum(intervals)
    whole, thinned = Arrivals(), Arrivals()
    whole.add(times)
    monkeypatch.setattr('mbaid_ros.replay.arrivals._KEPT', 3_000)
    for begin in range(0, len(times), 777):
        thinned.add(times[begin : begin + 777])
        assert len(thinned._times) <= 3_000
    exact, told = (each.statistics('/a', 'x', len(times), int(times[0])) for each in (whole, thinned))
    assert told.rate == exact.rate
    assert told.gaps == exact.gaps
    assert len(told.gaps) == 3
    assert len(told.course) == len(exact.course)
    assert np.array(told.course) == pytest.approx(np.array(exact.course), rel=0.05, abs=0.5)


def test_no_messages_at_a_time_change_nothing() -> None:
    topic = arrivals([0.0, 1.0])
    topic.add(np.zeros(0, dtype=np.int64))
    assert topic.statistics('/a', 'x', 2, 0).rate == 1.0
