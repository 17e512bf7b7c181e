"""Passes with more unknowns, as linear algebra: wider priors, another body, and what windows predict of each other."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from checked import generic, returned
from mbaid_ros.core.contracts import UNDISTURBED, Hypothesis
from mbaid_ros.core.diagnosis import passes
from mbaid_ros.core.diagnosis.passes import FilterPasses, Fit, contradicting_unknowns, estimated_repair
from mbaid_ros.core.filter.gaussian import SquareRootInformation
from mbaid_ros.core.filter.hypotheses import HypothesisFilter
from mbaid_ros.core.filter.linearise import WhitenedWindow
from mbaid_ros.core.filter.posterior import MeanAndCovariance
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.odometry.model import odometry_mount, odometry_scale, twist_bias
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.state import BODY, MOMENTUM, POSE, Declared, Layout
from mbaid_ros.core.target import another_body
from observed import kernel
from windowed import covariance_of

SERVICER = kernel('servicer7')
UNKNOWNS = (odometry_mount(1e-3, 2e-3), odometry_scale(1e-2), twist_bias(1e-4, 0.0))
LAYOUT = Layout.from_unknowns(SERVICER, UNKNOWNS)
PASSES = FilterPasses(LAYOUT, PlaneDetector(SERVICER.model), Declared())


def measured(seed: int) -> SquareRootInformation:
    """Return the Gaussian of all variables after some measurements of these."""
    space, rng = PASSES.variables, np.random.default_rng(seed)
    mean, triangle, _ = space.prior()
    rows = rng.normal(size=(60, len(mean)))
    both = np.vstack((np.column_stack((triangle, triangle @ mean)), np.column_stack((rows, 3.0 * rng.normal(size=60)))))
    root = np.asarray(np.linalg.qr(both, mode='r'))[: len(mean)]
    return SquareRootInformation.from_root(root[:, :-1], root[:, -1], ['none'], space)[0]


def test_the_prior_of_one_cause_is_widened() -> None:
    wider = PASSES.with_inflated_prior('mount', 30.0)
    before, after = (
        covariance_of(SquareRootInformation.prior(each.variables), each.variables) for each in (PASSES, wider)
    )
    own = np.arange(BODY.stop, LAYOUT.size)
    factor = np.where(np.array(LAYOUT.cause_of) == 'mount', 900.0, 1.0)
    assert np.sum(factor > 1.0) == 6
    assert np.diag(after)[own] == pytest.approx(factor * np.diag(before)[own])
    assert np.diag(after)[: BODY.stop] == pytest.approx(np.diag(before)[: BODY.stop])


def test_the_value_of_a_cause_is_in_its_own_units() -> None:
    gaussian: Any = SimpleNamespace(gaussian=measured(0))
    mean = MeanAndCovariance.from_gaussian(gaussian.gaussian, PASSES.variables).mean
    own = mean[BODY.stop :]
    assert PASSES.value(gaussian, 'mount') == pytest.approx(own[:6] * np.repeat([2e-3, 1e-3], 3))
    assert PASSES.value(gaussian, UNKNOWNS[1].labels[0]) == pytest.approx(own[6:7] * 1e-2)
    assert PASSES.value(gaussian, UNKNOWNS[2].labels[0]) == pytest.approx(own[7:] * 1e-4)
    assert len(PASSES.value(gaussian, 'nothing')) == 0


@pytest.mark.parametrize('wider', [1.0, 3.0, 100.0])
def test_a_repair_takes_a_cause_into_account_as_a_wider_prior_would_see_it(wider: float) -> None:
    """The same measurements under a prior of the mount that is so many times wider."""
    gaussian = measured(1)
    values, covariance = MeanAndCovariance.from_gaussian(gaussian, PASSES.variables).unknowns(LAYOUT)
    own = np.flatnonzero(np.array(LAYOUT.cause_of) == 'mount')
    left = covariance[np.ix_(own, own)]
    widened = np.linalg.inv(np.linalg.inv(left) - (1.0 - wider**-2) * np.eye(len(own)))
    units = np.repeat([2e-3, 1e-3], 3)
    mean, std = units * (widened @ np.linalg.solve(left, values[own])), units * np.sqrt(np.diag(widened))
    distribution = MeanAndCovariance.from_gaussian(gaussian, PASSES.variables)
    found, expected = (
        estimated_repair(distribution, LAYOUT, 'mount', wider),
        UNKNOWNS[0].repair('mount', mean, std, SERVICER),
    )
    assert found is not None
    assert expected is not None
    assert found.value == pytest.approx(expected.value)
    assert found.std == pytest.approx(expected.std)
    assert (found.cause, found.parameters) == (expected.cause, expected.parameters)
    assert estimated_repair(distribution, LAYOUT, 'nothing', wider) is None


def test_gains_are_those_of_a_wider_prior() -> None:
    """As the likelihood of the same measurements under either prior; declared causes by 30 times at most."""
    gaussian = measured(1)
    values, covariance = MeanAndCovariance.from_gaussian(gaussian, PASSES.variables).unknowns(LAYOUT)
    found = PASSES.gains(gaussian, ['mount'])
    assert set(found) == set(LAYOUT.causes)
    for cause in LAYOUT.causes:
        own = np.flatnonzero(np.array(LAYOUT.cause_of) == cause)
        mean, left = values[own], covariance[np.ix_(own, own)]
        best = -np.inf
        for factor in (3.0, 10.0, 30.0) if cause == 'mount' else (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0):
            less = 1.0 - factor**-2.0
            gain = 0.5 * mean @ np.linalg.solve(np.eye(len(own)) / less - left, mean)
            gain -= 0.5 * np.linalg.slogdet(np.eye(len(own)) - less * left)[1] + len(own) * np.log(factor)
            best = max(best, float(gain))
        assert found[cause][0] == pytest.approx(best)


@pytest.mark.parametrize('exchanged', [False, True])
def test_another_body_is_unknown_and_the_same_one_keeps_mass_and_momentum(exchanged: bool) -> None:
    space = PASSES.variables
    gaussian = measured(2)
    other = another_body(gaussian, space, exchanged=exchanged)
    before, after = covariance_of(gaussian, space), covariance_of(other, space)
    opened = np.zeros(len(before))
    opened[BODY.start + 1 : BODY.stop] = 1.0
    opened[MOMENTUM] = opened[BODY.start] = float(exchanged)
    added = np.diag(after - before)[POSE.stop :]
    assert np.all((added > 1e-6 * np.diag(before)[POSE.stop :]) == (opened[POSE.stop :] > 0.0))
    assert added == pytest.approx((opened * space.uninformative_deviation**2)[POSE.stop :], rel=1e-6, abs=1e-9)
    prior = covariance_of(SquareRootInformation.prior(space), space)
    assert after[POSE, POSE] == pytest.approx(prior[POSE, POSE], rel=1e-6)
    assert np.abs(after[POSE, POSE.stop :]).max() < 1e-9


@pytest.mark.parametrize('force', ['none', 'body'])
def test_windows_are_predicted_by_the_momentum_at_their_own_time(force: str) -> None:
    """The state after the last window, less the momentum that a force and the unknowns have brought since."""
    space = PASSES.variables
    count, own = len(space.scale), slice(space.pose_size, space.moving)
    rng = np.random.default_rng(3)
    windows: list[Any] = []
    pushes = rng.normal(size=(4, 6, 6))
    for push in pushes:
        brought = rng.normal(size=(6, count))
        brought[:, : space.moving] = 0.0  # depends on body and unknowns alone
        made: Any = SimpleNamespace(
            transition=rng.normal(size=(6, count)),
            drift=rng.normal(size=6),
            momentum_change=brought,
            force_impulse=lambda axes, push=push: push if axes == 'body' else None,
            length=0.5,
        )
        made.over_gap = partial(WhitenedWindow.over_gap, made)
        windows.append(made)
    mean, acting = generic(4, count), generic(5, 6)
    after, expected = mean.copy(), []
    after[: space.pose_size] = 0.0
    gaps = (0.0, 0.0, 0.7, 0.0)  # s before each, in which all act on the robot as it is after that
    for white, gap in zip(windows, gaps, strict=True):
        push = white.force_impulse('body') @ acting if force == 'body' else 0.0
        change = white.momentum_change @ after + push
        after[own] += gap / 0.5 * change
        expected.append(white.drift + white.transition @ after)
        after[own] += change
    gaussian: Any = SimpleNamespace(least_squares=np.concatenate((after, acting if force == 'body' else np.zeros(0))))
    gaussian.least_squares[: space.pose_size] = 7.0  # the pose error is another one in each window
    hypothesis = Hypothesis('pushed', force='body') if force == 'body' else UNDISTURBED
    before: list[Any] = [SimpleNamespace(gap=gap) for gap in (3.0, *gaps[1:])]
    found = PASSES.unpredicted([*zip(before, windows, strict=True)], gaussian, hypothesis)
    assert found == pytest.approx(np.array(expected))


class Refined(FilterPasses):
    """Passes of given likelihoods."""

    likelihoods: list[float | None]
    points: list[object]

    def filtered_once(self, _: object, point: object, __: object) -> Generator[int, None, Any]:
        """Return the next pass, or find its robot impossible."""
        self.points.append(point)
        likelihood = self.likelihoods[len(self.points) - 1]
        yield 1
        if likelihood is None:
            raise np.linalg.LinAlgError
        return SimpleNamespace(gaussian=SimpleNamespace(log_likelihood=likelihood))

    def _point(self, gaussian: Any) -> Any:
        return gaussian.log_likelihood


@pytest.mark.parametrize(
    ('likelihoods', 'best', 'points'),
    [
        ([1.0, 3.0, 2.0], 3.0, ['start', 1.0, 3.0]),
        ([3.0, 1.0, 2.0], 3.0, ['start', 3.0, 1.0]),
        ([3.0, None, 9.0], 3.0, ['start', 3.0]),
        ([None, 5.0, 9.0], None, ['start']),
    ],
)
def test_the_best_of_three_passes_counts(
    likelihoods: list[float | None], best: float | None, points: list[object]
) -> None:
    kind = type('Made', (Refined,), {'likelihoods': likelihoods, 'points': []})
    made = kind(LAYOUT, PlaneDetector(SERVICER.model), Declared())
    start: Any = 'start'
    work = made.refined([], start, UNDISTURBED)
    if best is None:
        with pytest.raises(np.linalg.LinAlgError):
            returned(work)
    else:
        assert returned(work).gaussian.log_likelihood == best
    assert made.points == points


def test_a_cause_by_itself_comes_before_a_kind_of_its_name() -> None:
    """What thrusters share is a cause, and the name of their kind."""

    def unknown(*labels: str) -> Any:
        return SimpleNamespace(labels=labels, factor=np.eye(len(labels)), repair=lambda *_: labels[0])

    layout: Any = SimpleNamespace(
        unknowns=(unknown('thruster:left'), unknown('thruster'), unknown('lag:elbow')),
        places=[slice(BODY.stop + place, BODY.stop + place + 1) for place in range(3)],
        kernel=None,
    )
    distribution: Any = SimpleNamespace(mean=np.zeros(BODY.stop + 3), unknowns_covariance=0.5 * np.eye(3))
    found: list[Any] = [
        estimated_repair(distribution, layout, cause) for cause in ('thruster', 'thruster:left', 'lag', 'zero')
    ]
    assert found == ['thruster', 'thruster:left', 'lag:elbow', None]


@pytest.mark.parametrize(
    ('mass', 'least', 'exists'),
    [(-0.04, None, True), (-0.06, None, False), (0.04, 0.05, False), (0.06, 0.05, True), (-0.04, 0.05, False)],
)
def test_a_fitted_target_has_a_mass_but_for_noise_or_the_least_that_a_convention_asks_for(
    mass: float, least: float | None, exists: bool
) -> None:
    """In parts of the mass of the known bodies."""
    known = np.array([[7.0, 1.0], [3.0, 1.0]])
    convention: Any = SimpleNamespace(least_mass=None if least is None else 10.0 * least)
    convention.kernel = SimpleNamespace(known=known)
    parameters = np.full(16, -9.0)
    parameters[6] = 10.0 * mass
    assert Fit(convention, parameters, 0.0).exists is exists


def test_a_point_of_passes_with_more_unknowns_is_that_of_the_run_with_zeros() -> None:
    at = LAYOUT.point(np.arange(LAYOUT.size, dtype=float))
    shorter = replace(at, parameters=at.parameters[:12], nuisance=at.nuisance[:1])
    asked: list[Any] = []

    def relinearise(_: object, point: Any) -> Generator[int, None, str]:
        asked.append(point)
        yield 1
        return 'windows'

    kind = type('Made', (FilterPasses,), {'_batch': SimpleNamespace(relinearise=relinearise)})
    made = kind(LAYOUT, PlaneDetector(SERVICER.model), Declared())
    assert returned(made.linearised([], shorter)) == 'windows'
    (point,) = asked
    assert point.parameters.tolist() == [*at.parameters[:12], *[0.0] * (len(at.parameters) - 12)]
    assert point.nuisance.tolist() == [*at.nuisance[:1], *[0.0] * (len(at.nuisance) - 1)]


class Changing(FilterPasses):
    """Passes in which the target changes: each window adds its number to the likelihood."""

    seen: list[Any]

    def linearised(self, windows: Any, point: Any) -> Generator[int, None, Any]:
        """Return the windows with the point that they are linearised at."""
        yield 1
        return [(each, (each, point)) for each in windows]

    def filtered(self, passed: Any, hypothesis: Any, longest: int = 0, begin: Any = None) -> Generator[int, None, Any]:
        """Return the sum of the windows passed, of a point that is known better by each pass."""
        assert (hypothesis, longest) == ('quiet', 0)
        self.seen.append(([number for number, _ in passed], {point for _, (_, point) in passed}, begin is not None))
        yield 1
        before = begin.gaussian.log_likelihood if begin else 0.0
        known: Any = Known(before + sum(each for each, _ in passed))
        return HypothesisFilter(UNDISTURBED, known)

    def _point(self, gaussian: Any) -> Any:
        return f'by {gaussian.log_likelihood:g}'


@dataclass(frozen=True)
class Known:
    """The likelihood of a Gaussian."""

    log_likelihood: float


def test_a_target_changes_between_two_windows_that_a_rare_event_explains(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of three passes is linearised at the one before; what is skipped costs its gain as a rare event."""
    monkeypatch.setattr(passes, 'update', lambda gaussian, white: Known(gaussian.log_likelihood + 100.0 * white[0]))
    monkeypatch.setattr(passes, 'rare_event_likelihood', lambda after: after.log_likelihood - 0.5)
    monkeypatch.setattr(passes, 'another_body', lambda gaussian, *_, **__: replace(gaussian, log_likelihood=-7e7))
    kind = type('Made', (Changing,), {'seen': []})
    made = kind(LAYOUT, PlaneDetector(SERVICER.model), Declared())
    numbers: Any = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0]
    points: Any = ('before', 'after')
    quiet: Any = 'quiet'
    found = returned(made.target_changes(numbers, 3, points, quiet, exchanged=True))
    assert found.gaussian.log_likelihood == 1.0 + 2.0 + 4.0 + (800.0 - 0.5) + (1600.0 - 0.5) + 32.0 + 64.0
    first, later = [1.0, 2.0, 4.0], [32.0, 64.0]
    last = f'by {found.gaussian.log_likelihood:g}'
    assert made.seen == [
        *((first, {'before'}, False), (later, {'after'}, True)),
        *((first, {'by 7'}, False), (later, {last}, True)) * 2,
    ]


def test_unknowns_that_contradict_the_model_are_causes_with_what_they_gain() -> None:
    def unknown(finding: Any, *numbers: float) -> Any:
        def found(mean: Array, covariance: Array) -> Any:
            assert mean.tolist() == [*numbers]
            assert np.diag(covariance).tolist() == [10.0 * each for each in numbers]
            return finding

        return SimpleNamespace(finding=found)

    place = BODY.stop
    layout: Any = SimpleNamespace(
        unknowns=(
            unknown(SimpleNamespace(text='a', gain=20.0, repair='how'), 1.0, 2.0),
            unknown(None, 3.0),
            unknown(SimpleNamespace(text='b', gain=None, repair=None), 4.0),
        ),
        places=(slice(place, place + 2), slice(place + 2, place + 3), slice(place + 3, place + 4)),
    )
    mean = np.concatenate((np.full(place, 9.0), np.arange(1.0, 5.0)))
    distribution: Any = SimpleNamespace(mean=mean, unknowns_covariance=np.diag([10.0, 20.0, 30.0, 40.0]))
    found = [*contradicting_unknowns(distribution, layout)]
    assert [(each.text, each.gain, each.repair) for each in found] == [('a', 20.0, 'how'), ('b', 0.0, None)]
