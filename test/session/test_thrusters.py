"""Thrust in a run: as good an estimate as without any, a disturbance if undeclared; and thrusters that deviate."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from checked import central_difference
from floating import true_momentum
from mbaid_ros.calibration.unknowns import StandardNormals, make_prior
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.forces import EXACT_THRUST, LATE_THRUST, SHARED_THRUST, Thrust, Thrusters, thrusters
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.links import relative_factor
from mbaid_ros.core.method import thrusters as estimated_thrusters
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.momentum import THRUSTER_ERRORS
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.state import UnknownsPrior
from mbaid_ros.parameters import build
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_run import SimulatedRun
from observed import LIMIT, MID, kernel, nees, observe, true_body, windows
from servicers import FORCE_TORQUE, OFF, ON, Timed, command, pulse, pushed, thrust_messages
from sessions import identify, session, simulated
from simulated import robot
from unchanged import Unchanged

SECONDS = 30.0
SCALE, TURN = 1.1, np.radians(5.0) * np.array([1.0, 0.0, 0.0])  # of a force along y, which that turns to z
LATE = 0.05  # s
PRIOR: dict[str, object] = {'thrust__scale_std': 0.15, 'thrust__direction_std': 0.1, 'thrust__delay_std': 0.1}


def run(seed: int, scale: float = SCALE, turn: Array = TURN, delay: float = LATE) -> SimulatedRun:
    """Return a run in which a 1 N thruster off the centre of mass fires for six seconds."""
    return simulated(
        SECONDS,
        seed=seed,
        thrust__time=12.0,
        thrust__duration=6.0,
        thrust__force=[0.0, 1.0, 0.0],
        thrust__torque=[0.0, 0.0, 0.6],
        thrust__scale=scale,
        thrust__turn=turn.tolist(),
        thrust__delay=delay,
    )


@pytest.mark.parametrize('seed', [0, pytest.param(1, marks=pytest.mark.long)])
def test_a_tenth_stronger_five_degrees_off_and_late(seed: int, unchanged: Unchanged) -> None:
    made = run(seed)
    last = identify(made, session(**PRIOR))
    unchanged(last)
    assert last.status in {'estimating', 'converged'}
    assert not last.events
    assert nees(last, made.target_inertia) < LIMIT
    (found,) = last.thrusters
    assert found.frame == 'base_link'
    along = SCALE * np.cos(TURN[0])
    assert found.scale == pytest.approx(along, abs=0.02)
    assert abs(found.scale - along) < 4.0 * found.scale_std
    assert found.scale_std < 0.02
    # Turned about x from y to z: what is across the command, over the command.
    assert abs(found.turn[0] - SCALE * np.sin(TURN[0])) < 4.0 * found.turn_std[0]
    assert found.turn_std[0] < 0.02
    assert abs(found.delay - LATE) < 4.0 * found.delay_std
    assert found.delay_std < 0.3 * LATE
    assert last.budget is not None
    assert 'thrust:base_link' in last.budget.causes


def test_a_known_push_of_seconds_at_twenty_samples_a_second_costs_nothing() -> None:
    """One sample a knot, at its begin: what thrust has brought is taken to the knot's centre like all else."""
    made = run(1, 1.0, np.zeros(3), 0.0)
    assert nees(identify(made, session()), made.target_inertia) < LIMIT


@pytest.mark.parametrize('method', ['difference', pytest.param('trajectory', marks=pytest.mark.long)])
def test_without_a_prior_it_is_no_quiet_error(method: str) -> None:
    last = identify(run(0), session(method=method))
    assert last.status == 'inconsistent' or last.events
    assert EXACT_THRUST in last.warnings


def test_the_first_stage_considers_them() -> None:
    made = run(0)
    considering = identify(made, session(method='difference', **PRIOR))
    assert considering.status in {'estimating', 'converged'}
    assert nees(considering, made.target_inertia) < LIMIT
    assert not considering.thrusters


def test_commands_that_are_right_stay_so() -> None:
    made = run(1, 1.0, np.zeros(3), 0.0)
    last = identify(made, session(**PRIOR))
    assert nees(last, made.target_inertia) < LIMIT
    (found,) = last.thrusters
    assert abs(found.scale - 1.0) < 4.0 * found.scale_std


def commanded(wrench: Array, delay: float = 0.0, *, late: bool = False) -> tuple[Array, Array]:
    """Return impulse (N, 6) and columns (N, 6, 5) of a wrench on link3, published before its samples or after all."""
    thrust = Thrust(robot('servicer7'), ['link3'])
    parts = windows(observe(pushed(), MID))
    last = len(parts) - 1
    found = [] if late else _reported(thrust, wrench, delay)
    for place, part in enumerate(parts):
        if late and place == last:
            _reported(thrust, wrench, delay)
        found.append(thrust.with_momentum(part, 0))
    impulse, columns = (np.concatenate([getattr(part, name) for part in found]) for name in ('impulse', 'thrust'))
    return impulse, columns.reshape(-1, 6, THRUSTER_ERRORS)


def _reported(thrust: Thrust, wrench: Array, delay: float) -> list[Samples]:
    thrust.add_command('link3', round((ON + delay) * 1e9), wrench, None)
    thrust.add_command('link3', round((OFF + delay) * 1e9), np.zeros(6), None)
    return []


