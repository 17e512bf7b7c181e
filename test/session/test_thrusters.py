"""Thrusters that are not as commanded: with their priors the intervals hold, and they calibrate themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from derivatives import central_difference
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.intake.thrust import Thrust
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.tide import OF_A_THRUSTER
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.unknowns.thrusters import thrusters
from mbaid_ros.session import Session
from mbaid_ros.simulated_run import SimulatedRun
from observed import MID, kernel, observe, windows
from orbiting import nees, session, simulated
from simulated import robot
from thrusting import FORCE_TORQUE, OFF, ON, pushed

SECONDS = 30.0
LIMIT = float(chi2.isf(1e-3, 10))
SCALE, TURN = 1.1, np.radians(5.0) * np.array([1.0, 0.0, 0.0])  # of a force along y, which that turns to z
PRIOR: dict[str, object] = {'thrust__scale_std': 0.15, 'thrust__direction_std': 0.1}


def run(seed: int, scale: float = SCALE, turn: Array = TURN) -> SimulatedRun:
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
    )


def identify(made: SimulatedRun, into: Session) -> Estimate:
    take = {'joint_states': into.add_joint_state, 'odom': into.add_odometry, 'thrust': into.add_thrust}
    for timed in made.read(SECONDS):
        take[timed.topic](timed.message)
    return into.process()[-1]


@pytest.mark.parametrize('seed', range(2))
def test_a_tenth_stronger_and_five_degrees_off(seed: int) -> None:
    made = run(seed)
    last = identify(made, session(**PRIOR))
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
    assert last.budget is not None
    assert 'thrust:base_link' in last.budget.causes


def test_a_known_push_of_seconds_at_twenty_samples_a_second_costs_nothing() -> None:
    """One sample a knot, at its begin: what thrust has brought is taken to the knot's centre like all else."""
    made = run(1, 1.0, np.zeros(3))
    assert nees(identify(made, session()), made.target_inertia) < LIMIT


def test_without_a_prior_it_is_no_quiet_error() -> None:
    last = identify(run(0), session())
    assert last.status == 'inconsistent' or last.events


def test_the_first_stage_considers_them() -> None:
    made = run(0)
    considering = identify(made, session(method='difference', **PRIOR))
    assert considering.status in {'estimating', 'converged'}
    assert nees(considering, made.target_inertia) < LIMIT
    assert not considering.thrusters


def test_commands_that_are_right_stay_so() -> None:
    made = run(1, 1.0, np.zeros(3))
    last = identify(made, session(**PRIOR))
    assert nees(last, made.target_inertia) < LIMIT
    (found,) = last.thrusters
    assert abs(found.scale - 1.0) < 4.0 * found.scale_std


def commanded(wrench: Array, *, late: bool = False) -> tuple[Array, Array]:
    """Return impulse (N, 6) and columns (N, 6, 4) of a wrench on link3, told before its samples or after all."""
    thrust = Thrust(robot('servicer7'), 1_000_000_000, ['link3'])
    parts = windows(observe(pushed(), MID))
    last = len(parts) - 1
    found = [] if late else _told(thrust, wrench)
    for place, part in enumerate(parts):
        if late and place == last:
            _told(thrust, wrench)
        found.append(thrust.applied(part, 0))
    impulse, columns = (np.concatenate([getattr(part, name) for part in found]) for name in ('impulse', 'thrust'))
    return impulse, columns.reshape(-1, 6, OF_A_THRUSTER)


def _told(thrust: Thrust, wrench: Array) -> list[Samples]:
    thrust.command('link3', round(ON * 1e9), wrench, None)
    thrust.command('link3', round(OFF * 1e9), np.zeros(6), None)
    return []


def test_columns_are_what_other_commands_would_have_brought() -> None:
    def impulse(off: Array) -> Array:
        turned = [(1.0 + off[0]) * part + np.cross(off[1:], part) for part in np.split(FORCE_TORQUE, 2)]
        return commanded(np.concatenate(turned))[0]

    expected = central_difference(impulse, np.zeros(4), 1e-3)
    assert np.abs(expected).max() > 1.0
    assert commanded(FORCE_TORQUE)[1] == pytest.approx(expected, abs=1e-9)
    # Told late, all of it counts from then on.
    assert commanded(FORCE_TORQUE, late=True)[1][-1] == pytest.approx(expected[-1], abs=1e-9)


def test_the_momentum_depends_on_them_by_these_columns() -> None:
    servicer, samples = kernel('servicer7'), observe(pushed(), MID)
    _, columns = commanded(FORCE_TORQUE)
    states = servicer.states(replace(samples, thrust=columns.reshape(len(samples), -1)))
    unknown = thrusters(['link3'], 0.1, 0.05)
    assert unknown.count == OF_A_THRUSTER
    moved = columns.copy()
    moved[:, 3:] -= np.cross(samples.base_position[:, :, None], columns[:, :3], axisa=1, axisb=1, axisc=1)
    assert unknown.momentum_columns(servicer, states) == pytest.approx(-moved, abs=1e-12)
