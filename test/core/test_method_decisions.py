"""What the trajectory method decides after a window, from what run and isolation come to: without a filter."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from checked import generic
from mbaid_ros.core import method as module
from mbaid_ros.core.contracts import UNDISTURBED, Hypothesis, kind_in_words
from mbaid_ros.core.filter.run import FIRST
from mbaid_ros.core.method import (
    _STRONG,
    ANY_CAUSE,
    ON_POSES,
    TARGET_CONTRADICTS,
    UNSOLVED,
    TrajectoryEstimator,
    TrajectorySettings,
    _remedies,
    joint_delay,
)
from mbaid_ros.core.results.estimate import WITHHELD, Estimate
from mbaid_ros.core.results.verdict import Cause, Distance, Verdict
from mbaid_ros.core.state import BODY, Declared
from observed import MID, kernel

METHOD: Any = TrajectoryEstimator  # its functions, called with stubs
CAUSE, OTHER = Cause('the arm', 20.0), Cause('the camera', 9.0)
WAITING = Estimate('trajectory', 'waiting', 3.0)


class Calls:
    """Keeps how it is called."""

    def __init__(self) -> None:
        self.made: list[tuple[Any, ...]] = []

    def __call__(self, *given: Any, **named: Any) -> None:
        """Keep it."""
        self.made.append((*given, *named.values()))


@dataclass(frozen=True)
class FilterVariables:
    """Variables of a run, with the attributes that the method asks for."""

    tracked: Any = None
    has_body_prior: bool = False
    previous_bias: Any = None
    continued: tuple[Any, ...] = ()
    to_state: Any = field(default_factory=lambda: np.diag([2.0, 3.0]))

    def for_continued_run(self, *before: Any) -> FilterVariables:
        """Return that of a run that goes on."""
        return replace(self, continued=before, previous_bias='bias')

    def prior(self) -> tuple[Any, Any]:
        """Return mean and factor."""
        return np.array([1.0, 4.0]), None


class Batch:
    """A closed window."""

    def __init__(self, impulse: Any, time: float = 2.5) -> None:
        self.impulse, self.time = impulse, np.array([time - 1.0, time])
        self.gravity_columns = np.zeros((6, 0))

    def __len__(self) -> int:
        return len(self.impulse)


def stub(**attributes: Any) -> Any:
    return SimpleNamespace(**attributes)


@pytest.mark.parametrize(
    ('now', 'moved'),
    [
        ({}, False),
        ({'joints_moved': True}, True),
        ({'body': True}, True),
        ({'bias': True}, True),
        ({'grasp_known': False}, False),
        ({'grasp_known': True}, True),
        ({'joints': 0}, False),
        ({'joints': 0, 'thrust': 1.0}, True),
        ({'thrust': 1.0}, False),
    ],
)
def test_a_run_starts_with_motion_or_with_what_makes_up_for_it(now: dict[str, Any], *, moved: bool) -> None:
    """Of the arm, a known body or bias, a target that was tracked in a known grasp, or thrust of a body without arm."""
    impulse = np.zeros((4, 6))
    impulse[2:, 1] = now.get('thrust', 0.0)
    knots = [
        stub(ready=None, still_open='open 0', joints_moved=now.get('joints_moved', False)),
        stub(ready='ready 1', still_open=None, joints_moved=now.get('joints_moved', False)),
    ]
    add, expect, seen = Calls(), Calls(), Calls()
    tracked = stub(grasp_known=now['grasp_known']) if 'grasp_known' in now else None
    method = stub(
        _averaging=stub(average=lambda _: knots),
        _expect=expect,
        _current_run=lambda: stub(add=add),
        _usable_part=lambda window: f'part of {window}',
        tasks=stub(finish_due=Calls()),
        _plane=stub(update=seen),
        _variables=FilterVariables(tracked, now.get('body', False), 'bias' if now.get('bias') else None),
        _kernel=stub(model=stub(joints=('joint',) * now.get('joints', 1))),
        _isolation=stub(add_window=Calls()),
        _moved=3,
        _samples=10,
        _estimate=lambda _run, window, origin, joints_moved: (window, origin, joints_moved),
    )
    batch: Any = [Batch(impulse), Batch(impulse)]
    found: Any = METHOD.update(method, batch, 7)
    assert found == [(window, 7, moved) for window in batch]
    assert add.made == [(None, 'part of open 0', moved), ('part of ready 1', None, moved)]
    assert expect.made == [(['open 0', 'ready 1'],)]
    assert seen.made == [(window,) for window in batch]
    assert method._isolation.add_window.made == [(None, batch[0]), ('part of ready 1', batch[1])]
    assert method._samples == 10 + 2 * 4
    assert method._moved == 3 + 2 * now.get('joints_moved', False)
    assert method._last is batch[1]


@pytest.mark.parametrize(
    ('has_state', 'converged', 'relinearises', 'solved'),
    [(True, True, False, True), (False, True, False, False), (True, False, False, False), (True, True, True, False)],
)
def test_a_window_has_a_solution_if_the_run_has_converged(
    has_state: bool, converged: bool, relinearises: bool, solved: bool
) -> None:
    run = stub(has_state=has_state, converged=converged, relinearises=relinearises, innovations=np.ones((1, 2)))
    method = stub(
        method='trajectory',
        _samples=12,
        _solution=lambda *given: (True, *given),
        _no_solution=lambda *given, joints_moved: (joints_moved, *given),
    )
    window: Any = Batch(np.zeros((4, 6)))
    found, of, now, seen = METHOD._estimate(method, run, window, 10**18, joints_moved=False)
    assert found is solved
    assert of is run
    assert seen is window
    assert (now.status, now.time, now.stamp, now.samples) == ('waiting', 2.5, 10**18 + 2_500_000_000, 12)
    assert now.innovations is run.innovations


@pytest.mark.parametrize(
    ('now', 'planar', 'expected'),
    [
        ({}, True, ()),
        ({'_wrong_twist': 'late'}, True, ('the twist is not used, because it contradicts the poses: late',)),
        ({'_left_out': 'frame'}, True, (TARGET_CONTRADICTS + 'frame',)),
        ({'_variables': FilterVariables('target'), '_moved': FIRST - 1}, True, (ON_POSES,)),
        ({'_variables': FilterVariables('target'), '_moved': FIRST}, True, ()),
        ({'before': True}, True, ()),
        ({'before': False}, False, ()),
        ({}, False, ()),
        ({'before': True, 'run': None}, None, ()),
        ({'before': True}, False, ('the run before, which was planar, does not count: this motion is not',)),
    ],
)
def test_a_run_is_warned_of_what_it_leaves_out(
    now: dict[str, Any], planar: bool | None, expected: tuple[str, ...]
) -> None:
    before: Any = stub(planar=now['before']) if 'before' in now else None
    reporting: Any = None
    settings = TrajectorySettings(MID, 0.5, 20, Declared(), (UNDISTURBED,), before=before)
    method: Any = TrajectoryEstimator(kernel('table1'), settings, reporting)
    method.run, method._variables = None if planar is None else stub(planar=planar), FilterVariables()
    for name, value in now.items():
        setattr(method, name, value)
    assert method._warnings == expected


@pytest.mark.parametrize(
    ('adequate', 'own', 'isolated', 'searched', 'expected', 'suspicious'),
    [
        (True, (), (OTHER,), True, (), False),
        (True, (CAUSE,), (OTHER,), True, (CAUSE,), True),
        (False, (), (OTHER,), True, (OTHER,), True),
        (False, (CAUSE,), (OTHER,), False, (OTHER,), True),
        (False, (CAUSE,), (), True, (CAUSE,), True),
        (False, (CAUSE,), (), False, (replace(CAUSE, repair=None),), True),
        (True, (CAUSE,), (OTHER,), False, (replace(CAUSE, repair=None),), True),
    ],
)
def test_causes_that_are_found_take_the_place_of_a_verdict_s(
    adequate: bool, own: tuple[Cause, ...], isolated: tuple[Cause, ...], searched: bool, expected: Any, suspicious: bool
) -> None:
    """A verdict's own causes have no remedy before a search has ended."""
    repair: Any = 'repair'
    own, isolated = (tuple(replace(cause, repair=repair) for cause in causes) for causes in (own, isolated))
    begun = Calls()
    isolation = stub(begin_if_due=begun, causes=lambda _: isolated, searched=searched)
    run: Any = object()
    found = METHOD._with_causes(stub(_isolation=isolation), run, Verdict(adequate, (), own, 1.0))
    assert begun.made == [(run, suspicious)]
    assert [cause.text for cause in found.causes] == [cause.text for cause in expected]
    kept = searched or (not adequate and bool(isolated))
    assert _remedies(found.causes) == ({cause.text: repair for cause in expected} if kept else {})


