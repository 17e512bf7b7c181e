"""A body without joints: known thrust moves it, and its mass is the impulse over the change of the velocity."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.parameters import build
from mbaid_ros.recordings.recording import resource, turned_about_z
from mbaid_ros.sensor_messages import Joints, Poses, Readings, Thrust, in_order
from mbaid_ros.session.session import Session

MASS, MOMENT = 23.0, 0.44
PERIOD, STEPS, SECONDS = 0.06, 12, 24.0  # s between samples, steps of the simulation in between, s
LEVER, FORCE = 0.06, 0.45  # m, N: thrusters 1, 2 push along -x, 5, 6 along x
POSITION, ORIENTATION = 6e-4, 1.5e-3  # m, rad: noise


def run(seed: int, scale_std: float) -> list[Estimate]:
    """Return the estimates of a body on a table that pairs of thrusters push and turn."""
    generator = np.random.default_rng(seed)
    count = round(SECONDS / PERIOD)
    time = PERIOD * np.arange(count)
    # Each command holds for half a second: thrusters 1, 2, 5, 6.
    on = np.repeat(generator.integers(0, 2, (count // 8 + 1, 4)), 8, axis=0)[:count].astype(float)
    pose = moved(on) + generator.standard_normal((count, 3)) * [POSITION, POSITION, ORIENTATION]
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
def test_the_mass_is_known_as_well_as_the_thrust(scale_std: float, least: float, most: float, seed: int) -> None:
    last = run(seed, scale_std)[-1]
    assert last.status in {'estimating', 'converged'}
    assert abs(last.parameters[0] - MASS) < 4.0 * last.std[0]
    assert abs(last.parameters[9] - MOMENT) < 4.0 * last.std[9]
    assert least * MASS < last.std[0] < most * MASS
