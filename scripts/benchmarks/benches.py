"""Simulated twins of the benches whose logs others have published: their rates, noise, defects and formats."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.io import savemat

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.inertia import physical
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import RobotModel, express, load_model
from mbaid_ros.core.robot.true_robot import true_robot
from mbaid_ros.core.robot.urdf_values import change_inertial
from mbaid_ros.core.simulation.drawn import ErrorSizes, draw, generator
from mbaid_ros.core.simulation.dynamics import State
from mbaid_ros.core.simulation.motion import Sinusoids
from mbaid_ros.core.simulation.push import Push
from mbaid_ros.core.simulation.run import Simulation
from mbaid_ros.recordings.planar_arm import BASE, planar_urdf
from mbaid_ros.recordings.spot_2021 import CHASER, COMMANDS_FILE

_STEP = 0.02  # s, of the integrator
_ARM = 42.0  # s, when the arm begins to move in the logs of 2021


@dataclass(frozen=True)
class Twin:
    """A run of a bench that was simulated.

    Attributes
    ----------
    log : file, as that bench would have written it
    truth : (10,) mass, CoM, inertia about it of the base
    lag : s, by which the arm is behind its commands
    slope : m/s^2
    """

    log: Path
    truth: Array
    lag: float
    slope: float


def spot_2021(folder: Path, seed: int, duration: float = 32.0) -> Twin:
    """Write what the bench of 2021 would have logged of a robot near the described one.

    Parameters
    ----------
    folder : where the log and the arm's commands are written
    seed : of the robot, its motion, and the noise
    duration : s, from the begin of the log's useful part
    """
    rng = np.random.default_rng(seed)
    described = load_model(planar_urdf(CHASER, ''))
    base = physical(described.link(BASE).parameters)
    # The base is what is looked for: it is another one than nominal.
    base[[0, 1, 2, 9]] = (
        base[0] * rng.uniform(0.85, 1.1), *rng.uniform(-0.01, 0.01, 2), base[9] * rng.uniform(0.7, 1.1)
    )  # fmt: skip
    base[[4, 7]] = base[9] / 2.0
    true = load_model(change_inertial(described.urdf, BASE, base))
    sizes = ErrorSizes(links_relative_std=0.02, zero_std=0.05, origin_std=0.01)
    errors = draw(true, BASE, sizes, generator(seed))
    robot, lag = true_robot(true, errors, (BASE,)), rng.uniform(0.2, 0.35)
    motion = _arm(rng)
    slope = rng.uniform(-6e-4, 6e-4, 2)
    logged = _ARM + 0.4 + np.arange(0.0, duration, 0.1)
    told = np.floor(logged / 0.2 + 1e-9) * 0.2  # when the pose there was new
    seen = _pulled(robot, motion, slope).advance(told - _ARM - lag)
    noise = rng.normal(size=(len(logged), 3))[np.round((told - told[0]) / 0.2).astype(int)] * (5e-4, 5e-4, 2e-3)
    table = np.zeros((len(logged), 65))
    table[:, 0] = logged
    table[:, 4:6] = seen.base_position[:, :2] + noise[:, :2]
    table[:, 6] = _wrapped(2.0 * np.arctan2(seen.base_orientation[:, 2], seen.base_orientation[:, 3]) + noise[:, 2])
    savemat(folder / 'run__stitched.mat', {'rt_tout': logged[:, None], 'rt_dataPacket': table})
    commanded = np.linspace(0.0, duration, 400)
    states = np.zeros((12, len(commanded)))
    states[3:6] = np.transpose([motion.reference(time)[0] for time in commanded]) - errors.zeros[:, None]
    savemat(folder / COMMANDS_FILE, {'primal': {'time': commanded, 'states': states}})
    return Twin(folder / 'run__stitched.mat', base, lag, float(np.linalg.norm(slope)))


def _arm(rng: np.random.Generator) -> Sinusoids:
    """Return a motion of three joints that begins at rest."""
    amplitude = rng.uniform(0.5, 1.0, (3, 1)) * rng.choice((-1.0, 1.0), (3, 1)) * np.array([[0.4], [0.9], [0.6]])
    start = np.array([np.pi / 2.0, 0.0, 0.0]) - amplitude[:, 0]
    return Sinusoids(start, amplitude, 1.0 / rng.uniform(12.0, 25.0, (3, 1)), np.full((3, 1), -np.pi / 2.0))


def _pulled(robot: RobotModel, motion: Sinusoids, slope: Array) -> Simulation:
    """Return a robot that slides down a table, from rest: what pulls acts at the common centre of mass."""
    rest = np.array([0.0, 0.0, 0.0, 1.0])
    start = State(np.zeros(3), rest, motion.start, np.zeros(6 + robot.joints))
    placed = Kinematics(robot).configure(np.eye(3)[None], motion.start[None])
    bodies = express(robot.body_parameters(), placed.rotation[0], placed.position[0])
    mass, first = bodies[:, 0].sum(), bodies[:, 1:4].sum(axis=0)
    force = np.append(mass * slope, 0.0)
    wrench = np.concatenate((force, np.cross(first / mass, force)))
    return Simulation(robot, motion, start, _STEP, Push.on(None, wrench))


def _wrapped(angle: Array) -> Array:
    """Return angles between -pi and pi."""
    return np.asarray(np.arctan2(np.sin(angle), np.cos(angle)))
