"""Small bags of simulated robots, for the tests of what reads them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbaid_ros.bags import BagWriter, message_class
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.motion import Passive
from mbaid_ros.simulation.simulation import Simulation, Truth
from simulated import table1

JOINT_STATE = 'sensor_msgs/msg/JointState'
ODOMETRY = 'nav_msgs/msg/Odometry'
EPOCH = 1_700_000_000  # s, stamp of the first sample


def time_message(nanoseconds: int) -> Any:
    return message_class('builtin_interfaces/msg/Time')(
        sec=EPOCH + nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000
    )


def header(nanoseconds: int, frame: str) -> Any:
    return message_class('std_msgs/msg/Header')(stamp=time_message(nanoseconds), frame_id=frame)


def vector(values: Sequence[float], kind: str = 'Vector3') -> Any:
    return message_class(f'geometry_msgs/msg/{kind}')(*(float(value) for value in values))


def joint_state(nanoseconds: int, names: Sequence[str], position: Any, velocity: Any) -> Any:
    return message_class(JOINT_STATE)(
        header=header(nanoseconds, ''),
        name=list(names),
        position=np.array(position),
        velocity=np.array(velocity),
        effort=np.zeros(0),
    )


def odometry(nanoseconds: int, truth: Truth, index: int, child_frame: str) -> Any:
    zero = np.zeros(36)
    pose = message_class('geometry_msgs/msg/Pose')(
        position=vector(truth.base_position[index], 'Point'),
        orientation=vector(truth.base_orientation[index], 'Quaternion'),
    )
    twist = message_class('geometry_msgs/msg/Twist')(
        linear=vector(truth.base_linear_velocity[index]), angular=vector(truth.base_angular_velocity[index])
    )
    return message_class(ODOMETRY)(
        header=header(nanoseconds, 'odom'),
        child_frame_id=child_frame,
        pose=message_class('geometry_msgs/msg/PoseWithCovariance')(pose=pose, covariance=zero),
        twist=message_class('geometry_msgs/msg/TwistWithCovariance')(twist=twist, covariance=zero),
    )


def messages(model: RobotModel, truth: Truth) -> Iterator[tuple[str, Any, int]]:
    """Yield (topic, message, ns since the start)."""
    for index, time in enumerate(truth.time):
        stamp = round(time * 1e9)
        names, position = model.joint_names, truth.joint_position[index]
        yield '/joint_states', joint_state(stamp, names, position, truth.joint_velocity[index]), stamp
        yield '/odom', odometry(stamp, truth, index, model.base_link), stamp


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
