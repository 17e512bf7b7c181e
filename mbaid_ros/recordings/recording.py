"""The readings in a log of any format, and the bag that is written of them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from mbaid_ros import sensor_messages
from mbaid_ros.bags import BAG_TYPES, BagWriter, message_class
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.files import write_text

JOINT_STATES, ODOMETRY, THRUST, IMU = '/joint_states', '/odom', '/thrust', '/imu'
STORED_MOMENTUM = '/stored_momentum'
DESCRIPTION = '/robot_description'
MODEL_FILE, PARAMETER_FILE, TRUTH_FILE = 'robot.urdf', 'estimator.yaml', 'truth.json'
ODOMETRY_FRAME = 'odom'
_LATEST = 4e9  # s, about the largest stamp


@dataclass(frozen=True)
class Joints:
    """N readings (N,) s of n joints, or commands to them: position (N, n) rad or m, velocity too where it is logged."""

    names: tuple[str, ...]
    time: Array
    position: Array
    velocity: Array | None = None


@dataclass(frozen=True)
class Poses:
    """N poses of the base, or of a frame on it, at times (N,) s."""

    time: Array
    position: Array  # (N, 3) m, in the odometry frame
    orientation: Array  # (N, 4) quaternion x, y, z, w from the frame on the base to the odometry frame
    twist: Array  # (N, 6) linear and angular velocity in that frame's axes, m/s and rad/s; NaN where it is not logged
    frame: str = 'base_link'


@dataclass(frozen=True)
class Thrust:
    """N commanded wrenches."""

    time: Array  # (N,) s, from when on each counts
    wrench: Array  # (N, 6) force and torque about the frame's origin in its axes, N and N m
    frame: str = 'base_link'  # a link, or the odometry frame


@dataclass(frozen=True)
class Imu:
    """N readings (N,) s of an IMU on a link: rad/s and m/s^2 without gravity's pull, (N, 3) in axes of the link.

    `orientation` (N, 4) x, y, z, w is of the link in the frame of an orientation sensor beside it; None without one.
    """

    time: Array
    angular_velocity: Array
    linear_acceleration: Array
    frame: str = 'base_link'
    orientation: Array | None = None


@dataclass(frozen=True)
class StoredMomentum:
    """N angular momenta (N, 3) N m s of wheels or gyros in axes of a link, at times (N,) s."""

    time: Array
    momentum: Array
    frame: str = 'base_link'


@dataclass(frozen=True)
class Recording:
    """A log; None or empty where it holds nothing."""

    joints: Joints | None = None
    poses: Poses | None = None
    thrust: Thrust | None = None
    imu: Imu | None = None
    stored: StoredMomentum | None = None
    robot: str = ''  # URDF of the robot that was flown
    parameters: str = ''  # text of a parameter file of the estimator
    truth: dict[str, Any] = field(default_factory=dict)  # content of `truth.json`
    notes: tuple[str, ...] = ()  # for the user, in words
    span: tuple[float, float] = (-math.inf, math.inf)  # s, begin and end of the part that is of use

    def between(self, begin: float, end: float) -> Recording:
        """Return the readings between two times, s, both included."""
        parts = {
            name: _between(part, begin, end)
            for name in ('joints', 'poses', 'thrust', 'imu', 'stored')
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
        raise DataError('the log holds no joint states and no poses in the time asked for')
    with BagWriter(path) as bag:
        if recording.robot:
            bag.add_topic(DESCRIPTION, 'std_msgs/msg/String', latched=True)
            bag.write(DESCRIPTION, message_class('std_msgs/msg/String')(data=recording.robot), messages[0][0])
        for topic in dict.fromkeys(own for _, own, _ in messages):
            bag.add_topic(topic, sensor_messages.SENSOR_TYPES[topic[1:]])
        for stamp, topic, message in messages:
            bag.write(topic, message, stamp)
    texts = {
        MODEL_FILE: recording.robot,
        PARAMETER_FILE: recording.parameters,
        TRUTH_FILE: json.dumps(recording.truth, indent=2) + '\n' if recording.truth else '',
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
    inside = (part.time >= begin) & (part.time <= end)
    cut = {name: value[inside] for name, value in vars(part).items() if isinstance(value, np.ndarray)}
    return type(part)(**{**vars(part), **cut})


def _in_order(recording: Recording) -> list[tuple[int, str, Any]]:
    """Return stamps (ns), topics and messages in the order of the stamps, joint states last."""
    parts: tuple[tuple[str, Any, Callable[[Any, int, int], Any]], ...] = (
        (THRUST, recording.thrust, _wrench),
        (IMU, recording.imu, _imu),
        (STORED_MOMENTUM, recording.stored, _vector),
        (ODOMETRY, recording.poses, _odometry),
        (JOINT_STATES, recording.joints, _joint_state),
    )
    messages = [
        (stamp, topic, make(part, index, stamp))
        for topic, part, make in parts
        if part is not None
        for index, stamp in enumerate(_stamps(part.time))
    ]
    return sorted(messages, key=lambda entry: entry[0])


def _stamps(time: Array) -> list[int]:
    """Return the stamps of readings, ns; refuse times that cannot be stamps."""
    bad = ~((time >= 0.0) & (time < _LATEST))
    if np.any(bad):
        raise DataError(f'the log has a time of {time[bad][0]:g} s; accepted: 0 to {_LATEST:g} s')
    return list(map(round, (time * 1e9).tolist()))


def _joint_state(joints: Joints, index: int, stamp: int) -> Any:
    none = np.zeros(0)
    velocity = none if joints.velocity is None else joints.velocity[index]
    return sensor_messages.joint_state_message(BAG_TYPES, stamp, joints.names, joints.position[index], velocity, none)


def _odometry(poses: Poses, index: int, stamp: int) -> Any:
    pose, twist = (poses.position[index], poses.orientation[index]), poses.twist[index]
    return sensor_messages.odometry_message(
        BAG_TYPES, stamp, (ODOMETRY_FRAME, poses.frame), pose, (twist[:3], twist[3:])
    )


def _imu(imu: Imu, index: int, stamp: int) -> Any:
    orientation = None if imu.orientation is None else (imu.orientation[index], np.zeros(9))
    rate, acceleration = imu.angular_velocity[index], imu.linear_acceleration[index]
    return sensor_messages.imu_message(BAG_TYPES, stamp, imu.frame, rate, acceleration, orientation)


def _vector(stored: StoredMomentum, index: int, stamp: int) -> Any:
    return sensor_messages.vector_message(BAG_TYPES, stamp, stored.frame, stored.momentum[index])


def _wrench(thrust: Thrust, index: int, stamp: int) -> Any:
    return sensor_messages.wrench_message(BAG_TYPES, stamp, thrust.frame, thrust.wrench[index])
