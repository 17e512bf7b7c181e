"""When a run is searched for a start, whatever the searches lead to."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pytest

from floating import make
from mbaid_ros.core.filter.start import MultiStart, Search
from mbaid_ros.core.filter.state import Point
from mbaid_ros.core.filter.window import Window
from mbaid_ros.simulation.simulation import Truth
from observed import MID, kernel, observe, windows


def spied(monkeypatch: pytest.MonkeyPatch, *, failing: bool) -> list[int]:
    """Return a list that the number of windows of every search goes to."""
    lengths: list[int] = []
    search = MultiStart.search

    def spying(self: MultiStart, run: list[Window], points: Sequence[Callable[[], Point | None]]) -> Search:
        lengths.append(len(run))
        return nowhere() if failing else search(self, run, points)

    def nowhere() -> Iterator[int]:
        yield 1
        raise np.linalg.LinAlgError('no start leads to a robot that can be')

    monkeypatch.setattr(MultiStart, 'search', spying)
    return lengths


def test_searches_go_on_after_any_number_that_failed(monkeypatch: pytest.MonkeyPatch, servicer: Truth) -> None:
    taken = windows(observe(servicer, MID, 1))
    lengths = spied(monkeypatch, failing=True)
    following = make(kernel('servicer7'), MID)
    for _ in range(5):
        for window in taken:
            following.update([window], 0)
    # As often in the second hundred windows as in the first, over no more than are kept.
    assert len(lengths) > 60
    assert max(lengths) <= following._runs._settings.kept + 1


def test_a_run_that_is_given_up_is_searched_again_from_as_many_windows_as_the_first(
    monkeypatch: pytest.MonkeyPatch, servicer: Truth
) -> None:
    taken = windows(observe(servicer, MID, 1))
    following = make(kernel('servicer7'), MID)
    following.update(taken, 0)
    run = following._runs.run
    assert run is not None
    run._young.windows, run._young.grown_up = [], True
    lengths = spied(monkeypatch, failing=False)
    following.restart()
    for window in taken:
        following.update([window], 0)
    assert lengths[0] == following._runs._settings.start
