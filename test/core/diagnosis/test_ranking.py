"""From evidence to verdict, by tables: which cause leads, what a candidate gains, which are tried."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mbaid_ros.core.diagnosis.isolation import (
    FEWEST,
    Candidate,
    CandidateCause,
    CandidateCauses,
    IsolationResult,
    explains,
    likeliest_kinds,
    ranked,
    with_links_as_likely,
)
from mbaid_ros.core.repair import Conversion, Repair
from mbaid_ros.core.results.innovations import BASE_SENSORS, Innovations
from mbaid_ros.tasks import Work

Row = tuple[float, str]  # gain, and kind: a thing, an error of the twist, or a walk without a mechanism

SOURCES = tuple(np.repeat(BASE_SENSORS, 3).tolist())


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
    assert IsolationResult(causes, Innovations.none(SOURCES)).leading is (first if leads else None)


def gaussian(misfit: float, log_likelihood: float) -> Any:
    """Return the numbers of the Gaussian after a pass that candidates compare."""
    return SimpleNamespace(misfit=misfit, log_likelihood=log_likelihood)


def candidate(
    windows: int,
    part: float = 1.0,
    text: Any = 'the thing',
    contradicting: tuple[float, float] = (0.0, 0.0),
    nis: float = 100.0,
    **changes: Any,
) -> list[CandidateCause]:
    """Return the causes that a candidate makes whose pass has a misfit of 30, and a log-likelihood of -130.

    Without it the misfit is 100, and the log-likelihood -200. A negative number of windows is of no robot that can be.
    `contradicting` is the gain of unknowns that contradict the model, without it and with it.
    """

    def refined(*_: object) -> Work[Any]:
        yield 1
        if windows < 0:
            raise np.linalg.LinAlgError
        return SimpleNamespace(gaussian=SimpleNamespace(misfit=30.0, log_likelihood=-130.0, nis=nis, measured=100))

    passes: Any = SimpleNamespace(refined=refined, contradicting=lambda _: contradicting[1])
    point: Any = 'a point'
    causes: Any = SimpleNamespace(hypotheses=('undisturbed',))
    made = Candidate(text, passes, [None] * abs(windows), point, of_twist=True, part=part, **changes)  # type: ignore[list-item]
    found: list[CandidateCause] = []

    def kept() -> Work[None]:
        found.extend((yield from CandidateCauses._scored(causes, made, gaussian(100.0, -200.0), contradicting[0])))

    assert sum(kept()) == (1 if abs(windows) >= FEWEST else 0)
    return found


@pytest.mark.parametrize(
    ('part', 'gain'),
    # The likelihoods are 70 apart. Of data left out the misfits count: half of the windows have half of the misfit.
    [(1.0, 70.0), (0.5, 100.0 - 2.0 * 30.0), (0.25, 100.0 - 4.0 * 30.0)],
)
def test_what_a_candidate_gains(part: float, gain: float) -> None:
    assert candidate(FEWEST, part) == [CandidateCause('the thing', gain, of_twist=True)]


def test_a_candidate_gains_what_it_explains_of_unknowns_that_contradict_the_model() -> None:
    assert candidate(FEWEST, contradicting=(40.0, 15.0))[0].gain == 70.0 + 25.0


def test_a_candidate_that_has_to_explain_the_whole_leaves_no_unknown_that_contradicts_the_model() -> None:
    assert candidate(FEWEST, contradicting=(40.0, 0.0), whole=True)[0].gain == 70.0 + 40.0
    assert candidate(FEWEST, contradicting=(40.0, 15.0), whole=True) == []
    assert candidate(FEWEST, nis=1000.0, whole=True) == []
    assert candidate(FEWEST, nis=1000.0)


def test_a_link_names_those_that_explain_the_data_as_well() -> None:
    rows = [('a panel', 45.0, ''), ('elbow', 40.0, 'elbow'), ('wrist', 31.0, 'wrist'), ('hand', 30.0, 'hand')]
    found = [CandidateCause(text, gain, link=link) for text, gain, link in (*rows, ('base', 29.0, 'base'))]
    said = {each.link: each.text for each in with_links_as_likely(found)}
    others = {name: name for name in ('wrist', 'hand', 'base')}
    assert said == {'': 'a panel', 'elbow': 'elbow; as likely: wrist, hand', **others}
    assert with_links_as_likely(found[:2]) == found[:2]
    weak = [CandidateCause('elbow', 12.0, link='elbow'), CandidateCause('wrist', 9.0, link='wrist')]
    assert with_links_as_likely(weak) == weak
    assert with_links_as_likely([found[1], found[4]]) == [found[1], found[4]]


@pytest.mark.parametrize(
    ('label', 'link'), [('link:elbow', 'elbow'), ('density:elbow', 'elbow'), ('lag:elbow', ''), (None, '')]
)
def test_a_candidate_of_a_link_knows_its_name(label: str | None, link: str) -> None:
    passes: Any = SimpleNamespace(repair=lambda *_: None)
    assert Candidate('', passes, [], repair=label).link == link


def test_a_candidate_gains_less_by_its_weight_and_by_what_chance_would_gain() -> None:
    assert candidate(FEWEST, weight=0.5, less=3.0)[0].gain == 0.5 * 70.0 - 3.0
    assert candidate(FEWEST, contradicting=(40.0, 15.0), weight=0.5)[0].gain == 0.5 * 95.0


def test_what_leaves_few_windows_or_cannot_be_is_no_candidate() -> None:
    def impossible(filtered: object) -> None:
        del filtered

    assert candidate(FEWEST - 1) == []
    assert candidate(-FEWEST) == []
    assert candidate(FEWEST, text=impossible) == []
    assert candidate(FEWEST, text=lambda filtered: f'{filtered.gaussian.misfit:.0f} left')[0].text == '30 left'


def test_three_of_a_kind_are_tried_and_five_in_all() -> None:
    gains = {
        'link:a': 90.0,
        'link:b': 80.0,
        'link:c': 70.0,
        'link:d': 60.0,
        'zero:a': 20.0,
        'mount': 50.0,
        'axis': 11.0,
    }
    assert likeliest_kinds(gains) == ['link:a', 'link:b', 'link:c', 'mount', 'zero:a']
    assert likeliest_kinds({}) == []
    heavier = {'density:a': 95.0, 'density:c': 65.0}
    assert likeliest_kinds(gains | heavier) == ['density:a', 'link:b', 'link:c', 'mount', 'zero:a']


@pytest.mark.parametrize(('nis', 'measured', 'enough'), [(149.0, 100, True), (151.0, 100, False)])
def test_a_pass_explains_the_data_by_innovations_as_large_as_the_noise(nis: float, measured: int, enough: bool) -> None:
    filtered: Any = SimpleNamespace(gaussian=SimpleNamespace(nis=nis, measured=measured))
    assert explains(filtered) is enough


def test_noise_values_gain_what_the_innovations_of_all_sensors_explain() -> None:
    """Of n numbers with nine times the variance n / 2 (9 - 1 - log 9); smaller ones than declared, or none, nothing."""
    innovations = Innovations.none(SOURCES)
    for _ in range(50):
        innovations = innovations.with_window(np.repeat([3.0, 0.1, 1.0, 1.0], 3), np.arange(12))
    (cause,) = ranked({}, innovations, 1.4)
    assert cause.gain == pytest.approx(0.5 * 150.0 * (8.0 - np.log(9.0)))
    assert ranked({}, innovations, 1.2) == ranked({}, innovations, np.nan) == ()


@pytest.mark.parametrize(('gain', 'named'), [(99.0, ['poses', 'other']), (101.0, ['twist', 'poses', 'other'])])
def test_a_twist_that_seems_wrong_by_wrong_poses_is_no_cause_beside_them(gain: float, named: list[str]) -> None:
    poses, twist = (Conversion(pose='inverse'), Conversion(with_twist=False))
    repairs = {'poses': Repair('poses', conversion=poses), 'twist': Repair('twist', conversion=twist), 'other': None}
    gains = {'poses': (100.0, True), 'twist': (gain, True), 'other': (20.0, True)}
    assert [cause.text for cause in ranked(gains, Innovations.none(SOURCES), 1.0, repairs)] == named