@pytest.mark.parametrize(
    ('now', 'status', 'reason'),
    [
        ({'has_state': True}, 'not_identifiable', 'no convergent solution yet'),
        ({'has_state': True, 'joints_moved': True}, 'not_identifiable', 'no convergent solution yet'),
        ({'joints_moved': True, 'searching': True}, 'waiting', 'looking for a start in the first'),
        ({'joints_moved': True}, 'waiting', 'collecting the first'),
        ({'samples': 2}, 'not_identifiable', 'for windows of 0.5 s: read the joints more often, or set window to 1.5'),
        ({}, 'not_identifiable', 'no joint has moved yet: with joints at rest'),
        ({'located': False}, 'not_identifiable', 'no joint has moved yet: tumbling'),
    ],
)
@pytest.mark.parametrize('doubt', [(False, False), (True, False), (False, True)])
def test_why_there_is_no_solution(now: dict[str, Any], status: str, reason: str, doubt: tuple[bool, bool]) -> None:
    """A run that contradicts itself, or did, has its faults isolated if there is any motion."""
    begun, repair = Calls(), stub()
    causes: Any = (replace(CAUSE, repair=repair), OTHER)
    isolation = stub(causes=lambda _: causes, suspicious=doubt[0], begin_if_due=begun)
    run = stub(has_state=now.get('has_state', False), searching=now.get('searching', False), inconsistent=doubt[1])
    method = stub(
        _isolation=isolation,
        _settings=stub(window=0.5, located=now.get('located', True)),
        _events=lambda now: ('event',) if now is None else (),
        _warnings=('another',),
    )
    impulse = generic(0, now.get('samples', 3), 6)
    window: Any = Batch(impulse)
    moved = now.get('joints_moved', False)
    found = METHOD._no_solution(method, run, replace(WAITING, momentum=np.zeros(6)), window, joints_moved=moved)
    assert found.status == status
    assert reason in found.warnings[0]
    assert found.warnings[1:] == ('another',)
    assert begun.made == ([(run, any(doubt))] if moved else [])
    assert found.causes == (('the arm', 20.0), ('the camera', 9.0))
    assert found.remedies == {'the arm': repair}
    assert found.events == ('event',)
    assert np.array_equal(found.impulse, impulse[-1])


