"""What is put off between windows: as much a window, however it is cut into calls."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from mbaid_ros.core.filter.batch import SLICE, BackgroundTask


def bits(sizes: list[int], done: list[int]) -> Iterator[int | str]:
    for size in sizes:
        done.append(size)
        yield size
    yield 'found'


@pytest.mark.parametrize('size', [24, 140])
@pytest.mark.parametrize('seed', range(5))
def test_what_is_done_before_a_window_does_not_depend_on_the_calls(seed: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    sizes, owed = rng.integers(1, 40, 60).tolist(), 250
    at_leisure, at_once = BackgroundTask[str](size), BackgroundTask[str](size)
    ways: tuple[list[int], list[int]] = ([], [])
    found: dict[str, int] = {}
    for task, done in zip((at_leisure, at_once), ways, strict=True):
        task.begin(bits(sizes, done))
    for number in range(40):
        for task in (at_leisure, at_once):
            task.owe(owed)
        for _ in range(int(rng.integers(0, 8))):
            if at_leisure.work_off():
                found['at leisure'] = number
        for name, task in (('at leisure', at_leisure), ('at once', at_once)):
            while task.owing:
                if task.work_off():
                    found[name] = number
        assert ways[0] == ways[1]
    assert ways[0] == sizes
    assert found['at leisure'] == found['at once'] > 1
    assert not at_leisure.under_way


def test_a_slice_is_bounded_and_larger_states_take_fewer_steps() -> None:
    done: list[int] = []
    task = BackgroundTask[str](24)
    task.begin(bits([1] * 500, done))
    task.owe(400)
    task.work_off()
    assert len(done) == SLICE
    larger: list[int] = []
    task = BackgroundTask[str](140)
    task.begin(bits([1] * 500, larger))
    task.owe(400)
    task.work_off()
    assert len(larger) == SLICE // 2
    assert task.owing


def test_what_fails_is_over() -> None:
    def failing() -> Iterator[int | str]:
        yield 1
        raise np.linalg.LinAlgError

    task = BackgroundTask[str](24)
    task.begin(failing())
    task.owe(10)
    with pytest.raises(np.linalg.LinAlgError):
        task.work_off()
    assert not task.under_way
    assert task.work_off() is None
    assert not task.owing
