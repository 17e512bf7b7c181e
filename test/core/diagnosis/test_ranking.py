"""From evidence to verdict, by tables: which cause leads, what a candidate gains, which are tried."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mbaid_ros.core.diagnosis.candidates import FEWEST, Candidate, CandidateCauses
from mbaid_ros.core.diagnosis.ranking import CandidateCause, IsolationResult, explains, likeliest_kinds, ranked
from mbaid_ros.core.results.status import Innovations

Row = tuple[float, str]  # gain, and what it is: a thing, something of the twist, or a walk without a mechanism


@pytest.mark.parametrize(
    ('rows', 'leads'),
    [
        ([], False),
        ([(11.0, 'thing')], True),
        ([(30.0, 'thing'), (25.0, 'thing')], False),
        ([(30.0, 'thing'), (15.0, 'thing')], True),
        ([(30.0, 'thing'), (20.0, 'thing')], False),  # by exactly as much
        ([(30.0, 'twist'), (25.0, 'twist')], True),  # both are of the twist
        ([(30.0, 'twist'), (25.0, 'thing')], False),
        ([(30.0, 'thing'), (25.0, 'twist')], False),
        ([(30.0, 'thing'), (25.0, 'walk')], True),
        ([(31.0, 'walk'), (30.0, 'thing')], True),  # 5 % more by what explains anything
        ([(40.0, 'walk'), (30.0, 'thing')], False),
        ([(40.0, 'walk')], False),
    ],
)
def test_a_cause_leads_where_no_other_explains_the_data_nearly_as_well(rows: list[Row], leads: bool) -> None:
    causes = tuple(
        CandidateCause(f'{place}', gain, physical=kind != 'walk', of_twist=kind == 'twist')
        for place, (gain, kind) in enumerate(rows)
    )
    first = next((each for each in causes if each.physical), None)
    assert IsolationResult(causes, Innovations.none(6)).leading is (first if leads else None)


def gaussian(misfit: float, log_likelihood: float) -> Any:
    """Return what is compared of the Gaussian after a pass."""
    return SimpleNamespace(misfit=misfit, log_likelihood=log_likelihood)


@pytest.mark.parametrize(
    ('part', 'gain'),
    # The likelihoods are 70 apart. Of data left out the misfits count: half of the windows have half of the misfit.
    [(1.0, 70.0), (0.5, 100.0 - 2.0 * 30.0), (0.25, 100.0 - 4.0 * 30.0)],
)
def test_what_a_candidate_gains(part: float, gain: float) -> None:
    def refined(*_: object) -> Iterator[int]:
        yield 1
        return SimpleNamespace(gaussian=gaussian(30.0, -130.0))

    passes: Any = SimpleNamespace(refined=refined)
    point: Any = 'a point'
    windows: Any = [None] * FEWEST
    causes: Any = SimpleNamespace(hypotheses=('undisturbed',))
    candidate = Candidate('the thing', passes, windows, point, of_twist=True, part=part)
    found, work = run(CandidateCauses._scored(causes, candidate, gaussian(100.0, -200.0)))
    assert found == [CandidateCause('the thing', gain, of_twist=True)]
    assert work == 1
    # A value that cannot be is none, and so is what leaves too few windows.
    nothing = Candidate(lambda filtered: None, passes, windows, point)
    assert run(CandidateCauses._scored(causes, nothing, gaussian(100.0, -200.0)))[0] == []
    short = Candidate('the thing', passes, windows[1:], point)
    assert run(CandidateCauses._scored(causes, short, gaussian(100.0, -200.0)))[0] == []


def test_a_robot_that_cannot_be_is_no_candidate() -> None:
    def refined(*_: object) -> Iterator[int]:
        yield 1
        raise np.linalg.LinAlgError

    passes: Any = SimpleNamespace(refined=refined)
    point: Any = 'a point'
    windows: Any = [None] * FEWEST
    causes: Any = SimpleNamespace(hypotheses=('undisturbed',))
    candidate = Candidate('the thing', passes, windows, point)
    assert run(CandidateCauses._scored(causes, candidate, gaussian(100.0, -200.0)))[0] == []


def run(work: Any) -> tuple[Any, int]:
    """Return the outcome of a long computation, and its cost."""
    spent = 0
    while True:
        try:
            spent += next(work)
        except StopIteration as end:
            return end.value, spent


def test_three_of_a_kind_are_tried_and_five_in_all() -> None:
    gains = {'link:a': 90.0, 'link:b': 80.0, 'link:c': 70.0, 'link:d': 60.0, 'zero:a': 20.0, 'mount': 50.0, 'axis': 11.0}
    assert likeliest_kinds(gains) == ['link:a', 'link:b', 'link:c', 'mount', 'zero:a']
    assert likeliest_kinds({}) == []


@pytest.mark.parametrize(('nis', 'measured', 'enough'), [(149.0, 100, True), (151.0, 100, False)])
def test_a_pass_explains_the_data_by_innovations_as_large_as_the_noise(nis: float, measured: int, enough: bool) -> None:
    filtered: Any = SimpleNamespace(gaussian=SimpleNamespace(nis=nis, measured=measured))
    assert explains(filtered) is enough


def test_noise_values_gain_what_the_innovations_of_all_sensors_explain() -> None:
    """Of n numbers with nine times the variance n / 2 (9 - 1 - log 9); smaller ones than declared, or none, nothing."""
    innovations = Innovations.none(6)
    for _ in range(50):
        innovations = innovations.with_window(np.repeat([3.0, 0.1, 1.0, 1.0], 3), np.arange(12))
    (cause,) = ranked({}, innovations, 1.4)
    assert cause.gain == pytest.approx(0.5 * 150.0 * (8.0 - np.log(9.0)))
    assert ranked({}, innovations, 1.2) == ()
