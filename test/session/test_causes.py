"""The true cause is named first, in simulated runs with one thing wrong."""

from __future__ import annotations

import pytest

from benchmarks.honesty.runs import run
from benchmarks.honesty.true_causes import rank


@pytest.mark.parametrize(
    'condition',
    [
        "a joint's zero 30 mrad off",
        "a joint's sign flipped",
        'clocks 100 ppm apart',
        'noise of the joints declared 10 x too small',
        'odometry in an orbit-fixed frame',
        'the body slips in the grasp by 5 deg',
    ],
)
def test_the_true_cause_is_named_first(condition: str) -> None:
    told = run((condition, 'trajectory', 0))
    assert told.status in {'inconsistent', 'not_identifiable'}
    assert rank(condition, told.causes.split('\n')) == 1


def test_a_panel_is_named_by_its_frequency_next_to_that_something_moves() -> None:
    condition = 'a flexible panel of 0.3 Hz'
    told = run((condition, 'trajectory', 0))
    assert told.status == 'inconsistent'
    assert rank(condition, told.causes.split('\n')) <= 2


def test_where_nothing_is_wrong_nothing_is_named() -> None:
    told = run(('sinusoids of the shipped robot', 'trajectory', 0))
    assert told.status in {'estimating', 'converged'}
    assert told.causes == ''
