"""JointState and Odometry as objects and as bytes, and small bags: of simulated robots, and of random numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mbaid_ros.bags import BagReader, BagWriter, deserialize, message_class, serialize
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.samples import JOINT_STATE_TYPE, ODOMETRY_TYPE
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.motion import Passive
from mbaid_ros.simulation.simulation import Simulation, Truth
from simulated import table1

JOINT_STATE, ODOMETRY = JOINT_STATE_TYPE, ODOMETRY_TYPE
TOPICS = '/joint_states', '/odom'
EPOCH = 1_700_000_000  # s, stamp of the first sample
Change = Callable[[int, Any], Any]  # the n-th message of a topic, as it is written; None leaves it out


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


def header(stamp: int, frame: str = '') -> Any:
    second, nanosecond = divmod(stamp, 1_000_000_000)
    time = message_class('builtin_interfaces/msg/Time')(sec=second, nanosec=nanosecond)
    return message_class('std_msgs/msg/Header')(stamp=time, frame_id=frame)


def of(kind: str, values: Sequence[float] | Array) -> Any:
    """Return a message of geometry_msgs that holds numbers alone: a Point, a Quaternion, a Vector3."""
    return message_class(f'geometry_msgs/msg/{kind}')(*map(float, values))


def joint_state(
    names: Sequence[str], position: Any, velocity: Any, *, stamp: int = 1, effort: int = 0, frame: str = ''
) -> Any:
    numbers = (np.array(each, dtype=float) for each in (position, velocity, np.ones(effort)))
    return message_class(JOINT_STATE_TYPE)(header(stamp, frame), list(names), *numbers)


def odometry(
    numbers: Array, covariances: Array, *, stamp: int = 1, child: str = 'base_link', frame: str = 'odom'
) -> Any:
    """Return an Odometry of 13 numbers (position, orientation, linear and angular velocity) and two covariances."""
    parts = []
    for name, kinds, values, covariance in (
        ('Pose', ('Point', 'Quaternion'), np.split(numbers[:7], [3]), covariances[0]),
        ('Twist', ('Vector3', 'Vector3'), np.split(numbers[7:], [3]), covariances[1]),
    ):
        part = message_class(f'geometry_msgs/msg/{name}')(*map(of, kinds, values))
        parts.append(message_class(f'geometry_msgs/msg/{name}WithCovariance')(part, covariance.ravel()))
    return message_class(ODOMETRY_TYPE)(header(stamp, frame), child, *parts)


def as_bytes(message: Any) -> bytes:
    return serialize(message, message.__msgtype__)


def again(data: bytes, type_name: str) -> Any:
    """Return the object that bytes hold."""
    return deserialize(data, type_name)


def same(_number: int, message: Any) -> Any:
    return message


def changed(bag: str, path: Path, joints: Change, base: Change = same) -> str:
    """Write a bag anew, with changed messages."""
    with BagReader(bag) as before, BagWriter(path) as after:
        for topic, kind, change in zip(TOPICS, (JOINT_STATE, ODOMETRY), (joints, base), strict=True):
            after.add_topic(topic, kind)
            for number, (_, message, time) in enumerate(before.read([topic])):
                if (made := change(number, message)) is not None:
                    after.write(topic, made, time)
    return str(path)


def stamped(stamp: Callable[[int], int], change: Change = same) -> Change:
    """Return a change with the n-th message stamped with a number of nanoseconds of n."""

    def also(number: int, message: Any) -> Any:
        seconds, nanoseconds = divmod(stamp(number), 1_000_000_000)
        time = replace(message.header.stamp, sec=seconds, nanosec=nanoseconds)
        return change(number, replace(message, header=replace(message.header, stamp=time)))

    return also
