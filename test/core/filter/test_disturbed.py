"""What disturbs a run of the filter: found, named and allowed for, or warned of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.stats import chi2

from benchmarks.frame import PUBLISHED
from checked import some
from floating import DEFAULT, float_freely, follow, make, normalised, pushing, true_momentum
from mbaid_ros.core.diagnosis.isolation import CandidateCause, CandidateCauses, Change, IsolationResult
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.innovations import Innovations
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.simulation import Truth
from mbaid_ros.tasks import Work
from observed import HIGH, LIMIT, MID, estimator, kernel, observe, true_body, windows
from servicers import capture
from unchanged import Unchanged

SECONDS = 20.0
FORCE_TORQUE = np.array([0.012, -0.010, 0.011, -0.006, 0.005, 0.006])  # N, N m
PULSE = np.array([0.6, -0.6, 0.5, 0.3, 0.25, -0.3])  # N s, N m s
PULSED = 12.2  # s
LATE = 0.005  # s


@pytest.fixture(scope='module')
def momentum(robot: MomentumKernel, servicer: Truth) -> Array:
    return true_momentum(robot, observe(servicer[:1], MID))[0]


@pytest.mark.parametrize('known', [0.05, pytest.param(0.0, marks=pytest.mark.long)])
def test_a_pulse(robot: MomentumKernel, joints: Sinusoids, momentum: Array, known: float, unchanged: Unchanged) -> None:
    """Also where the linear momentum was known at first: the pulse is as large as any."""
    truth = float_freely(robot, joints, momentum, SECONDS, pulse=(PULSED, PULSE))
    following = make(robot, MID, adapt=True, declared=replace(DEFAULT, linear_momentum=known))
    last = unchanged.course(following.update(windows(observe(truth, MID, 4)), 0))
    (event,) = last.events
    assert event.kind == 'step'
    assert PULSED - 0.5 <= event.time <= PULSED + 0.5
    # A twentieth of a kilogram-metre a second: three standard deviations of a momentum known from a few seconds.
    assert event.linear == pytest.approx(PULSE[:3], abs=0.15)
    assert event.angular == pytest.approx(PULSE[3:], abs=0.15)
    assert normalised(last, robot) < LIMIT
    assert last.status in {'estimating', 'converged'}


NAMED = {
    'inertial': 'in inertial axes, at the common centre of mass',
    'inertial on the base': 'in inertial axes, on the base',
    'body': 'in base axes',
}


@pytest.mark.parametrize(
    'axes', ['inertial on the base', *(pytest.param(axes, marks=pytest.mark.long) for axes in ('inertial', 'body'))]
)
def test_a_constant_force(
    robot: MomentumKernel, joints: Sinusoids, momentum: Array, axes: str, unchanged: Unchanged
) -> None:
    start = momentum * np.repeat((axes != 'inertial', True), 3)  # else the centre of mass moves
    wrench = FORCE_TORQUE * (4.0 if axes == 'inertial on the base' else 1.0)  # weak ones act as at the centre of mass
    truth = float_freely(robot, joints, start, SECONDS, push=pushing(wrench, axes))
    following = make(robot, MID, adapt=True)
    last = unchanged.course(following.update(windows(observe(truth, MID, 5)), 0))
    assert any(f'constant force or torque acts, {NAMED[axes]}' in each for each in last.warnings)
    assert normalised(last, robot) < LIMIT
    assert [event.kind for event in last.events] == ['ramp']
    run = some(following.run)
    distribution = run.distribution()
    error = distribution.force - wrench
    covariance = distribution.force_factor @ distribution.force_factor.T
    known = slice(0, 3 if axes == 'inertial' else 6)  # the torque there is about the centre of mass
    error, covariance = error[known], covariance[known, known]
    assert float(error @ np.linalg.solve(covariance, error)) < chi2.isf(1e-3, len(error))
    assert np.array_equal(np.concatenate((last.events[0].linear, last.events[0].angular)), distribution.force)


@pytest.mark.parametrize(
    'declared',
    [{'disturbance__constant': 'inertial'}, pytest.param({'disturbance__force_std': 10.0}, marks=pytest.mark.long)],
)
def test_a_tilted_table_determines_no_more_than_a_level_one(
    robot: MomentumKernel, servicer: Truth, declared: dict[str, str | float]
) -> None:
    """In a frame that falls along nothing acts: the same noise gives the same numbers and intervals."""
    level = observe(servicer, MID, 4)
    time, acceleration = level.time[:, None], np.array([6e-3, -4e-3, 0.0])
    slid = replace(
        level,
        base_position=level.base_position + 0.5 * time**2 * acceleration,
        base_linear_velocity=level.base_linear_velocity + time * acceleration,
    )
    given: dict[str, object] = {'known_links__relative_std': 0.01, 'disturbance__axes': 'inertial', **declared}
    found = [
        estimator(robot, MID, method='trajectory', **given).update(windows(samples), 0)[-1] for samples in (level, slid)
    ]
    assert [each.status for each in found] == ['estimating'] * 2
    # Corrections for nonlinearity differ, of moments of inertia most.
    assert found[1].std[:4] == pytest.approx(found[0].std[:4], rel=0.1)
    assert np.all(found[1].std > 0.8 * found[0].std)
    assert np.all(np.abs(found[1].parameters - found[0].parameters) < found[1].std)


@pytest.mark.long
@pytest.mark.parametrize('axes', ['inertial', 'body'])
def test_a_pulse_is_reported_without_the_momentum_of_a_constant_force(
    robot: MomentumKernel, joints: Sinusoids, momentum: Array, axes: str
) -> None:
    force = 4.0 * FORCE_TORQUE
    truth = float_freely(robot, joints, momentum, 30.0, push=pushing(force, axes), pulse=(PULSED, PULSE))
    last = estimator(robot, MID, method='trajectory', disturbance__constant=axes).update(
        windows(observe(truth, MID, 4)), 0
    )[-1]
    events = {event.kind: event for event in last.events}
    assert set(events) == {'ramp', 'step'}
    # The force alone brings .9 N s in the 18 s that follow.
    assert events['step'].linear == pytest.approx(PULSE[:3], abs=0.15)
    assert events['step'].angular == pytest.approx(PULSE[3:], abs=0.3)


@pytest.mark.long
def test_a_force_that_is_declared_contends_with_nothing_that_is_declared_of_the_robot(
    robot: MomentumKernel, joints: Sinusoids, momentum: Array
) -> None:
    """No run without the force is followed then, so its gain over one is not known."""
    truth = float_freely(robot, joints, momentum, SECONDS, push=pushing(FORCE_TORQUE, 'body'))
    reported = {'disturbance__constant': 'body', 'known_links__relative_std': 1e-4, 'known_joints__zero_std': 1e-4}
    run = estimator(robot, MID, method='trajectory', **reported)
    last = run.update(windows(observe(truth, MID, 5)), 0)[-1]
    assert last.status in {'estimating', 'converged'}
    assert normalised(last, robot) < LIMIT


@pytest.mark.parametrize('seed', [1, *(pytest.param(seed, marks=pytest.mark.long) for seed in (2, 3))])
def test_an_odometry_position_that_drifts_beside_poor_encoders(
    robot: MomentumKernel, servicer: Truth, seed: int
) -> None:
    """Rows are full of noise then: the start must not take what drifts for that."""
    walk = np.cumsum(1e-4 * np.random.default_rng(seed).normal(size=(len(servicer), 3)), axis=0)
    samples = observe(servicer, HIGH, seed)
    samples = replace(samples, base_position=samples.base_position + walk)[: int(np.searchsorted(samples.time, 13.0))]
    reported = [each for each in follow(robot, samples, HIGH, adapt=True) if each.std[0] > 0.0]
    assert len(reported) > 8
    assert any('odometry position drifts' in warning for warning in reported[-1].warnings)
    assert normalised(reported[-1], robot) < LIMIT


def test_nothing_disturbs_an_undisturbed_run(robot: MomentumKernel, servicer: Truth) -> None:
    last = follow(robot, observe(servicer[:1200], MID, 8), MID, adapt=True)[-1]
    assert not last.warnings
    assert not last.events


def test_joints_that_are_late(robot: MomentumKernel, servicer: Truth, unchanged: Unchanged) -> None:
    curve = CubicSpline(servicer.time, servicer.joint_position)
    late = replace(servicer, joint_position=curve(servicer.time - LATE))
    last = unchanged.course(follow(robot, observe(late, MID, 7), MID))
    assert abs(last.time_offset - LATE) < 3.0 * last.time_offset_std
    assert last.time_offset_std < 2e-4
    assert normalised(last, robot) < LIMIT


CAUGHT, END = 12.0, 28.0  # s
VELOCITY, SPIN = np.array([0.004, -0.006, 0.003]), np.array([0.02, -0.03, 0.015])  # m/s, rad/s


def change_at_the_first_jump(
    _self: object, _windows: object, _point: object, jumps: Sequence[float], *_: str
) -> Work[IsolationResult]:
    """Return that another body is in the grasp, as a search finds within seconds."""
    yield 1
    cause = CandidateCause('another body', 1e4, change=Change(jumps[0], exchanged=True))
    return IsolationResult((cause,), Innovations.none(('odom',)))


@cache
def history(searched: bool) -> list[Estimate]:
    truth = capture(CAUGHT, END - CAUGHT, VELOCITY, SPIN).truth
    with pytest.MonkeyPatch.context() as patch:
        if not searched:
            patch.setattr(CandidateCauses, 'isolate', change_at_the_first_jump)
        return estimator(kernel('servicer7'), MID, method='trajectory').update(windows(observe(truth, MID, 1)), 0)


SEARCHED = pytest.mark.parametrize('searched', [False, pytest.param(True, marks=pytest.mark.long)])


@SEARCHED
def test_a_second_body_in_the_grasp_is_reported_and_identified(searched: bool, unchanged: Unchanged) -> None:
    last = unchanged.course(history(searched))
    (event,) = last.events
    assert event.kind == 'target_changed'
    assert event.time == pytest.approx(CAUGHT, abs=0.5)
    assert 'another body' in event.cause
    assert last.status in PUBLISHED
    assert np.all(np.abs(last.parameters - true_body(kernel('servicer7'))) < 4.0 * last.std)


@SEARCHED
def test_what_is_in_the_grasp_then_is_never_published_as_what_was_before(searched: bool) -> None:
    since = [
        estimate for estimate in history(searched) if estimate.time > CAUGHT + 0.5 and estimate.status in PUBLISHED
    ]
    assert since
    for estimate in since:
        assert np.abs(estimate.parameters[0] - true_body(kernel('servicer7'))[0]) < 5.0 * estimate.std[0]
