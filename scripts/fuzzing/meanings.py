"""Well-formed messages that mean something else: names, stamps, numbers and covariances that are none."""

from __future__ import annotations

from typing import Any

import numpy as np

from fuzzing.damage import one
from mbaid_ros.bags.types import deserialize, serialize

TYPES = {'joint_states': 'sensor_msgs/msg/JointState', 'odom': 'nav_msgs/msg/Odometry'}
NUMBERS = (0.0, -1.0, 1e-300, 1e300, -1e9, np.nan, np.inf, -np.inf)
SECONDS = (0, -(2**31), 2**31 - 1, 1_700_000_000, 1)
NAMES: tuple[list[str], ...] = (
    [],
    [''],
    ['a'] * 4,
    ['joint1'],
    ['joint1'] * 9,
    [f'n{k}' for k in range(10_000)],
    ['x' * 100_000],
)
FRAMES = ('', 'odom', '/base_link', 'link4', 'x' * 1_000_000, '\n\x1b[31m', 'ä' * 1000)


def meaning(topic: str, data: bytes, generator: np.random.Generator) -> bytes:
    """Return a well-formed message of a topic that means something else."""
    message = deserialize(data, TYPES[topic])
    way = int(generator.integers(0, 5))
    if way == 0:
        message.header.stamp.sec = one(SECONDS, generator)
    elif way == 1:
        message.header.frame_id = one(FRAMES, generator)
    elif topic == 'odom':
        _odometry(message, way, generator)
    elif way == 2:
        message.name = one(NAMES, generator)
        length = one((0, 1, len(message.name)), generator)
        message.position = np.full(length, one(NUMBERS, generator))
    else:
        name = one(('position', 'velocity'), generator)
        values = np.array(getattr(message, name), dtype=float)
        values[generator.integers(0, len(values), min(1, len(values)))] = one(NUMBERS, generator)
        setattr(message, name, values)
    return serialize(message, TYPES[topic])


def _odometry(message: Any, way: int, generator: np.random.Generator) -> None:
    if way == 2:
        message.child_frame_id = one(FRAMES, generator)
        return
    part = one((message.pose, message.twist), generator)
    part.covariance = np.array(part.covariance, dtype=float)
    part.covariance[int(generator.integers(0, 36))] = one(NUMBERS, generator)
    if way == 3:
        setattr(message.pose.pose.orientation, one(('x', 'y', 'z', 'w'), generator), one(NUMBERS, generator))
