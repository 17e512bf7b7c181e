"""The first look at stamps: jumps are believed when two messages agree, single stray stamps are not."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.sensors.streams import (
    JUMPED_BACK,
    STRAY_STAMP,
    ZERO_STAMP,
    Gate,
)

SECOND = 1_000_000_000


def passed(stamps: list[float], *, ignore: bool = False) -> tuple[list[float], list[float], dict[str, int]]:
    """Return the stamps (s) that pass, the jumps back and what is dropped."""
    gate, jumps = Gate(SECOND, ignore_jumps=ignore), []
    for stamp in stamps:
        jump = gate.take(round(stamp * SECOND), stamp)
        if jump:
            jumps.append(jump / SECOND)
            gate.settle(stamp)
    return gate.take_all(), jumps, dict(gate.dropped)


@pytest.mark.parametrize(
    ('stamps', 'kept', 'jumps', 'dropped'),
    [
        ([5.0, 5.5, 5.4, 6.0], [5.0, 5.5, 5.4, 6.0], [], {}),
        ([5.0, 9.0, 5.5], [5.0, 5.5], [], {STRAY_STAMP: 1}),
        ([5.0, 1.0, 5.5], [5.0, 5.5], [], {STRAY_STAMP: 1}),
        ([5.0, 1.0, 1.5, 2.0], [5.0, 1.0, 1.5, 2.0], [4.0], {}),
        ([5.0, 9.0, 9.5], [5.0, 9.0, 9.5], [], {}),
        ([5.0, 9.0, 13.0, 17.0, 17.5], [5.0, 9.0, 13.0, 17.0, 17.5], [], {}),
        ([5.0, 3.0, 1.0, 1.5], [5.0, 1.0, 1.5], [4.0], {STRAY_STAMP: 1}),
        ([5.0, 9.0, 1.0, 1.5], [5.0, 1.0, 1.5], [4.0], {STRAY_STAMP: 1}),
        ([0.0, 0.5, 1.0], [0.0, 0.5, 1.0], [], {}),
        ([0.0, 0.0, 0.0], [0.0], [], {ZERO_STAMP: 2}),
        ([5.0, 0.0, 0.0, 5.5], [5.0, 5.5], [], {ZERO_STAMP: 2}),
        ([-3.0, -2.5], [-3.0, -2.5], [], {}),
    ],
)
def test_what_passes(stamps: list[float], kept: list[float], jumps: list[float], dropped: dict[str, int]) -> None:
    assert passed(stamps) == (kept, jumps, dropped)


def test_jumps_back_can_be_waited_out() -> None:
    stamps = [5.0, 1.0, 1.5, 2.0, 2.5, 5.5, 6.0]
    assert passed(stamps, ignore=True) == ([5.0, 5.5, 6.0], [], {JUMPED_BACK: 4})


@pytest.mark.parametrize('begin', [[], [5.0], [5.0, 9.0], [5.0, 4.9]])
@pytest.mark.parametrize(
    ('stamps', 'regular'),
    [
        ([], True),
        ([5.1, 5.2, 5.15, 6.2], True),
        ([5.1, 4.5, 6.1], True),
        ([5.1, 6.2], False),
        ([5.9, 4.8, 6.0], False),
        ([5.1, 0.0, 5.2], False),
    ],
)
def test_many_that_all_pass_are_taken_as_one_by_one(begin: list[float], stamps: list[float], *, regular: bool) -> None:
    singly, together = Gate(SECOND), Gate(SECOND)
    for gate in (singly, together):
        for stamp in begin:
            gate.take(round(stamp * SECOND), stamp)
    given = np.array([round(stamp * SECOND) for stamp in stamps], dtype=np.int64)
    # Nothing is known before the first stamp, and one that is far from the others waits for the next.
    assert together.passes(given) == ((regular and begin in ([5.0], [5.0, 4.9])) or not stamps)
    if together.passes(given):
        together.take_regular(given, stamps)
        for stamp in stamps:
            assert singly.take(round(stamp * SECOND), stamp) == 0
        assert (singly.newest, singly.dropped) == (together.newest, together.dropped)
        assert singly.take_all() == together.take_all()
