"""A target that is another from some time on: told, and identified anew with what is known of the robot."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from benchmarks.honesty.runs import PUBLISHED, Outcome, run
from captured import capture
from mbaid_ros.core.results.causes import PULSE
from mbaid_ros.core.results.estimate import Estimate
from observed import MID, estimator, kernel, observe, true_body, windows
from shortened import shorten

CAUGHT, END = 20.0, 40.0  # s
VELOCITY, SPIN = np.array([0.004, -0.006, 0.003]), np.array([0.02, -0.03, 0.015])  # m/s, rad/s


@cache
def history() -> list[Estimate]:
    truth = capture(CAUGHT, END - CAUGHT, VELOCITY, SPIN).truth
    return estimator(kernel('servicer7'), MID, method='trajectory').update(windows(observe(truth, MID, 1)), 0)


def test_a_second_body_in_the_grasp_is_told_and_identified() -> None:
    last = history()[-1]
    (event,) = last.events
    assert event.kind == 'target_changed'
    assert event.time == pytest.approx(CAUGHT, abs=0.5)
    assert 'another body' in event.cause
    assert last.status in PUBLISHED
    assert np.all(np.abs(last.parameters - true_body(kernel('servicer7'))) < 4.0 * last.std)


def test_what_is_in_the_grasp_then_is_never_published_as_what_was_before() -> None:
    since = [estimate for estimate in history() if estimate.time > CAUGHT + 0.5 and estimate.status in PUBLISHED]
    assert since
    for estimate in since:
        assert np.abs(estimate.parameters[0] - true_body(kernel('servicer7'))[0]) < 5.0 * estimate.std[0]


@pytest.mark.long
def test_a_push_is_a_push(monkeypatch: pytest.MonkeyPatch) -> None:
    name = 'a thrust pulse of 1 N s, 0.5 N m s'
    shorten(monkeypatch, name, 40.0)
    told = run((name, 'trajectory', 0))
    assert told.status in PUBLISHED
    assert told.named == PULSE
    assert max(told.worst, told.young) < 5.0


def gone_on(name: str, seed: int, cause: str) -> Outcome:
    """Return what a run says that has told of a change and goes on with the target of afterwards."""
    told = run((name, 'trajectory', seed))
    assert told.status in PUBLISHED
    assert cause in told.causes
    given = told.std > 0.0
    assert np.all(np.abs(told.error[given]) < 4.0 * told.std[given])
    return told


def test_after_a_slip_the_run_goes_on() -> None:
    gone_on('the body slips in the grasp by 5 deg', 0, 'moved in the grasp at 30.0 s')


@pytest.mark.long
def test_a_wide_slip_is_told_from_the_first_inquiry_on(monkeypatch: pytest.MonkeyPatch) -> None:
    name = 'the body slips in the grasp by 30 deg'
    shorten(monkeypatch, name, 48.0)
    gone_on(name, 1, 'moved in the grasp at 30.0 s')


@pytest.mark.long
def test_after_the_hand_has_lost_its_body_the_run_goes_on_with_the_empty_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    name = 'the hand loses the body'
    shorten(monkeypatch, name, 48.0)
    told = gone_on(name, 0, 'another body is in the grasp since 30.0 s, caught or lost')
    assert told.error[0] < 5.0  # kg, of a body that was 155 kg heavier
