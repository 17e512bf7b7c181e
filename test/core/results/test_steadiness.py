"""Estimates that leave their own intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from made_runs import estimate
from mbaid_ros.core.results.estimate import Estimate, Event
from mbaid_ros.core.results.publication import IntervalConsistency


def moved(time: float, by: float) -> Estimate:
    """Return an estimate whose mass is so many of its standard deviations further on."""
    made = estimate()
    parameters = made.parameters.copy()
    parameters[0] += by * made.std[0]
    return replace(made, time=time, parameters=parameters)


@pytest.mark.parametrize(('by', 'status'), [(4.5, 'as it was'), (5.5, 'inconsistent'), (-5.5, 'inconsistent')])
def test_an_estimate_that_leaves_its_interval_by_far_is_inconsistent(by: float, status: str) -> None:
    steadiness = IntervalConsistency()
    first = steadiness.judged(moved(20.0, 0.0), early=False)
    assert first.status == estimate().status
    then = steadiness.judged(moved(25.0, by), early=False)
    assert then.status == (status if status == 'inconsistent' else first.status)
    assert any('mass has moved by 5.5' in text for text in then.warnings) == (status == 'inconsistent')


def test_it_is_so_for_some_seconds() -> None:
    steadiness = IntervalConsistency()
    steadiness.judged(moved(20.0, 0.0), early=False)
    found = [steadiness.judged(moved(time, 8.0), early=False).status for time in (25.0, 29.0, 31.0)]
    assert found == ['inconsistent', 'inconsistent', estimate().status]


def test_first_estimates_and_those_of_another_target_are_not_compared() -> None:
    steadiness = IntervalConsistency()
    steadiness.judged(moved(3.0, 0.0), early=True)
    assert steadiness.judged(moved(5.0, 8.0), early=False).status == estimate().status
    changed = Event(5.5, 'target_changed', np.zeros(3), np.zeros(3), 'another body')
    other = replace(moved(6.0, 0.0), events=(changed,))
    assert steadiness.judged(other, early=False).status == estimate().status


def test_what_was_inconsistent_anyway_is_no_measure() -> None:
    steadiness = IntervalConsistency()
    steadiness.judged(replace(moved(20.0, 0.0), status='inconsistent'), early=False)
    assert steadiness.judged(moved(21.0, 8.0), early=False).status == estimate().status
