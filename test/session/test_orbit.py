"""Runs in orbit, from the simulator's messages to estimates: as good as anywhere else, in whatever frame."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.config.simulator_parameters import SimulatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import build
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_robot import make_simulation
from mbaid_ros.simulated_run import SimulatedRun
from mbaid_ros.simulation.simulation import total_momentum
from observed import LIMIT, nees
from sessions import AWAY, URDF, declared, history, identify, session, simulated
from unchanged import Unchanged

SECONDS = 30.0
LONG = pytest.mark.long
ECCENTRIC: dict[str, object] = {'orbit.eccentricity': 0.3, 'orbit.true_anomaly': 1.0}
FAST = 0.005  # rad/s: four times the mean motion of a low orbit, so that half a minute is enough


def given(parameters: dict[str, object]) -> dict[str, object]:
    return {name.replace('.', '__'): value for name, value in parameters.items()}


def momentum_now(run: SimulatedRun) -> Array:
    """Return the true momentum at the end of the run, in the frame that falls along."""
    simulation = make_simulation(run.config, run.robot)
    return total_momentum(run.robot, simulation.advance(np.array([0.0, SECONDS - 0.05])))[-1]


def within(estimate: Estimate, run: SimulatedRun) -> bool:
    off = estimate.momentum - momentum_now(run)
    return float(off @ np.linalg.solve(estimate.momentum_covariance, off)) < chi2.isf(1e-4, 6)


@pytest.mark.parametrize(
    ('frame', 'method'),
    [
        ('lvlh', 'trajectory'),
        ('inertial', 'difference'),
        *(pytest.param(*each, marks=LONG) for each in (('lvlh', 'difference'), ('inertial', 'trajectory'))),
        *(pytest.param('hill', method, marks=LONG) for method in ('difference', 'trajectory')),
    ],
)
def test_intervals_hold(frame: str, method: str, unchanged: Unchanged) -> None:
    around = given(declared(frame, FAST) | (ECCENTRIC if frame == 'hill' else {}))
    run = simulated(SECONDS, initial__base_position=AWAY, **around)
    into = session(method=method, **around)
    last = identify(run, into)
    unchanged(last)
    assert last.status in {'estimating', 'converged'}
    assert not last.events
    assert nees(last, run.target_inertia) < LIMIT
    # The momentum that is reported is that of now, in inertial axes; that of the begin is another one.
    assert within(last, run)
    off = last.momentum - run.momentum
    assert float(off @ np.linalg.solve(last.momentum_covariance, off)) > chi2.isf(1e-12, 6)


def test_a_gyro_is_inertial_in_a_frame_that_turns() -> None:
    around = given(declared('lvlh', FAST))
    run = simulated(SECONDS, initial__base_position=AWAY, orbit__twist='inertial', **around)
    right = identify(run, session(method='difference', orbit__twist='inertial', **around))
    assert right.status in {'estimating', 'converged'}
    assert nees(right, run.target_inertia) < LIMIT


@pytest.mark.parametrize(
    ('frame', 'method'),
    [
        ('lvlh', 'difference'),
        *(pytest.param(frame, 'trajectory', marks=LONG) for frame in ('lvlh', 'inertial', 'hill')),
    ],
)
def test_without_the_parameter_it_is_no_quiet_error(frame: str, method: str) -> None:
    run = simulated(SECONDS, initial__base_position=AWAY, **given(declared(frame, FAST)))
    last = identify(run, session(method=method))
    assert last.status == 'inconsistent' or last.events


@pytest.mark.parametrize('place', [pytest.param([0.0, 0.0, 0.0], marks=LONG), AWAY])
def test_a_gravity_gradient_that_is_not_declared_is_reported(place: list[float], unchanged: Unchanged) -> None:
    """In a frame that does not turn it may be too small to contradict anything: it is estimated along."""
    run = simulated(SECONDS, initial__base_position=place, **given(declared('inertial', 0.5 * FAST)))
    last = identify(run, session(orbit__undeclared_rate=0.5 * FAST))
    unchanged(last)
    assert last.status == 'inconsistent'
    assert nees(last, run.target_inertia) < LIMIT
    assert 'set orbit.mean_motion' in last.causes[0][0]
    assert any('set orbit.mean_motion' in warning for warning in last.warnings)


@LONG
@pytest.mark.parametrize('place', [[0.0, 0.0, 0.0], AWAY])
def test_intervals_of_the_difference_form_allow_for_one(place: list[float]) -> None:
    run = simulated(SECONDS, initial__base_position=place, **given(declared('inertial', 0.5 * FAST)))
    last = identify(run, session(method='difference', orbit__undeclared_rate=0.5 * FAST))
    assert last.status in {'estimating', 'converged'}
    assert nees(last, run.target_inertia) < LIMIT


@LONG
@pytest.mark.parametrize('frame', ['lvlh', 'inertial', 'hill'])
def test_an_orbit_that_is_no_circle_where_one_is_declared(frame: str) -> None:
    around = given(declared(frame, FAST))
    eccentric: dict[str, object] = {'orbit__eccentricity': 0.015, 'orbit__true_anomaly': 1.0}
    run = simulated(SECONDS, initial__base_position=AWAY, **around, **eccentric)
    last = identify(run, session(orbit__undeclared_eccentricity=0.02, **around))
    assert last.status in {'estimating', 'converged'}
    assert not last.events
    assert nees(last, run.target_inertia) < LIMIT
    assert within(last, run)
    assert last.budget is not None
    assert 'orbit shape' in last.budget.causes
    again = simulated(SECONDS, initial__base_position=AWAY, **around, **eccentric)
    certain = identify(again, session(**around))
    assert certain.status == 'inconsistent' or certain.events or nees(certain, run.target_inertia) > LIMIT


@LONG
def test_a_gravity_gradient_that_has_turned_too_far_is_no_quiet_error() -> None:
    """In half a minute it turns by 0.6 rad: that is no longer a change at a constant rate."""
    run = simulated(SECONDS, initial__base_position=AWAY, **given(declared('inertial', 2.0 * FAST)))
    reported = history(run, session(orbit__undeclared_rate=2.0 * FAST))
    late = {each.status for each in reported if each.time > 0.5 * SECONDS}
    # Which of the two it ends with is a matter of when the latest search has led to nothing that stays.
    assert 'inconsistent' in late
    assert late <= {'inconsistent', 'not_identifiable'}
    # A search that is under way has no causes yet.
    assert 'set orbit.mean_motion' in next(each.causes[0][0] for each in reversed(reported) if each.causes)


@LONG
def test_no_orbit_is_none() -> None:
    run = simulated(SECONDS)
    last = identify(run, session(orbit__undeclared_rate=0.5 * FAST))
    assert last.status in {'estimating', 'converged'}
    assert nees(last, run.target_inertia) < LIMIT
    assert not last.causes


@LONG
def test_the_epoch_is_a_stamp() -> None:
    """Ten seconds after the directions were as given, they have turned by a twentieth."""
    around = given(declared('inertial', FAST))
    run = simulated(SECONDS, initial__base_position=AWAY, **around)
    run.start = 1_000_000_000_000
    right = session(method='difference', orbit__epoch=1000.0, **around)
    assert nees(identify(run, right), run.target_inertia) < LIMIT
    again = simulated(SECONDS, initial__base_position=AWAY, **around)
    again.start = 1_000_000_000_000
    wrong = identify(again, session(method='difference', orbit__epoch=700.0, **around))
    assert wrong.status == 'inconsistent' or nees(wrong, run.target_inertia) > LIMIT


@pytest.mark.parametrize(
    ('parameters', 'named'),
    [
        ({'orbit.mean_motion': 1e-3}, "'orbit.nadir' is empty"),
        ({'orbit.mean_motion': 1e-3, 'orbit.nadir': [0.0, 0.0, 1.0]}, "'orbit.normal' is empty"),
        ({'orbit.mean_motion': 1e-3, 'orbit.nadir': [0.0, 0.0, 1.0], 'orbit.normal': [0.0, 1.0, 1.0]}, 'right angles'),
        ({'orbit.mean_motion': 1e-3, 'orbit.frame': 'lvlh', 'orbit.nadir': [0.0, 0.0, 1.0]}, 'which has its own'),
    ],
)
def test_orbits_that_cannot_be(parameters: dict[str, object], named: str) -> None:
    with pytest.raises(ParameterError, match=named):
        Session(build(EstimatorConfig, parameters), URDF)
    with pytest.raises(ParameterError, match=named):
        SimulatedRun(build(SimulatorConfig, parameters), URDF, BAG_TYPES)


@LONG
def test_a_capture() -> None:
    """What the captured body had before, in a run that the orbit changes the momentum of all the time."""
    around, time = given(declared('lvlh', FAST) | ECCENTRIC), 20.0
    body = {
        'capture__time': time,
        'capture__mass': 140.0,
        'capture__com': [0.1, -0.05, 0.7],
        'capture__inertia': [40.0, 1.0, -2.0, 45.0, 1.5, 30.0],
        'capture__linear_velocity': [0.02, -0.01, 0.015],
        'capture__angular_velocity': [0.02, 0.01, -0.03],
    }
    run = simulated(50.0, initial__base_position=AWAY, **around, **body)
    into = session(capture__time=time, **around)
    last = identify(run, into)
    assert last.status in {'estimating', 'converged'}
    assert nees(last, run.target_inertia) < LIMIT
    capture = into.robot.captured(last)
    assert capture is not None
    off = capture.momentum - run.target_momentum
    assert float(off @ np.linalg.solve(capture.covariance, off)) < chi2.isf(1e-3, 6)
    assert np.linalg.norm(off[:3]) < 0.05 * np.linalg.norm(run.target_momentum[:3])
