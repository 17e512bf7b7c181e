"""The trajectory filter from a cold start, within its covariance, and a run that goes on from an earlier one."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.appendages import PANELS, with_panels
from checked import generic, some
from floating import errors, follow, normalised, true_momentum
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.contracts import UNDISTURBED, Axes
from mbaid_ros.core.filter.posterior import Continuation
from mbaid_ros.core.filter.run import FIRST
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.method import TrajectoryEstimator, TrajectorySettings, _point_of, forces, jumps
from mbaid_ros.core.pipeline import Estimator
from mbaid_ros.core.results.estimate import PULSE, SYMPTOM, Estimate
from mbaid_ros.core.robot.body import standard
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import MomentumKernel, Springs
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.state import MOMENTUM, Declared, Layout
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import build, values_of
from mbaid_ros.session.continuation import continuation_as_json, read_continuation
from mbaid_ros.session.methods import make_estimator
from mbaid_ros.session.robot import KnownRobot, with_known_errors
from mbaid_ros.simulation.simulation import Truth
from mbaid_ros.simulation.true_robot import ErrorStds, draw, generator
from observed import HIGH, MID, configured_motion, kernel, nees, observe, true_body, windows
from simulated import robot
from unchanged import Unchanged


def until(samples: Samples, seconds: float) -> Samples:
    return samples[: int(np.searchsorted(samples.time, seconds - 1e-9))]


def covered(surprises: list[float], freedom: int) -> bool:
    """Return whether errors are as large as covariances say: their sum within 99.8 % of chi-square."""
    low, high = chi2.interval(0.998, freedom * len(surprises))
    return bool(low < sum(surprises) < high)


@pytest.mark.parametrize(
    ('case', 'seeds'),
    [
        ('servicer', 2),
        ('satellite', 2),
        *(pytest.param(case, 4, marks=pytest.mark.long) for case in ('servicer', 'satellite')),
    ],
)
def test_a_cold_start(case: str, seeds: int, servicer: Truth, satellite: Truth, unchanged: Unchanged) -> None:
    truth, robot = (servicer, kernel('servicer7')) if case == 'servicer' else (satellite, kernel('ets7'))
    total = true_momentum(robot, observe(truth, MID))[0]
    surprises, momenta = [], []
    for seed in range(1, 1 + seeds):
        last = unchanged.course(follow(robot, until(observe(truth, MID, seed), 10.0), MID))
        assert last.status in {'estimating', 'converged'}
        assert np.all(last.identifiable)
        assert np.all(np.abs(errors(last, robot)) < 4.5 * last.std)
        surprises.append(normalised(last, robot))
        change = last.momentum - total
        momenta.append(float(change @ np.linalg.solve(last.momentum_covariance, change)))
        # Of 220 or so normalised innovations: four standard deviations.
        assert last.residual**2 == pytest.approx(1.0, abs=0.4)
    assert covered(surprises, 10)
    assert covered(momenta, 6)


def test_a_robot_without_unknowns_is_followed_without_a_word_on_the_terminal(
    robot: MomentumKernel, servicer: Truth, capfd: pytest.CaptureFixture[str]
) -> None:
    estimator = make_estimator(build(EstimatorConfig, EXACT), robot, KnownRobot(robot, Declared()))
    last = estimator.update(windows(until(observe(servicer, MID, 1), 6.0)), 0)[-1]
    assert last.status in {'estimating', 'converged'}
    assert capfd.readouterr() == ('', '')


def test_knots_follow_data_better_than_any_sensor_s(robot: MomentumKernel, servicer: Truth) -> None:
    finest = SensorNoise(*(1e-3 * np.array([1e-4, 1e-3, 1e-3, 1e-4, 1e-3, 1e-4])))
    history = follow(robot, until(observe(servicer, finest, 1), 15.0), finest)
    assert not any(each.status == 'inconsistent' or each.events for each in history)
    assert np.all(np.abs(errors(history[-1], robot)) < 4.5 * history[-1].std)


def test_a_guess_that_leads_astray_does_not_end_the_run(robot: MomentumKernel, servicer: Truth) -> None:
    # From the heaviest guess the passes over this draw lead to a robot that turns a thousand times a second.
    last = follow(robot, until(observe(servicer, HIGH, 3), 8.0), HIGH)[-1]
    assert last.status == 'estimating'
    assert normalised(last, robot) < chi2.isf(1e-3, 10)


def test_a_gap_of_several_seconds(robot: MomentumKernel, servicer: Truth, unchanged: Unchanged) -> None:
    samples = observe(servicer, MID, 3)
    later = samples[int(np.searchsorted(samples.time, 12.1)) :]
    out = follow(robot, Samples.concatenate([until(samples, 8.3), later]), MID)
    last = unchanged.course(out)
    assert normalised(last, robot) < chi2.isf(1e-3, 10)
    assert not last.events
    assert last.residual**2 == pytest.approx(1.0, abs=0.3)
    # What was learnt before the gap still counts.
    after = follow(robot, until(observe(servicer, MID, 3), 8.0), MID)[-1]
    assert np.all(last.std < after.std)


URDF = '<robot/>'


def made(before: Continuation | None = None) -> tuple[Estimator, MomentumKernel]:
    """Return a method with the default uncertainty of the robot, in which all windows count, and its kernel."""
    config = build(EstimatorConfig, {f'noise.{name}': value for name, value in vars(MID).items()})
    model = robot('servicer7')
    kernel, _ = with_known_errors(MomentumKernel(model, model.last_link), config.known_links)
    return make_estimator(config, kernel, before=before), kernel


def halves(seed: int) -> tuple[list[Samples], list[Samples]]:
    """Return the windows of a motion in two halves, of a robot that is not its URDF."""
    errors = draw(robot('servicer7'), 'link7', ErrorStds(0.01, 1e-3, 1e-3, 1e-3, 2e-3, 2e-3), generator(seed))
    seen = windows(observe(configured_motion('servicer7', 24.0, 20.0, errors), MID, seed, errors))
    return seen[: len(seen) // 2], seen[len(seen) // 2 :]


def left_by(method: Estimator) -> Continuation:
    known = some(method.posterior())
    return known.continuation


@pytest.fixture(scope='module')
def runs() -> tuple[Estimate, Estimate, Estimate, Continuation]:
    """Return the last estimates of a first half, of a second that goes on from it, and of one run over both."""
    first, second = halves(3)
    begun = made()[0]
    before = begun.update(first, 0)[-1]
    left = left_by(begun)
    return before, made(left)[0].update(second, 0)[-1], made()[0].update([*first, *second], 0)[-1], left


def test_two_halves_agree_with_one_run_over_both(runs: tuple[Estimate, Estimate, Estimate, Continuation]) -> None:
    before, after, whole, _ = runs
    assert after.identifiable.all()
    # One run knows the momentum of the second half already: the difference has the variance that this takes off.
    difference = np.sqrt(np.maximum(after.std**2 - whole.std**2, 0.0) + (0.15 * whole.std) ** 2)
    assert np.all(np.abs(after.parameters - whole.parameters) < 3.0 * difference)
    assert np.all(after.std < 1.35 * whole.std)
    assert np.all(after.std < 0.9 * before.std)
    assert nees(after, true_body(made()[1])) < 30.0  # of ten


def test_the_file_of_a_run_holds_it_and_is_of_that_robot(
    runs: tuple[Estimate, Estimate, Estimate, Continuation], tmp_path: Path
) -> None:
    left, path = runs[-1], tmp_path / 'run.json'
    config = build(EstimatorConfig, {'continue_from': str(path)})
    parameters = json.loads(json.dumps(values_of(config)))

    def written(**changes: object) -> None:
        content = {'continuation': continuation_as_json(left, URDF), 'made_by': {'parameters': parameters}, **changes}
        path.write_text(json.dumps(content), encoding='utf-8')

    written()
    found = some(read_continuation(config, URDF))
    assert not found.planar
    np.testing.assert_array_equal(found.root, left.root)
    np.testing.assert_array_equal(found.bias, left.bias)
    with pytest.raises(ParameterError, match='is of another robot description'):
        read_continuation(config, '<robot name="other"/>')
    for name, value, differ in (
        ('known_links.relative_std', 0.02, '0.01'),
        ('poses.names', ['camera'], r'\[\]'),
        ('known_joints.joint2.zero_std', 0.02, 'not set'),
    ):
        other = build(EstimatorConfig, {'continue_from': str(path), name: value})
        with pytest.raises(ParameterError, match=f'was made with {name} {differ}, this run has'):
            read_continuation(other, URDF)
    parameters['known_joints.joint4.zero_std'] = 0.02
    written()
    with pytest.raises(ParameterError, match=r'with known_joints.joint4.zero_std 0.02, this run has not set'):
        read_continuation(config, URDF)
    written(continuation=None)
    with pytest.raises(ParameterError, match='cannot be continued'):
        read_continuation(config, URDF)


def test_a_run_goes_on_with_a_calibration_of_the_same_contents_alone(
    runs: tuple[Estimate, Estimate, Estimate, Continuation], tmp_path: Path
) -> None:
    path, *files = (tmp_path / name for name in ('run.json', 'first', 'copy', 'other'))
    for file, text in zip(files, ('{"a": 1}', '{"a": 1}', '{"a": 2}'), strict=True):
        file.write_text(text, encoding='utf-8')
    first, copy, other = (
        build(EstimatorConfig, {'continue_from': str(path), 'known_links.calibration': str(file)}) for file in files
    )
    left = continuation_as_json(runs[-1], URDF, str(files[0]))
    content = {'continuation': left, 'made_by': {'parameters': json.loads(json.dumps(values_of(first)))}}
    path.write_text(json.dumps(content), encoding='utf-8')
    for config in (first, copy):
        assert read_continuation(config, URDF) is not None
    with pytest.raises(ParameterError, match=r'made with a known_links\.calibration of other contents than'):
        read_continuation(other, URDF)
    with pytest.raises(ParameterError, match=r'was made with known_links\.calibration'):
        read_continuation(build(EstimatorConfig, {'continue_from': str(path)}), URDF)
    files[0].write_text('{"a": 3}', encoding='utf-8')  # calibrated again, in the same place
    with pytest.raises(ParameterError, match='other contents'):
        read_continuation(first, URDF)
    assert 'calibration' not in continuation_as_json(runs[-1], URDF)


@pytest.mark.parametrize(('numbers', 'reported'), [(3, True), (6, False)])
def test_a_force_in_a_plane_is_compared_with_as_many_numbers_as_it_has(numbers: int, reported: bool) -> None:
    """A chi-square of 34 is rarer than once in a million of three numbers, not of six."""
    force = np.append(np.sqrt(34.0), np.zeros(5))
    distribution: Any = SimpleNamespace(
        force=force,
        force_factor=np.eye(6)[:, :numbers],
        gaussian=SimpleNamespace(size=20 + numbers),
        variables=SimpleNamespace(scale=np.ones(20)),
    )
    filtered: Any = SimpleNamespace(hypothesis=SimpleNamespace(force='inertial'))
    assert [event.kind for event in forces(filtered, distribution)] == ['ramp'] * reported


@pytest.mark.long
def test_runs_that_add_up_are_as_sure_as_they_say() -> None:
    """Of six robots the errors of continued runs are chi-square, ten numbers each."""
    found = []
    for seed in range(10, 16):
        first, second = halves(seed)
        begun, kernel = made()
        begun.update(first, 0)
        found.append(nees(made(left_by(begun))[0].update(second, 0)[-1], true_body(kernel)))
    assert 30.0 < sum(found) < 110.0, found


@dataclass(frozen=True)
class Following:
    """Variables of a run, with a target that is tracked or without."""

    tracked: object


def about(momentum: Array, origin: Array) -> Array:
    """Return a momentum (6,) about a point, from that about the odometry's origin."""
    return np.concatenate((momentum[:3], momentum[3:] - np.cross(origin, momentum[:3])))


