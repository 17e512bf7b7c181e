"""Wheels inside the base, from simulated messages to estimates: by their speeds, their momentum, or undeclared."""

from __future__ import annotations

from copy import deepcopy
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.config.simulator_parameters import SimulatorConfig
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.wheels import NOT_ASKED_FOR, OTHER_MOMENTUM_FRAME
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import build
from mbaid_ros.session.explanation import intake_warnings
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_run import SimulatedRun, TimedMessage
from observed import LIMIT, nees
from sessions import URDF, feed, session, simulated
from unchanged import Unchanged

AXES = [1.0, 1.0, 1.0, -1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0, -1.0, 1.0]
NAMES = ['rw1', 'rw2', 'rw3', 'rw4']
WHEELS: dict[str, object] = {'wheels.names': NAMES, 'wheels.axes': AXES, 'wheels.spin_inertias': [0.05] * 4}
RAMP = {'wheels.accelerations': [5.0, -5.0, 4.0, 5.0], 'wheels.speed_noise': 0.05}
SECONDS = 20.0


@cache
def spinning(seconds: float = SECONDS, **wheels: object) -> tuple[SimulatedRun, tuple[TimedMessage, ...]]:
    """Return the servicer's run with wheels that store up to 5 N m s each, and its messages."""
    own = {f'wheels.{name}': each for name, each in wheels.items()}
    run = simulated(SECONDS, joint_rate=50.0, odometry_rate=50.0, **{**WHEELS, **RAMP, **own})
    return run, tuple(run.read(seconds))


@cache
def by_speeds(method: str) -> tuple[Estimate, tuple[str, ...]]:
    """Return the last estimate of a session that reads the wheels' speeds, and its warnings of messages."""
    into = session(method=method, **WHEELS)
    return feed(spinning()[1], into)[-1], tuple(intake_warnings(into))


def agrees(estimate: Estimate, run: SimulatedRun) -> bool:
    return estimate.status in {'estimating', 'converged'} and nees(estimate, run.target_inertia) < LIMIT


@pytest.mark.parametrize('method', ['difference', 'trajectory'])
def test_by_their_speeds(method: str) -> None:
    (run, _), (last, warnings) = spinning(), by_speeds(method)
    assert agrees(last, run)
    # What is reported is the total, wheels included.
    off = last.momentum - run.momentum
    assert float(off @ np.linalg.solve(last.momentum_covariance, off)) < chi2.isf(1e-4, 6)
    assert not warnings


def test_by_their_momentum(unchanged: Unchanged) -> None:
    (run, messages), into = spinning(publish='stored_momentum'), session(wheels__momentum_frame='base_link')
    last = feed(messages, into)[-1]
    unchanged(last)
    assert agrees(last, run)
    assert into.intake.stored_momentum.used == round(SECONDS * 50) + 1
    assert np.mean(last.std / by_speeds('trajectory')[0].std) == pytest.approx(1.0, abs=0.05)


def test_momentum_that_comes_seldom_costs_no_samples() -> None:
    run, messages = spinning(publish='stored_momentum')
    into = session(wheels__momentum_frame='base_link')
    stored = [timed for timed in messages if timed.topic == 'stored_momentum']
    seldom = {id(timed) for timed in stored[::4]}
    last = feed([each for each in messages if each.topic != 'stored_momentum' or id(each) in seldom], into)[-1]
    assert nees(last, run.target_inertia) < LIMIT
    assert into.used > 0.98 * SECONDS * 50


@pytest.mark.parametrize('publish', ['joint_states', 'stored_momentum', pytest.param('none', marks=pytest.mark.long)])
def test_without_their_parameters_they_are_no_quiet_error(publish: str) -> None:
    into = session(method='difference')
    last = feed(spinning(publish=publish)[1], into)[-1]
    assert last.status == 'inconsistent'
    # The cause names the parameter where the joint states hold speeds that nothing reads.
    named = any('joint states contain rw1' in cause and 'wheels.names' in cause for cause, _ in last.causes[:2])
    assert named == (publish == 'joint_states')
    warned = any(NOT_ASKED_FOR in warning for warning in intake_warnings(into))
    assert warned == (publish == 'stored_momentum')


def test_momentum_in_another_frame_and_speeds_that_never_come_are_named() -> None:
    into, messages = session(wheels__momentum_frame='base_link'), deepcopy(spinning(2.0, publish='stored_momentum')[1])
    for timed in messages:
        if timed.topic == 'stored_momentum':
            timed.message.header.frame_id = 'link3'
    assert not feed(messages, into)
    warnings = ' '.join(intake_warnings(into))
    assert OTHER_MOMENTUM_FRAME in warnings
    assert "'link3'; accepted: wheels.momentum_frame, 'base_link'" in warnings
    into = session(wheels__momentum_frame='base_link', frame_prefix='link')
    into.add_stored_momentum(next(each.message for each in messages if each.topic == 'stored_momentum'))
    assert into.intake.stored_momentum.other_frame == '3'  # less the prefix
    into = session(**WHEELS)
    assert not feed(spinning(2.0, publish='none')[1], into)
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
        lambda: Session(build(EstimatorConfig, wheels), URDF),
        lambda: SimulatedRun(build(SimulatorConfig, wheels), URDF, BAG_TYPES),
    ):
        with pytest.raises(ParameterError, match=named):
            refused()
