"""Wheels inside the base, from the simulator's messages to estimates: by their speeds, by their momentum, or untold."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.sensors.external_momentum import NOT_ASKED_FOR, OTHER_MOMENTUM_FRAME
from mbaid_ros.replay.bag_types import BAG_TYPES
from mbaid_ros.session import Session, intake_warnings
from mbaid_ros.simulated_run import SimulatedRun
from simulated import CONFIG

AXES = [1.0, 1.0, 1.0, -1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0, -1.0, 1.0]
NAMES = ['rw1', 'rw2', 'rw3', 'rw4']
WHEELS = {'wheels.names': NAMES, 'wheels.axes': AXES, 'wheels.spin_inertias': [0.05] * 4}
RAMP = {'wheels.accelerations': [5.0, -5.0, 4.0, 5.0], 'wheels.wander': 20.0, 'wheels.speed_noise': 0.05}
NOISE = {
    **dict(zip(('noise.joint_position', 'noise.joint_velocity'), (1e-4, 1e-3), strict=True)),
    **{f'noise.base_{part}': 1e-3 for part in ('position', 'linear_velocity')},
    **{f'noise.base_{part}': 1e-4 for part in ('orientation', 'angular_velocity')},
}
SECONDS = 20.0
LIMIT = float(chi2.isf(1e-3, 10))


def urdf() -> str:
    return (CONFIG / 'servicer7.urdf').read_text(encoding='utf-8')


def simulated(**wheels: object) -> SimulatedRun:
    """Return the servicer's run with wheels that store up to 5 N m s each."""
    values = load_parameter_file(CONFIG / 'servicer7_simulator.yaml', 'simulator')
    values |= {'duration': SECONDS, 'joint_rate': 50.0, 'odometry_rate': 50.0, **NOISE, **WHEELS, **RAMP}
    values |= {f'wheels.{name}': value for name, value in wheels.items()}
    return SimulatedRun(build(SimulatorConfig, values), urdf(), BAG_TYPES)


def session(**parameters: object) -> Session:
    given = {name.replace('__', '.'): value for name, value in parameters.items()}
    return Session(build(EstimatorConfig, {**EXACT, **NOISE, 'target_link': 'link7', **given}), urdf())


def identify(run: SimulatedRun, into: Session, frame: str = '') -> Estimate:
    """Return the last estimate; stored momentum is told in another frame where one is given."""
    for timed in run.read(SECONDS):
        if frame and timed.topic == 'stored_momentum':
            timed.message.header.frame_id = frame
        take = {
            'joint_states': into.add_joint_state,
            'odom': into.add_odometry,
            'stored_momentum': into.add_stored_momentum,
        }
        take[timed.topic](timed.message)
    return into.process()[-1]


def nees(estimate: Estimate, run: SimulatedRun) -> float:
    error = estimate.parameters - run.target_inertia
    return float(error @ np.linalg.solve(estimate.covariance, error))


@pytest.mark.parametrize('method', ['difference', 'trajectory'])
def test_by_their_speeds(method: str) -> None:
    run, into = simulated(), session(method=method, **{name.replace('.', '__'): v for name, v in WHEELS.items()})
    last = identify(run, into)
    assert nees(last, run) < LIMIT
    assert last.status in {'estimating', 'converged'}
    # What is reported is the total, wheels included.
    off = last.momentum - run.momentum
    assert float(off @ np.linalg.solve(last.momentum_covariance, off)) < chi2.isf(1e-4, 6)
    assert not intake_warnings(into)


def test_by_their_momentum() -> None:
    run, into = simulated(publish='stored_momentum'), session(wheels__momentum_frame='base_link')
    last = identify(run, into)
    assert nees(last, run) < LIMIT
    assert last.status in {'estimating', 'converged'}
    assert into.intake.stored_momentum.taken == round(SECONDS * 50) + 1
    as_speeds = identify(simulated(), session(**{name.replace('.', '__'): value for name, value in WHEELS.items()}))
    assert np.mean(last.std / as_speeds.std) == pytest.approx(1.0, abs=0.05)


def test_momentum_that_comes_seldom_costs_no_samples() -> None:
    run, into = simulated(publish='stored_momentum', wander=0.0), session(wheels__momentum_frame='base_link')
    kept = 0
    for timed in run.read(SECONDS):
        if timed.topic == 'stored_momentum':
            kept += 1
            if kept % 4 == 1:
                into.add_stored_momentum(timed.message)
        else:
            (into.add_joint_state if timed.topic == 'joint_states' else into.add_odometry)(timed.message)
    last = into.process()[-1]
    assert nees(last, run) < LIMIT
    assert into.used > 0.98 * SECONDS * 50


@pytest.mark.parametrize('publish', ['joint_states', 'stored_momentum', 'none'])
def test_untold_they_are_no_quiet_error(publish: str) -> None:
    run, into = simulated(publish=publish), session(method='difference')
    last = identify(run, into)
    assert last.status == 'inconsistent'
    # Who has speeds beside the joints that nobody reads is told where they would be read.
    named = any('joint states hold rw1' in cause and 'wheels.names' in cause for cause, _ in last.causes[:2])
    assert named == (publish == 'joint_states')
    told = any(NOT_ASKED_FOR in warning for warning in intake_warnings(into))
    assert told == (publish == 'stored_momentum')


def test_momentum_in_another_frame_is_refused_with_what_is_accepted() -> None:
    run, into = simulated(publish='stored_momentum'), session(wheels__momentum_frame='base_link')
    with pytest.raises(IndexError):
        identify(run, into, frame='link3')
    warnings = ' '.join(intake_warnings(into))
    assert OTHER_MOMENTUM_FRAME in warnings
    assert "'link3'; accepted: wheels.momentum_frame, 'base_link'" in warnings


def test_speeds_that_never_come_are_named() -> None:
    into = session(**{name.replace('.', '__'): value for name, value in WHEELS.items()})
    run = simulated(publish='none')
    with pytest.raises(IndexError):
        identify(run, into)
    assert any('rw1' in warning for warning in intake_warnings(into))


@pytest.mark.parametrize(
    ('wheels', 'named'),
    [
        ({'wheels.names': ['joint1'], 'wheels.axes': [0.0, 0.0, 1.0], 'wheels.spin_inertias': [0.1]}, 'is joint1;'),
        ({'wheels.names': ['a', 'a'], 'wheels.axes': [1.0] * 6, 'wheels.spin_inertias': [0.1] * 2}, 'that differ'),
        ({'wheels.names': ['a'], 'wheels.axes': [1.0, 0.0], 'wheels.spin_inertias': [0.1]}, "'wheels.axes' has 2"),
        ({'wheels.names': ['a'], 'wheels.axes': [0.0] * 3, 'wheels.spin_inertias': [0.1]}, 'not all of them 0'),
        ({'wheels.names': ['a'], 'wheels.axes': [0.0, 0.0, 1.0]}, "'wheels.spin_inertias' has 0 numbers; accepted: 1"),
    ],
)
def test_wheels_that_cannot_be(wheels: dict[str, object], named: str) -> None:
    for refused in (
        lambda: Session(build(EstimatorConfig, wheels), urdf()),
        lambda: SimulatedRun(build(SimulatorConfig, wheels), urdf(), BAG_TYPES),
    ):
        with pytest.raises(ParameterError, match=named):
            refused()
