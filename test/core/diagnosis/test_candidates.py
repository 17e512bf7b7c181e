"""The rules by which candidate causes are tried, ordered and accepted, without a simulation."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, TypeVar

import numpy as np
import pytest

from checked import returned, some
from mbaid_ros.core.contracts import UNDISTURBED, Hypothesis
from mbaid_ros.core.diagnosis import isolation
from mbaid_ros.core.diagnosis.isolation import (
    Candidate,
    CandidateCause,
    CandidateCauses,
    FaultIsolation,
    IsolationResult,
    _text_of,
)
from mbaid_ros.core.forces import DisturbanceModel
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.repair import Repair, widened
from mbaid_ros.core.results.innovations import BASE_SENSORS, Innovations
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.state import Declared, Layout
from mbaid_ros.core.windows import AFTER, BEFORE, Window
from mbaid_ros.session.catalogue import conventions, suspects
from observed import MID, kernel
from windowed import joint_window

Outcome = TypeVar('Outcome')
KERNEL = kernel('table1')
JOINTS = KERNEL.model.joints
NIS = 1000  # innovations squared, of as many numbers, that a pass leaves which explains all


def finished(value: Outcome) -> Generator[int, None, Outcome]:
    """Return a computation that ends with a value."""
    yield 1
    return value


def impossible(*_: object) -> Generator[int, None, Any]:
    """Return a computation that finds its robot impossible."""
    yield 1
    raise np.linalg.LinAlgError


def passed(likelihood: float, *, explains: bool = True, jumps: Sequence[float] = ()) -> Any:
    """Return a hypothesis after a pass."""
    nis = NIS if explains else 2 * NIS
    gaussian = SimpleNamespace(
        log_likelihood=likelihood,
        nis=nis,
        measured=NIS,
        misfit=0.5 * (nis - NIS),
        innovations=Innovations.none(('base_position',) * 6),
    )
    return SimpleNamespace(gaussian=gaussian, jumps=[SimpleNamespace(time=time) for time in jumps])


def windows(count: int, moving: Sequence[int] = range(JOINTS)) -> list[Window]:
    """Return windows, half a second each, in which some joints move."""
    way = np.zeros((BEFORE + 10 + AFTER, JOINTS))
    way[:, list(moving)] = np.linspace(0.1, 0.2, len(way))[:, None]
    return [joint_window(way, 0.5 * place) for place in range(count)]


def causes(kind: type[CandidateCauses] = CandidateCauses, *hypotheses: Hypothesis) -> Any:
    """Return the candidates of a planar arm."""
    layout = Layout.from_unknowns(KERNEL, ())
    return kind(
        layout,
        PlaneDetector(KERNEL.model),
        Declared(),
        (UNDISTURBED, *hypotheses),
        suspects(KERNEL),
        conventions(None),
    )


def fit(text: str, misfit: float, *, exists: bool = True, delay: float = 0.0, left: float = 0.8, every: int = 1) -> Any:
    """Return a fit under a convention that keeps one in so many windows."""
    convention = SimpleNamespace(
        text=text,
        delay=delay,
        misfit_left=left,
        kernel=KERNEL,
        windows=lambda given: given[::every],
        repair=None,
        rest=(),
    )
    return SimpleNamespace(convention=convention, misfit=misfit, exists=exists, point=lambda layout: (text, layout))


def test_the_conventions_that_fit_best_are_tried() -> None:
    fits = [
        fit('declared', 1.0),
        fit('hardly better', 0.85),
        fit('late', 0.3, delay=0.05, every=2),
        fit('later', 0.2, delay=0.1, every=2),
        fit('no body', 0.01, exists=False),
        fit('turned', 0.3, left=0.2),
        fit('degrees', 0.1),
        fit('swapped', 0.5),
        fit('sign', 0.6),
        fit('scale', 0.7),
        fit('tensors', 1.01, left=np.inf),
        fit('no tensors', 0.9, exists=False, left=np.inf),
    ]
    tried = ['degrees', 'later', 'swapped', 'sign', 'tensors']  # the last beside the four
    found = list(causes()._conventions(windows(10), fits))
    assert [each.text for each in found] == tried
    assert [each.part for each in found] == [1.0, 0.5, 1.0, 1.0, 1.0]
    assert [len(each.windows) for each in found] == [10, 5, 10, 10, 10]
    assert [each.point[0] for each in found] == tried
    assert [each.whole for each in found] == [False] * 4 + [True]
    few = [fit('declared', 1.0), fit('swapped', 0.75), fit('degrees', 0.5)]  # by a part of the declared one's misfit
    assert [each.text for each in causes()._conventions(windows(10), few)] == ['degrees', 'swapped']


@pytest.mark.parametrize(
    ('whole', 'explained', 'gains'), [(True, True, [470.0]), (True, False, []), (False, False, [470.0])]
)
def test_a_small_change_that_leaves_something_unexplained_is_no_cause(
    whole: bool, explained: bool, gains: list[float]
) -> None:
    passes: Any = SimpleNamespace(
        refined=lambda *_: finished(passed(-30.0, explains=explained)), contradicting=lambda _: 0.0
    )
    point: Any = 'a point'
    candidate = Candidate('the tensors', passes, windows(10), point, whole=whole)
    found = returned(causes()._scored(candidate, passed(-500.0).gaussian, 0.0))
    assert [each.gain for each in found] == gains


def test_a_wrong_twist_and_joints_that_stand_still_are_left_out() -> None:
    made = windows(12)
    for place in (4, 5):
        made[place] = windows(12, moving=range(1, JOINTS))[place]
    assert [each.text for each in causes()._left_out(windows(6), '')] == []
    twist, still = causes()._left_out(made, 'the twist is wrong')
    assert (twist.text, twist.of_twist, len(twist.windows)) == ('the twist is wrong', True, 12)
    assert all(np.isnan(each.knots.base_twist).all() for each in twist.windows)
    assert still.text == 'the reading of joint1 repeats from 2.0 to 3.0 s: check its encoder or driver'
    # With their neighbours, which may have a part of it; nothing links the window after them to that before.
    assert [each.start for each in still.windows] == [0.0, 0.5, 1.0, *np.arange(3.5, 6.0, 0.5)]
    assert [each.after_gap for each in still.windows] == [False] * 3 + [True] + [False] * 4
    assert still.point is None
    assert [(each.repair.cause, each.repair.since) for each in (twist, still)] == [
        ('the twist is wrong', None),
        ('the reading of joint1 repeats from 2.0 to 3.0 s', 1.5),
    ]


def test_the_point_that_explains_most_is_the_base() -> None:
    likelihoods = {'first': -50.0, 'second': -30.0, 'third': -40.0}

    def linearised(_: object, point: str) -> Generator[int, None, str]:
        return finished(point) if point in likelihoods else impossible()

    wide: Any = SimpleNamespace(
        linearised=linearised, filtered=lambda point, _: finished(passed(likelihoods[point])), hypotheses=()
    )
    point, whole, gaussian = returned(causes()._base(wide, [], ['none', 'first', 'second', 'third']))
    assert (point, whole, gaussian.log_likelihood) == ('second', 'second', -30.0)
    with pytest.raises(np.linalg.LinAlgError):
        returned(causes()._base(wide, [], ['none']))


class Swinging(CandidateCauses):
    """Passes in which one joint is noisier."""

    likelihoods: dict[tuple[int, float], float]
    explained = True

    def extended(self, *_: object) -> Any:
        """Return passes whose likelihood is looked up by the noisier joint."""

        def once(noisier: Sequence[Window], *_: object) -> Generator[int, None, Any]:
            times = np.atleast_1d(noisier[0].noise.joint_position) / windows(1)[0].noise.joint_position
            joint = int(np.argmax(times))
            likelihood = self.likelihoods.get((joint, round(float(times[joint]))), -300.0)
            return finished(passed(likelihood, explains=self.explained))

        return SimpleNamespace(filtered_once=once)


@pytest.mark.parametrize(
    ('likelihoods', 'explained', 'found'),
    [
        ({(1, 30): -100.0, (1, 10): -90.0, (1, 100): -95.0, (2, 30): -110.0, (2, 10): -10.0}, True, (1, 10.0, 110.0)),
        ({(1, 30): -100.0, (1, 10): -190.0}, True, (1, 30.0, 100.0)),
        ({(1, 30): -210.0, (1, 10): -90.0}, True, (1, 30.0, -10.0)),  # no better: the others are not tried
        ({(1, 30): -100.0}, False, None),
    ],
)
def test_the_likeliest_joint_to_swing_is_tried_with_other_sizes(
    likelihoods: dict[tuple[int, float], float], explained: bool, found: tuple[int, float, float] | None
) -> None:
    made = causes(type('Made', (Swinging,), {'likelihoods': likelihoods, 'explained': explained}))
    result = returned(made._swinging(windows(6), 'a point', passed(-200.0, explains=False).gaussian))
    if found is None:
        assert result == []
        return
    joint, times, gain = found
    (cause,) = result
    assert cause.text.startswith(f'joint{joint + 1} is flexible or has play')
    assert f'about {times * 1e-4 / np.sqrt(100) * 1e3:.1g} mrad' in cause.text
    assert (cause.gain, cause.physical) == (gain, False)


class Target(CandidateCauses):
    """Passes in which the target changes."""

    asked: list[tuple[int, bool]]
    explained: bool

    def extended(self, *_: object) -> Any:
        """Return passes that note where the target changes."""

        def changes(
            _: object, place: int, __: object, hypothesis: Hypothesis, *, exchanged: bool
        ) -> Generator[int, None, Any]:
            assert hypothesis is UNDISTURBED
            self.asked.append((place, exchanged))
            return finished(passed(-100.0 - place - 5.0 * exchanged, explains=self.explained))

        return SimpleNamespace(target_changes=changes)


class Pushed(CandidateCauses):
    """Passes under forces and torques that vary."""

    likelihoods: dict[tuple[str, float, float], float]

    def extended(self, *processes: Any) -> Any:
        """Return the passes: likelihoods are by kind, level and time."""
        both = {type(each).__name__[8:].lower(): each.model for each in processes}
        kind = 'both' if len(both) == 2 else next(iter(both))
        model, mass = next(iter(both.values())), float(np.sum(KERNEL.known[:, 0]))
        value = self.likelihoods.get((kind, round(model.deviation / mass, 7), model.time), -1000.0)
        return SimpleNamespace(filtered_once=lambda *_: finished(passed(value)))


@pytest.mark.parametrize(
    ('likelihoods', 'found'),
    [
        ({('both', 1e-4, 10.0): 500.0}, (1e-4, 1e-4, 10.0)),
        # A rougher one that lacks a tenth of the gain of 1000, and not more, is taken.
        ({('both', 1e-4, 100.0): 500.0, ('both', 1e-3, 1.0): 401.0}, (1e-3, 1e-3, 1.0)),
        ({('both', 1e-4, 100.0): 500.0, ('both', 1e-3, 1.0): 399.0}, (1e-4, 1e-4, 100.0)),
        # Of one time, the largest level that is as likely.
        ({('both', 1e-4, 1.0): 500.0, ('both', 1e-3, 1.0): 491.0}, (1e-3, 1e-3, 1.0)),
        ({('both', 1e-4, 1.0): 500.0, ('both', 1e-3, 1.0): 489.0}, (1e-4, 1e-4, 1.0)),
        # A torque alone, where that is likelier; a level in between.
        ({('both', 1e-4, 1.0): 500.0, ('torque', 1e-4, 1.0): 520.0}, (1e-4, 0.0, 1.0)),
        ({('both', 1e-4, 1.0): 500.0, ('both', 3e-4, 1.0): 520.0}, (3e-4, 3e-4, 1.0)),
        # Of a small gain, a difference of ten counts.
        ({('both', 1e-5, 100.0): -450.0, ('both', 1e-5, 1.0): -459.0}, (1e-5, 1e-5, 1.0)),
        ({('both', 1e-5, 100.0): -450.0, ('both', 1e-5, 1.0): -461.0}, (1e-5, 1e-5, 100.0)),
    ],
)
def test_a_varying_force_has_the_roughest_process_that_is_likely(
    likelihoods: dict[tuple[str, float, float], float], found: tuple[float, float, float]
) -> None:
    made: Any = causes(type('Made', (Pushed,), {'likelihoods': likelihoods}))
    torque, force = returned(made._process([], None, -500.0))
    mass = float(np.sum(KERNEL.known[:, 0]))
    assert (torque.deviation, force.deviation) == tuple(widened(level * mass) for level in found[:2])
    assert torque.time == force.time == found[2]


def test_a_force_under_which_no_robot_can_be_is_none() -> None:
    made: Any = causes(type('Made', (Pushed,), {'extended': lambda *_: SimpleNamespace(filtered_once=impossible)}))
    assert returned(made._process([], None, -500.0)) is None


@pytest.mark.parametrize(
    ('gains', 'best', 'leading', 'named'),
    [
        ({'a drift': 60.0, 'a force': 40.0, 'a swing: there': 60.0}, 100.0, '', ['a drift', 'a swing: there']),
        ({'a drift': 50.0}, 100.0, '', []),  # of half of the best gain
        ({'a drift': 9.0}, 10.1, '', []),
        ({'a drift': 9.0}, 10.0, '', ['a drift']),  # where nothing is worth anything a drift may lead later
        ({'a drift': 9.0}, 100.0, 'a drift', ['a drift']),
        ({'a shove': 90.0, 'a link': 99.0}, 100.0, '', []),  # one that a run takes into account, and no force
        ({}, 100.0, 'a force', ['a force']),
    ],
)
def test_forces_that_vary_are_sized_where_they_are_likely_or_lead(
    gains: dict[str, float], best: float, leading: str, named: list[str]
) -> None:
    force = Hypothesis('a push', 'a force', force='body')
    known = Hypothesis('known', 'a shove', force='body', repair=Repair('known'))
    walk = Hypothesis('drifting', 'a drift', momentum=1.0, physical=False)
    found = [CandidateCause(text, gain, vibrates='swing' in text) for text, gain in gains.items()]
    sizes = DisturbanceModel(2.0, 1.0), DisturbanceModel(3.0, 10.0)
    asked: list[float] = []

    def process(_: object, __: object, ___: object, base: float) -> Any:
        asked.append(base)
        return finished(sizes)

    made: Any = causes(type('Made', (CandidateCauses,), {'_process': process}), force, known, walk)
    repairs = returned(made._processes(found, [], None, best, leading, passed(-70.0).gaussian))
    assert [*repairs] == named
    assert asked == ([-70.0] if named else [])
    words = {'a drift': 'drifting', 'a swing: there': 'a swing', 'a force': 'a push'}
    assert [each.cause for each in repairs.values()] == [words[each] for each in named]


def moved(count: int) -> list[Window]:
    """Return windows of a base that moves: a body can be fitted to them."""
    return [joint_window(np.random.default_rng(place).normal(size=(30, JOINTS)), 0.5 * place) for place in range(count)]


@pytest.mark.parametrize(
    ('times', 'explained', 'asked'),
    [
        ([4.9], True, [(10, False), (10, True)]),
        ([4.4], True, []),  # the body before has to be known from ten windows
        ([4.9, 6.0], True, [(10, False), (10, True)]),  # a change that explains the data needs no later one
        ([4.9, 6.0], False, [(10, False), (10, True), (12, False), (12, True)]),
        ([4.4, 6.0], True, [(12, False), (12, True)]),
        ([7.0], True, [(14, False), (14, True)]),
        ([7.5], True, []),  # two windows after it are skipped, and four have to be left
    ],
)
def test_when_a_target_may_have_changed(times: list[float], explained: bool, asked: list[tuple[int, bool]]) -> None:
    made = causes(type('Made', (Target,), {'asked': [], 'explained': explained}), Hypothesis('force', 'a force'))
    result = returned(made._target_changes(moved(20), 'a point', times, passed(-300.0).gaussian))
    assert made.asked == asked
    assert [(each.gain, each.change is not None) for each in result] == (
        [(200.0 - asked[0][0], explained)] if asked else []
    )


class Isolating(CandidateCauses):
    """A search whose parts are given."""

    found: dict[str, float]
    force: float
    pulses: Sequence[float]
    explained: bool
    swung: list[bool]
    changed_at: list[float]

    tried_at: list[Any]

    def _fits(self, _: object) -> Any:
        return finished([fit('declared', 1.0), fit('other', 0.5)])

    def _base(self, _: object, __: object, points: Sequence[object]) -> Any:
        self.tried_at.extend(points)
        return finished((points[0], 'windows', passed(-600.0, explains=False).gaussian))

    def extended(self, *_: object) -> Any:
        """Return the passes."""

        def filtered(_: object, hypothesis: Hypothesis, longest: int = 0) -> Any:
            if longest:
                assert hypothesis is UNDISTURBED
                return finished(passed(-100.0, explains=self.explained, jumps=self.pulses))
            return finished(passed({'force': self.force - 600.0, 'walk': -120.0}[hypothesis.name]))

        return SimpleNamespace(
            filtered=filtered,
            gains=lambda *_: {},
            unpredicted=lambda _, __, hypothesis: np.zeros((int(hypothesis is not UNDISTURBED), 6)),
            contradicting=lambda _: 40.0,
        )

    def _unknowns(self, *_: object) -> Any:
        return iter(self.found)

    def _conventions(self, *_: object) -> Any:
        return iter(())

    def _left_out(self, *_: object) -> Any:
        return iter(())

    def _vibrations(self, _: object, __: object, unpredicted: Array) -> Any:
        assert not len(unpredicted)
        return iter(())

    def _scored(self, candidate: Any, _: object, contradicting: float) -> Any:
        assert contradicting == 40.0
        return finished([CandidateCause(candidate, self.found[candidate])])

    def _target_changes(self, _: object, __: object, times: Sequence[float], ___: object) -> Any:
        self.changed_at.extend(times)
        return finished([])

    def _swinging(self, *_: object) -> Any:
        self.swung.append(True)
        return finished([])


def isolated(jumps: Sequence[float] = (), point: Any = None, **given: object) -> tuple[IsolationResult, Any]:
    """Return the result of a search from a pass with a misfit of 500, and the search."""
    parts = {'found': {}, 'force': 450.0, 'pulses': (), 'explained': True, 'swung': [], 'changed_at': []} | {
        'tried_at': []
    }
    walk = Hypothesis('walk', 'a walk', physical=False)
    made = causes(type('Made', (Isolating,), parts | given), Hypothesis('force', 'a force'), walk)
    return returned(made.isolate(windows(20), point, jumps)), made


@pytest.mark.parametrize('point', [None, 'a point'])
def test_windows_are_passed_at_the_point_of_the_run_and_at_that_of_the_robot_as_declared(point: object) -> None:
    _, made = isolated(point=point)
    layouts = [each for each in made.tried_at if each != 'a point']
    assert made.tried_at == [*([point] if point else []), ('declared', made.layout)]
    assert len(layouts) == 1


def test_all_gains_of_a_search_are_over_the_same_pass_and_small_ones_are_none() -> None:
    found, _ = isolated(found={'a link': 470.0, 'a zero': 9.0, 'a mount': 11.0})
    assert found.contradicting == 40.0
    assert [(each.text, each.gain, each.physical) for each in found.causes] == [
        ('a walk', 480.0, False),
        ('a link', 470.0, True),
        ('a force', 450.0, True),
        ('a mount', 11.0, True),
    ]


@pytest.mark.parametrize(
    ('found', 'force', 'swings'),
    [
        ({}, 450.0, False),  # which leaves no more than a tenth of the misfit of 500
        ({}, 440.0, True),  # as the walk, which explains more, has no mechanism
        ({'a link': 451.0}, 440.0, False),
        ({'a link': 430.0}, 440.0, True),
    ],
)
def test_a_loose_joint_is_looked_for_only_where_much_is_left(
    found: dict[str, float], force: float, swings: bool
) -> None:
    assert bool(isolated(found=found, force=force)[1].swung) is swings


@pytest.mark.parametrize(
    ('pulses', 'explained', 'text'),
    [
        ((), True, ''),
        ((3.0,), True, 'thrust pulse or contact at 3.0 s'),
        ((3.0, 4.5), True, 'thrust pulse or contact at 3.0, 4.5 s'),
        ((3.0, 4.5, 6.0), True, ''),  # too many
        ((3.0,), False, ''),
    ],
)
def test_one_or_two_pulses_that_explain_all_are_a_cause(pulses: Sequence[float], explained: bool, text: str) -> None:
    found, _ = isolated(pulses=pulses, explained=explained)
    assert [each.text for each in found.causes if 'pulse' in each.text] == ([text] if text else [])


@pytest.mark.parametrize(
    ('jumps', 'pulses', 'times'),
    [
        ((), (), []),
        ((), (3.0, 4.0), [3.0, 4.0]),
        ((5.0,), (3.0, 4.0), [5.0]),
        ((-1.0,), (3.0,), [3.0]),  # before the windows
        ((5.0, 6.0, 7.0, 8.0), (), [5.0, 6.0, 7.0]),
    ],
)
def test_a_target_may_have_changed_at_the_first_jumps(
    jumps: Sequence[float], pulses: Sequence[float], times: list[float]
) -> None:
    assert isolated(jumps, pulses=pulses)[1].changed_at == times


@pytest.mark.parametrize(('less', 'possible'), [(1.4, True), (1.6, False)])
def test_no_link_loses_far_more_than_its_mass(less: float, possible: bool) -> None:
    mass = KERNEL.known[KERNEL.model.link('link2').body, 0]

    def value(*_: object) -> Array:
        return np.array([-less * mass, *np.zeros(9)])

    passes: Any = SimpleNamespace(value=value, layout=Layout.from_unknowns(KERNEL, ()), declared=Declared())
    filtered: Any = None
    for cause in ('link:link2', 'density:link2'):
        text = _text_of(passes, cause)(filtered)
        assert (text is not None) is possible
        assert 'link2' in (text or 'link2')


def test_a_contradicted_run_is_tried_with_errors_of_all_that_is_declared_exact() -> None:
    kinds = {label.partition(':')[0] for each in suspects(KERNEL) for label in each.causes}
    assert {'link', 'density', 'zero', 'origin', 'axis', 'mount', 'time offset', 'lag'} <= kinds
    isolation = causes()
    tried = {label for each in isolation._suspects for label in each.causes}
    declared = next(each for each in suspects(KERNEL) if 'zero:joint1' in each.causes).part('zero:joint1')
    beside = replace(isolation, layout=Layout.from_unknowns(KERNEL, (declared,)))
    assert tried - {label for each in beside._suspects for label in each.causes} == {'zero:joint1'}


class Searched(FaultIsolation):
    """Fault isolation over windows of half a second in a run that is suspicious from some window on."""

    def __init__(self, run: dict[str, Any], since: int, count: int, result: IsolationResult | None = None) -> None:
        run, self.begun = dict(run), list[tuple[int, Any]]()
        tasks: Any = SimpleNamespace(cancel=lambda _: None, begin=self.begin, require=lambda _: self._accept(result))
        candidates: Any = SimpleNamespace(isolate=self.isolate, layout=SimpleNamespace(size=7), read_joints=())
        super().__init__(candidates, MID, tasks)
        self.checked: list[int] = []
        twist: Any = SimpleNamespace(add=self.checked.append, reason=lambda: SimpleNamespace(text='the twist is wrong'))
        self._twist, quiet = twist, SimpleNamespace(physical=True, disturbed=False, cause='a cause')
        best = SimpleNamespace(hypothesis=run.pop('hypothesis', quiet), jumps=())
        self.run: Any = SimpleNamespace(
            **({'has_state': True, 'point': 'a point', 'best': best, 'unconfirmed_jumps': (), 'jump_times': ()} | run)
        )
        following: Any = self.run
        for place, window in enumerate(windows(count)):
            sample: Any = place
            self.add_window(window, sample)
            self.begin_if_due(following, suspicious=place >= since)

    def isolate(self, *given: object) -> Any:
        """Note for what a search is begun, after how many windows."""
        self.begun.append((self._seen, given))
        return finished(None)

    def begin(self, _kind: object, _work: object, _accept: object, **how: Any) -> None:
        """Note that it is for a state of so many numbers."""
        assert how['size'] == 7


@pytest.mark.parametrize(
    ('quiet', 'begun'),
    [
        (0, [24, 48, 96]),  # as often as the contradicted windows are twice as many
        (10, [24, 40, 70]),
        (40, [41, 57, 74, 108]),  # at once where there are enough before, and sixteen later at the earliest
    ],
)
def test_a_search_begins_with_enough_windows_and_again_with_twice_as_many(quiet: int, begun: list[int]) -> None:
    nothing = IsolationResult((), Innovations.none(()))
    assert [seen for seen, _ in Searched({}, quiet, 120, nothing).begun] == begun


WALK = SimpleNamespace(physical=False, disturbed=True, cause='a walk', repair=None)


@pytest.mark.parametrize(
    ('run', 'begun'),
    [
        ({}, 31),
        ({'unconfirmed_jumps': (14.9,), 'jump_times': (14.9,)}, 37),  # seven windows after it became suspicious
        ({'unconfirmed_jumps': (14.9,), 'has_state': False}, 31),
        ({'jump_times': (14.9,), 'hypothesis': WALK}, 38),  # the window from 18.5 s on: seven after the jump
        ({'jump_times': (14.4, 16.0), 'hypothesis': WALK}, 37),
        ({'jump_times': (), 'hypothesis': WALK}, 31),
        ({'jump_times': (14.9,)}, 31),
    ],
)
def test_a_search_waits_until_a_jump_may_be_seen_to_be_a_change_of_the_target(run: dict[str, Any], begun: int) -> None:
    found = Searched(run, 30, 38)
    (seen, (made, point, jumps, twist, leading)), *_ = found.begun
    known = run.get('has_state', True)
    assert (seen, len(made), jumps, twist) == (begun, begun, found.run.jump_times, 'the twist is wrong')
    assert point == ('a point' if known else None)
    assert leading == ('' if not known else 'a walk' if 'hypothesis' in run else 'a cause')
    assert found.checked == [*range(24), *range(31, 38)]  # samples, while a search may need them
    assert [each.start for each in found.windows_since(17.0)] == [17.0, 17.5, 18.0, 18.5]


@pytest.mark.parametrize(
    ('jumps', 'left', 'physical', 'open_jumps'),
    [
        ((9.4, 9.6, 15.2, 16.0), (9.4, 9.6, 15.2), True, (15.2,)),  # of a window that was suspicious, and not explained
        ((15.2, 16.0), (), True, ()),
        ((15.2, 16.0), (), False, (15.2, 16.0)),  # a walk has taken them up
    ],
)
def test_jumps_are_open_while_a_search_is_under_way(
    jumps: tuple[float, ...], left: tuple[float, ...], open_jumps: tuple[float, ...], *, physical: bool
) -> None:
    found = Searched({'jump_times': jumps}, 30, 31)
    kind = SimpleNamespace(physical=physical)
    found.run.best = SimpleNamespace(hypothesis=kind, jumps=[SimpleNamespace(time=time) for time in left])
    assert found.open_jumps(found.run) == open_jumps
    found.run.jump_times = (*jumps, 15.9)  # which it is not about
    assert found.open_jumps(found.run) == open_jumps
    for window in windows(48)[31:]:
        found._windows.append(window)
    assert found.open_jumps(found.run) == tuple(time for time in open_jumps if time > 15.5)
    found._due = None
    assert found.open_jumps(found.run) == ()


REPAIR = Repair('as it is')


def test_causes_are_those_of_the_latest_search_and_the_force_that_leads() -> None:
    """What explains anything gains no more than the least of them, over the latest windows alone."""
    causes = (CandidateCause('a link', 40.0, repair=REPAIR), CandidateCause('a zero', 20.0))
    found = Searched({'log_likelihood_ratio': 30.0}, 0, 30, IsolationResult(causes, Innovations.none(())))
    found._noise = SimpleNamespace(for_window=lambda _: SimpleNamespace(joint_position=1e-4))  # type: ignore[assignment]
    found._samples.clear()
    found._samples.append([])  # type: ignore[arg-type]
    assert (found.searched, found.contradicting, found.change, found.wrong_twist) == (True, 0.0, None, '')
    ranks: list[Any] = []
    for physical, disturbed, known in (
        (True, True, True),
        (False, True, True),
        (True, False, True),
        (True, True, False),
    ):
        kind = SimpleNamespace(cause='a force', physical=physical, disturbed=disturbed, repair=None)
        found.run.best, found.run.has_state = SimpleNamespace(hypothesis=kind), known
        ranks.append([(each.text, each.gain) for each in found.causes(found.run)])
    alone = [('a link', 40.0), ('a zero', 20.0)]
    assert ranks[0] == [alone[0], ('a force', 30.0), alone[1]]
    assert ranks[1] == [*alone, ('a force', 0.95 * 20.0)]
    assert ranks[2:] == [alone, alone]
    assert found.causes(found.run)[0].repair is REPAIR
    nothing = IsolationResult((), Innovations.none(()), {'a force': REPAIR})
    found._found, kind.disturbed, found.run.has_state = replace(nothing, causes=causes), True, True
    assert [each.repair for each in found.causes(found.run)] == [REPAIR, REPAIR, None]
    kind.disturbed = False
    for over, left in ((False, 2), (True, 0)):  # a search that finds none, before the contradiction has ended and after
        found._over = over
        found._accept(nothing)
        assert len(found.causes(found.run)) == left
    found._accept(None)
    assert found._due is None
    before = Searched({}, 0, 20)
    assert (before.searched, before.contradicting, before.causes(before.run)) == (False, np.inf, ())


class Extended(CandidateCauses):
    """Passes that say what they are extended by, and with which wider prior."""

    def extended(self, *more: Any) -> Any:
        """Return the labels of more unknowns, and the poses that count."""
        labels = sorted({label for each in more for label in each.causes})
        return SimpleNamespace(with_inflated_prior=lambda *given: (labels, given), odometry=self.layout.odometry)


def test_unknowns_are_tried_with_the_prior_that_gains_most() -> None:
    gains = {'mount': (30.0, 7.0), 'zero:joint1': (11.0, 3.0), 'zero:joint2': (9.0, 3.0), 'twist late': (12.0, 5.0)}
    found = list(causes(Extended)._unknowns(['windows'], 'here', gains))
    assert [each.repair for each in found] == ['mount', 'twist late', 'zero:joint1']
    assert [each.of_twist for each in found] == [False, True, False]
    assert [each.passes[1] for each in found] == [('mount', 7.0), ('twist late', 5.0), ('zero:joint1', 3.0)]
    assert [each.passes[0] for each in found] == [['mount'], ['twist late'], ['zero:joint1']]


def test_a_sensor_that_contradicts_the_others_is_noisier_than_declared_or_left_out() -> None:
    """Noisier where its innovations are white; what chance gains by leaving it out is taken off."""
    table: Any = {
        'imu': (4.0, 1.1, 200.0, {'imu.noise_density': 1e-4, 'imu.other': 0.0}),
        'poses.mocap': (4.0, 1.3, 50.0, {'poses.mocap.position_std': 1e-3}),
        'poses.star': (9.0, 0.1, 8.0, {'poses.star.orientation_std': 0.0}),
        'poses.fine': (0.9, 0.1, 50.0, {}),
        BASE_SENSORS[0]: (1.0, 0.0, 120.0, {}),
        BASE_SENSORS[3]: (1.0, 0.0, 80.0, {}),
    }
    ratio, correlation, count = np.array([each[:3] for each in table.values()]).T
    innovations: Any = SimpleNamespace(sensors=tuple(table), ratio=ratio, correlation=correlation, count=count)
    sensors = tuple(
        SimpleNamespace(
            name=name,
            noise=table[name][3],
            leave_out={f'{name}.use': False},
            of_pose=name.startswith('poses'),
            without=lambda window, own=name: (own, window.start),
        )
        for name in (*table, 'poses.unseen')
        if name not in BASE_SENSORS and name in table
    )
    made: Any = causes(Extended)
    for odometry, count_of in ((True, 4), (False, 3)):
        layout = replace(made.layout, sensors=sensors, odometry=odometry)
        found = list(replace(made, layout=layout)._without_sensors(windows(2), innovations))
        assert len(found) == count_of
        assert [each.less for each in found] == pytest.approx([20.0, 10.0, 4.0, 20.0][:count_of])
        assert {each.weight for each in found} == {0.95}
        parts = [some(each.repair).parameters for each in found[:3]]
        assert parts == [{'imu.noise_density': 2e-4}, {'poses.mocap.use': False}, {'poses.star.use': False}]
        assert found[1].text.startswith('poses.mocap contradicts the other sensors, with 2 times its noise: check')
        assert [each.windows for each in found[:2]] == [[(name, 0.0), (name, 0.5)] for name in ('imu', 'poses.mocap')]
    made = replace(made, layout=replace(made.layout, sensors=sensors, odometry=True))
    last = list(made._without_sensors(windows(2), innovations))[-1]
    assert (last.passes.odometry, last.repair) == (False, None)
    assert all(np.isnan(each.knots.base_twist).all() for each in last.windows)
    made = replace(made, layout=replace(made.layout, sensors=sensors[:1]))
    assert len(list(made._without_sensors(windows(2), innovations))) == 1  # a gyro alone locates nothing


@pytest.mark.parametrize(
    ('given', 'searched', 'kept'),
    [
        # A convention that leaves a twentieth of the misfit of 100 is enough: several wrong numbers are not looked for.
        ({'one': 4.9}, [], ['', 'one']),
        ({'one': 5.1}, ['clock', 'placed', 'scaled', 'mapped'], ['', 'one']),
        ({'one': 4.9, 'impossible': True}, ['clock', 'placed', 'scaled', 'mapped'], ['', 'one']),
        # As soon as a search has found one, the next ones are not begun.
        ({'one': 50.0, 'placed': 1.0}, ['clock', 'placed'], ['', 'one', 'placed']),
        ({'one': 50.0, 'clock': 6.0}, ['clock', 'placed', 'scaled', 'mapped'], ['', 'one', 'clock']),
        # One of an earlier search saves another, if the windows agree by now.
        ({'one': 50.0, 'earlier': 0.9}, [], ['', 'one', 'earlier']),
        ({'one': 50.0, 'earlier': 1.1}, ['clock', 'placed', 'scaled', 'mapped'], ['', 'one']),
    ],
)
def test_several_wrong_numbers_are_looked_for_where_one_does_not_explain_the_motion(
    given: dict[str, Any], searched: list[str], kept: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def convention(text: str) -> Any:
        return SimpleNamespace(text=text, possible=lambda _: text != 'not possible')

    def fitted(_: object, of: Any, every: int) -> Any:
        assert every == 2
        exists = not (of.text == 'one' and 'impossible' in given)
        return SimpleNamespace(convention=of, misfit=given.get(of.text, 100.0), exists=exists)

    begun: list[str] = []

    def search(name: str) -> Any:
        def run() -> Generator[int, None, list[Any]]:
            begun.append(name)
            yield 1
            return [convention(name)] if name in given else []

        return lambda *_: run()

    monkeypatch.setattr(isolation, 'fitted', fitted)
    monkeypatch.setattr(isolation, 'Convention', lambda text, _: convention(text))
    for name, function in {
        'clock': 'joints_by_another_clock',
        'placed': 'placed_bases',
        'scaled': 'scaled_positions',
        'mapped': 'mapped_joints',
    }.items():
        monkeypatch.setattr(isolation, function, search(name))
    made = replace(causes(), conventions=(lambda _: [convention('one'), convention('not possible')],))
    made.several.extend([convention('earlier')] if 'earlier' in given else [])
    found = returned(made._fits([]))
    assert begun == searched
    assert [each.convention.text for each in found] == kept
    assert [each.text for each in made.several if each.text != 'earlier'] == [
        each for each in kept[2:] if each != 'earlier'
    ]


@pytest.mark.parametrize('point', [None, 'a point'])
def test_windows_with_data_left_out_are_linearised_where_a_fit_of_them_is(
    point: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The data left out have misled the run. Their misfits count, not the likelihoods."""
    monkeypatch.setattr(isolation, 'point_as_described', lambda _, windows: f'of {len(windows)} windows')
    asked: list[object] = []

    def refined(_: object, at: object, hypothesis: Hypothesis) -> Generator[int, None, Any]:
        asked.append((at, hypothesis))
        return finished(passed(-130.0, explains=False))

    passes: Any = SimpleNamespace(refined=refined, contradicting=lambda _: 0.0)
    made: Any = causes(CandidateCauses, Hypothesis('force', 'a force'))
    base: Any = SimpleNamespace(misfit=NIS, log_likelihood=-200.0)
    (cause,) = returned(made._scored(Candidate('a thing', passes, windows(6), point), base, 0.0))
    assert asked == [(point or 'of 6 windows', UNDISTURBED)]
    assert cause.gain == (70.0 if point else 0.5 * NIS)
