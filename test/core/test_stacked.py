"""Records of arrays, and queues of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from mbaid_ros.core.array_record import ArrayRecord, Queue
from mbaid_ros.core.geometry import Array


@dataclass(frozen=True)
class Pair(ArrayRecord):
    """Two arrays of different shapes."""

    one: Array
    many: Array


def pairs(first: int, count: int) -> Pair:
    values = np.arange(first, first + count, dtype=float)
    return Pair(values, values[:, None, None] * np.ones((2, 3)))


@pytest.mark.parametrize('most', [1, 3, 10])
def test_a_queue_holds_what_has_come_last(most: int) -> None:
    queue = Queue(Pair(np.zeros(0), np.zeros(0)))
    seen, expected = [], []
    for first in range(0, 60, 2):
        queue.append(pairs(first, 2))
        queue.drop(max(len(queue) - most, 0))
        seen.append(queue.entries)
        expected.append(list(range(max(first + 2 - most, 0), first + 2)))
        assert len(queue) == len(queue.entries) == len(expected[-1])
    # What was seen once stays as it was.
    for entries, values in zip(seen, expected, strict=True):
        assert entries.one.tolist() == values
        assert np.array_equal(entries.many, pairs(values[0], len(values)).many)


def test_entries_that_leave_make_room() -> None:
    queue = Queue(pairs(0, 5))
    queue.append(pairs(5, 1))
    before = queue.entries
    queue.drop(2)
    queue.append(pairs(6, 2))
    assert queue.entries.one.tolist() == [2.0, 3.0, 4.0, 5.0, 6.0, 7.0]
    assert before.one.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    queue.drop(9)
    assert len(queue) == 0
