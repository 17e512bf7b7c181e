"""What is put off between windows: as much a window, however it is cut into calls."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from mbaid_ros.core.trajectory.errand import SLICE, Errand


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
    at_leisure, at_once = Errand[str](size), Errand[str](size)
    ways: tuple[list[int], list[int]] = ([], [])
    found: dict[str, int] = {}
    for errand, done in zip((at_leisure, at_once), ways, strict=True):
        errand.begin(bits(sizes, done))
    for number in range(40):
        for errand in (at_leisure, at_once):
            errand.owe(owed)
        for _ in range(int(rng.integers(0, 8))):
            if at_leisure.work_off():
                found['at leisure'] = number
        for name, errand in (('at leisure', at_leisure), ('at once', at_once)):
            while errand.owing:
                if errand.work_off():
                    found[name] = number
        assert ways[0] == ways[1]
    assert ways[0] == sizes
    assert found['at leisure'] == found['at once'] > 1
    assert not at_leisure.under_way


def test_a_slice_is_bounded_and_larger_states_take_fewer_steps() -> None:
    done: list[int] = []
    errand = Errand[str](24)
    errand.begin(bits([1] * 500, done))
    errand.owe(400)
    errand.work_off()
    assert len(done) == SLICE
    larger: list[int] = []
    errand = Errand[str](140)
    errand.begin(bits([1] * 500, larger))
    errand.owe(400)
    errand.work_off()
    assert len(larger) == SLICE // 2
    assert errand.owing


def test_what_fails_is_over() -> None:
    def failing() -> Iterator[int | str]:
        yield 1
        raise np.linalg.LinAlgError

    errand = Errand[str](24)
    errand.begin(failing())
    errand.owe(10)
    with pytest.raises(np.linalg.LinAlgError):
        errand.work_off()
    assert not errand.under_way
    assert errand.work_off() is None
    assert not errand.owing
