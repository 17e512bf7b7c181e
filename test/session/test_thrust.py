"""Known thrust in a run: as good an estimate as without any, and a disturbance where nobody tells of it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from floating import true_momentum
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.sensors.external_momentum import LATE_THRUST, SHARED_THRUST
from mbaid_ros.session.session import Session
from observed import MID, kernel, observe, true_body
from simulated import robot
from thrusting import FORCE_TORQUE, OFF, ON, Timed, command, messages, pulse, pushed

SEEDS = range(2)
METHODS = ('difference', 'trajectory')


def make(method: str = 'difference') -> Session:
    return Session(build(EstimatorConfig, {**EXACT, 'method': method, 'target_link': 'link7'}), robot('servicer7').urdf)


def add(session: Session, timed: Timed) -> bool:
    topic, message, _ = timed
    if topic == '/thrust':
        session.add_thrust(message)
        return False
    return (session.add_joint_state if topic == '/joint_states' else session.add_odometry)(message)


def identify(session: Session, read: Iterable[Timed]) -> list[Estimate]:
    for timed in read:
        add(session, timed)
    return session.process()


def errors(estimate: Estimate) -> Array:
    return estimate.parameters - true_body(kernel('servicer7'))


@pytest.mark.parametrize('method', METHODS)
def test_a_known_pulse_costs_nothing(method: str) -> None:
    quiet, known = [], []
    for seed in SEEDS:
        without = identify(make(method), messages(seed, thrust=False))[-1]
        last = identify(make(method), messages(seed, *pulse()))[-1]
        assert not last.events
        assert last.status == without.status
        quiet.append(errors(without) / without.std)
        known.append(errors(last) / without.std)
        momentum = true_momentum(kernel('servicer7'), observe(pushed(), MID)[-1:])[0]
        off = last.momentum - momentum
        assert float(off @ np.linalg.solve(last.momentum_covariance, off)) < 30.0  # six chi-squares: 1 in 20 000
    assert np.sqrt(np.mean(np.square(known))) < 1.1 * np.sqrt(np.mean(np.square(quiet)))


@pytest.mark.parametrize('method', METHODS)
def test_the_wrong_command_is_a_disturbance(method: str) -> None:
    last = identify(make(method), messages(0, *pulse(), thrust=False))[-1]
    assert [event.kind for event in last.events] == ['step']
    assert last.events[0].time == pytest.approx(ON, abs=1.0)
    rotation = observe(pushed(), MID)[230:231].base_rotation[0]
    assert last.events[0].linear == pytest.approx(-(OFF - ON) * rotation @ FORCE_TORQUE[:3], abs=0.7)


def test_a_command_that_comes_late_is_told_and_not_lost() -> None:
    on, off = pulse()
    read = messages(0, off)
    # Two seconds after it acted.
    place = next(index for index, timed in enumerate(read) if timed[2] > 11.2e9)
    session = make()
    last = identify(session, [*read[:place], on, *read[place:]])[-1]
    assert LATE_THRUST in last.warnings
    assert session.thrust.late
    truth = true_momentum(kernel('servicer7'), observe(pushed(), MID))
    assert session.thrust.brought == pytest.approx(truth[-1] - truth[0], abs=0.1)
    # The windows that were solved without it have seen a momentum that jumps.
    assert last.status == 'inconsistent'


def test_reset_forgets_it() -> None:
    session = make()
    identify(session, messages(0, *pulse()))
    assert np.any(session.thrust.brought)
    session.reset()
    assert not np.any(session.thrust.brought)


def test_two_publishers_of_one_frame_are_the_first_cause() -> None:
    """Each command of the one ends that of the other."""
    session, parts = make(), (FORCE_TORQUE * [1, 1, 1, 0, 0, 0], FORCE_TORQUE * [0, 0, 0, 1, 1, 1])
    turns = [command(ON + 0.01 * index, parts[index % 2]) for index in range(30)]
    last = identify(session, messages(0, *turns, command(OFF, np.zeros(6))))[-1]
    assert SHARED_THRUST.format('base_link') in (last.causes[0][0] if last.contradicted else last.warnings[0])
