"""A small bag of random numbers, for the tests of the bags."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import wire
from mbaid_ros.bags import BagReader, BagWriter, message_class

JOINT_STATE = 'sensor_msgs/msg/JointState'
STRING = 'std_msgs/msg/String'
COUNT = 1500


def joint_state(index: int) -> Any:
    # Random numbers, so that the chunks do not compress to nothing and a cut can fall within one.
    noise = np.random.default_rng(index).normal(size=40)
    return wire.joint_state(['a', 'b'], noise, noise, stamp=10_000_000 * index)


def string(text: str) -> Any:
    return message_class(STRING)(data=text)


def write_bag(path: Path, count: int = COUNT) -> Path:
    with BagWriter(path) as bag:
        bag.add_topic('/robot_description', STRING, latched=True)
        bag.add_topic('/joint_states', JOINT_STATE, reliable=False)
        bag.write('/robot_description', string('<robot/>'), 0)
        for index in range(count):
            bag.write('/joint_states', joint_state(index), 1 + index * 10_000_000)
            if index % 300 == 299:
                bag.flush()
    return path


def everything(path: Path) -> tuple[list[tuple[str, bytes, int]], list[str]]:
    with BagReader(path) as bag:
        return list(bag.raw()), bag.warnings
