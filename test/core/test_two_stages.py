"""Which of the two stages is published, and how long the first one goes on: a table, with stand-ins for the stages."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from made_runs import BODY, STD, estimate
from mbaid_ros.core.method import (
    _ALONE,
    _FIRST_ESTIMATE_PERIOD,
    _LONGEST,
    DISAGREE,
    FIRST_ESTIMATE,
    FIRST_STAGE,
    LATE,
    UNSOLVED,
    TwoStageEstimator,
)
from mbaid_ros.core.results.estimate import WITHHELD, Estimate
from mbaid_ros.core.samples import FEWEST

FIRST, SECOND = 'difference', 'trajectory'


class AtOnce:
    """Background work that is done at once."""

    def finish_due(self) -> None:
        """Have nothing left."""

    def begin(self, _kind: object, work: Iterator[object], done: Callable[[Any], object], steps: object) -> None:
        """Do some work."""
        assert steps
        try:
            while True:
                next(work)
        except StopIteration as end:
            done(end.value)


class Stage:
    """A stage that gives one estimate after the other."""

    def __init__(self, method: str, *, settled: bool = True) -> None:
        self.method, self.tasks = method, AtOnce()
        self.settled, self.changed, self.disturbed = settled, False, False
        self.updates = self.restarts = 0
        self.offered: list[Estimate] = []
        self.next = made(method)

    def update(self, windows: list[Any], _origin: int) -> list[Estimate]:
        """Return the next estimate of each window, at its time."""
        self.updates += len(windows)
        return [replace(self.next, time=window.time) for window in windows]

    def restart(self) -> None:
        """Count it."""
        self.restarts += 1

    def offer(self, given: Estimate) -> None:
        """Keep it."""
        self.offered.append(given)


def made(method: str, off: float = 0.0, **changes: Any) -> Estimate:
    """Return an estimate that is off by some standard deviations in each number."""
    return estimate(method=method, stage='', parameters=BODY + off * STD, **changes)


def stages(*, settled: bool = True) -> tuple[TwoStageEstimator, Stage, Stage]:
    first, second = Stage(FIRST), Stage(SECOND, settled=settled)
    return TwoStageEstimator(cast('Any', first), cast('Any', second)), first, second


def published(method: TwoStageEstimator, time: float) -> Estimate:
    window = SimpleNamespace(time=time, missing_rates=(False, False))
    (found,) = method.update(cast('Any', [window]), 0)
    return found


def test_the_first_stage_is_published_until_the_second_has_started() -> None:
    """With what the second knows beside the body: the time offset and the causes."""
    method, first, second = stages(settled=False)
    second.next = made(SECOND, 30.0, time_offset=0.01, time_offset_std=1e-3, causes=(('a cause', 20.0),))
    found = published(method, 10.0)
    assert (found.method, found.stage) == (SECOND, FIRST)
    assert np.array_equal(found.parameters, BODY)
    assert (found.time_offset, found.time_offset_std) == (0.01, 1e-3)
    assert found.causes == (('a cause', 20.0),)
    assert set(found.warnings) == {FIRST_ESTIMATE, LATE}
    assert len(second.offered) == 1
    second.settled = True
    second.next = made(SECOND, 1.0)
    later = published(method, 10.0 + _FIRST_ESTIMATE_PERIOD)
    assert np.array_equal(later.parameters, second.next.parameters)
    assert not later.warnings
    first.next = made(FIRST, status='inconsistent')
    published(method, 30.0)
    assert len(second.offered) == 2


def test_numbers_are_first_ones_for_six_seconds_even_if_another_stage_gives_them() -> None:
    method, _, second = stages(settled=True)
    second.next = made(SECOND, 1.0)
    found = [published(method, time).warnings for time in (3.0, 3.0 + 0.99 * _FIRST_ESTIMATE_PERIOD, 9.1)]
    assert found == [(FIRST_ESTIMATE,), (FIRST_ESTIMATE,), ()]


@pytest.mark.parametrize(
    ('mass_std', 'unknown', 'windows'),
    [(0.01, (), 20), (0.049, (), 20), (0.051, (), 21), (0.01, (3,), 21)],
)
def test_the_first_stage_ends_once_it_knows_the_mass_and_has_agreed_for_twenty_windows(
    mass_std: float, unknown: tuple[int, ...], windows: int
) -> None:
    """Not while the second determines more parameters than it."""
    method, first, _ = stages()
    std = STD.copy()
    std[0] = mass_std * BODY[0]
    identifiable = ~np.isin(np.arange(10), unknown)
    first.next = made(FIRST, covariance=np.diag(std**2), identifiable=identifiable)
    for place in range(21):
        published(method, 20.0 + 0.5 * place)
    assert first.updates == windows


@pytest.mark.parametrize(('off', 'contradicts'), [(1.0, False), (40.0, True)])
def test_the_first_stage_ends_after_ten_minutes_unless_the_two_contradict_each_other(
    off: float, *, contradicts: bool
) -> None:
    method, first, second = stages()
    first.next = made(FIRST, covariance=np.diag((STD + np.eye(1, 10)[0] * 0.2 * BODY[0]) ** 2))  # never known well
    second.next = made(SECOND, off)
    for place in range(_LONGEST + 5):
        published(method, 20.0 + 0.5 * place)
    assert first.updates == _LONGEST + 5 * contradicts
    assert second.restarts == contradicts


def test_a_second_stage_that_contradicts_the_first_is_started_again_once_and_then_warned_of() -> None:
    method, _, second = stages()
    second.next = made(SECOND, 40.0)
    once, twice = published(method, 20.0), published(method, 20.5)
    assert (once.stage, once.status) == (FIRST, 'inconsistent')
    assert DISAGREE.text in once.warnings
    assert second.restarts == 1
    assert np.array_equal(twice.parameters, second.next.parameters)
    assert DISAGREE.text in twice.warnings
    second.settled = False  # while it is, the first one stands, in doubt
    assert DISAGREE.text in published(method, 21.0).warnings
    second.settled, second.next = True, made(SECOND)
    assert DISAGREE.text not in published(method, 21.5).warnings
    second.next = made(SECOND, 40.0)
    published(method, 22.0)  # it leads, and is compared beside that
    assert DISAGREE.text in published(method, 22.5).warnings
    assert second.restarts == 1


@pytest.mark.parametrize(('off', 'restarts'), [(2.9, 0), (3.2, 1)])
def test_two_stages_agree_within_the_sum_of_their_covariances(off: float, restarts: int) -> None:
    """A chance of one in a million: a chi-square of 46.9 of ten numbers, 3.06 standard deviations of each."""
    method, _, second = stages()
    second.next = made(SECOND, off)
    published(method, 20.0)
    assert second.restarts == restarts


@pytest.mark.parametrize(
    'first',
    [
        {'status': 'inconsistent'},
        {'identifiable': np.arange(10) > 0},  # no mass
        {'identifiable': np.zeros(10, dtype=bool)},
    ],
)
def test_a_first_stage_without_a_mass_or_in_doubt_contradicts_nothing(first: dict[str, Any]) -> None:
    method, one, second = stages()
    one.next, second.next = made(FIRST, **first), made(SECOND, 40.0)
    found = published(method, 20.0)
    assert np.array_equal(found.parameters, second.next.parameters)
    assert second.restarts == 0


def test_a_disturbed_second_stage_is_published_and_a_changed_one_ends_the_first() -> None:
    method, first, second = stages()
    second.next, second.disturbed = made(SECOND, 40.0), True
    assert np.array_equal(published(method, 20.0).parameters, second.next.parameters)
    second.changed = True
    published(method, 20.5)
    published(method, 21.0)
    assert first.updates == 2
    assert second.restarts == 0


@pytest.mark.parametrize('known', [False, True])
def test_a_strong_cause_contradicts_the_first_stage_where_the_second_has_no_solution(known: bool) -> None:
    method, first, second = stages(settled=False)
    first.next = made(FIRST)
    published(method, 1.0)
    second.next = made(SECOND, status='not_identifiable', causes=(('inches', 101.0),), warnings=(WITHHELD,))
    if not known:
        first.next = made(FIRST, identifiable=np.zeros(10, dtype=bool), status='not_identifiable')
    found = published(method, 1.0 + _ALONE)
    assert found.likely_causes == (('inches', 101.0),)
    assert (found.status, found.stage) == ('inconsistent' if known else 'not_identifiable', FIRST)
    assert UNSOLVED.text in found.warnings
    assert (WITHHELD in found.warnings) is not known


def test_where_neither_stage_has_numbers_the_second_says_what_it_waits_for() -> None:
    method, first, second = stages(settled=False)
    first.next = made(FIRST, identifiable=np.zeros(10, dtype=bool), status='not_identifiable', warnings=('first',))
    second.next = made(SECOND, identifiable=np.zeros(10, dtype=bool), status='waiting', warnings=('second',))
    found = published(method, 1.0)
    assert (found.status, found.stage, found.warnings) == ('waiting', '', ('second',))
    first.next = replace(first.next, warnings=(WITHHELD,))
    assert published(method, 2.0).warnings == (WITHHELD,)


def test_a_first_stage_that_contradicts_the_data_is_withheld_for_ten_seconds() -> None:
    method, first, _ = stages(settled=False)
    first.next = made(FIRST, identifiable=np.zeros(10, dtype=bool), status='not_identifiable')
    assert FIRST_STAGE not in published(method, 1.0).warnings
    first.next = made(FIRST, status='inconsistent')
    found = published(method, 4.0)
    assert (found.status, found.warnings[:2]) == ('not_identifiable', (FIRST_STAGE, WITHHELD))
    assert np.isnan(found.parameters).all()
    assert not found.identifiable.any()
    first.next = made(FIRST)
    found = published(method, 4.0 + 0.99 * _ALONE)
    assert (found.status, found.warnings[0]) == ('not_identifiable', FIRST_STAGE)
    assert WITHHELD not in found.warnings
    found = published(method, 4.0 + _ALONE)
    assert found.identifiable.all()
    assert FIRST_STAGE not in found.warnings


class Reading(SimpleNamespace):
    """A window without some rates."""

    def __len__(self) -> int:
        return int(self.length)


@pytest.mark.parametrize(
    ('missing', 'length', 'used'),
    [
        ((False, False), 1, True),
        ((True, False), FEWEST, True),
        ((False, True), FEWEST, True),
        ((True, True), FEWEST - 1, False),
        ((True, False), FEWEST - 1, False),
    ],
)
def test_a_first_stage_without_a_twist_is_withheld_at_first_and_without_samples_left_out(
    missing: tuple[bool, bool], length: int, used: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('mbaid_ros.core.method.with_rates', lambda window: window)
    method, first, second = stages(settled=False)
    first.next = made(FIRST)
    window = Reading(time=4.0, missing_rates=missing, length=length)
    (found,) = method.update(cast('Any', [window]), 0)
    assert (first.updates, len(second.offered), found.stage == FIRST) == (used, used, used)
    assert (FIRST_STAGE in found.warnings) is (used and missing[1])
    assert (FIRST_STAGE in published(method, 4.5).warnings) is missing[1]


@pytest.mark.parametrize(
    'found', [{'identifiable': np.arange(10) > 0}, {'status': 'inconsistent'}, {'identifiable': np.arange(10) < 1}]
)
def test_only_a_first_stage_with_a_mass_and_without_doubt_is_a_start(found: dict[str, Any]) -> None:
    method, first, second = stages(settled=False)
    first.next = made(FIRST, **found)
    published(method, 4.0)
    assert len(second.offered) == ('identifiable' in found and bool(found['identifiable'][0]))
