"""The records of results: the filter's numbers in units of the user, and the end of a publication."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from checked import some
from made_runs import STD, estimate
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import (
    Estimate,
    Event,
    PassiveJoint,
    Thruster,
    determined,
    is_complete,
    is_usable,
)
from mbaid_ros.core.results.verdict import Cause, Verdict
from mbaid_ros.core.robot.body import standard
from mbaid_ros.core.target import Debris, DebrisPublication, changed_by, debris


def test_a_thruster_has_its_scale_turn_and_delay_at_its_own_strength() -> None:
    """The numbers are scale less 1, turn, and delay times strength; thrusters one after the other."""
    values = np.array([0.25, 0.1, 0.2, 0.3, 0.05, -0.5, 0.4, 0.5, 0.6, 0.02])
    first, second = Thruster.all_of(['left', 'right'], values, 0.1 * np.arange(1.0, 11.0))
    assert (first.frame, second.frame) == ('left', 'right')
    assert (first.scale, second.scale) == pytest.approx((1.25, 0.5))
    assert (first.scale_std, second.scale_std) == pytest.approx((0.1, 0.6))
    assert first.turn == pytest.approx([0.1, 0.2, 0.3])
    assert second.turn_std == pytest.approx([0.7, 0.8, 0.9])
    assert (first.delay, second.delay) == pytest.approx((0.04, 0.04))
    assert (first.delay_std, second.delay_std) == pytest.approx((0.4, 2.0))


def test_a_passive_joint_is_as_declared_where_the_data_do_not_resolve_it() -> None:
    declared = np.array([2.0 * np.pi, 4.0 * np.pi]), np.array([0.01, 0.02]), np.array([[0.1, 0.005], [0.2, 0.006]])
    found, other = PassiveJoint.all_of(
        ['boom', 'panel'],
        declared,
        np.array([[np.log(1.5), 0.003], [0.7, 0.004]]),
        np.array([[0.01, 0.001], [0.02, 0.002]]),
        np.array([[0.3, 0.4], [-0.1, -0.2], [0.25, 0.35]]),
        np.array([True, False]),
    )
    assert (found.joint, found.resolved, other.joint, other.resolved) == ('boom', True, 'panel', False)
    assert (found.frequency, found.frequency_std) == pytest.approx((1.5, 0.015))
    assert (found.damping, found.damping_std) == pytest.approx((0.013, 0.001))
    assert (other.frequency, other.frequency_std) == pytest.approx((2.0, 0.4))
    assert (other.damping, other.damping_std) == pytest.approx((0.02, 0.006))
    assert (found.deflection, found.swing, other.swing) == (0.3, (-0.1, 0.25), (-0.2, 0.35))
    assert '1.5 ± 0.029 Hz with a damping ratio of 0.013 ± 0.002, by up to 0.3 rad' in str(found)
    assert '(as set)' in str(other)
    assert 'by up to' not in str(replace(found, deflection=np.nan))


@pytest.mark.parametrize(
    ('momentum', 'stds', 'known'),
    [
        ([1.0, 2.0, 3.0], [0.1, 0.1, 0.1], [True, True, True]),
        ([1.0, 2.0, 0.0], [0.1, 0.1, 1e4], [True, True, False]),  # out of a plane
        ([0.0, 0.0, 0.0], [0.1, 0.1, 9.0], [True, True, True]),  # at rest: within a hundred times the best
        ([0.0, 0.0, 0.0], [0.1, 0.1, 11.0], [True, True, False]),
        ([30.0, 40.0, 0.0], [0.1, 0.1, 49.0], [True, True, True]),  # less than the momentum itself
        ([1.0, np.nan, 3.0], [0.1, np.nan, 0.1], [True, False, True]),
    ],
)
def test_which_components_of_a_momentum_are_worth_a_number(
    momentum: list[float], stds: list[float], known: list[bool]
) -> None:
    assert determined(np.array(momentum), np.array(stds)).tolist() == known


def test_known_thrust_adds_to_the_momentum_of_the_begin() -> None:
    impulse = np.arange(1.0, 7.0)
    after = estimate().after_thrust(impulse)
    assert after.momentum == pytest.approx(estimate().momentum + impulse)
    assert after.impulse is impulse
    assert not np.any(estimate().after_thrust(np.zeros(6)).impulse)


@pytest.mark.parametrize(
    ('kind', 'text'),
    [
        ('step', 'momentum jumped at 5.0 s, by (1, 2, 3) N s, (4, 5, 6) N m s: a push'),
        ('ramp', 'momentum changes since 5.0 s, by (1, 2, 3) N, (4, 5, 6) N m: a push'),
        ('target_changed', 'a push'),
    ],
)
def test_an_event_in_words(kind: str, text: str) -> None:
    made = Event(5.0, kind, np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]), 'a push')  # type: ignore[arg-type]
    assert str(made) == text


def test_a_change_of_the_target_has_its_size_in_words() -> None:
    centre = np.array([0.1, -0.2, 0.0])
    assert changed_by('it moved', None, centre) == 'it moved; the centre of mass has changed by (+0.1, -0.2, +0) m'
    assert changed_by('it went', -3.0, centre).endswith('m, the mass by -3 kg')


LINK = standard(np.array([40.0, 0.1, 0.0, 0.2, 5.0, 0.0, 0.0, 6.0, 0.0, 4.0]))


@pytest.mark.parametrize(
    ('relative', 'link', 'known'),
    [(0.01, LINK, True), (0.37, LINK, True), (0.4, LINK, False), (0.01, 162.0 / 40.0 * LINK, False)],
    ids=['well known', 'hardly known', 'may be nothing', 'nothing'],
)
def test_debris_is_known_where_its_mass_cannot_be_zero(relative: float, link: Array, known: bool) -> None:
    """At two standard deviations of 162 kg less those 40 kg of the link."""
    std = STD.copy()
    std[0] = relative * 162.0
    found = debris(estimate(covariance=np.diag(std**2)), link)
    assert (found is not None) is known
    assert found is None or found.parameters[0] == pytest.approx(122.0)


def test_debris_that_is_lost_is_published_once_without_numbers() -> None:
    known, publication = Debris(np.ones(10), np.eye(10)), DebrisPublication()
    assert publication.next_published(None) is None
    assert publication.next_published(known) is known
    lost = some(publication.next_published(None))
    assert np.isnan(lost.parameters).all()
    assert np.isnan(lost.covariance).all()
    assert publication.next_published(None) is None


def test_a_further_cause_takes_its_place_and_is_a_reason() -> None:
    verdict = Verdict(adequate=False, reasons=('wrong',), causes=(Cause('a', 30.0), Cause('b', 10.0)), widening=1.0)
    more = verdict.with_cause(Cause('c', 20.0))
    assert [each.text for each in more.causes] == ['a', 'c', 'b']
    assert more.reasons == ('wrong', 'c')
    again = more.with_cause(Cause('b', 40.0))
    assert [each.text for each in again.causes] == ['b', 'a', 'c']


@pytest.mark.parametrize(
    ('changes', 'status', 'usable', 'complete'),
    [
        ({}, 'estimating', True, True),
        ({}, 'inconsistent', False, False),
        ({0: -1.0}, 'estimating', False, False),
        ({0: np.nan}, 'estimating', False, False),
        ({1: np.nan}, 'estimating', True, False),  # of a plane
        ({3: np.nan}, 'estimating', True, False),
        ({1: np.nan, 2: np.nan}, 'estimating', False, False),
        ({3: np.nan, 2: np.nan}, 'estimating', False, False),
        ({4: np.nan, 7: np.nan}, 'estimating', True, False),
        ({4: np.nan, 7: np.nan, 9: np.nan}, 'estimating', False, False),
        ({4: -1.0, 7: -1.0, 9: -1.0}, 'estimating', False, False),
        ({5: np.nan}, 'estimating', True, False),
    ],
)
def test_an_estimate_is_usable_with_what_a_plane_shows_and_complete_with_all(
    changes: dict[int, float], status: Any, *, usable: bool, complete: bool
) -> None:
    parameters = np.arange(1.0, 11.0)
    for place, value in changes.items():
        parameters[place] = value
    known = np.isfinite(parameters)
    estimate = Estimate('trajectory', status, 3.0, parameters=parameters, identifiable=known)
    assert (is_usable(estimate), is_complete(estimate)) == (usable, complete)
    assert not is_complete(replace(estimate, identifiable=known & (np.arange(10) != 9)))
    assert is_complete(replace(estimate, identifiable=np.ones(10, dtype=bool))) is complete


def test_a_momentum_after_thrust_is_larger_by_its_impulse() -> None:
    before = Estimate('trajectory', 'estimating', 3.0, momentum=np.arange(6.0))
    assert before.after_thrust(np.zeros(6)) is before
    for impulse in (np.arange(6.0) * (np.arange(6) == 4), np.ones(6)):
        after = before.after_thrust(impulse)
        assert after.momentum.tolist() == (np.arange(6.0) + impulse).tolist()
        assert after.impulse is impulse