def test_a_start_is_before_known_thrust_and_about_the_run_s_origin() -> None:
    """Moments of inertia that a planar motion leaves open are the largest known one, all else that is open zero."""
    layout = Layout.from_unknowns(kernel('servicer7'), ())
    momentum, thrust, origin, body = generic(0, 6), generic(1, 6), generic(2, 3), true_body(layout.kernel)
    whole = Estimate('', 'estimating', parameters=body, identifiable=np.ones(10, dtype=bool), momentum=momentum)
    for estimate in (whole, whole.after_thrust(thrust)):
        point = _point_of(estimate, layout, origin)
        assert point.parameters == pytest.approx(np.concatenate((about(momentum, origin), standard(body))))
    planar = np.isin(np.arange(10), [0, 1, 2, 9])
    open_ones = np.where(np.arange(6) % 2 == 0, momentum, np.nan)
    part = Estimate(
        '', 'estimating', parameters=np.where(planar, body, np.nan), identifiable=planar, momentum=open_ones
    )
    ball = np.array([*body[:3], 0.0, body[9], 0.0, 0.0, body[9], 0.0, body[9]])
    expected = np.concatenate((about(np.nan_to_num(open_ones), origin), standard(ball)))
    assert _point_of(part, layout, origin).parameters == pytest.approx(expected)


