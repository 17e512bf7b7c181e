"""Records of arrays, queues of them, and symmetric systems with empty directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.linear_algebra import solve_symmetric
from mbaid_ros.core.samples import ArrayRecord, Queue


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


def test_directions_without_information_are_left_alone() -> None:
    basis = np.linalg.qr(np.random.default_rng(10).normal(size=(3, 3)))[0]
    information = (basis * np.array([4.0, 1.0, 0.0])) @ basis.T
    right_side = information @ np.array([1.0, 2.0, 3.0])
    found = solve_symmetric(information, right_side)
    assert information @ found == pytest.approx(right_side, rel=1e-9)
    assert np.abs(found).max() < 10.0


def test_unknowns_of_very_different_size_are_solved_for() -> None:
    full = np.diag([1e12, 1.0, 1e-12])
    assert solve_symmetric(full, np.array([1e12, 2.0, 3e-12])) == pytest.approx([1.0, 2.0, 3.0])
