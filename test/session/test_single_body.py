"""A body without joints: known thrust moves it, and its mass is the impulse over the change of the velocity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.forces import thrusters
from mbaid_ros.core.geometry import Array, chi_square_limit
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import build
from mbaid_ros.recordings.recording import resource, turned_about_z
from mbaid_ros.sensor_messages import Joints, Poses, Readings, Thrust, in_order
from mbaid_ros.session.session import Session
from unchanged import Unchanged

MASS, MOMENT = 23.0, 0.44
PERIOD, STEPS, SECONDS = 0.06, 12, 24.0  # s between samples, steps of the simulation in between, s
LEVER, FORCE = 0.06, 0.45  # m, N: thrusters 1, 2 push along -x, 5, 6 along x
POSITION, ORIENTATION = 6e-4, 1.5e-3  # m, rad: noise


def run(
    seed: int,
    scale_std: float,
    declared: Mapping[str, float] | None = None,
    *,
    hold: int = 8,
    strength: Sequence[float] = (1.0,) * 4,
) -> list[Estimate]:
    """Return the estimates of a body on a table that pairs of thrusters push and turn.

    Parameters
    ----------
    declared : parameters of thrust beside its scale
    hold : samples that each command holds for
    strength : of thrusters 1, 2, 5, 6, relative to the commands
    """
    generator = np.random.default_rng(seed)
    count = round(SECONDS / PERIOD)
    time = PERIOD * np.arange(count)
    on = np.repeat(generator.integers(0, 2, (count // hold + 1, 4)), hold, axis=0)[:count].astype(float)
    pose = moved(on * np.array(strength)) + generator.standard_normal((count, 3)) * [POSITION, POSITION, ORIENTATION]
    position = np.column_stack((pose[:, :2], np.zeros(count)))
    poses = Poses(time, position, turned_about_z(pose[:, 2]), np.full((count, 6), np.nan))
    wrenches = np.zeros((4, count, 6))
    wrenches[:, :, 0] = FORCE * on.T
    frames = ('thruster1', 'thruster2', 'thruster5', 'thruster6')
    thrust = [Thrust(time, wrench, frame) for wrench, frame in zip(wrenches, frames, strict=True)]
    parameters = {
        'target_link': 'base_link',
        'window': 0.6,
        'noise.base_position': POSITION,
        'noise.base_orientation': ORIENTATION,
        'thrust.scale_std': scale_std,
        'thrust.frames': list(frames),
        **{f'thrust.{name}': value for name, value in (declared or {}).items()},
    }
    session = Session(build(EstimatorConfig, parameters), resource('air_bearing_thrusters.urdf'))
    readings: list[Readings] = [*thrust, poses, Joints((), time, np.zeros((count, 0)))]
    add = {
        'thrust': session.add_thrust,
        'odom': session.add_odometry,
        'joint_states': session.add_joint_state,
    }
    for _, topic, message in in_order(readings, BAG_TYPES, lambda _, at: round(at * 1e9)):
        add[topic](message)
    return session.process()


def moved(on: Array) -> Array:
    """Return x, y and heading (N, 3) of the body under commands (N, 4)."""
    place: Array = np.zeros(3)
    speed: Array = np.array([0.02, -0.03, 0.05])
    poses = []
    sign, lever, step = np.array([-1.0, -1.0, 1.0, 1.0]), np.array([-1.0, 1.0, 1.0, -1.0]) * LEVER, PERIOD / STEPS
    for commands in on:
        poses.append(place.copy())
        along, torque = FORCE * (sign @ commands), FORCE * ((sign * lever) @ commands)
        for _ in range(STEPS):
            angle = place[2] + 0.5 * step * speed[2]
            force = along * np.array([np.cos(angle), np.sin(angle)])
            rate = np.append(force / MASS, torque / MOMENT)
            place, speed = place + step * speed + 0.5 * step**2 * rate, speed + step * rate
    return np.array(poses)


@pytest.mark.parametrize('seed', [0, pytest.param(1, marks=pytest.mark.long)])
@pytest.mark.parametrize(('scale_std', 'least', 'most'), [(1e-9, 0.0, 0.01), (0.1, 0.02, 0.1)])
def test_the_mass_is_known_as_well_as_the_thrust(
    scale_std: float, least: float, most: float, seed: int, unchanged: Unchanged
) -> None:
    last = run(seed, scale_std)[-1]
    unchanged(last)
    assert last.status in {'estimating', 'converged'}
    assert abs(last.parameters[0] - MASS) < 4.0 * last.std[0]
    assert abs(last.parameters[9] - MOMENT) < 4.0 * last.std[9]
    assert least * MASS < last.std[0] < most * MASS


def test_short_pulses_leave_true_intervals() -> None:
    errors = []
    for seed in (10, 13):
        last = run(seed, 1e-9, hold=1)[-1]
        errors += [(last.parameters[0] - MASS) / last.std[0], (last.parameters[9] - MOMENT) / last.std[9]]
    assert float(np.sum(np.square(errors))) < chi_square_limit(1e-3, len(errors))


def test_the_common_scale_is_the_uncertainty_of_the_mass() -> None:
    last = run(0, 1e-9, {'common_scale_std': 0.05})[-1]
    assert abs(last.parameters[0] - MASS) < 4.0 * last.std[0]
    assert 0.045 * MASS < last.std[0] < 0.055 * MASS


def test_a_dead_thruster_is_named_and_may_be_declared() -> None:
    dead = (1.0, 0.0, 1.0, 1.0)
    last = run(0, 0.1, strength=dead)[-1]
    assert last.status in {'inconsistent', 'not_identifiable'}
    assert 'thruster2' in last.causes[0][0]
    assert run(0, 0.02, {'common_scale_std': 0.02}, strength=dead)[-1].status == last.status
    last = run(0, 0.1, {'thruster2.scale_std': 1.0}, strength=dead)[-1]
    assert last.status in {'estimating', 'converged'}
    assert abs(last.parameters[0] - MASS) < 4.0 * last.std[0]
    assert abs(last.thrusters[1].scale) < 4.0 * last.thrusters[1].scale_std < 0.2


def test_deviations_of_no_thruster_are_refused() -> None:
    with pytest.raises(ParameterError, match=r"'thrust.thruster9' is of no thruster"):
        run(0, 0.1, {'thruster9.scale_std': 1.0})


def test_a_repair_widens_what_is_off() -> None:
    unknown = thrusters(['thruster2'], [(0.1, 0.02, 0.03)])
    value, std = np.array([-0.98, 0.0, 0.0, 0.01, 0.0]), np.array([0.05, 0.0, 0.0, 0.02, 0.03])
    model = load_model(resource('air_bearing_thrusters.urdf'))
    repair = unknown.repair('thrust:thruster2', value, std, MomentumKernel(model, 'base_link'))
    assert repair.cause == 'thruster2 has 2 ± 9.8 % of its commanded thrust'
    assert repair.parameters == {'thrust.thruster2.scale_std': 2.0}