@pytest.mark.parametrize('count', [0, 3, 4])
def test_jumps_are_changes_that_no_constant_force_explains(count: int) -> None:
    """About the odometry's origin, and pulses unless there are too many."""
    force, start, sizes, origin = generic(0, 6), generic(1, 6), generic(2, 4, 6)[:count], generic(3, 3)
    times = 2.0 + 1.5 * np.arange(count)
    made: Any = [
        SimpleNamespace(time=time, before=start + time * force + sizes[:place].sum(axis=0), force_impulse=time)
        for place, time in enumerate(times)
    ]
    mean = np.zeros(MOMENTUM.stop)
    mean[MOMENTUM] = start + 11.0 * force + sizes.sum(axis=0)
    distribution: Any = SimpleNamespace(mean=mean, impulse_of_force=lambda seconds: seconds * force)
    filtered: Any = SimpleNamespace(jumps=made, force_impulse=11.0)
    found = jumps(filtered, distribution, origin)
    assert [each.time for each in found] == times.tolist()
    assert {each.cause for each in found} == ({PULSE if count < 4 else SYMPTOM} if count else set())
    for event, size in zip(found, sizes, strict=True):
        assert about(np.concatenate((event.linear, event.angular)), origin) == pytest.approx(size)


@pytest.mark.parametrize(
    ('axes', 'size', 'reported'),
    [('none', 9.0, False), ('inertial', 2.5, False), ('inertial', 2.6, True), ('body', 9.0, True)],
)
def test_a_constant_force_is_reported_if_it_is_significant(axes: Axes, size: float, *, reported: bool) -> None:
    """By a chance of one in a million: a chi-square of 38.3 of six numbers, 2.53 standard deviations of each."""
    factor = generic(0, 6, 6)
    force = size * factor @ np.ones(6)
    filtered: Any = SimpleNamespace(hypothesis=SimpleNamespace(force=axes))
    numbers = {'gaussian': SimpleNamespace(size=26), 'variables': SimpleNamespace(scale=np.ones(20))}
    distribution: Any = SimpleNamespace(force=force, force_factor=factor, **numbers)
    found = forces(filtered, distribution)
    assert [(each.kind, each.time) for each in found] == [('ramp', 0.0)] * reported
    for event in found:
        assert np.concatenate((event.linear, event.angular)) == pytest.approx(force)