def test_columns_are_what_other_commands_would_have_brought() -> None:
    def impulse(off: Array) -> Array:
        turned = [(1.0 + off[0]) * part + np.cross(off[1:4], part) for part in np.split(FORCE_TORQUE, 2)]
        return commanded(np.concatenate(turned), off[4])[0]

    expected = central_difference(impulse, np.zeros(THRUSTER_ERRORS), 1e-3)
    found, time = commanded(FORCE_TORQUE)[1], observe(pushed(), MID).time
    assert found[..., :4] == pytest.approx(expected[..., :4], abs=1e-9)
    # A delay of nothing is not half of one that is too early and one that is late: of each change, for one sample.
    changing = np.isin(np.round(time, 6), (ON, OFF))
    assert found[~changing, :, 4] == pytest.approx(expected[~changing, :, 4], abs=5e-3 * np.abs(FORCE_TORQUE).max())
    assert np.abs(expected[..., 4]).max() > 1.0
    # Published late, all of it counts from then on.
    assert commanded(FORCE_TORQUE, late=True)[1][-1] == pytest.approx(found[-1], abs=1e-9)


def test_the_momentum_depends_on_them_by_these_columns() -> None:
    servicer, samples = kernel('servicer7'), observe(pushed(), MID)
    _, columns = commanded(FORCE_TORQUE)
    states = servicer.states(replace(samples, thrust=columns.reshape(len(samples), -1)))
    unknown = thrusters(['link3'], [(0.1, 0.05, 0.02)])
    assert unknown.count == THRUSTER_ERRORS
    moved = columns.copy()
    moved[:, 3:] -= np.cross(samples.base_position[:, :, None], columns[:, :3], axisa=1, axisb=1, axisc=1)
    assert unknown.momentum_columns(servicer, states) == pytest.approx(-moved, abs=1e-12)


def test_calibrate_reports_their_deviations() -> None:
    servicer = kernel('servicer7')
    prior = make_prior(servicer, [relative_factor(servicer.target.parameters, 0.01)])
    before = StandardNormals.from_prior(prior, servicer, (thrusters(['link3'], [(0.1, 0.05, 0.02)]),))
    (found,) = estimated_thrusters(before.values_of(Thrusters))
    assert (found.scale, found.scale_std, found.delay, found.delay_std) == pytest.approx((1.0, 0.1, 0.0, 0.02))
    assert found.turn_std == pytest.approx(np.full(3, 0.05))
    mean = before.gaussian.mean.copy()
    place = 10 + sum(each.count for each in before.unknowns[: before.unknowns.index(_thrusters(before))])
    mean[place : place + THRUSTER_ERRORS] = [2.0, 0.0, -1.0, 0.0, 3.0]
    after = replace(before, gaussian=UnknownsPrior(mean, 0.5 * before.gaussian.factor))
    (found,) = estimated_thrusters(after.values_of(Thrusters))
    assert found.frame == 'link3'
    assert (found.scale, found.scale_std) == pytest.approx((1.2, 0.05))
    assert found.turn == pytest.approx([0.0, -0.05, 0.0])
    assert found.delay == pytest.approx(0.06 / 1.2)  # of a thruster that is stronger


def _thrusters(normals: StandardNormals) -> Thrusters:
    return next(each for each in normals.unknowns if isinstance(each, Thrusters))


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


def estimates_of(session: Session, read: Iterable[Timed]) -> list[Estimate]:
    for timed in read:
        add(session, timed)
    return session.process()


def errors(estimate: Estimate) -> Array:
    return estimate.parameters - true_body(kernel('servicer7'))


@pytest.mark.parametrize('method', ['difference', pytest.param('trajectory', marks=pytest.mark.long)])
def test_a_known_pulse_costs_nothing(method: str) -> None:
    quiet, known = [], []
    for seed in SEEDS:
        without = estimates_of(make(method), thrust_messages(seed, thrust=False))[-1]
        last = estimates_of(make(method), thrust_messages(seed, *pulse()))[-1]
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
    last = estimates_of(make(method), thrust_messages(0, *pulse(), thrust=False))[-1]
    assert [event.kind for event in last.events] == ['step']
    assert last.events[0].time == pytest.approx(ON, abs=1.0)
    rotation = observe(pushed(), MID)[230:231].base_rotation[0]
    assert last.events[0].linear == pytest.approx(-(OFF - ON) * rotation @ FORCE_TORQUE[:3], abs=0.7)


def test_a_late_command_is_reported_and_not_lost() -> None:
    on, off = pulse()
    read = thrust_messages(0, off)
    # Two seconds after it acted.
    place = next(index for index, timed in enumerate(read) if timed[2] > 11.2e9)
    session = make()
    last = estimates_of(session, [*read[:place], on, *read[place:]])[-1]
    assert LATE_THRUST in last.warnings
    assert session.thrust.late
    truth = true_momentum(kernel('servicer7'), observe(pushed(), MID))
    assert session.thrust.impulse == pytest.approx(truth[-1] - truth[0], abs=0.1)
    # The windows that were solved without it have seen a momentum that jumps.
    assert last.status == 'inconsistent'


def test_reset_forgets_it() -> None:
    session = make()
    estimates_of(session, thrust_messages(0, *pulse()))
    assert np.any(session.thrust.impulse)
    session.reset()
    assert not np.any(session.thrust.impulse)


def test_two_publishers_of_one_frame_are_the_first_cause() -> None:
    """Each command of the one ends that of the other."""
    session, parts = make(), (FORCE_TORQUE * [1, 1, 1, 0, 0, 0], FORCE_TORQUE * [0, 0, 0, 1, 1, 1])
    turns = [command(ON + 0.01 * index, parts[index % 2]) for index in range(30)]
    last = estimates_of(session, thrust_messages(0, *turns, command(OFF, np.zeros(6))))[-1]
    assert SHARED_THRUST.format('base_link') in (last.causes[0][0] if last.contradicted else last.warnings[0])
