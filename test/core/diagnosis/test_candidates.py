"""The rules by which candidate causes are tried, ordered and accepted, without a simulation."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, TypeVar

import numpy as np
import pytest

from mbaid_ros.core.contracts import UNDISTURBED, Hypothesis
from mbaid_ros.core.diagnosis.isolation import (
    CandidateCause,
    CandidateCauses,
    FaultIsolation,
    IsolationResult,
    _text_of,
)
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.repair import widened
from mbaid_ros.core.results.innovations import Innovations
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


def outcome(work: Generator[int, None, Outcome]) -> Outcome:
    """Return the outcome of a long computation."""
    found: list[Outcome] = []

    def kept() -> Iterator[int]:
        found.append((yield from work))

    assert all(cost > 0 for cost in kept())
    return found[0]


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
    ]
    found = list(causes()._conventions(windows(10), fits))
    assert [each.text for each in found] == ['degrees', 'later', 'swapped', 'sign']
    assert [each.part for each in found] == [1.0, 0.5, 1.0, 1.0]
    assert [len(each.windows) for each in found] == [10, 5, 10, 10]
    assert [each.point[0] for each in found] == ['degrees', 'later', 'swapped', 'sign']


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


def test_the_point_that_explains_most_is_the_base() -> None:
    likelihoods = {'first': -50.0, 'second': -30.0, 'third': -40.0}

    def linearised(_: object, point: str) -> Generator[int, None, str]:
        return finished(point) if point in likelihoods else impossible()

    wide: Any = SimpleNamespace(
        linearised=linearised, filtered=lambda point, _: finished(passed(likelihoods[point])), hypotheses=()
    )
    point, whole, gaussian = outcome(causes()._base(wide, [], ['none', 'first', 'second', 'third']))
    assert (point, whole, gaussian.log_likelihood) == ('second', 'second', -30.0)
    with pytest.raises(np.linalg.LinAlgError):
        outcome(causes()._base(wide, [], ['none']))


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
    result = outcome(made._swinging(windows(6), 'a point', passed(-200.0, explains=False).gaussian))
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

        def changes(_: object, place: int, *__: object, exchanged: bool) -> Generator[int, None, Any]:
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
    torque, force = outcome(made._process([], None, -500.0))
    mass = float(np.sum(KERNEL.known[:, 0]))
    assert (torque.deviation, force.deviation) == tuple(widened(level * mass) for level in found[:2])
    assert torque.time == force.time == found[2]


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
    made = causes(type('Made', (Target,), {'asked': [], 'explained': explained}))
    result = outcome(made._target_changes(moved(20), 'a point', times, passed(-300.0).gaussian))
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

    def _fits(self, _: object) -> Any:
        return finished([fit('declared', 1.0)])

    def _base(self, _: object, __: object, points: Sequence[object]) -> Any:
        return finished((points[0], 'windows', passed(-600.0, explains=False).gaussian))

    def extended(self, *_: object) -> Any:
        """Return the passes."""

        def filtered(_: object, hypothesis: Hypothesis, longest: int = 0) -> Any:
            if longest:
                return finished(passed(-100.0, explains=self.explained, jumps=self.pulses))
            return finished(passed({'force': self.force - 600.0, 'walk': -120.0}[hypothesis.name]))

        return SimpleNamespace(
            filtered=filtered,
            gains=lambda *_: {},
            unpredicted=lambda *_: np.zeros((0, 6)),
            contradicting=lambda _: 40.0,
        )

    def _unknowns(self, *_: object) -> Any:
        return iter(self.found)

    def _conventions(self, *_: object) -> Any:
        return iter(())

    def _left_out(self, *_: object) -> Any:
        return iter(())

    def _vibrations(self, *_: object) -> Any:
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


def isolated(jumps: Sequence[float] = (), **given: object) -> tuple[IsolationResult, Any]:
    """Return the result of a search from a pass with a misfit of 500, and the search."""
    parts = {'found': {}, 'force': 450.0, 'pulses': (), 'explained': True, 'swung': [], 'changed_at': []}
    walk = Hypothesis('walk', 'a walk', physical=False)
    made = causes(type('Made', (Isolating,), parts | given), Hypothesis('force', 'a force'), walk)
    return outcome(made.isolate(windows(20), None, jumps)), made


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


def searches_begun(suspicious: Sequence[bool]) -> list[int]:
    """Return how many windows there have been at the begin of each search of a run that is suspicious now and then."""
    begun: list[int] = []
    accepted: list[Any] = []

    def begin(_kind: object, _work: object, accept: Any, **_: object) -> None:
        begun.append(isolation._seen)
        accepted.append(accept)

    tasks: Any = SimpleNamespace(
        cancel=lambda _: None, begin=begin, require=lambda _: accepted[-1](IsolationResult((), Innovations.none(())))
    )
    isolation = FaultIsolation(causes(), MID, tasks)
    twist: Any = SimpleNamespace(add=lambda _: None, reason=lambda: None)
    run: Any = SimpleNamespace(has_state=False, jump_times=())
    sample: Any = None
    isolation._twist = twist
    for window, doubtful in zip(windows(len(suspicious)), suspicious, strict=True):
        isolation.add_window(window, sample)
        isolation.begin_if_due(run, suspicious=doubtful)
    return begun


@pytest.mark.parametrize(
    ('quiet', 'begun'),
    [
        (0, [24, 48, 96]),  # as often as the contradicted windows are twice as many
        (40, [41, 57, 74, 108]),  # at once where there are enough before, and sixteen later at the earliest
    ],
)
def test_a_search_begins_with_enough_windows_and_again_with_twice_as_many(quiet: int, begun: list[int]) -> None:
    assert searches_begun([place >= quiet for place in range(120)]) == begun
