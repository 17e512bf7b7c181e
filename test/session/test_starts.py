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


@pytest.mark.long
def test_what_noise_feigns_of_a_single_joint_is_not_counted() -> None:
    # Two thirds of what least squares takes for known of this body is noise in its rows: 4.8 deviations off, once.
    told = run(('start: a single joint', 'trajectory', 16))
    assert told.status == 'estimating'
    assert max(told.worst, told.young) < 3.0