@pytest.mark.parametrize(
    ('name', 'before', 'planar'),
    [('table1', None, True), ('table1', True, True), ('table1', False, False), ('servicer7', None, False)],
)
def test_a_run_is_planar_where_the_robot_and_the_run_before_are(name: str, before: bool | None, planar: bool) -> None:
    earlier: Any = None if before is None else SimpleNamespace(planar=before)
    unknowns: Any = tuple(SimpleNamespace(tilt=tilt) for tilt in (0.0, 0.02, 0.01))
    settings = TrajectorySettings(MID, 0.5, 20, Declared(unknowns), (UNDISTURBED,), before=earlier)
    reporting: Any = None
    plane = TrajectoryEstimator(kernel(name), settings, reporting)._plane
    assert plane.planar is planar
    assert plane._tilt == 0.02  # of that which may be tilted most


def test_passive_joints_are_as_declared_where_unresolved_or_between_base_and_target() -> None:
    model = load_model(with_panels())
    joints = (*(model.joint_names.index(name) for name in PANELS), model.joint_names.index('joint3'))
    declared = Springs(joints, np.full(3, 2.0), np.full(3, 0.01), np.zeros((2, 3)))
    layout = Layout.from_unknowns(MomentumKernel(model, 'link7').with_springs(declared), ())
    run: Any = SimpleNamespace(resolved=np.array([True, False, True]), deflections=np.zeros((3, 3)))
    size = layout.size
    distribution: Any = SimpleNamespace(mean=np.zeros(size), unknowns_covariance=np.zeros((0, 0)))
    method: Any = SimpleNamespace(_layout=layout)
    found = TrajectoryEstimator._flexible(method, run, distribution)
    assert [each.resolved for each in found] == [True, False, False]


