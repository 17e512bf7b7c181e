"""Background work: what is done before a window does not depend on when slices run."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.tasks import AT_ONCE, SLICE, Kind, Tasks, Work


def pieces(sizes: list[int], done: list[int]) -> Work[str]:
    for size in sizes:
        done.append(size)
        yield size
    return 'found'


def naming(kind: Kind) -> Work[Kind]:
    yield SLICE
    yield 1
    return kind


def failing() -> Work[str]:
    yield 1
    raise FloatingPointError('no outcome')


@pytest.mark.parametrize('size', [24, 140])
@pytest.mark.parametrize('seed', range(5))
def test_what_is_done_before_a_window_does_not_depend_on_the_calls(seed: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    sizes, steps = rng.integers(1, 40, 60).tolist(), 250
    at_leisure, at_once = Tasks(), Tasks()
    ways: tuple[list[int], list[int]] = ([], [])
    found: tuple[list[str], list[str]] = ([], [])
    for tasks, done, ends in zip((at_leisure, at_once), ways, found, strict=True):
        tasks.begin(Kind.SEARCH, pieces(sizes, done), ends.append, size=size)
    for number in range(40):
        for tasks in (at_leisure, at_once):
            tasks.allot_steps(steps, Kind.SEARCH)
        for _ in range(int(rng.integers(0, 8))):
            at_leisure.run_slice()
        for tasks in (at_leisure, at_once):
            tasks.finish_due()
        assert ways[0] == ways[1]
        assert found[0] == found[1]
        assert not (found[0] and number < 2)
    assert ways[0] == sizes
    assert found[0] == ['found']
    assert not at_leisure.is_under_way(Kind.SEARCH)


def test_kinds_run_in_their_order_whichever_began_first() -> None:
    tasks, ended = Tasks(), list[Kind]()
    for kind in reversed(Kind):
        tasks.begin(kind, naming(kind), ended.append, steps=AT_ONCE)
    while tasks.run_slice():
        pass
    assert ended == list(Kind)


@pytest.mark.parametrize('early', [False, True])
def test_an_outcome_waits_until_it_is_required(early: bool) -> None:
    tasks, found = Tasks(), list[str]()
    tasks.begin(Kind.CAUSES, pieces([1, 1], []), found.append, steps=AT_ONCE, due=False)
    while early and tasks.run_slice():
        pass
    tasks.finish_due()
    assert not found
    assert tasks.is_under_way(Kind.CAUSES)
    tasks.require(Kind.CAUSES)
    assert not found
    tasks.finish_due()
    assert found == ['found']
    assert not tasks.is_under_way(Kind.CAUSES)


def test_work_that_is_cancelled_or_replaced_or_raises_is_over() -> None:
    tasks, found = Tasks(), list[str]()
    tasks.begin(Kind.SEARCH, pieces([1], []), found.append, steps=AT_ONCE)
    tasks.cancel(Kind.SEARCH, Kind.CAUSES)
    tasks.finish_due()
    tasks.begin(Kind.SEARCH, pieces([1], []), found.append, steps=AT_ONCE)
    tasks.begin(Kind.SEARCH, failing(), found.append, steps=AT_ONCE)
    with pytest.raises(FloatingPointError):
        tasks.finish_due()
    tasks.finish_due()
    assert not found
    assert not tasks.is_under_way(Kind.SEARCH)
