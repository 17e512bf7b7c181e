"""What disturbs a run: found, named and allowed for, or warned of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.stats import chi2

from floating import DEFAULT, errors, float_freely, follow, make, normalised, pushing, true_momentum
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model_errors import body_sizes
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.simulation import Truth
from observed import HIGH, MID, estimator, kernel, observe, windows

SECONDS = 20.0
FORCE_TORQUE = np.array([0.012, -0.010, 0.011, -0.006, 0.005, 0.006])  # N, N m
PULSE = np.array([0.6, -0.6, 0.5, 0.3, 0.25, -0.3])  # N s, N m s
PULSED = 12.2  # s
LATE = 0.005  # s
# Ten parameters, one run in a thousand.
LIMIT = float(chi2.isf(1e-3, 10))


@pytest.fixture(scope='module')
def robot() -> MomentumKernel:
    return kernel('servicer7')


@pytest.fixture(scope='module')
def momentum(robot: MomentumKernel, servicer: Truth) -> Array:
    return true_momentum(robot, observe(servicer[:1], MID))[0]


def test_the_two_simulations_agree(robot: MomentumKernel, servicer: Truth, joints: Sinusoids, momentum: Array) -> None:
    free = float_freely(robot, joints, momentum, 5.0)
    # Lagrangian dynamics and conserved momentum: the same motion, to the integrators' errors.
    assert free.base_position == pytest.approx(servicer.base_position[: len(free)], abs=1e-9)


@pytest.mark.parametrize('known', [0.0, 0.05])
def test_a_pulse(robot: MomentumKernel, joints: Sinusoids, momentum: Array, known: float) -> None:
    """Also where the linear momentum was known at first: the pulse is as large as any."""
    truth = float_freely(robot, joints, momentum, SECONDS, pulse=(PULSED, PULSE))
    following = make(robot, MID, adapt=True, uncertainty=replace(DEFAULT, linear_momentum=known))
    last = following.update(windows(observe(truth, MID, 4)), 0)[-1]
    (event,) = last.events
    assert event.kind == 'step'
    assert PULSED - 0.5 <= event.time <= PULSED + 0.5
    # A twentieth of a kilogram-metre a second: three standard deviations of a momentum known from a few seconds.
    assert event.linear == pytest.approx(PULSE[:3], abs=0.15)
    assert event.angular == pytest.approx(PULSE[3:], abs=0.15)
    assert normalised(last, robot) < LIMIT
    assert last.status in {'estimating', 'converged'}


@pytest.mark.parametrize('axes', ['inertial', 'body'])
def test_a_constant_force_on_the_base(robot: MomentumKernel, joints: Sinusoids, momentum: Array, axes: str) -> None:
    truth = float_freely(robot, joints, momentum, SECONDS, push=pushing(FORCE_TORQUE, axes))
    following = make(robot, MID, adapt=True)
    last = following.update(windows(observe(truth, MID, 5)), 0)[-1]
    assert any(
        f'constant force or torque acts, in {"base" if axes == "body" else axes} axes' in x for x in last.warnings
    )
    assert normalised(last, robot) < LIMIT
    assert [event.kind for event in last.events] == ['ramp']
    run = following._runs.run
    assert run is not None
    moments = run.moments()
    error = moments.force - FORCE_TORQUE
    covariance = moments.force_factor @ moments.force_factor.T
    assert float(error @ np.linalg.solve(covariance, error)) < chi2.isf(1e-3, 6)
    assert np.array_equal(np.concatenate((last.events[0].linear, last.events[0].angular)), moments.force)
    # Without the hypothesis the force is taken for inertia.
    assert normalised(follow(robot, observe(truth, MID, 5), MID)[-1], robot) > 2.0 * LIMIT


@pytest.mark.parametrize('axes', ['inertial', 'body'])
def test_a_pulse_is_told_without_what_a_constant_force_brings(
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


def test_a_force_that_is_declared_contends_with_nothing_that_is_declared_of_the_robot(
    robot: MomentumKernel, joints: Sinusoids, momentum: Array
) -> None:
    """No run without the force is followed then, so that what it gains over one cannot be told."""
    truth = float_freely(robot, joints, momentum, SECONDS, push=pushing(FORCE_TORQUE, 'body'))
    told = {'disturbance__constant': 'body', 'known_links__relative_std': 1e-4, 'known_joints__zero_std': 1e-4}
    run = estimator(robot, MID, method='trajectory', **told)
    last = run.update(windows(observe(truth, MID, 5)), 0)[-1]
    assert last.status in {'estimating', 'converged'}
    assert normalised(last, robot) < LIMIT


def test_an_odometry_position_that_drifts(robot: MomentumKernel, servicer: Truth) -> None:
    walk = np.cumsum(1e-4 * np.random.default_rng(7).normal(size=(len(servicer), 3)), axis=0)
    samples = observe(servicer, MID, 6)
    samples = replace(samples, base_position=samples.base_position + walk)
    last = follow(robot, samples, MID, adapt=True)[-1]
    assert any('odometry position drifts' in warning for warning in last.warnings)
    assert normalised(last, robot) < LIMIT
    assert not last.events


@pytest.mark.parametrize('seed', [1, 2, 3])
def test_an_odometry_position_that_drifts_beside_poor_encoders(
    robot: MomentumKernel, servicer: Truth, seed: int
) -> None:
    """Rows are full of noise then: the start must not take what drifts for that."""
    walk = np.cumsum(1e-4 * np.random.default_rng(seed).normal(size=(len(servicer), 3)), axis=0)
    samples = observe(servicer, HIGH, seed)
    samples = replace(samples, base_position=samples.base_position + walk)[: int(np.searchsorted(samples.time, 13.0))]
    told = [each for each in follow(robot, samples, HIGH, adapt=True) if each.std[0] > 0.0]
    assert len(told) > 8
    assert any('odometry position drifts' in warning for warning in told[-1].warnings)
    assert normalised(told[-1], robot) < LIMIT


def test_nothing_disturbs_an_undisturbed_run(robot: MomentumKernel, servicer: Truth) -> None:
    last = follow(robot, observe(servicer, MID, 8), MID, adapt=True)[-1]
    assert not last.warnings
    assert not last.events


def test_joints_that_are_late(robot: MomentumKernel, servicer: Truth) -> None:
    curve = CubicSpline(servicer.time, servicer.joint_position)
    late = replace(servicer, joint_position=curve(servicer.time - LATE))
    last = follow(robot, observe(late, MID, 7), MID)[-1]
    assert abs(last.time_offset - LATE) < 3.0 * last.time_offset_std
    assert last.time_offset_std < 2e-4
    assert normalised(last, robot) < LIMIT


def test_known_bodies_that_are_a_little_wrong(robot: MomentumKernel, servicer: Truth) -> None:
    rng = np.random.default_rng(8)
    change = np.array([0.01 * rng.normal(size=10) * body_sizes(x) if x[0] > 0.0 else np.zeros(10) for x in robot.known])
    wrong = robot.corrected(change)
    samples = observe(servicer, MID, 8)
    exact, allowed = (follow(wrong, samples, MID, known_std=deviation)[-1] for deviation in (0.0, 0.01))
    assert normalised(allowed, robot) < LIMIT
    assert allowed.status in {'estimating', 'converged'}
    # Taken for exact they lead astray, which shows.
    assert np.linalg.norm(errors(exact, robot)) > np.linalg.norm(errors(allowed, robot))
    assert exact.status == 'inconsistent'
    assert any('does not explain the data' in warning for warning in exact.warnings)


@pytest.mark.parametrize('axes', ['inertial', 'body'])
def test_exact_data_give_the_exact_force(robot: MomentumKernel, joints: Sinusoids, momentum: Array, axes: str) -> None:
    """The momentum that a force adds is followed so closely that the errors stay far below the noise's."""
    truth = float_freely(robot, joints, momentum, SECONDS, push=pushing(FORCE_TORQUE, axes))
    following = make(robot, MID, adapt=True)
    last = following.update(windows(observe(truth, MID)), 0)[-1]
    assert last.events[0].kind == 'ramp'
    assert np.all(np.abs(errors(last, robot)) < 0.02 * last.std)


def test_a_force_that_only_linearisation_speaks_for_is_not_believed(plane: Truth) -> None:
    # Encoders so poor that for this draw a force that fits worse, at a body of a third of the mass, has the larger
    # likelihood: what is linearised there leaves less room for errors.
    planar = kernel('table1')
    last = follow(planar, observe(plane, HIGH, 16_834_525_784_445_026_308), HIGH, adapt=True)[-1]
    assert not last.events
    assert last.parameters[0] == pytest.approx(physical(planar.target.parameters)[0], abs=5.0 * last.std[0])
