"""Searches for a start, and how far an estimate is from its linearisation."""

from __future__ import annotations

from copy import copy
from functools import partial
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from checked import returned, some
from floating import make
from mbaid_ros.core.contracts import STACK, UNDISTURBED, in_stacks
from mbaid_ros.core.filter import gauss_newton
from mbaid_ros.core.filter.gauss_newton import HOPELESS, MASS, BatchIteration, BatchResult, MultiStart, Start
from mbaid_ros.core.filter.hypotheses import LONGEST_AT_A_GUESS, MARGIN, NO_JUMPS, HypothesisFilter
from mbaid_ros.core.filter.posterior import MeanAndCovariance
from mbaid_ros.core.filter.run import Run
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.state import BODY, BODY_PLACES, Point
from mbaid_ros.core.windows import Window
from mbaid_ros.simulation.simulation import Truth
from mbaid_ros.tasks import AT_ONCE, Kind, Tasks, Work
from observed import HIGH, kernel, observe, windows

ENOUGH = 10_000  # steps of the filter


class Young:
    """A young run of few windows, and passes over it."""

    def __init__(self, truth: Truth) -> None:
        following = make(kernel('servicer7'), HIGH)
        following.update(windows(observe(truth, HIGH, 3))[:16], 0)
        run = some(following.run)
        self.windows: list[Window] = run._windows
        self.passes: BatchIteration = run._batch
        self.point = run.point

    def passed(self, point: Point) -> tuple[HypothesisFilter, MeanAndCovariance]:
        """Return what all windows lead to, linearised at a point."""
        passed = returned(self.passes.relinearise(in_stacks(self.windows), point))
        (filtered,) = returned(self.passes.filter(passed, (self.passes.prior(UNDISTURBED),)))
        return filtered, MeanAndCovariance.from_gaussian(filtered.gaussian, self.passes.variables)

    def at(self, distribution: MeanAndCovariance) -> Point:
        """Return the point of a distribution."""
        return self.passes.layout.point(distribution.mean, distribution.deviation)

    def far(self) -> Point:
        """Return a point of twice the moments of inertia."""
        layout = self.passes.layout
        state = np.zeros(layout.size)
        state[layout.parameters] = self.point.parameters
        state[BODY.start + 4 : BODY.stop] *= 2.0
        return layout.point(state)


@pytest.fixture(scope='module')
def young(servicer: Truth) -> Young:
    return Young(servicer)


def finished(value: Any) -> Work[Any]:
    """Return work that comes to a value at once."""
    yield 1
    return value


def taken_over(run: Run, filtered: HypothesisFilter, point: Point, covariance: Array) -> None:
    """Have it go on from a search that has led to a hypothesis, with the body's covariance by then."""
    run._take_over(Start((filtered,), point, accepted=True, covariance=covariance, nonlinearity=None))


def test_it_is_the_step_of_the_next_pass(young: Young) -> None:
    filtered, distribution = young.passed(young.far())
    _, after = young.passed(young.at(distribution))
    found = returned(young.passes.newton_step(in_stacks(young.windows), filtered))
    assert found.shifts[0] == pytest.approx(after.mean[BODY] - distribution.mean[BODY], rel=1e-9, abs=1e-12)


def test_it_is_asked_once_the_body_is_better_known_and_kept_until_windows_are_linearised_anew(young: Young) -> None:
    filtered, distribution = young.passed(young.far())
    covariance = distribution.covariance(BODY_PLACES)
    layout, variables = young.passes.layout, young.passes.variables
    asked = []
    for before in (covariance, 3.0 * covariance):  # no better known than where they were linearised, or better
        tasks = Tasks()
        run = Run(layout, variables, (UNDISTURBED,), ENOUGH, tasks)
        run._windows, run._searched, run._latest = list(young.windows), len(young.windows), filtered
        taken_over(run, filtered, young.point, before)
        run._check_newton_step(filtered)
        asked.append(tasks.is_under_way(Kind.NEWTON_STEP))
    assert asked == [False, True]
    tasks.allot_steps(AT_ONCE, Kind.NEWTON_STEP)
    tasks.finish_due()
    assert run._due == len(young.windows)  # a search is due with the next window
    displaced = [run._is_displaced]
    taken_over(run, filtered, young.point, 3.0 * covariance)
    displaced.append(run._is_displaced)  # better known than where they were linearised anew: not checked yet
    taken_over(run, filtered, young.point, covariance)
    displaced.append(run._is_displaced)
    assert displaced == [True, True, False]


