"""Bags of days: the endless motion of a robot with fresh noise, a period's messages made at once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from tqdm import tqdm

from benchmarks.data import DURATION, LEVELS, endless_motion, model
from benchmarks.speed_bag import START, TOPICS
from mbaid_ros.bags import BagWriter
from mbaid_ros.bags.types import serialize
from mbaid_ros.core.geometry import Array
from mbaid_ros.outgoing import SensorMessages
from mbaid_ros.replay.bag_types import BAG_TYPES
from mbaid_ros.simulation.sensors import BaseReadings, JointReadings, Sensors
from mbaid_ros.simulation.simulation import Truth

_STAMP = 4  # place of the stamp's seconds and nanoseconds in CDR bytes
_NANOSECONDS = 10**9


def make_long_bag(path: Path, robot: str, level: str, hours: float, rate: float) -> None:
    """Write a bag, an Odometry and a JointState a sample.

    Parameters
    ----------
    path : folder to make
    robot, level : of benchmarks.data
    hours : length
    rate : samples a second
    """
    truth, sensors = endless_motion(robot, rate), Sensors(LEVELS[level], seed=0)
    templates = _Templates(SensorMessages(BAG_TYPES, model(robot), 'odom'), truth, sensors)
    with BagWriter(path) as bag:
        for topic, kind in TOPICS.items():
            bag.add_topic(topic, kind)
        for minute in tqdm(range(round(60 * hours)), unit=' min', disable=None, leave=False):
            stamps = START + np.round((minute * DURATION + truth.time) * _NANOSECONDS).astype(np.int64)
            joints, base = sensors.joints(truth), sensors.base(truth)
            messages = zip(
                stamps.tolist(), templates.odometry(base, stamps), templates.joints(joints, stamps), strict=True
            )
            for stamp, odometry, joint_state in messages:
                bag.write_raw('/odom', odometry, stamp)
                bag.write_raw('/joint_states', joint_state, stamp)


class _Templates:
    """CDR bytes of one message of each topic, and where its numbers are: they are alike but for these."""

    def __init__(self, messages: SensorMessages, truth: Truth, sensors: Sensors) -> None:
        one = truth[:1]
        joints, base = sensors.joints(one), sensors.base(one)
        self._joints = _Template('/joint_states', messages.joint_state(joints, 0, START), _of_joints(joints)[0])
        self._base = _Template('/odom', messages.odometry(base, 0, START), _of_base(base)[0])

    def joints(self, readings: JointReadings, stamps: npt.NDArray[np.int64]) -> list[bytes]:
        """Return the messages of readings."""
        return self._joints.filled(_of_joints(readings), stamps)

    def odometry(self, readings: BaseReadings, stamps: npt.NDArray[np.int64]) -> list[bytes]:
        """Return the messages of readings."""
        return self._base.filled(_of_base(readings), stamps)


def _of_joints(readings: JointReadings) -> Array:
    return np.hstack((readings.position, readings.velocity, readings.effort))


def _of_base(readings: BaseReadings) -> Array:
    return np.hstack(
        (readings.position, readings.orientation, readings.linear_velocity, readings.angular_velocity),
    )


class _Template:
    """The bytes of a message with places for k numbers."""

    def __init__(self, topic: str, message: Any, numbers: Array) -> None:
        data = serialize(message, TOPICS[topic])
        self._data = np.frombuffer(data, dtype=np.uint8)
        self._places = [data.index(number.tobytes()) for number in numbers]
        if len(set(self._places)) < len(numbers):
            raise ValueError('two numbers of the first message are the same')

    def filled(self, numbers: Array, stamps: npt.NDArray[np.int64]) -> list[bytes]:
        """Return the bytes of messages with numbers (N, k) and stamps (N,), ns."""
        rows = np.tile(self._data, (len(numbers), 1))
        rows[:, _STAMP : _STAMP + 8] = np.column_stack(np.divmod(stamps, _NANOSECONDS)).astype('<u4').view(np.uint8)
        for place, column in zip(self._places, numbers.T, strict=True):
            rows[:, place : place + 8] = np.ascontiguousarray(column, dtype='<f8').view(np.uint8).reshape(-1, 8)
        return [row.tobytes() for row in rows]
