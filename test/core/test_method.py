"""The trajectory filter from a cold start, within its covariance, and a run that goes on from an earlier one."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from checked import some
from floating import errors, follow, normalised, true_momentum
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.filter.posterior import Continuation
from mbaid_ros.core.method import forces
from mbaid_ros.core.pipeline import Estimator
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.state import Declared
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
