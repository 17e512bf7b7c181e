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


@pytest.mark.parametrize('seed', [pytest.param(20, marks=pytest.mark.long), 90])
def test_what_a_young_run_has_left_behind_counts_no_more(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    # While a pass over a single joint's windows is due, its inertia becomes eight times as well known: 5 deviations off
    # where those windows were linearised.
    name = 'start: a single joint'
    shorten(monkeypatch, name, 24.0)
    told = run((name, 'trajectory', seed))
    assert told.first < 20.0
    assert max(told.worst, told.young) < 4.0


@pytest.mark.long
def test_what_noise_feigns_of_a_single_joint_is_not_counted() -> None:
    # Two thirds of what least squares takes for known of this body is noise in its rows: 4.8 deviations off, once.
    told = run(('start: a single joint', 'trajectory', 16))
    assert told.status == 'estimating'
    assert max(told.worst, told.young) < 3.0


@pytest.mark.long
def test_a_run_is_grown_up_by_its_own_windows_not_by_those_of_a_pass_before() -> None:
    # The pass before is near linear, its own is not: what is linearised there is 2.8 deviations off a second later.
    told = run(('start: a minute at rest first, then trapezoids, from rest', 'trajectory', 66))
    assert told.status == 'estimating'
    assert told.alarms == 0
    assert max(told.worst, told.young) < 3.0
