"""Runs of the robots of config/ with an IMU at 200 Hz and poses without a twist at 10 Hz, for the tests of the gyro."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from benchmarks.data import simulator_config
from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.geometry import Array, rotation_from_quaternion
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.model import Kinematics, express
from mbaid_ros.parameters import build
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_robot import make_simulation
from mbaid_ros.simulated_run import SimulatedRun, TimedMessage
from mbaid_ros.simulation.simulation import total_momentum
from sessions import NOISE, fed
from simulated import robot
from streams import urdf

DENSITY = 1e-4  # rad/s/sqrt(Hz)
IMU: dict[str, object] = {
    'imu.rate': 200.0,
    'imu.noise_density': DENSITY,
    'imu.bias': [3e-3, -2e-3, 1e-3],
    'imu.bias_walk': 2e-5,
    'imu.scale': [2e-3, -1e-3, 3e-3],
}
KNOWN: dict[str, object] = {
    **EXACT,
    'maximum_gap': 0.25,
    'imu.noise_density': DENSITY,
    'imu.bias_std': 5e-3,
    'imu.scale_std': 3e-3,
}
Spoil = Callable[[float, Any], Any]


@cache
def messages(
    name: str, seconds: float, seed: int, orientation: float = 0.0, link: str = ''
) -> tuple[TimedMessage, ...]:
    """Return what the sensors of a robot say: an IMU at 200 Hz, poses without a twist at 10 Hz.

    Parameters
    ----------
    name : of the robot
    seconds : of the run
    seed : of the noise
    orientation : rad, noise of the orientation that the IMU measures; 0 if it measures none
    link : that the IMU is on; empty is the base link
    """
    own = {**IMU, 'imu.orientation_noise': orientation, 'imu.link': link}
    config = simulator_config(name, {**NOISE, **own, 'seed': seed, 'odometry_rate': 10.0})
    made = SimulatedRun(config, urdf(name), BAG_TYPES)
    made.start = 1_700_000_000_000_000_000
    said = made.read(seconds - 0.001)
    for each in said:
        if each.topic == 'odom':
            motion = each.message.twist.twist
            for part in (motion.linear, motion.angular):
                part.x = part.y = part.z = np.nan
    return tuple(said)


def taken(
    said: tuple[TimedMessage, ...],
    name: str,
    parameters: Mapping[str, object] = KNOWN,
    spoil: Spoil | None = None,
    at_once: int = 100_000,
) -> tuple[Session, list[Estimate]]:
    session = Session(build(EstimatorConfig, parameters), urdf(name))
    if spoil is not None:
        changed = (
            replace(each, message=spoil(each.time, deepcopy(each.message))) if each.topic == 'imu' else each
            for each in said
        )
        said = tuple(each for each in changed if each.message is not None)
    return session, fed(session, ((each.topic, each.message) for each in said), at_once)


def angular_momentum(name: str) -> Array:
    """Return the true angular momentum of a robot's run about its centre of mass, odometry axes, kg m^2/s."""
    truth = make_simulation(simulator_config(name), robot(name)).advance(np.zeros(1))
    momentum = total_momentum(robot(name), truth)[0]
    placed = Kinematics(robot(name)).configure(rotation_from_quaternion(truth.base_orientation), truth.joint_position)
    bodies = express(robot(name).body_parameters(), placed.rotation, placed.position)[0]
    centre = truth.base_position[0] + bodies[:, 1:4].sum(axis=0) / bodies[:, 0].sum()
    return np.asarray(momentum[3:] - np.cross(centre, momentum[:3]))


def normalised(estimate: Estimate, name: str) -> Array:
    """Return the errors of what is determined in standard deviations."""
    model = robot(name)
    truth = physical(model.link(model.last_link).parameters)
    return ((estimate.parameters - truth) / estimate.std)[estimate.identifiable]


def rated(change: Callable[[Array], Array]) -> Spoil:
    """Return what changes the angular velocity of a message."""

    def spoil(_time: float, message: Any) -> Any:
        rate = message.angular_velocity
        rate.x, rate.y, rate.z = change(np.array([rate.x, rate.y, rate.z]))
        return message

    return spoil
