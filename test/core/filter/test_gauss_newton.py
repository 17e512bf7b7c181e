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
from mbaid_ros.core.filter.gauss_newton import BatchIteration, MultiStart, Start
from mbaid_ros.core.filter.hypotheses import MARGIN, HypothesisFilter
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
    search: Any = MagicMock(hypotheses=('quiet',), _from_guesses=lambda _: finished(guessed))
    search._choose_hypothesis = lambda _, chosen: finished((chosen, 'bank', False))
    assert returned(MultiStart.search(search, [], [])).point == guessed[1].linearised_at
    search._from_guesses = lambda _: finished([])
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
    results: list[Any] = returned(MultiStart._from_guesses(search, stacks))
    assert results == ([found] if found else [])
    assert asked == [((list(range(BODY.start, BODY.stop)), 0), 'quiet')]
