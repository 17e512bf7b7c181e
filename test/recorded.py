"""Small bags: of simulated robots, and of random numbers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from mbaid_ros.bags import BagReader, BagWriter, message_class
from mbaid_ros.cdr import JOINT_STATE_TYPE, ODOMETRY_TYPE
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.motion import Passive
from mbaid_ros.simulation.simulation import Simulation, Truth
from simulated import table1
from wire import joint_state, odometry

JOINT_STATE, ODOMETRY = JOINT_STATE_TYPE, ODOMETRY_TYPE
EPOCH = 1_700_000_000  # s, stamp of the first sample


def messages(model: RobotModel, truth: Truth) -> Iterator[tuple[str, Any, int]]:
    """Yield (topic, message, ns since the start); no covariance is set."""
    pose, twist = (
        (truth.base_position, truth.base_orientation),
        (truth.base_linear_velocity, truth.base_angular_velocity),
    )
    base = np.concatenate((*pose, *twist), axis=1)
    for index, time in enumerate(truth.time):
        since = round(time * 1e9)
        stamp, joints = EPOCH * 1_000_000_000 + since, (truth.joint_position[index], truth.joint_velocity[index])
        yield '/joint_states', joint_state(model.joint_names, *joints, stamp=stamp), since
        yield '/odom', odometry(base[index], np.zeros((2, 36)), stamp=stamp, child=model.base_link), since


def write(path: Path, model: RobotModel, truth: Truth) -> Path:
    with BagWriter(path) as bag:
        bag.add_topic('/joint_states', JOINT_STATE)
        bag.add_topic('/odom', ODOMETRY)
        for topic, message, time in messages(model, truth):
            bag.write(topic, message, EPOCH * 1_000_000_000 + time)
    return path


def simulate(model: RobotModel, start: State, duration: float, rate: float) -> Truth:
    return Simulation(model, Passive(), start).advance(
        np.linspace(0.0, duration, round(duration * rate) + 1, dtype=np.float64)
    )


def papers_case(path: Path, duration: float = 20.0, rate: float = 20.0) -> Path:
    """Write the paper's case, free of noise: table1.urdf, whose last link is the unknown one."""
    model, start = table1()
    return write(path, model, simulate(model, start, duration, rate))


STRING = 'std_msgs/msg/String'
COUNT = 1500


def random_joint_state(index: int) -> Any:
    # Random numbers, so that the chunks do not compress to nothing and a cut can fall within one.
    noise = np.random.default_rng(index).normal(size=40)
    return joint_state(['a', 'b'], noise, noise, stamp=10_000_000 * index)


def string(text: str) -> Any:
    return message_class(STRING)(data=text)


def write_bag(path: Path, count: int = COUNT) -> Path:
    with BagWriter(path) as bag:
        bag.add_topic('/robot_description', STRING, latched=True)
        bag.add_topic('/joint_states', JOINT_STATE_TYPE, reliable=False)
        bag.write('/robot_description', string('<robot/>'), 0)
        for index in range(count):
            bag.write('/joint_states', random_joint_state(index), 1 + index * 10_000_000)
            if index % 300 == 299:
                bag.flush()
    return path


def everything(path: Path) -> tuple[list[tuple[str, bytes, int]], list[str]]:
    with BagReader(path) as bag:
        return list(bag.raw()), bag.warnings
