"""Robots of config/ in motion, and parameters on a command line."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.simulation import without_linear_momentum
from mbaid_ros.simulation.true_robot import ErrorStds, ModelErrors, draw, generator, true_robot

CONFIG = Path(__file__).resolve().parents[1] / 'config'
DEGREE = np.pi / 180.0
# Of all sensors but the joints' velocities.
NOISE = {
    'joint_position': 1e-4, 'base_position': 1e-3, 'base_orientation': 1e-4, 'base_linear_velocity': 1e-3,
    'base_angular_velocity': 1e-4,
}  # fmt: skip


def options(*texts: str) -> list[str]:
    """Return the words of a command line that set parameters, given as name:=value."""
    return [word for text in texts for word in ('-p', text)]


def assigned(values: Mapping[str, object]) -> list[str]:
    """Return the words of a command line that give parameters their values."""
    return options(*(f'{name}:={value}' for name, value in values.items()))


def robot(name: str) -> RobotModel:
    """Return a robot of config/."""
    return load_model((CONFIG / f'{name}.urdf').read_text(encoding='utf-8'))


def drawn(model: RobotModel, seed: int = 0, /, **sizes: float) -> tuple[ModelErrors, RobotModel]:
    """Return the errors of a robot whose last link is the target, of the sizes given, and the robot that has them."""
    errors = draw(model, model.last_link, ErrorStds(**sizes), generator(seed))
    return errors, true_robot(model, errors, (model.last_link,))


def state(
    joint_position: Array, joint_velocity: Array, angular: tuple[float, ...] = (0.0, 0.0, 0.0), linear: float = 0.0
) -> State:
    """Return a state with the base link in the odometry frame, moving along x at `linear` m/s and turning (rad/s)."""
    velocity = np.concatenate(([linear, 0.0, 0.0], angular, joint_velocity))
    return State(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), np.asarray(joint_position, dtype=float), velocity)


def table1() -> tuple[RobotModel, State]:
    """Return the paper's servicer and the start of its case: Table 1, with the base velocity that gives P = 0."""
    model = robot('table1')
    start = state(
        np.array([60.0, -60.0, -60.0, 60.0]) * DEGREE,
        np.array([1.0, -2.0, 1.0, 2.0]) * DEGREE,
        (0.0, 0.0, 2.0 * DEGREE),
    )
    return model, without_linear_momentum(model, start)


def relative_drift(total: Array) -> float:
    """Return the largest change of the linear and of the angular momentum, each relative to its own largest size.

    A linear momentum of zero is measured against what the angular one would be at a metre.
    """
    size = np.linalg.norm(total.reshape(len(total), 2, 3), axis=2).max(axis=0)
    scale = np.maximum(size, 1e-3 * size.max())
    change = np.abs(total - total[0]).reshape(len(total), 2, 3).max(axis=(0, 2))
    return float((change / scale).max())