@pytest.mark.parametrize(('lead', 'leads'), [(0.5 * MARGIN, False), (5.0 * MARGIN, True)])
def test_another_hypothesis_leads_a_start_if_it_is_far_likelier_at_its_own_solution(lead: float, leads: bool) -> None:
    def filtered(hypothesis: str, likelihood: float) -> Any:
        gaussian = SimpleNamespace(log_likelihood=likelihood)
        return SimpleNamespace(hypothesis=hypothesis, gaussian=gaussian, misfit=-2.0 * likelihood)

    quiet, pushed = filtered('quiet', 0.0), filtered('pushed', lead)
    place: Any = SimpleNamespace(linearised_at=None, windows=None, point=None)
    result: Any = SimpleNamespace(**vars(place), filtered=quiet, mass_held=True, consistent=False)
    other: Any = SimpleNamespace(**vars(place), filtered=pushed, acceptable=True, consistent=True)
    banks = iter([(pushed,), (quiet, pushed)])
    asked: list[str] = []
    batch = SimpleNamespace(
        priors=lambda *_, **__: (),
        filter=lambda *_: finished(next(banks)),
        prior_at=lambda hypothesis, _: asked.append(hypothesis),
        converge=lambda *_: finished(other),
    )
    quiet.longest_jump = 2
    search: Any = SimpleNamespace(hypotheses=('quiet', 'pushed'), batch=batch, _is_hardly_shifted=lambda _: False)
    found = returned(MultiStart._choose_hypothesis(search, [], result))
    assert found == ((other if leads else result), (quiet, pushed), leads)
    assert asked == (['pushed'] if leads else [])


