"""The readings in a log of any format, and the bag that is written of them."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from mbaid_ros.bags import BAG_TYPES, BagWriter, message_class
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.errors import DataError
from mbaid_ros.files import write_text
from mbaid_ros.sensor_messages import Imu, Joints, NamedPoses, Poses, StoredMomentum, Thrust, in_order

JOINT_STATES, ODOMETRY, THRUST, IMU = '/joint_states', '/odom', '/thrust', '/imu'
STORED_MOMENTUM = '/stored_momentum'
DESCRIPTION = '/robot_description'
MODEL_FILE, PARAMETER_FILE, TRUTH_FILE = 'robot.urdf', 'estimator.yaml', 'truth.json'
_WEIGHED_FILE = 'weighed.json'  # of a truth that is a few weighings, which reports do not read
ODOMETRY_FRAME = 'odom'
_LATEST = 4e9  # s, about the largest stamp


@dataclass(frozen=True)
class Recording:
    """A log; None or empty where it holds nothing."""

    joints: Joints | None = None
    poses: Poses | None = None
    thrust: Thrust | tuple[Thrust, ...] | None = None  # several, each of a frame of its own
    imu: Imu | None = None
    stored: StoredMomentum | None = None
    named: tuple[Imu | NamedPoses, ...] = ()  # further gyros and poses, each on a topic of its own
    robot: str = ''  # URDF of the robot that was flown
    parameters: str = ''  # text of a parameter file of the estimator
    truth: dict[str, Any] = field(default_factory=dict)  # content of `truth.json`, or of `weighed.json`
    notes: tuple[str, ...] = ()  # for the user, in words
    span: tuple[float, float] = (-math.inf, math.inf)  # s, begin and end of the part that is of use

    def between(self, begin: float, end: float) -> Recording:
        """Return the readings between two times, s, both included."""
        parts = {
            name: _between(part, begin, end)
            for name in ('joints', 'poses', 'thrust', 'imu', 'stored', 'named')
            if (part := getattr(self, name)) is not None
        }
        return Recording(**{**vars(self), **parts})


def write_recording(recording: Recording, path: Path) -> int:
    """Write a bag, and robot, parameters and truth into its folder; return the number of messages.

    Raises DataError: There is nothing to write, a time is no stamp, or the folder exists.
    Raises ModelError: The robot cannot be used.
    """
    if recording.robot:
        load_model(recording.robot)
    messages = _in_order(recording)
    if not messages:
        raise DataError('the log contains no joint states and no poses in the time asked for')
    with BagWriter(path) as bag:
        if recording.robot:
            bag.add_topic(DESCRIPTION, 'std_msgs/msg/String', latched=True)
            bag.write(DESCRIPTION, message_class('std_msgs/msg/String')(data=recording.robot), messages[0][0])
        for topic, kind in {own: message.__msgtype__ for _, own, message in messages}.items():
            bag.add_topic(topic, kind)
        for stamp, topic, message in messages:
            bag.write(topic, message, stamp)
    texts = {
        MODEL_FILE: recording.robot,
        PARAMETER_FILE: recording.parameters,
        _WEIGHED_FILE if 'weighed' in recording.truth else TRUTH_FILE: (
            json.dumps(recording.truth, indent=2) + '\n' if recording.truth else ''
        ),
    }
    for name, text in texts.items():
        if text:
            write_text(path / name, text)
    return bag.messages


def resource(name: str) -> str:
    """Return a text file of this package: a robot description or parameters."""
    return files(__package__).joinpath(name).read_text('utf-8')


def turned_about_z(angle: Array) -> Array:
    """Return quaternions (N, 4) x, y, z, w of turns about z by angles (N,), rad."""
    zero = np.zeros_like(angle)
    return np.stack((zero, zero, np.sin(angle / 2.0), np.cos(angle / 2.0)), axis=-1)


def _between(part: Any, begin: float, end: float) -> Any:
    if isinstance(part, tuple):
        return tuple(_between(each, begin, end) for each in part)
    inside = (part.time >= begin) & (part.time <= end)
    cut = {name: value[inside] for name, value in vars(part).items() if isinstance(value, np.ndarray)}
    return type(part)(**{**vars(part), **cut})


def _in_order(recording: Recording) -> list[tuple[int, str, Any]]:
    """Return stamps (ns), topics and messages in the order of the stamps, joint states last.

    Raises DataError: A time cannot be a stamp.
    """
    thrust = recording.thrust if isinstance(recording.thrust, tuple) else (recording.thrust,)
    every = (*thrust, recording.imu, *recording.named, recording.stored, recording.poses, recording.joints)
    parts = [part for part in every if part is not None]
    for part in parts:
        bad = ~((part.time >= 0.0) & (part.time < _LATEST))
        if np.any(bad):
            raise DataError(f'the log has a time of {part.time[bad][0]:g} s; accepted: 0 to {_LATEST:g} s')
    messages = in_order(parts, BAG_TYPES, lambda _, time: round(time * 1e9))
    return [(round(time * 1e9), f'/{topic}', message) for time, topic, message in messages]