@pytest.mark.parametrize(
    ('now', 'expected'),
    [
        ({}, 'run'),
        ({'contradicts': True}, 'all, without the target'),
        ({'moved': 2 * FIRST}, 'all, without the target'),  # it leads nowhere with it
        ({'moved': 2 * FIRST - 1}, 'run'),
        ({'moved': FIRST, 'grasp_known': True}, 'all, without the target'),
        ({'moved': 2 * FIRST, 'converged': True}, 'run'),
        ({'tracked': False, 'contradicts': True, 'moved': 2 * FIRST}, 'run'),
        ({'change': 'slip'}, 'after slip'),
        ({'change': 'slip', 'wrong_twist': 'late'}, 'after slip'),
        ({'wrong_twist': 'late'}, 'all, part of each'),
        ({'wrong_twist': 'late', 'known': 'late'}, 'run'),
    ],
)
def test_a_run_goes_on_unless_target_or_twist_are_wrong(now: dict[str, Any], expected: str) -> None:
    tracked = SimpleNamespace(grasp_known=now.get('grasp_known', False)) if now.get('tracked', True) else None
    run = SimpleNamespace(planar=True, contradicts_target=now.get('contradicts', False))
    run.converged = now.get('converged', False)
    method: Any = SimpleNamespace(
        run=run,
        _plane=SimpleNamespace(planar=True),
        _variables=Following(tracked),
        _moved=now.get('moved', 0),
        _left_out='',
        _wrong_twist=now.get('known', ''),
        _isolation=SimpleNamespace(
            change=now.get('change'),
            wrong_twist=now.get('wrong_twist', ''),
            windows_since=lambda time: ['all'] if time == -np.inf else [],
        ),
        _usable_part=lambda window: f'{window}, part of each',
        _run_after=lambda _, change: f'after {change}',
        _new_run=lambda windows: (
            windows[0] + ('' if method._variables.tracked or not tracked else ', without the target')
        ),
    )
    found: Any = TrajectoryEstimator._current_run(method)
    assert found is method.run
    assert found is run if expected == 'run' else found == expected
    assert bool(method._left_out) is expected.endswith('the target')
    assert method._wrong_twist == ('late' if expected.endswith('each') else now.get('known', ''))


@pytest.mark.parametrize(
    ('state', 'hypothesis', 'jumps', 'delay', 'disturbed'),
    [
        (True, False, (), False, False),
        (True, True, (), False, True),
        (True, False, ('jump',), False, True),
        (True, False, (), True, True),
        (False, True, ('jump',), True, False),
    ],
)
def test_a_run_is_disturbed_by_a_force_a_jump_or_late_joints(
    state: bool, hypothesis: bool, jumps: tuple[str, ...], delay: bool, disturbed: bool
) -> None:
    best = SimpleNamespace(hypothesis=SimpleNamespace(disturbed=hypothesis), jumps=jumps)
    reporting: Any = None
    method = TrajectoryEstimator(kernel('table1'), TrajectorySettings(MID, 0.5, 20, Declared(), ()), reporting)
    assert not method.disturbed
    run: Any = SimpleNamespace(has_state=state, best=best, has_joint_delay=delay, converged=True)
    method.run = run
    assert method.disturbed is disturbed
    assert method.settled is state
