"""The rules by which a run searches, freezes and carries its linearisation: tables of evidence and verdict."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from checked import generic, returned, some
from mbaid_ros.core.filter import gauss_newton
from mbaid_ros.core.filter import run as run_module
from mbaid_ros.core.filter.gauss_newton import (
    HOPELESS,
    BatchIteration,
    BatchResult,
    MultiStart,
    from_loose_swing,
    is_converged,
    momentum_drift,
    reverses,
)
from mbaid_ros.core.filter.hypotheses import MARGIN
from mbaid_ros.core.filter.run import LinearisationPoint, Phase, Run
from mbaid_ros.core.forces import DisturbanceModel, disturbances
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.verdict import IMPOSSIBLE, LARGEST_NIS
from mbaid_ros.core.robot.body import body_sizes, is_physical
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.state import (
    BODY,
    MOMENTUM,
    Declared,
    Layout,
    MomentumDrift,
    Variables,
    layout_of,
    trust_region,
    variables,
)
from mbaid_ros.tasks import Work
from observed import kernel


def bare(**known: Any) -> Any:
    """Return a run of which some things alone are known."""
    run = Run.__new__(Run)
    settings = {'is_informed': False, 'pushed': False}
    run._variables = SimpleNamespace(**{name: known.pop(name, value) for name, value in settings.items()})  # type: ignore[assignment]
    for name, value in ({'grasp_known': False} | known).items():
        setattr(run, f'_{name}' if name != 'phase' else name, value)
    return run


@pytest.mark.parametrize(
    ('known', 'misfit', 'windows', 'following'),
    [
        ({'grasp_known': True, 'is_informed': True}, 1.0, 11, 12),
        ({'grasp_known': True, 'is_informed': True}, 1.0, 12, 15),
        ({'is_informed': True}, 1.0, 10, 13),
        ({}, 1.0, 10, 12),  # not accepted: soon again
        ({}, 1.0, 40, 44),
        ({}, 1.01 * HOPELESS, 10, 15),  # for nothing
        ({'accepted': True}, 1.0, 10, 15),
        ({'accepted': True}, 1.0, 41, 62),
        ({'accepted': True, 'pushed': True}, 1.0, 41, 46),
        ({'pushed': True}, 1.0, 40, 44),
    ],
)
def test_when_a_run_is_searched_again(known: dict[str, Any], misfit: float, windows: int, following: int) -> None:
    run = bare(**{'accepted': False, **known})
    assert run._next_search(windows, SimpleNamespace(nis=misfit * 100, measured=100)) == following


def best(*times: float, nis: float = 100.0) -> Any:
    jumps = tuple(SimpleNamespace(time=time, gaussian=f'before {time:g}') for time in times)
    return SimpleNamespace(jumps=jumps, gaussian=SimpleNamespace(nis=nis, measured=100))


@pytest.mark.parametrize(
    ('phase', 'linearised', 'newest', 'open_jumps'),
    [
        (Phase.TRACKING, 0.0, 10.0, (6.1, 9.0)),  # eight windows of half a second
        (Phase.TRACKING, 0.0, 10.2, (9.0,)),
        (Phase.INITIALISING, 5.0, 10.0, (6.0, 6.1, 9.0)),  # not yet relinearised
        (Phase.INITIALISING, 9.5, 10.0, (6.1, 9.0)),
    ],
)
def test_a_jump_is_confirmed_by_the_windows_after_it(
    phase: Phase, linearised: float, newest: float, open_jumps: tuple[float, ...]
) -> None:
    window = SimpleNamespace(start=newest, length=0.5)
    run = bare(phase=phase, linearised_until=linearised, newest=window, latest=best(2.0, 6.0, 6.1, 9.0))
    assert run.unconfirmed_jumps == open_jumps
    nothing = bare(phase=phase, linearised_until=linearised, newest=None, latest=best(2.0))
    assert nothing.unconfirmed_jumps == (2.0,)


def test_the_information_before_a_jump_is_found_by_its_time() -> None:
    run = bare(bank=(best(2.0, 6.0), best(4.0)))
    assert run.gaussian_before(6.3, 0.3) == 'before 6'
    assert run.gaussian_before(5.7, 0.3) == 'before 6'
    assert run.gaussian_before(6.3, 0.2) is None
    assert run.gaussian_before(4.0, 0.3) is None  # of the first hypothesis alone
    assert run.jump_times == (2.0, 6.0)
    assert bare(bank=()).gaussian_before(6.0, 1.0) is None
    assert bare(bank=()).jump_times == ()


def test_a_run_is_inconsistent_by_its_innovations_or_a_jump() -> None:
    assert not bare(latest=best(nis=99.0 * LARGEST_NIS)).inconsistent
    assert bare(latest=best(nis=101.0 * LARGEST_NIS)).inconsistent
    assert bare(latest=best(3.0)).inconsistent
    assert bare(latest=None).inconsistent
    for phase, known, relinearises in (
        (Phase.INITIALISING, True, True),
        (Phase.TRACKING, True, False),
        (Phase.INITIALISING, False, False),
    ):
        assert bare(phase=phase, grasp_known=known, latest=None).relinearises is relinearises


@pytest.mark.parametrize(('windows', 'due', 'after'), [(0, 40, 9), (30, 40, 30), (30, 20, 20)])
def test_a_run_that_is_given_up_is_searched_anew_with_all_its_windows(windows: int, due: int, after: int) -> None:
    cancelled: list[Any] = []
    tasks = SimpleNamespace(cancel=lambda *kinds: cancelled.extend(kinds))
    given: dict[str, Any] = {
        'frozen_resolved': np.zeros(2, dtype=bool),
        'due': due,
        'first': 9,
        'windows': [None] * windows,
    }
    run = bare(phase=Phase.TRACKING, tasks=tasks, bank=('b',), latest='l', nonlinearity='n', accepted=True, **given)
    run.restart()
    assert (run.phase, run._bank, run._latest, run._due) == (Phase.COLLECTING, (), None, after)
    assert (run.converged, run._nonlinearity, run._newton_step) == (False, None, None)
    assert run._frozen_resolved.all()
    assert len(set(cancelled)) == 3


def test_an_estimate_misses_a_tracked_motion_by_the_square_of_its_rows() -> None:
    rows, scaled, mean = generic(1, 4, 6), generic(2, 5, 5), generic(3, 5)
    tracked = SimpleNamespace(at=lambda *_: rows)
    run, distribution = bare(layout=SimpleNamespace(point=lambda _: None)), SimpleNamespace(mean=mean)
    run._variables.tracked, run._variables.from_state = tracked, scaled
    misfit = rows[:, :5] @ scaled @ mean - rows[:, 5]
    assert run.misfit_of_target(distribution) == (pytest.approx(np.sum(misfit**2)), 4)
    run._variables.tracked = None
    assert run.misfit_of_target(distribution) == (0.0, 0)


def misfit(physical: bool, nis: float) -> Any:
    gaussian = SimpleNamespace(nis=nis, measured=10.0 * nis, log_likelihood=nis)
    return SimpleNamespace(hypothesis=SimpleNamespace(physical=physical), misfit=nis + 5.0, gaussian=gaussian)


def test_innovations_are_those_of_the_hypotheses_with_a_mechanism() -> None:
    run = bare(bank=(misfit(True, 1.0), misfit(False, 2.0), misfit(True, 30.0)))
    assert run.innovations.tolist() == [[6.0, 10.0], [35.0, 300.0]]
    assert run.log_likelihood_ratio == 29.0
    assert bare(bank=()).innovations.shape == (0, 2)
    assert bare(bank=()).log_likelihood_ratio == 0.0


LAYOUT = Layout.from_unknowns(kernel('servicer7'), ())


def drift(instant: float, starts: Array) -> MomentumDrift:
    return MomentumDrift(starts, generic(1, len(starts), 6), instant, generic(2, 6), 50.0)


def test_a_linearisation_point_goes_along_with_the_momentum_that_forces_bring() -> None:
    state = np.concatenate((np.zeros(6), generic(3, 6), np.abs(generic(4, 10))))
    point = LAYOUT.point(state)
    held = LinearisationPoint(point, state.copy())
    assert held.carried(3.0, None) is held
    before = drift(2.0, np.array([0.0, 1.0]))
    pushed = LinearisationPoint(point.drifting(before), state.copy())
    times = pushed.point.total_mass / 50.0  # of its own mass
    carried = pushed.carried(3.5, None)
    change = np.zeros(len(state))
    change[MOMENTUM] = times * 1.5 * before.rate
    assert carried.point.state == pytest.approx(state + change)
    assert carried.reference == pytest.approx(state + change)
    assert carried.point.drift is None
    assert pushed.point.parameters is point.parameters
    again = pushed.carried(3.5, before).point.drift
    assert again is not None
    assert (again.instant, again.starts.tolist()) == (3.5, [3.5])
    assert not again.offsets.any()
    assert again.rate == pytest.approx(pushed.point.total_mass / 50.0 * before.rate, rel=0.5)


def test_the_momentum_of_windows_is_that_at_their_start() -> None:
    """Of past ones as they were, of later ones by the rate; before the first as of the first."""
    starts, length = np.array([1.0, 2.0, 3.0]), 1.0
    brought = drift(4.0, starts)
    found = brought.at([0.5, 1.0, 2.4, 3.9, 4.0, 6.0])
    rows = brought.offsets[[0, 0, 1, 2]]
    assert found == pytest.approx(np.vstack((rows, 0.0 * brought.rate, 2.0 * brought.rate)))
    steps = brought.until_next([1.0, 2.0, 3.0, 4.0], length)
    offsets = np.vstack((brought.offsets, np.zeros(6)))
    assert steps == pytest.approx(np.vstack((np.diff(offsets, axis=0), brought.rate)))
    heavier = brought.of_mass(75.0)
    assert heavier.at(starts.tolist()) == pytest.approx(1.5 * brought.at(starts.tolist()))
    assert (heavier.rate / brought.rate).tolist() == pytest.approx([1.5] * 6)
    assert heavier.mass == 75.0


@pytest.mark.parametrize(
    ('step', 'size', 'converged'),
    [([0.05, 0.0], [1.0, 1.0], True), ([0.0, -0.3], [1.0, 1.0], False), ([0.0, 0.0], [0.0, 0.0], True)],
)
def test_an_iteration_is_converged_by_its_deviations(step: list[float], size: list[float], converged: bool) -> None:
    assert is_converged(np.array(step), np.array(size)) is converged


@pytest.mark.parametrize(('angle', 'back'), [(0.0, False), (115.0, False), (125.0, True), (180.0, True)])
def test_a_step_that_turns_by_more_than_120_degrees_goes_back(angle: float, back: bool) -> None:
    turned = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
    sizes = np.array([3.0, 0.2])
    assert reverses(turned * sizes * 7.0, np.array([1.0, 0.0]) * sizes, sizes) is back
    assert not reverses(-turned, turned, np.zeros(2))


def test_a_step_is_taken_as_far_as_the_body_is_linear() -> None:
    body = np.array([10.0, 1.0, 2.0, -1.0, 3.0, 0.1, 0.2, 4.0, 0.3, 5.0])
    parameters = np.concatenate((generic(5, 6), body))
    step = np.zeros(16)
    step[6] = 1.0
    whole = trust_region(parameters, step)
    assert whole == 1.0
    far = trust_region(parameters, 100.0 * step)
    assert far == pytest.approx(0.5 * trust_region(parameters, 50.0 * step))
    assert 0.0 < far < 0.1
    assert trust_region(np.zeros(16), 1e9 * step) == 1.0
    assert trust_region(parameters, np.concatenate((1e9 * np.ones(6), np.zeros(10)))) == 1.0


@pytest.mark.parametrize(('shift', 'small'), [(0.9, True), (1.1, False), (-1.1, False)])
def test_a_shift_by_noise_in_the_rows_is_small_below_a_deviation(shift: float, small: bool) -> None:
    numbers = np.zeros(LAYOUT.size)
    numbers[BODY.stop - 1] = shift * 0.2
    result: Any = SimpleNamespace(distribution=SimpleNamespace(shift=numbers), deviation=np.full(LAYOUT.size - 6, 0.2))
    search: Any = SimpleNamespace(batch=SimpleNamespace(layout=LAYOUT))
    assert MultiStart._is_hardly_shifted(search, result) is small


def outcome(likelihood: float = 0.0, apart: float = 0.0, nis: float = 100.0, std: float = 1.0, **known: Any) -> Any:
    """Return the outcome of an iteration at so many standard deviations from another, with a mass of 10."""
    gaussian, parameters = SimpleNamespace(log_likelihood=likelihood, nis=nis, measured=100), np.zeros(16)
    parameters[6], parameters[-1] = 10.0, apart  # kg first
    point, filtered = SimpleNamespace(parameters=parameters), SimpleNamespace(gaussian=gaussian)
    parts: Any = point, None, [], filtered, None, np.full(16, std)
    return BatchResult(*parts, **({'converged': True, 'physical': True, 'mass_held': False} | known))


def test_solutions_are_rivalled_ordered_accepted_and_consistent() -> None:
    near = [(-0.9, 3.1), (-0.9, -3.1), (-1.1, 3.1), (-0.9, 2.9), (5.0, 3.1)]  # log-likelihood over the margin, distance
    rivals = [outcome().is_rivalled_by(outcome(size * MARGIN, apart)) for size, apart in near]
    assert rivals == [True, True, False, False, True]
    order = [outcome(50.0, mass_held=True), outcome(-1.1 * MARGIN), outcome(converged=False), outcome(-0.9 * MARGIN)]
    assert sorted(order[2:] + order[:2], key=lambda each: each.merit) == order
    # One in a hundred of 100 innovations exceeds 135.8.
    table = [outcome(nis=135.0, std=1.4), outcome(nis=137.0), outcome(std=1.6)]
    table += [outcome(converged=False), outcome(physical=False)]
    assert [each.consistent for each in table] == [True, False, True, False, False]
    assert [each.acceptable for each in table] == [True, True, False, False, False]


class Iterating:
    """An iteration over one number, from 8 on: each step leads as far past zero as a factor says."""

    def __init__(self, factor: float, misfits: list[float], *, informed: bool = False, failing: int = 99) -> None:
        self.variables, self.layout = SimpleNamespace(is_informed=informed), SimpleNamespace(point=self.point)
        self._factor, self._misfits, self._failing = factor, misfits, failing
        self.at: list[float] = []

    def point(self, state: Any) -> Any:
        """Return the point of a state."""
        made = SimpleNamespace(state=np.array(state), parameters=np.array(state), drift='drift')
        made.drifting = lambda drift: made if drift == 'drift' else None
        return made

    def relinearise(self, _: object, point: Any) -> Work[Any]:
        """Note where windows are linearised."""
        yield 1
        self.at.append(float(point.state[0]))
        if len(self.at) == self._failing:
            raise np.linalg.LinAlgError
        return point

    def _followed(self, windows: Any, _: object) -> Work[Any]:
        yield 1
        return windows, None

    def _step(self, held: Any, *_: object, mass_held: bool) -> BatchResult:
        misfit = self._misfits[min(len(self.at), len(self._misfits)) - 1]
        filtered = SimpleNamespace(misfit=100.0 * misfit, gaussian=SimpleNamespace(measured=100))
        parts: Any = self.point(-self._factor * held.state), held, [], filtered, None, np.ones(1)
        flags: dict[str, Any] = {'converged': abs(held.state[0]) < 0.1, 'physical': True, 'mass_held': mass_held}
        return BatchResult(*parts, **flags)

    def outcome(self) -> Any:
        """Return the outcome of the iteration."""
        prior: Any = lambda _: None  # noqa: E731
        made: Any = self
        return returned(BatchIteration.converge(made, [], self.point([8.0]), prior))


def test_an_iteration_goes_on_until_it_converges_or_is_hopeless() -> None:
    """Where the target has a prior, steps that turn back are halved, and then grow by half up to whole ones."""
    plain = Iterating(0.4, [1.0])
    assert plain.outcome().converged
    assert plain.at == pytest.approx([8.0 * (-0.4) ** place for place in range(6)])
    for informed, most in ((False, 12), (True, 24)):
        endless = Iterating(-1.0, [1.0], informed=informed)
        assert not endless.outcome().converged
        assert len(endless.at) == most
    # From 8 by a whole step, then by halves, as each turns back.
    damped = Iterating(1.5, [1.0], informed=True)
    damped.outcome()
    expected, pace, before = [8.0], 1.0, 0.0
    while abs(expected[-1]) >= 0.1:
        step = -2.5 * expected[-1]
        pace = 0.5 * pace if step * before < 0.0 else min(1.0, 1.5 * pace)
        before = step
        expected.append(expected[-1] + pace * step)
    assert damped.at == pytest.approx(expected)
    hopeless = {(20.0, 15.0, 15.0, 16.0, 15.0, 14.0): 5, (20.0, 9.9, 12.0): 12, (20.0, 19.0, 18.0, 17.0, 16.0, 5.0): 12}
    for misfits, count in hopeless.items():
        endless = Iterating(-1.0, list(misfits))
        endless.outcome()
        assert len(endless.at) == count
    assert Iterating(0.4, [1.0], failing=1).outcome() is None
    lost = Iterating(0.4, [1.0], failing=3).outcome()
    assert (lost.converged, lost.point.state.tolist()) == (False, [-3.2])


@pytest.mark.parametrize(
    ('frequency', 'eased', 'parts'), [(0.59, True, []), (0.61, True, [1.0, 0.1, 0.01]), (0.61, False, [])]
)
def test_a_fast_swing_is_loose_first(frequency: float, parts: list[float], *, eased: bool) -> None:
    def loosened(part: float, _: object) -> Any:
        return ('loose', part) if eased else spring

    spring: Any = SimpleNamespace(eased=loosened)
    layout: Any = dataclasses.make_dataclass('Fake', ['unknowns', 'kernel'])(
        (spring,), SimpleNamespace(springs=SimpleNamespace(highest_frequency=frequency, count=0))
    )
    nothing: Any = None
    batch = BatchIteration(layout, nothing, nothing)
    *stages, last = from_loose_swing(batch)
    assert last is batch
    found: list[Any] = [each.layout.unknowns for each in stages]
    assert found == [(('loose', part),) for part in parts]


BODY_THERE = np.array([10.0, 1.0, 2.0, -1.0, 8.0, 0.1, 0.2, 9.0, 0.3, 7.0])


@pytest.mark.parametrize(
    ('share', 'change', 'linear'),
    [
        (0.09, {}, True),
        (0.11, {}, False),
        (-0.09, {}, False),  # of a body with a negative mass
        (0.09, {'nonlinearity': None}, False),
        (0.09, {'nonlinearity': SimpleNamespace(is_nonlinear=True)}, False),
        (0.09, {'newton_step': SimpleNamespace(is_nonlinear=True)}, False),
        (0.09, {'newton_step': SimpleNamespace(is_nonlinear=False)}, True),
        (0.09, {'layout': (1, [True, False])}, False),
        (0.09, {'layout': (1, [True, True])}, True),
        (0.09, {'layout': (0, [True, False])}, True),
    ],
)
def test_windows_are_near_linear_about_a_body_that_is_known_to_a_tenth(
    share: float, change: dict[str, Any], linear: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    count, resolved = change.pop('layout', (0, []))
    monkeypatch.setattr(run_module, 'MeanAndCovariance', SimpleNamespace(from_gaussian=lambda given, _: given))
    monkeypatch.setattr(
        run_module, 'resolved_frequencies', lambda *given: np.array(resolved) if given[2] == 4.5 else None
    )
    mean = np.concatenate((np.zeros(BODY.start), np.sign(share) * BODY_THERE))
    factor = np.zeros((10, 20))
    factor[range(10), range(10)] = 0.6 * abs(share) * body_sizes(BODY_THERE)
    factor[range(10), range(10, 20)] = 0.8 * abs(share) * body_sizes(BODY_THERE)
    factor[:9] *= 0.5  # all directions count
    gaussian: Any = SimpleNamespace(mean=mean, deviation=None, factor_of=lambda _: factor)
    near = {'nonlinearity': SimpleNamespace(is_nonlinear=False), 'newton_step': None} | change
    springs = SimpleNamespace(kernel=SimpleNamespace(springs=SimpleNamespace(count=count)))
    run = bare(
        to_state=np.eye(16), **near, windows=[SimpleNamespace(start=each) for each in (1.5, 6.0)], layout=springs
    )
    run._variables.to_state = np.eye(16)
    assert run._is_linear(gaussian) is linear


@pytest.mark.parametrize(('correction', 'physical'), [(0.9 * IMPOSSIBLE, True), (1.1 * IMPOSSIBLE, False)])
@pytest.mark.parametrize(('size', 'converged'), [(50.0, False), (1e-3, True)])
def test_a_step_goes_as_far_as_the_body_is_linear(
    size: float, correction: float, monkeypatch: pytest.MonkeyPatch, *, converged: bool, physical: bool
) -> None:
    held = LAYOUT.point(np.concatenate((np.zeros(6), generic(3, 6), BODY_THERE)))
    state = held.state + size * np.concatenate((np.zeros(6), generic(4, 16)))
    distribution = SimpleNamespace(deviation=np.full(LAYOUT.size, 0.1), mean=None)
    monkeypatch.setattr(gauss_newton, 'MeanAndCovariance', SimpleNamespace(from_gaussian=lambda *_: distribution))
    monkeypatch.setattr(BatchIteration, '_nearest_physical', lambda *_: (state.copy(), correction))
    nothing: Any = None
    filtered: Any = SimpleNamespace(gaussian=None)
    step = BatchIteration(LAYOUT, nothing, nothing)._step(held, filtered, [], drift(2.0, np.zeros(1)), mass_held=True)
    whole = (state - held.state)[6:]
    part = trust_region(held.parameters, whole)
    assert (part < 1.0) is (size > 1.0)
    assert step.point.parameters == pytest.approx(held.parameters + part * whole)
    assert (step.converged, step.physical, step.mass_held) == (converged, physical, True)
    assert step.linearised_at is held
    assert some(step.point.drift).instant == 2.0


def test_other_numbers_follow_the_likeliest_body_that_can_exist() -> None:
    """As far as they are correlated with it; where it can exist, or in a plane, all is as estimated."""
    mean, sizes = np.concatenate((generic(3, 12), BODY_THERE)), np.concatenate((np.ones(12), body_sizes(BODY_THERE)))
    root = sizes[:, None] * (0.1 * np.eye(22) + 0.03 * generic(8, 22, 22))
    covariance = root @ root.T
    nothing: Any = None

    def nearest(body: Array, plane: object = None) -> tuple[Array, float]:
        values = np.concatenate((mean[:12], body))
        parts: Any = SimpleNamespace(mean=values, factor=root, covariance=lambda _: covariance[12:, 12:])
        layout: Any = SimpleNamespace(plane=plane, kernel=LAYOUT.kernel)
        return BatchIteration(layout, nothing, nothing)._nearest_physical(parts)

    impossible = BODY_THERE.copy()
    impossible[4] = -2.0
    for body, plane in ((BODY_THERE, None), (impossible, 'a plane')):
        state, distance = nearest(body, plane)
        assert state[12:] == pytest.approx(body)
        assert distance == 0.0
    state, distance = nearest(impossible)
    moved = state[12:] - impossible
    weighed = np.linalg.solve(covariance[12:, 12:], moved)
    assert distance == pytest.approx(np.sqrt(moved @ weighed), rel=1e-3)
    assert distance > 1.0
    assert state[:12] - mean[:12] == pytest.approx(covariance[:12, 12:] @ weighed, rel=1e-6)
    assert is_physical(state[12:] + 1e-6 * BODY_THERE)


SEARCHED: dict[str, Any] = {'confirmed': True, 'accepted': True, 'kept': 100, 'searched': 30, 'due': 41, 'nis': 100.0}


@pytest.mark.parametrize(
    ('change', 'linear', 'phase', 'left', 'due'),
    [
        ({}, True, Phase.TRACKING, 0, 41),
        ({'due': 40}, True, Phase.INITIALISING, 34, 40),
        ({'due': 31, 'kept': 30}, True, Phase.TRACKING, 0, 31),
        ({}, False, Phase.INITIALISING, 34, 41),
        ({'due': 101}, False, Phase.TRACKING, 0, 101),
        ({'due': 101, 'nis': 200.0}, False, Phase.INITIALISING, 19, 29),
        ({'confirmed': False}, True, Phase.INITIALISING, 34, 41),
        ({'confirmed': False, 'accepted': False, 'due': 99}, True, Phase.INITIALISING, 34, 99),
        ({'confirmed': False, 'accepted': False, 'due': 101}, True, Phase.INITIALISING, 19, 21),
        ({'searching': True}, True, Phase.INITIALISING, 34, 41),
    ],
)
def test_a_run_freezes_its_linearisation_or_drops_the_older_half_of_its_windows(
    change: dict[str, Any], phase: Phase, left: int, due: int, *, linear: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = SEARCHED | change
    nis, searching = known.pop('nis'), known.pop('searching', False)
    gaussian = SimpleNamespace(gaussian=SimpleNamespace(nis=nis, measured=100, log_likelihood=0.0), misfit=nis)
    cancelled: list[Any] = []
    tasks = SimpleNamespace(is_under_way=lambda _: searching, cancel=cancelled.append)
    run = bare(phase=Phase.INITIALISING, tasks=tasks, bank=(gaussian,), windows=[*range(34)], covariance='', **known)
    monkeypatch.setattr(Run, '_is_linear', lambda *_: linear)
    monkeypatch.setattr(Run, 'resolved', 'resolved')
    run._freeze_if_possible()
    assert (run.phase, len(run._windows), run._due) == (phase, left, due)
    assert bool(cancelled) is (left < 34)
    assert run._windows == [*range(34 - left, 34)]


PUSHES = disturbances(DisturbanceModel(0.1, 20.0, 'inertial'), DisturbanceModel(0.2, 0.0, 'inertial'))


def pushed_run(axes: str) -> tuple[Any, Any, Layout, Variables]:
    """Return windows in which a varying torque, a constant force and one in some axes act, and what they lead to."""
    robot, declared = kernel('servicer7'), Declared(PUSHES)
    detector = PlaneDetector(robot.model)
    layout = layout_of(robot, declared, detector)
    space = variables(layout, detector, declared)
    rng, windows = np.random.default_rng(0), []
    for place in range(4):
        brought, push = rng.normal(size=(6, len(space.scale))), rng.normal(size=(6, 6))
        white = SimpleNamespace(momentum_change=brought, force_impulse=lambda _, push=push: push, length=0.5)
        white.over_gap = lambda change, window: window.gap / 0.5 * change
        windows.append((SimpleNamespace(start=0.5 * place, length=0.5, gap=0.0), white))
    numbers = np.abs(rng.normal(size=len(space.scale) + 6 * (axes != 'none')))
    gaussian = SimpleNamespace(axes=axes, mean_and_shift=lambda: (numbers, 0.0 * numbers))
    return windows, gaussian, layout, space


@pytest.mark.parametrize('axes', ['none', 'body', 'inertial'])
def test_the_momentum_of_earlier_windows_is_less_by_what_constant_forces_have_brought_since(axes: str) -> None:
    windows, gaussian, layout, space = pushed_run(axes)
    found = some(momentum_drift(windows, gaussian, space, layout))
    numbers, count = gaussian.mean_and_shift()[0], len(space.scale)
    constant = np.setdiff1d(np.arange(space.first_unknown, count), space.gauss_markov)
    impulses = []
    for _, white in windows:
        forced = 0.0 if axes == 'none' else white.force_impulse(axes) @ numbers[count:]
        impulses.append(white.momentum_change[:, constant] @ numbers[constant] + forced)
    sizes = np.diag(space.to_state)[MOMENTUM]
    brought = sizes * np.array(impulses)
    assert len(constant) == 3
    assert found.offsets == pytest.approx(-np.cumsum(brought[::-1], axis=0)[::-1])
    assert found.starts.tolist() == [0.0, 0.5, 1.0, 1.5]
    windows[2][0].gap = 3.0  # six windows as the one after it
    later = some(momentum_drift(windows, gaussian, space, layout)).offsets
    assert later - found.offsets == pytest.approx(-6.0 * np.outer([1.0, 1.0, 0.0, 0.0], brought[2]))
    assert (found.instant, found.central) == (2.0, axes != 'body')
    assert found.rate == pytest.approx(brought[-1] / 0.5)
    body = space.to_state[BODY.start] @ numbers[:count]
    assert found.mass == pytest.approx(body + np.sum(layout.kernel.known[:, 0]))


def test_the_momentum_of_earlier_windows_follows_a_force_that_varies() -> None:
    """As each window's estimate has it; its impulse is that of the mean of the force at its ends."""
    windows, gaussian, layout, space = pushed_run('none')
    numbers, momentum = gaussian.mean_and_shift()[0], slice(space.pose_size, space.moving)
    course: list[Any] = []
    for place in range(4):
        values = numbers.copy()
        values[momentum] = generic(20 + place, 6)
        values[space.gauss_markov] = generic(30 + place, 3)
        course.append(SimpleNamespace(given=lambda _, places, own=values: own[places], values=values))
    found = some(momentum_drift(windows, gaussian, space, layout, course))
    sizes, kept, expected = np.diag(space.to_state)[MOMENTUM], np.exp(-0.5 / 20.0), []
    for (_, white), each in zip(windows, course, strict=True):
        acting = each.values.copy()
        acting[space.gauss_markov] *= 0.5 * (1.0 + 1.0 / kept)  # between v and v / kept
        impulse = white.momentum_change[:, space.first_unknown :] @ acting[space.first_unknown :]
        expected.append(sizes * (each.values[momentum] - impulse - course[-1].values[momentum]))
    assert found.offsets == pytest.approx(np.array(expected))
    quiet = SimpleNamespace(axes='none')
    nothing = Layout.from_unknowns(kernel('servicer7'), ())
    space = variables(nothing, PlaneDetector(nothing.kernel.model), Declared())
    assert momentum_drift(windows, quiet, space, nothing) is None  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ('change', 'begun', 'left', 'due'),
    [
        ({}, ['offered'], 10, 10),
        ({'offered': None}, [], 10, 10),
        ({'due': 11}, None, 10, 11),
        ({'moved': False}, None, 4, 10),
        ({'searching': True}, None, 10, 10),
        ({'accepted': True}, ['best', 'offered'], 10, 10),
        ({'accepted': True, 'nonlinearity': None}, ['offered'], 10, 10),
        ({'due': 99, 'windows': 20}, None, 11, 13),
        ({'due': 12, 'windows': 20, 'kept': 21, 'searching': True}, None, 21, 12),
        ({'due': 99, 'windows': 19}, None, 20, 99),
        ({'due': 99, 'windows': 20, 'accepted': True}, None, 21, 99),
        # The solution of a target with a prior explains the windows no more, as it did.
        ({'due': 99, 'accepted': True, 'is_informed': True, 'latest': None}, ['best', 'offered'], 10, 99),
        ({'due': 99, 'accepted': True, 'is_informed': True}, None, 10, 99),
        ({'due': 99, 'accepted': True, 'latest': None}, None, 10, 99),
        ({'due': 99, 'accepted': True, 'is_informed': True, 'latest': None, 'consistent': False}, None, 10, 99),
        ({'due': 99, 'is_informed': True, 'latest': None}, None, 10, 99),
    ],
)
def test_when_a_search_begins_and_where(
    change: dict[str, Any], begun: list[str] | None, left: int, due: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It begins at the estimate and at what another method offers; without one the older half of the windows goes."""
    known: dict[str, Any] = {
        'windows': 9,
        'due': 10,
        'kept': 20,
        'accepted': False,
        'nonlinearity': 'known',
        'consistent': True,
        'latest': best(),
        'offered': 'offered',
        'covariance': None,
        'layout': SimpleNamespace(size=30),
    } | change
    moved, searching = known.pop('moved', True), known.pop('searching', False)
    started: list[Any] = []
    monkeypatch.setattr(run_module, 'outcome_or_none', lambda search, _: search)
    monkeypatch.setattr(Run, '_best_point', 'best')
    known['multi_start'] = SimpleNamespace(search=lambda windows, points: (len(windows), points))
    known['tasks'] = SimpleNamespace(
        is_under_way=lambda _: searching, begin=lambda _, search, __, size: started.append((*search, size))
    )
    known['windows'] = [*range(known['windows'])]
    run, window = bare(**known), len(known['windows'])
    run._store(window, joints_moved=moved)
    assert started == ([] if begun is None else [(left, begun, 30)])
    assert (len(run._windows), run._windows[-1], run._due) == (left, window, due)
    assert begun is None or run._searched == left


@pytest.mark.parametrize(
    ('change', 'consistent', 'contradicts', 'confirmed', 'frozen'),
    [
        ({}, True, False, False, False),
        ({'accepted': True}, True, False, True, False),
        ({'misfit': 60.0}, True, True, False, False),
        ({'misfit': 60.0, 'numbers': 0}, True, False, False, False),
        ({'misfit': 60.0, 'start': False}, True, False, False, True),
        ({'nis': 151.0}, False, True, False, False),
        ({'nis': 149.0}, True, False, False, False),
        ({'accepted': True, 'start': False}, True, False, False, True),
    ],
)
def test_what_a_run_takes_over_from_a_search(
    change: dict[str, Any],
    consistent: bool,
    contradicts: bool,
    confirmed: bool,
    frozen: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A chi-square of 36 of six numbers is rarer than once in a million; a second search that is accepted confirms."""
    filtered, point = best(nis=change.get('nis', 100.0)), SimpleNamespace(state='state', drift='drift')
    filtered.gaussian.log_likelihood, freezes = 0.0, list[int]()
    start: Any = SimpleNamespace(
        bank=(filtered,), point=point, accepted=change.get('start', True), nonlinearity='work', covariance='covariance'
    )
    begun: list[Any] = []
    tasks = SimpleNamespace(
        cancel=lambda *_: None, begin=lambda *given, size, steps: begun.append((given[1], size, steps > 0))
    )
    run = bare(accepted=change.get('accepted', False), nonlinearity='before', newton_step='step', searched=3)
    run._tasks, run._layout = tasks, SimpleNamespace(size=30)
    run._windows = [SimpleNamespace(start=0.5 * place) for place in range(5)]
    monkeypatch.setattr('mbaid_ros.core.filter.run.MeanAndCovariance.from_gaussian', lambda *_: None)
    monkeypatch.setattr(Run, 'misfit_of_target', lambda *_: (change.get('misfit', 30.0), change.get('numbers', 6)))
    monkeypatch.setattr(Run, '_is_sharper', lambda *_: False)
    monkeypatch.setattr(Run, '_freeze_if_possible', lambda *_: freezes.append(1))
    run._take_over(start)
    known = change.get('accepted', False)
    assert (run.phase, run._consistent, run.contradicts_target) == (Phase.INITIALISING, consistent, contradicts)
    assert (run._accepted, run._confirmed, bool(freezes)) == (start.accepted, confirmed, frozen)
    assert (run._linearised_until, run._point.point, run._drift) == (1.0, point, 'drift')
    assert (run._nonlinearity, run._newton_step) == ('before' if known else None, None)
    assert begun == [('work', 30, not known)]
    run._take_over(None)
    assert run._due == 3 + 2


@pytest.mark.parametrize('disturbed', [False, True])
@pytest.mark.parametrize(
    ('phase', 'ready', 'still_open', 'filtered', 'newest'),
    [
        (Phase.COLLECTING, 3, 4, [], 2),
        (Phase.INITIALISING, 3, 4, [3, 4], 4),
        (Phase.TRACKING, 3, 4, [3, 4], 4),
        (Phase.INITIALISING, 3, None, [3], 3),
        (Phase.INITIALISING, None, 4, [4], 4),
        (Phase.TRACKING, None, 4, [4], 4),
        (Phase.TRACKING, None, None, [], 2),
    ],
)
def test_what_a_window_updates(
    phase: Phase,
    ready: int | None,
    still_open: int | None,
    filtered: list[int],
    newest: int,
    monkeypatch: pytest.MonkeyPatch,
    *,
    disturbed: bool,
) -> None:
    """Windows are numbered from their start. Where nothing acts, the state does not advance over one that is open."""
    windows = {start: SimpleNamespace(start=start) for start in range(5)}
    stored, checked, carried, updated = list[int](), list[int](), list[int](), list[tuple[int, bool]]()

    def update(bank: Any, window: Any, _white: Any, _variables: Any, *, advancing: bool = True) -> Any:
        updated.append((window.start, advancing))
        return tuple(SimpleNamespace(**vars(each) | {'latest': window.start}) for each in bank)

    def carry(start: int, _drift: Any) -> Any:
        carried.append(start)
        return SimpleNamespace(near_estimate=lambda *_: point)

    monkeypatch.setattr(run_module, 'leader', lambda bank: bank[0])
    monkeypatch.setattr(run_module, 'update_bank', update)
    monkeypatch.setattr(run_module, 'momentum_drift', lambda passed, *_: passed[0][0].start)
    monkeypatch.setattr(Run, '_store', lambda _, window, **__: stored.append(window.start))
    monkeypatch.setattr(Run, '_check_newton_step', lambda _, best: checked.append(best.latest))
    point = SimpleNamespace(carried=carry, point='point')
    first = SimpleNamespace(hypothesis=SimpleNamespace(disturbed=disturbed), gaussian=None, latest=2)
    run = bare(phase=phase, point=point, bank=(first,), newest=windows[2], drift=None, latest=first, accepted=False)
    run._nonlinearity, run._tasks = None, SimpleNamespace(allot_steps=lambda *_: None)
    run._linearised, run._layout = SimpleNamespace(whitened=lambda *_: None), SimpleNamespace(has_varying_push=False)
    run._variables.random_walk = np.zeros((6, 0))
    run.add(*(None if start is None else windows[start] for start in (ready, still_open)), joints_moved=True)
    assert stored == ([ready] if ready and phase is not Phase.TRACKING else [])
    assert updated == [(start, start == ready or disturbed) for start in filtered]
    assert checked == ([ready] if ready and phase is Phase.INITIALISING else [])
    assert carried == filtered[:1]
    assert (run._newest.start, run._latest.latest) == (newest, newest)
    assert run._bank[0].latest == (ready if ready in filtered else 2)


@pytest.mark.parametrize(
    ('nonlinear', 'nis', 'due'), [(True, 100.0, 30), (False, 100.0, 40), (True, 200.0, 40), (True, None, 40)]
)
def test_a_step_that_is_not_linear_makes_a_search_due(nonlinear: bool, nis: float | None, due: int) -> None:
    """But not where the data contradict the model."""
    step: Any = SimpleNamespace(is_nonlinear=nonlinear, covariance='its')
    latest = None if nis is None else best(nis=nis)
    run = bare(covariance='before', latest=latest, due=40, windows=[None] * 30, nonlinearity='n', newton_step=None)
    run._take_newton_step(step)
    assert (run._due, run._covariance, run._is_displaced) == (due, 'its', nonlinear)
    assert run.nonlinearities(consistent=True) == ('n', step)
    assert run.nonlinearities(consistent=False) == ('n',)
    run._covariance = None
    run._take_newton_step(step)
    assert run._covariance is None


@pytest.mark.parametrize(('delay', 'delayed'), [(None, False), (0.0, False), (-0.01, True)])
def test_an_estimate_has_a_joint_delay_where_its_linearisation_point_has_one(
    delay: float | None, *, delayed: bool
) -> None:
    nominal = SimpleNamespace(delay=delay)
    point = None if delay is None else SimpleNamespace(point=SimpleNamespace(nominal=nominal))
    assert bare(point=point).has_joint_delay is delayed


def test_a_frequency_is_resolved_by_the_data_up_to_the_end_of_the_newest_window(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One that was not resolved when the linearisation was frozen stays so."""
    least = np.array([4.2, 4.2, 4.6])  # s of data that each of three frequencies needs
    monkeypatch.setattr(Run, 'distribution_of_first', lambda _: SimpleNamespace(deviation=None))
    monkeypatch.setattr(run_module, 'resolved_frequencies', lambda _, __, seconds: least < seconds)
    window = SimpleNamespace(start=4.0, length=0.5)
    run = bare(newest=window, layout=None, frozen_resolved=np.array([True, False, True]))
    assert run.resolved.tolist() == [True, False, False]
    run._newest = None
    assert not run.resolved.any()
