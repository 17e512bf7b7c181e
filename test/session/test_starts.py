"""Motions that are hard to start with: nothing that is wrong is published as an estimate."""

from __future__ import annotations

import pytest

from benchmarks.honesty.runs import run
from shortened import shorten


def test_a_joint_that_moves_for_the_first_time_is_taken_for_no_push(monkeypatch: pytest.MonkeyPatch) -> None:
    # Its first windows are linearised where what is known of the others has led: the momentum seems to jump.
    name = 'start: trapezoids of 60 s'
    shorten(monkeypatch, name, 20.0)
    told = run((name, 'trajectory', 11))
    assert told.status == 'estimating'
    assert max(told.worst, told.young) < 5.0