@pytest.mark.parametrize(
    ('other_leads', 'acceptable', 'rivalled', 'accepted'),
    [
        (False, True, False, True),
        (False, True, True, False),  # another solution is about as likely
        (False, False, False, False),
        (True, False, True, True),  # a disturbance that explains far more
    ],
)
def test_a_start_is_accepted_by_its_solution_and_its_rivals(
    other_leads: bool, acceptable: bool, rivalled: bool, accepted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Points are tried in order until one leads to a solution; windows that come meanwhile are only filtered."""
    known: Any = SimpleNamespace(from_gaussian=lambda *_: SimpleNamespace(covariance=lambda _: 'covariance'))
    monkeypatch.setattr(gauss_newton, 'MeanAndCovariance', known)
    monkeypatch.setattr(gauss_newton, 'leader', lambda bank: SimpleNamespace(gaussian=bank))
    monkeypatch.setattr(gauss_newton, 'stacked', list)
    points: list[Any] = [None, *(SimpleNamespace(parameters=np.full(16, mass)) for mass in (0.0, 1.0, 2.0, 3.0, 4.0))]
    rival = SimpleNamespace(consistent=False)
    result: Any = SimpleNamespace(consistent=not other_leads, acceptable=acceptable, linearised_at='there')
    result.is_rivalled_by = lambda other: rivalled and other is rival
    outcomes, windows, tried, filtered = iter([None, rival, result]), list[Any](), list[Any](), list[Any]()

    def converge(_stacks: Any, point: Any, prior: str) -> Work[Any]:
        tried.append((point.parameters[0], prior))
        windows.extend(range(len(windows), len(windows) + 4))
        return finished(next(outcomes))

    def relinearise(stacks: Any, point: str) -> Work[Any]:
        filtered.append((stacks, point))
        return finished([])

    batch = SimpleNamespace(
        prior_at='prior at {}'.format,
        converge=converge,
        relinearise=relinearise,
        filter=lambda _, bank: finished(bank),
        variables=None,
        nonlinearity=lambda *_: 'nonlinearity',
    )
    search: Any = SimpleNamespace(batch=batch, hypotheses=('quiet', 'pushed'))
    search._choose_hypothesis = lambda _, chosen: finished((chosen, 'bank', other_leads and chosen is result))
    start = returned(MultiStart.search(search, windows, [partial(copy, each) for each in points]))
    assert tried == [(mass, 'prior at quiet') for mass in (1.0, 2.0, 3.0)]
    assert start == Start('bank', 'there', accepted, 'covariance', 'nonlinearity' if accepted else None)  # type: ignore[arg-type]
    assert filtered == [([[*range(STACK)]], 'there'), ([[10, 11]], 'there')]


def test_a_search_without_a_point_takes_the_best_of_all_guesses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gauss_newton, 'MeanAndCovariance', MagicMock())
    monkeypatch.setattr(gauss_newton, 'leader', MagicMock())
    guessed: list[Any] = [MagicMock(merit=(True, merit), linearised_at=merit) for merit in (1.0, 3.0, 2.0)]
    search: Any = MagicMock(hypotheses=('quiet',), _from_guesses=lambda *_: finished(guessed))
    search._choose_hypothesis = lambda _, chosen: finished((chosen, 'bank', False))
    assert returned(MultiStart.search(search, [], [])).point == guessed[1].linearised_at
    search._from_guesses = lambda *_: finished([])
    with pytest.raises(np.linalg.LinAlgError):
        returned(MultiStart.search(search, [], []))


@pytest.mark.parametrize('found', [None, 'result'])
def test_a_target_that_is_known_beforehand_is_guessed_as_declared_at_the_first_windows(found: str | None) -> None:
    variables = SimpleNamespace(has_body_prior=True, mean=np.arange(BODY.stop, dtype=float))
    asked: list[Any] = []

    def converge(_stacks: Any, point: Any, prior: str) -> Work[Any]:
        asked.append((point, prior))
        return finished(found)

    layout = SimpleNamespace(point=lambda state: state)
    batch = SimpleNamespace(variables=variables, layout=layout, prior_at=lambda which: which, converge=converge)
    search: Any = SimpleNamespace(batch=batch, hypotheses=('quiet', 'pushed'))
    search._beginning = lambda body, windows: (body.tolist(), windows)
    stacks: Any = [[SimpleNamespace(windows=2 * part + each) for each in (0, 1)] for part in (0, 1)]
    results: list[Any] = returned(MultiStart._from_guesses(search, stacks, []))
    assert results == ([found] if found else [])
    assert asked == [((list(range(BODY.start, BODY.stop)), 0), 'quiet')]


def likely(which: str, likelihood: float) -> Any:
    """Return a filter after all windows."""
    return SimpleNamespace(hypothesis=which, gaussian=SimpleNamespace(log_likelihood=likelihood), longest_jump=2)


@pytest.mark.parametrize(
    ('consistent', 'shifted', 'other', 'far', 'leads'),
    [
        (False, True, {}, True, True),
        (True, False, {}, True, True),
        (True, True, {}, True, False),  # the gain may come from noise in the rows
        (False, True, {'acceptable': False}, True, False),
        (False, True, {'consistent': False}, True, False),
        (False, True, {}, False, False),
        (False, True, None, True, False),
    ],
)
def test_another_hypothesis_leads_where_it_is_needed_and_explains_all(
    consistent: bool,
    shifted: bool,
    other: dict[str, bool] | None,
    far: bool,
    leads: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    quiet, pushed = likely('quiet', 0.0), likely('pushed', 50.0)
    result: Any = SimpleNamespace(
        linearised_at='there',
        windows='windows',
        point='a point',
        filtered=quiet,
        mass_held=False,
        consistent=consistent,
    )
    moved: Any = None
    if other is not None:
        own = {'acceptable': True, 'consistent': True} | other
        moved = SimpleNamespace(linearised_at='elsewhere', windows='others', point='b', filtered=pushed, **own)
    asked: list[Any] = []

    def priors(hypotheses: Any, longest: int, point: str) -> Any:
        asked.append((tuple(hypotheses), longest, point))
        return tuple(hypotheses)

    batch = SimpleNamespace(
        priors=priors,
        filter=lambda _, given: finished(tuple(pushed if each == 'pushed' else quiet for each in given)),
        prior_at=lambda hypothesis, longest: (hypothesis, longest),
        converge=lambda _, point, prior: finished(moved if (point, prior) == ('a point', ('pushed', 2)) else 'wrong'),
    )
    monkeypatch.setattr(gauss_newton, 'joined', lambda bank: bank)
    monkeypatch.setattr(gauss_newton, 'far_likelier', lambda one, two: (one, two) == (pushed, quiet) and far)
    monkeypatch.setattr(gauss_newton, 'cap_likelihood', lambda bank: ('capped', *bank))
    search: Any = SimpleNamespace(hypotheses=('quiet', 'pushed'), batch=batch, _is_hardly_shifted=lambda _: not shifted)
    found, bank, others = returned(MultiStart._choose_hypothesis(search, [], result))
    assert (found, others) == ((moved, True) if leads else (result, False))
    assert bank == ((quiet, pushed) if leads else ('capped', quiet, pushed))
    expected: list[Any] = [(('pushed',), 2, 'there'), (('quiet', 'pushed'), 2, 'elsewhere')]
    assert asked == expected[: 1 + leads]


@pytest.mark.parametrize(('mass_held', 'shares'), [(False, True), (True, False)])
def test_a_first_hypothesis_shares_its_root_unless_the_mass_is_held(
    mass_held: bool, shares: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    quiet, pushed = likely('quiet', 0.0), likely('pushed', 1.0)
    batch = SimpleNamespace(priors=lambda *_, **__: (), filter=lambda *_: finished((pushed,)))
    monkeypatch.setattr(gauss_newton, 'joined', lambda bank: bank[::-1])
    monkeypatch.setattr(gauss_newton, 'leader', lambda _: quiet)
    search: Any = SimpleNamespace(hypotheses=('quiet', 'pushed'), batch=batch)
    result: Any = SimpleNamespace(linearised_at=None, windows=None, filtered=quiet, mass_held=mass_held)
    _, bank, others = returned(MultiStart._choose_hypothesis(search, [], result))
    assert bank == ((pushed, quiet) if shares else (quiet, pushed))
    assert not others
    search.hypotheses = ('quiet',)
    assert returned(MultiStart._choose_hypothesis(search, [], result))[1] == ((quiet,))


@pytest.mark.parametrize(('shift', 'hardly'), [(0.9, True), (-0.9, True), (1.1, False), (-1.1, False)])
def test_noise_in_the_rows_shifts_a_result_by_a_deviation_at_most(shift: float, hardly: bool) -> None:
    search: Any = SimpleNamespace(batch=SimpleNamespace(layout=SimpleNamespace(parameters=slice(1, 3))))
    deviation = np.array([2.0, 0.5])
    result: Any = SimpleNamespace(
        distribution=SimpleNamespace(shift=np.array([9.0, 0.0, 0.5 * shift, 9.0])), deviation=deviation
    )
    assert MultiStart._is_hardly_shifted(search, result) is hardly


def solution(name: str, merit: float, **sure: bool) -> Any:
    """Return a result whose point has its name."""
    flags = {'consistent': True, 'acceptable': True} | sure
    return SimpleNamespace(name=name, merit=merit, point=name, **flags)


class Iteration:
    """Converges from points to given results, and notes how it was asked."""

    def __init__(self, found: dict[str, Any], springs: int = 0) -> None:
        self._found, self.asked = found, list[tuple[str, Any, bool]]()
        self.layout = SimpleNamespace(kernel=SimpleNamespace(springs=SimpleNamespace(count=springs)))
        self.variables = SimpleNamespace(has_body_prior=False)

    @staticmethod
    def prior_at(hypothesis: str, longest: int, mass: float | None = None) -> Any:
        """Return the prior."""
        return hypothesis, longest, mass

    def converge(self, _: object, start: Any, prior: Any, *, mass_held: bool = False) -> Work[Any]:
        """Return what a start leads to."""
        name = start if isinstance(start, str) else start.name
        self.asked.append((name, prior, mass_held))
        return finished(self._found.get(name))


def guess(name: str, mass: float) -> Any:
    """Return a point with a mass."""
    parameters = np.zeros(10)
    parameters[MASS] = mass
    return SimpleNamespace(name=name, parameters=parameters)


def masses(found: dict[str, Any], springs: int = 0, *, hardly: bool = True) -> tuple[list[str], Any]:
    """Return the names of the results from three guesses, and the iteration."""
    batch = Iteration(found, springs)
    guesses = [guess(name, mass) for name, mass in (('a', 3.0), ('b', 1.0), ('c', 10.0))]
    search: Any = SimpleNamespace(
        batch=batch, hypotheses=('quiet', 'pushed'), _guesses=lambda *_: guesses, _is_hardly_shifted=lambda _: hardly
    )
    stacks: Any = [[SimpleNamespace(windows=())]]
    results: list[Any] = returned(MultiStart._from_masses(search, stacks, batch))  # type: ignore[arg-type]
    return [each.name for each in results], batch


ANY = ('quiet', LONGEST_AT_A_GUESS, None)


def test_each_mass_is_held_first_and_then_let_go_from_the_best_solution() -> None:
    held = {'a': solution('A', 1.0), 'b': solution('B', 3.0), 'c': solution('C', 2.0)}
    found, batch = masses({**held, 'B': solution('free B', 4.0)})
    assert found == ['free B', 'A', 'B', 'C']
    assert batch.asked == [
        *((name, ('quiet', LONGEST_AT_A_GUESS, mass), True) for name, mass in (('a', 3.0), ('b', 1.0), ('c', 10.0))),
        ('B', ANY, False),
    ]
    found, _ = masses({**held, 'B': solution('free B', 4.0, acceptable=False), 'C': solution('free C', 0.0)})
    assert found == ['free B', 'free C', 'A', 'B', 'C']  # one that is not acceptable stays a rival
    found, _ = masses({'a': held['a'], 'c': held['c']})
    assert found == ['A', 'C']


@pytest.mark.parametrize(
    ('springs', 'first', 'free', 'hardly', 'found'),
    [
        (1, {}, {}, True, ['free A', 'A']),
        (0, {}, {}, True, ['free A', 'A', 'B']),
        (1, {'consistent': False}, {}, True, ['free A', 'A', 'B']),
        (1, {}, {'consistent': False}, True, ['free A', 'A', 'B']),
        (1, {}, {'acceptable': False}, True, ['free A', 'free B', 'A', 'B']),
        (1, {}, {}, False, ['free A', 'A', 'B']),
    ],
)
def test_with_passive_joints_one_guess_is_enough_where_its_solution_is_sure(
    springs: int, first: dict[str, bool], free: dict[str, bool], hardly: bool, found: list[str]
) -> None:
    results = {'a': solution('A', 9.0, **first), 'A': solution('free A', 9.0, **free), 'b': solution('B', 3.0)}
    results['B'] = solution('free B', 5.0, acceptable=not (free or first) or 'acceptable' in free, consistent=False)
    assert masses(results, springs, hardly=hardly)[0] == found


def test_a_loose_swing_is_tightened_from_the_best_solution_of_each_stage(monkeypatch: pytest.MonkeyPatch) -> None:
    batch = Iteration({})
    stages = [Iteration({'B': solution('one', 1.0)}), Iteration({'one': solution('two', 1.0)})]
    monkeypatch.setattr(gauss_newton, 'from_loose_swing', lambda _: ['loose', *stages])
    asked: list[Any] = []

    def from_masses(_: object, first: Any) -> Work[Any]:
        asked.append(first)
        return finished([solution('A', 1.0), solution('B', 2.0)])

    search: Any = SimpleNamespace(batch=batch, hypotheses=('quiet', 'pushed'), _from_masses=from_masses)
    results: list[Any] = returned(MultiStart._from_guesses(search, [], []))
    assert (asked, [each.name for each in results]) == (['loose'], ['two'])
    assert [each.asked for each in stages] == [[(name, ('quiet', NO_JUMPS, None), False)] for name in ('B', 'one')]
    stages[0]._found.clear()  # a stage that leads nowhere
    assert returned(MultiStart._from_guesses(search, [], [])) == []
    search._from_masses = lambda *_: finished([])
    assert returned(MultiStart._from_guesses(search, [], [])) == []


@pytest.mark.parametrize('name', ['servicer7', 'table1'])
@pytest.mark.parametrize('declared', [0.0, 7.0])
def test_guesses_are_balls_of_the_declared_mass_or_of_parts_of_the_known_one(declared: float, name: str) -> None:
    """A quarter of the robot's length in radius, where it has seven links at most."""
    servicer = kernel(name)
    mean = np.zeros(BODY.stop)
    mean[BODY.start] = declared
    batch = SimpleNamespace(
        layout=SimpleNamespace(kernel=servicer),
        variables=SimpleNamespace(mean=mean, tracked=None, typical_momentum=[1.0]),
    )
    search: Any = SimpleNamespace(batch=batch, _beginning=lambda body, _: body)
    layout: Any = SimpleNamespace(point=lambda body: body)
    known = float(np.sum(servicer.known[:, 0]))
    guessed: list[Any] = MultiStart._guesses(search, [], layout)
    assert [body[0] for body in guessed] == pytest.approx([7.0] if declared else [0.3 * known, 0.1 * known, known])
    lengths = [float(np.sqrt(each @ each)) for each in servicer.model.positions]
    radius = 0.25 * sum(lengths) * min(1.0, 7.0 / len(lengths))
    for body in guessed:
        moments = np.array([[body[4], body[5], body[6]], [body[5], body[7], body[8]], [body[6], body[8], body[9]]])
        assert moments == pytest.approx(body[0] * radius**2 * np.eye(3))
        assert not body[1:4].any()
    tracked = SimpleNamespace(grasp_known=True, point=lambda mass: ('tracked', mass))
    batch.variables.tracked = tracked
    placed: list[Any] = MultiStart._guesses(search, [], layout)
    assert [each for each, _ in placed] == ['tracked'] * 3
    tracked.grasp_known = False
    assert len(MultiStart._guesses(search, [], layout)) == len(guessed)


def outcome(likelihood: float = 0.0, nis: float = 100.0, **changes: Any) -> BatchResult:
    """Return the outcome of an iteration with hundred measured numbers and a mass of 10 kg, known to 1 kg."""
    parameters, deviation = np.zeros(16), np.ones(16)
    parameters[MASS] = changes.pop('mass', 10.0)
    parameters[0] = changes.pop('momentum', 0.0)
    deviation[MASS] = changes.pop('deviation', 1.0)
    gaussian = SimpleNamespace(log_likelihood=likelihood, nis=nis, measured=100)
    flags = {'converged': True, 'physical': True, 'mass_held': False} | changes
    nothing: Any = None
    point: Any = SimpleNamespace(parameters=parameters)
    filtered: Any = SimpleNamespace(gaussian=gaussian)
    return BatchResult(point, nothing, nothing, filtered, nothing, deviation, **flags)


@pytest.mark.parametrize(
    ('changes', 'consistent', 'acceptable'),
    [
        ({}, True, True),
        ({'nis': 300.0}, False, True),
        ({'converged': False}, False, False),
        ({'physical': False}, False, False),
        ({'deviation': 9.9}, True, False),
        ({'mass': -10.0}, True, False),
        ({'nis': 300.0, 'deviation': 9.9}, False, False),
    ],
)
def test_what_an_iteration_has_come_to(changes: dict[str, Any], *, consistent: bool, acceptable: bool) -> None:
    result = outcome(**changes)
    assert (result.consistent, result.acceptable) == (consistent, acceptable)


def test_results_stand_by_their_likelihood_with_a_free_mass_and_convergence_first() -> None:
    held, free = outcome(likelihood=100.0, mass_held=True), outcome(likelihood=0.0)
    unsure = outcome(likelihood=MARGIN + 1.0, converged=False)
    worse = outcome(likelihood=MARGIN - 1.0, converged=False)
    assert sorted((held, free, unsure, worse), key=lambda each: each.merit) == [held, worse, free, unsure]


@pytest.mark.parametrize(
    ('likelihood', 'momentum', 'rivals'),
    [
        (0.0, 0.0, False),  # the same point
        (0.0, 30.0, True),
        (0.0, -30.0, True),
        (1.0 - MARGIN, 30.0, True),
        (-1.0 - MARGIN, 30.0, False),
        (50.0, 30.0, True),
    ],
)
def test_a_rival_is_about_as_likely_elsewhere(likelihood: float, momentum: float, *, rivals: bool) -> None:
    assert outcome().is_rivalled_by(outcome(likelihood, momentum=momentum)) is rivals


def test_a_swing_is_followed_over_ever_more_windows_from_points_that_explain_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """No impulse explains a swing that is out of phase, and where nothing is solved the point before stays."""
    monkeypatch.setattr(gauss_newton, 'in_stacks', list)
    misfits = {3: HOPELESS - 0.01, 4: HOPELESS + 0.01, 5: 0.5, 6: None}
    begun: list[tuple[int, Any, Any, bool]] = []

    def converge(windows: Any, point: Any, prior: Any, *, mass_held: bool = False) -> Work[Any]:
        begun.append((len(windows), point, prior, mass_held))
        misfit = misfits.get(len(windows), 1.0)
        gaussian = SimpleNamespace(nis=misfit and 30.0 * misfit, measured=30)
        found: Any = SimpleNamespace(point=f'by {len(windows)}', filtered=SimpleNamespace(gaussian=gaussian))
        found.consistent = len(begun) > 7  # of the second guess
        return finished(None if misfit is None else found)

    first, second, third = (SimpleNamespace(parameters=np.arange(16.0) + mass) for mass in (0.0, 1.0, 2.0))
    layout = SimpleNamespace(kernel=SimpleNamespace(springs=SimpleNamespace(count=1)))
    batch: Any = SimpleNamespace(prior_at=lambda *asked: asked, converge=converge, layout=layout)
    search: Any = SimpleNamespace(batch=batch, hypotheses=('quiet', 'pushed'))
    search._guesses = lambda *_: (first, second, third)
    windows: Any = range(11)
    results: list[Any] = returned(MultiStart._following_a_swing(search, [[]], windows))
    assert [each[0] for each in begun] == 2 * [3, 4, 5, 6, 8, 10, 1]
    assert [each[1] for each in begun] == [
        *(first, 'by 3', 'by 3', 'by 5', 'by 5', 'by 8', 'by 10'),
        *(second, 'by 3', 'by 3', 'by 5', 'by 5', 'by 8', 'by 10'),
    ]
    held = [('quiet', NO_JUMPS, mass) for mass in (6.0, 7.0)]
    assert [each[2:] for each in begun] == [
        call for prior in held for call in (*(6 * [(prior, True)]), (('quiet', NO_JUMPS), False))
    ]
    assert [each.consistent for each in results] == [False, True]  # the third mass is not needed


@pytest.mark.parametrize(
    ('found', 'springs', 'followed'),
    [([False, True], 1, False), ([False], 1, True), ([], 1, True), ([False], 0, False)],
)
def test_a_swing_is_followed_from_the_first_windows_where_nothing_else_explains_them(
    monkeypatch: pytest.MonkeyPatch, found: list[bool], springs: int, *, followed: bool
) -> None:
    monkeypatch.setattr(gauss_newton, 'from_loose_swing', lambda batch: [batch])
    layout = SimpleNamespace(kernel=SimpleNamespace(springs=SimpleNamespace(count=springs)))
    batch = SimpleNamespace(layout=layout, variables=SimpleNamespace(has_body_prior=False))
    results = [SimpleNamespace(consistent=each) for each in found]
    search: Any = SimpleNamespace(batch=batch, hypotheses=('quiet',))
    search._from_masses = lambda *_: finished([*results])
    search._following_a_swing = lambda *_: finished(['followed'])
    assert returned(MultiStart._from_guesses(search, [], [])) == [*results, *(['followed'] if followed else [])]


def test_a_robot_without_joints_is_guessed_as_a_body_of_its_own_shape() -> None:
    """Its masses are parts of the typical one where no other link has any; without a shape it is a ball."""
    described = np.array([4.0, -0.4, -0.8, 1.2, 2.0, 0.1, 0.2, 3.0, 0.3, 5.0])
    model = SimpleNamespace(joints=0, positions=np.zeros((1, 3)))
    robot = SimpleNamespace(known=np.zeros((1, 10)), model=model, target=SimpleNamespace(parameters=described))
    space = SimpleNamespace(mean=np.zeros(BODY.stop), tracked=None, typical_momentum=[20.0])
    batch = SimpleNamespace(layout=SimpleNamespace(kernel=robot), variables=space)
    search: Any = SimpleNamespace(batch=batch, _beginning=lambda body, _: body)
    layout: Any = SimpleNamespace(point=lambda body: body)
    for declared, masses in ((0.0, [6.0, 2.0, 20.0]), (7.0, [7.0])):
        space.mean[BODY.start] = declared
        guessed: list[Any] = MultiStart._guesses(search, [], layout)
        assert guessed == [pytest.approx(mass / 4.0 * described) for mass in masses]
    robot.target.parameters = np.zeros(10)
    (ball,) = MultiStart._guesses(search, [], layout)
    assert np.asarray(ball)[[0, 1, 5]].tolist() == [7.0, 0.0, 0.0]