@pytest.mark.parametrize('has_state', [False, True])
@pytest.mark.parametrize('gain', [_STRONG, 1.01 * _STRONG])
def test_a_strong_cause_contradicts_a_run_without_a_solution(has_state: bool, gain: float) -> None:
    isolation = stub(causes=lambda _: (replace(CAUSE, gain=gain),), suspicious=True, begin_if_due=Calls())
    run: Any = stub(has_state=has_state, searching=True, inconsistent=True)
    method = stub(_isolation=isolation, _settings=stub(), _events=lambda _: (), _warnings=('another',))
    window: Any = Batch(np.zeros((3, 6)))
    found = METHOD._no_solution(method, run, replace(WAITING, momentum=np.zeros(6)), window, joints_moved=True)
    assert found.contradicted is (gain > _STRONG)
    assert bool(found.likely_causes) is found.contradicted
    if found.contradicted:
        assert found.status == 'not_identifiable'
        assert found.warnings == (UNSOLVED.text, WITHHELD, 'another')


@pytest.mark.parametrize(
    ('plane', 'before', 'left_out', 'expected'),
    [
        ((None, True), None, '', ((), 'target')),
        ((True, False), None, '', ((), 'target')),
        ((True, True), None, '', None),
        ((False, False), None, '', None),
        ((None, True), True, '', (('root', 'bias'), 'target')),
        ((None, False), True, 'frame', ((), None)),
        ((None, False), False, '', (('root', 'bias'), 'target')),
        ((None, True), None, 'frame', ((), None)),
    ],
)
def test_a_run_begins_anew_where_a_motion_leaves_its_plane(
    plane: tuple[bool | None, bool], before: bool | None, left_out: str, expected: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With what a run before it knew, if that was planar or spatial as this one, and with a target that was tracked."""
    monkeypatch.setattr(module, 'layout_of', lambda *_: stub(point=lambda state: state))
    monkeypatch.setattr(module, 'variables', lambda *_: FilterVariables())
    monkeypatch.setattr(module, 'CaptureRows', lambda tracked, *_: tracked)
    earlier, now = plane
    offers = Calls()
    new = stub(offer=offers)
    old = None if earlier is None else stub(planar=earlier)
    continued = None if before is None else stub(planar=before, root='root', bias='bias')
    method = stub(
        run=old,
        _plane=stub(planar=now),
        _variables=FilterVariables(),
        _kernel=None,
        _settings=stub(before=continued, tracked='target', declared=None),
        _left_out=left_out,
        _averaging=stub(origin=None),
        _isolation=stub(change=None, wrong_twist=''),
        _new_run=lambda windows: new if windows == [] else None,
    )
    found: Any = METHOD._current_run(method)
    assert found is method.run
    assert found is (old if expected is None else new)
    assert (method._variables.continued, method._variables.tracked) == (expected or ((), None))
    assert [made().tolist() for (made,) in offers.made] == ([[2.0, 12.0]] if expected and expected[0] else [])


def solved(verdict: Verdict, hypothesis: Hypothesis, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return the solution of a run with this hypothesis, and how its nonlinearities were asked for."""
    monkeypatch.setattr(module, 'implausible_springs', lambda *given: ('springs', given[-1]))
    rows = BODY.stop
    inner = generic(1, rows, rows)
    distribution = stub(
        mean=np.zeros(rows),
        published=lambda _scales, _layout, numbers: (np.arange(len(numbers)), generic(0, len(numbers), 8)),
        variables=stub(covariance_outside=inner),
    )
    run = stub(
        best=stub(gaussian=stub(nis=5.0, measured=7), hypothesis=hypothesis),
        nonlinearities=lambda consistent: consistent,
        resolved='resolved',
    )
    method = stub(
        _layout='layout',
        _averaging=stub(origin='origin'),
        _plane=stub(plane=lambda target: f'plane of {target}'),
        _kernel=stub(target='link'),
        _warnings=('left out',),
        _soft=('soft',),
    )
    scales: Any = stub(significant=(('link', 3.0),))
    return METHOD._solved(method, run, distribution, scales, verdict, ('spring',) if verdict.adequate else ())


@pytest.mark.parametrize('adequate', [True, False])
@pytest.mark.parametrize(
    ('force', 'physical', 'acts'), [('inertial', True, True), ('none', True, False), ('inertial', False, False)]
)
def test_a_solution_has_its_covariance_and_its_reasons(
    adequate: bool, force: Any, physical: bool, acts: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    hypothesis = Hypothesis('a force', force=force, physical=physical)
    found = solved(Verdict(adequate, ('a reason',), (), 1.7), hypothesis, monkeypatch)
    factor = generic(0, 16, 8)
    inner = generic(1, BODY.stop, BODY.stop)[np.ix_(module._REPORTED, module._REPORTED)]
    assert found.covariance == pytest.approx(1.7 * (factor @ factor.T + inner))
    assert found.covariance_for_identifiability is found.covariance
    assert (found.cost, found.redundancy, found.origin, found.plane) == (5.0, 7, 'origin', 'plane of link')
    assert found.nonlinearities is adequate
    texts = [(each.text, each.severity) for each in found.reasons if hasattr(each, 'text')]
    assert texts[0] == ('left out', 'note')
    assert any('3.0 times as far off' in text for text, _ in texts) is adequate
    assert any('it is estimated as well' in text for text, _ in texts) is acts
    assert texts[-2:] == [('soft', 'note'), ('a reason', 'contradiction')]
    assert (found.reasons[-2:] == ('springs', 'resolved')) is adequate  # of the springs, where there are any


def test_an_estimate_to_start_from_and_a_restart_reach_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, '_point_of', lambda *given: given)
    offer, restart = Calls(), Calls()
    averaging = stub(origin='origin')
    for run in (None, stub(offer=offer, restart=restart)):
        method = stub(run=run, _layout='layout', _averaging=averaging)
        METHOD.offer(method, WAITING)
        METHOD.restart(method)
    ((point,),) = offer.made
    assert point() == (WAITING, 'layout', 'origin')
    assert restart.made == [()]


def solution(now: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> tuple[Any, Any, Verdict]:
    """Return the method, its estimate and the verdict that it was reported with."""
    contradicting, seen, rows = now.get('contradicting', ()), [], []

    def error(mean: Any, _factor: Any) -> str:
        rows.append(mean)
        if now.get('singular'):
            raise np.linalg.LinAlgError
        return str(now.get('error', ''))

    def report(_solution: Any, history: Estimate) -> Estimate:
        known = np.full(10, now.get('known', True))
        return replace(history, identifiable=known, momentum=np.arange(6.0), momentum_covariance=np.ones((6, 6)))

    verdict = Verdict(now.get('adequate', True), (), now.get('causes', ()), 1.0)
    monkeypatch.setattr(module, 'CaptureRows', lambda *_: stub(pose_error=error))
    monkeypatch.setattr(module, 'judge', lambda _: verdict)
    monkeypatch.setattr(module, 'contradicting_unknowns', lambda *_: contradicting)
    monkeypatch.setattr(module, 'error_budget', lambda *_: 'budget')
    run = stub(
        distribution=lambda: stub(mean='mean', factor='factor'),
        misfit_of_target=lambda _: (3.0, 2),
        prior_scales=lambda _: 'scales',
    )
    method = stub(
        _layout=None,
        _settings=stub(tracked=now.get('tracked', 'target'), declared=None, located=now.get('located', True)),
        _left_out=now.get('left_out', ANY_CAUSE),
        _moved=now.get('moved', module._NAMED_BY - 1),
        _averaging=stub(origin=None),
        _evidence=lambda *_: None,
        _with_causes=lambda _, verdict: verdict,
        _isolation=stub(contradicting=now.get('gain', 0.0)),
        _history=lambda _run, now, _distribution, verdict: replace(now, causes=verdict.causes, flexible=()),
        _solved=lambda *given: seen.append(given[3]),
        _reporting=stub(estimate=report),
        _momentum_change=lambda *_: np.full(6, 2.0),
    )
    window: Any = Batch(np.zeros((4, 6)))
    found = METHOD._solution(method, run, WAITING, window)
    assert found.target_misfit == (3.0, 2)
    assert np.array_equal(found.impulse, np.full(6, 2.0))
    method.asked = len(rows)
    return method, found, seen[0]


@pytest.mark.parametrize(
    ('now', 'left_out', 'asked'),
    [
        ({'error': 'scale'}, 'scale', 1),
        ({'error': ''}, ANY_CAUSE, 1),
        ({'error': 'scale', 'singular': True}, ANY_CAUSE, 1),
        ({'error': 'scale', 'tracked': None}, ANY_CAUSE, 0),
        ({'error': 'scale', 'left_out': 'frame'}, 'frame', 0),
        ({'error': 'scale', 'left_out': ''}, '', 0),
        ({'error': 'scale', 'moved': module._NAMED_BY}, ANY_CAUSE, 0),
    ],
)
def test_a_cause_is_sought_for_a_while_why_a_target_s_motion_is_left_out(
    now: dict[str, Any], left_out: str, asked: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    method, _, _ = solution(now, monkeypatch)
    assert (method._left_out, method.asked) == (left_out, asked)


@pytest.mark.parametrize(
    ('now', 'adequate', 'causes'),
    [
        ({}, True, ()),
        ({'adequate': False, 'causes': (CAUSE,)}, False, (CAUSE,)),
        ({'contradicting': (OTHER,)}, False, (OTHER,)),
        ({'contradicting': (OTHER,), 'causes': (CAUSE,)}, False, (CAUSE,)),  # a search does not see the other
        ({'contradicting': (OTHER,), 'causes': (CAUSE,), 'gain': 5.0}, False, (CAUSE, OTHER)),
    ],
)
def test_an_unknown_that_contradicts_its_declaration_makes_a_solution_inadequate(
    now: dict[str, Any], adequate: bool, causes: tuple[Cause, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, found, verdict = solution(now, monkeypatch)
    assert (verdict.adequate, verdict.causes, found.causes) == (adequate, causes, causes)
    assert verdict.reasons == tuple(cause.text for cause in causes[-1:] if 'contradicting' in now)


@pytest.mark.parametrize(('known', 'located'), [(True, True), (False, True), (True, False)])
def test_without_a_place_of_the_base_there_is_no_linear_momentum(
    known: bool, located: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And without any number no budget of errors."""
    _, found, _ = solution({'known': known, 'located': located}, monkeypatch)
    assert found.budget == ('budget' if known else None)
    assert np.isnan(found.momentum).tolist() == [not located] * 3 + [False] * 3
    expected = np.full((6, 6), not located)
    expected[3:, 3:] = False
    assert np.array_equal(np.isnan(found.momentum_covariance), expected)


@pytest.mark.parametrize(
    ('force', 'physical', 'first', 'distances', 'gain', 'hypothesis'),
    [
        ('none', True, 'none', 'now', 4.0, ''),
        ('inertial', True, 'none', 'now', 6.0, 'a force'),
        ('inertial', False, 'none', 'first', 6.0, 'a force'),
        ('inertial', True, 'inertial', 'now', 0.0, 'a force'),
    ],
)
def test_the_evidence_of_a_run(
    force: Any, physical: bool, first: Any, distances: str, gain: float, hypothesis: str
) -> None:
    """Deviations beyond the declared ones are looked for without the force, which would absorb them."""
    scales = stub(distances={'link': Distance(1.0, 2.0, 3)}, likeliest=('link', 4.0))
    of_first = stub(distances={'zero': Distance(4.0, 5.0, 6)}, likeliest=('zero', 6.0))
    gaussian = stub(nis=30.0, measured=20, innovations='innovations')
    run: Any = stub(
        best=stub(gaussian=gaussian, hypothesis=Hypothesis('a force', force=force, physical=physical), jumps=(1, 2)),
        prior_scales=lambda distribution: of_first if distribution == 'of first' else None,
        distribution_of_first=lambda: 'of first',
        unconfirmed_jumps=(),
        log_likelihood_ratio=8.0,
    )
    method = stub(
        _settings=stub(hypotheses=(Hypothesis('a force', force=first),)),
        _isolation=stub(open_jumps=lambda _: (2.0,)),
        _repairs=lambda _, beside: {'repairs': beside},
        _layout=stub(sensors=(stub(name='wheels', noise={'noise': 1.0}),)),
    )
    found = METHOD._evidence(method, run, scales)
    beside = scales if distances == 'now' else of_first
    assert found.distances == {kind_in_words(name): value for name, value in beside.distances.items()}
    assert found.repairs == {'repairs': beside}
    assert found.instead == (kind_in_words({4.0: 'link', 6.0: 'zero'}[gain]) if gain else '', gain)
    assert (found.nis, found.jumps, found.unconfirmed, found.gain) == (1.5, 2, (2.0,), 8.0)
    assert (found.hypothesis, found.physical, found.noises) == (hypothesis, physical, {'wheels': {'noise': 1.0}})
    gaussian.nis, gaussian.measured, run.unconfirmed_jumps = 3.0, 0, (1.0,)
    found = METHOD._evidence(method, run, scales)
    assert (found.nis, found.unconfirmed) == (3.0, (1.0,))


def test_repairs_of_what_is_further_off_than_declared(monkeypatch: pytest.MonkeyPatch) -> None:
    def repair(_distribution: Any, _layout: Any, cause: str, wider: float) -> str | None:
        return f'{cause} {wider:g}' if cause == 'link' else None

    monkeypatch.setattr(module, 'estimated_repair', repair)
    monkeypatch.setattr(module, 'is_suspect', lambda distance: distance > 5.0)
    monkeypatch.setattr(module, 'kind_in_words', lambda cause: f'the {cause}')
    run, method = stub(distribution=lambda: None), stub(_layout=None)
    far: Any = stub(distances={'link': 6.0, 'zero': 7.0, 'mount': 5.0})
    assert METHOD._repairs(method, run, far) == {'the link': 'link 30'}
    assert METHOD._repairs(method, run, stub(distances={'link': 5.0})) == {}


@pytest.mark.parametrize(('columns', 'expected'), [(0, 'thrust'), (2, 'orbit')])
def test_the_momentum_changes_by_thrust_and_by_an_orbit_s_gravity(
    columns: int, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, 'momentum_change', lambda _, body: body)
    state = generic(0, 20)
    point = stub(nominal=stub(kernel=stub(body_parameters=lambda body: body)))
    window: Any = Batch(generic(1, 4, 6))
    window.gravity_columns = np.zeros((6, columns))
    found = METHOD._momentum_change(stub(_layout=stub(point=lambda _: point)), window, state)
    assert np.array_equal(found, window.impulse[-1] if expected == 'thrust' else state[BODY])


@pytest.mark.parametrize(
    ('run', 'last', 'settled', 'located', 'there'),
    [
        (True, True, True, True, True),
        (False, True, True, True, False),
        (True, False, True, True, False),
        (True, True, False, True, False),
        (True, True, True, False, False),
    ],
)
def test_a_posterior_needs_a_settled_run_that_is_located(
    run: bool, last: bool, settled: bool, located: bool, there: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, 'posterior', lambda *given: given[-1])
    monkeypatch.setattr(module, 'End', stub(from_window=lambda *given: given))
    ran = stub(distribution=lambda: stub(mean=None), prior_scales=lambda _: None, best=stub(hypothesis=None))
    method = stub(
        run=ran if run else None,
        _last='window' if last else None,
        settled=settled,
        _settings=stub(located=located, noise='noise', window=0.5),
        _momentum_change=lambda *_: 'change',
        _averaging=stub(origin='origin'),
        _layout=None,
    )
    found: Any = METHOD.posterior(method)
    assert found == (('window', 'noise', 0.5, 'origin', 'change') if there else None)


def test_the_joints_delay_is_unknown_where_it_is_not_estimated(monkeypatch: pytest.MonkeyPatch) -> None:
    either: Any = None
    estimated: list[Any] = []
    monkeypatch.setattr(module, 'estimates', lambda *_: iter(estimated))
    assert np.isnan(joint_delay(either, either)).all()
    estimated.append(('delay', np.array([0.02]), np.array([0.003])))
    assert joint_delay(either, either) == (0.02, 0.003)


@pytest.mark.parametrize(
    ('change', 'twist', 'changed'), [(None, '', False), ('a change', '', True), (None, 'the twist is wrong', True)]
)
def test_a_run_has_changed_with_its_target_or_without_its_twist(change: Any, twist: str, *, changed: bool) -> None:
    assert METHOD.changed.fget(stub(_change=change, _wrong_twist=twist)) is changed


@pytest.mark.parametrize('twist', ['', 'the twist is wrong'])
def test_windows_that_come_are_expected_without_a_wrong_twist(twist: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, 'without_twist', lambda window: f'{window} without')
    expect = Calls()
    method = stub(_wrong_twist=twist, run=None)
    method._usable_part = lambda window: METHOD._usable_part(method, window)
    METHOD._expect(method, ['one', 'two'])  # there is no run yet
    method.run = stub(expect=expect)
    METHOD._expect(method, ['three', 'four'])
    end = ' without' if twist else ''
    assert expect.made == [([f'three{end}', f'four{end}'],)]
    assert method._coming == ['three', 'four']


def test_a_new_run_is_led_through_the_windows_since_its_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is added when the work on those before it is done; then it expects those that come."""
    order = list[Any]()

    class Noting:
        def __init__(self, *given: Any) -> None:
            self.given = given

        def expect(self, windows: list[str]) -> None:
            order.append(('expect', *windows))

        def add(self, window: str, later: Any, *, joints_moved: bool) -> None:
            order.append(('add', window, later, joints_moved))

    monkeypatch.setattr(module, 'Run', Noting)
    monkeypatch.setattr(module, 'CandidateCauses', lambda *given: ('candidates', *given))
    monkeypatch.setattr(module, 'FaultIsolation', lambda *given: ('isolation', *given))
    settings = stub(
        hypotheses='bank', declared='declared', suspects='suspects', conventions='conventions', noise='noise', kept=7
    )
    tasks = stub(finish_due=lambda: order.append('done'))
    method = stub(_settings=settings, _layout='layout', _plane='plane', _variables='variables', tasks=tasks)
    method._coming, method._usable_part = ['later'], lambda window: f'part of {window}'
    run = METHOD._new_run(method, ['one', 'two'])
    assert run.given == ('layout', 'variables', 'bank', 7, tasks)
    parts = ('layout', 'plane', 'declared', 'bank', 'suspects', 'conventions')
    assert method._isolation == ('isolation', ('candidates', *parts), 'noise', tasks)
    assert order == [
        ('expect', 'one', 'two'),
        *(('add', 'one', None, True), 'done', ('add', 'two', None, True), 'done'),
        ('expect', 'part of later'),
    ]


@pytest.mark.parametrize('exchanged', [False, True])
@pytest.mark.parametrize(('known', 'state'), [(True, True), (False, True), (False, False)])
def test_a_run_after_a_change_of_the_target_knows_the_robot_and_the_jumps_before(
    known: bool, state: bool, exchanged: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Windows begin to count two later: the target may change for as long."""
    slack = module._SETTLING * 2.0
    asked = list[Any]()
    events = [stub(time=time) for time in (3.0, 10.0 - slack - 1e-3, 10.0 - slack, 10.0)]

    def moments(gaussian: str, variables: str) -> Any:
        return stub(of=(gaussian, variables), mean=np.arange(30.0), factor=np.eye(30))

    def another(gaussian: str, variables: str, *, exchanged: bool) -> Any:
        asked.append((gaussian, variables, exchanged))
        return stub(root='root')

    monkeypatch.setattr(module, 'MeanAndCovariance', stub(from_gaussian=moments))
    monkeypatch.setattr(module, 'jumps', lambda best, *_: [*events] if best == 'best' else [])
    monkeypatch.setattr(module, 'another_body', another)
    monkeypatch.setattr(module, 'replace', lambda what, **new: (what, new))
    before, continued = Calls(), Calls()

    def gaussian_before(*given: Any) -> str | None:
        before(*given)
        return 'before' if known else None

    def for_new_target(root: str, mean: Any, *, exchanged: bool) -> str:
        continued(root, mean[-1], exchanged)
        return 'new variables'

    run = stub(
        gaussian_before=gaussian_before,
        best='best',
        has_state=state,
        distribution=lambda: 'distribution',
    )
    space = stub(for_new_target=for_new_target)
    method = stub(
        _settings=stub(window=2.0),
        _isolation=stub(windows_since=lambda time: [time]),
        _variables=space,
        _averaging=stub(origin=None),
        _layout='layout',
        _events=lambda now: [stub(time=-1.0, now=now)],
        _new_run=lambda windows: ('run', windows),
    )
    assert METHOD._run_after(method, run, stub(time=10.0, exchanged=exchanged)) == ('run', [10.0 + slack])
    assert before.made == [(10.0, slack)]
    first, *jumped = method._earlier
    assert (first.now is not None) == known
    assert jumped == (events[:2] if state else [])
    assert (method._change.time, method._change.exchanged) == (10.0, exchanged)
    if not known:
        assert (asked, continued.made, method._layout, method._variables) == ([], [], 'layout', space)
        return
    assert (asked, continued.made) == ([('before', space, exchanged)], [('root', 29.0, exchanged)])
    (layout, new) = method._layout
    assert (layout, method._variables) == ('layout', 'new variables')
    assert new['known'].mean.tolist() == np.arange(30.0)[BODY.stop :].tolist()
    assert np.array_equal(new['known'].factor, np.eye(30)[BODY.stop :])
