"""What a log holds once it is read, whatever its format, and how that becomes a bag."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mbaid_ros.bags import BagWriter, message_class
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.files import write_text

JOINT_STATES, ODOMETRY, THRUST, IMU = '/joint_states', '/odom', '/thrust', '/imu'
DESCRIPTION = '/robot_description'
MODEL_FILE, PARAMETER_FILE, TRUTH_FILE = 'robot.urdf', 'estimator.yaml', 'truth.json'
ODOMETRY_FRAME = 'odom'
_LATEST = 4e9  # s, which is about what a stamp can hold

_TYPES = {
    JOINT_STATES: 'sensor_msgs/msg/JointState',
    ODOMETRY: 'nav_msgs/msg/Odometry',
    THRUST: 'geometry_msgs/msg/WrenchStamped',
    IMU: 'sensor_msgs/msg/Imu',
}


@dataclass(frozen=True)
class Joints:
    """N readings of joints, or commands to them.

    Attributes
    ----------
    names : n of them
    time : (N,) s
    position : (N, n) rad, m for prismatic joints
    velocity : (N, n) rad/s, m/s; None where it is not logged
    """

    names: tuple[str, ...]
    time: Array
    position: Array
    velocity: Array | None = None


@dataclass(frozen=True)
class Poses:
    """N poses of the base, or of a frame on it.

    Attributes
    ----------
    time : (N,) s
    position : (N, 3) m, in the odometry frame
    orientation : (N, 4) quaternion x, y, z, w from the frame on the base to the odometry frame
    twist : (N, 6) linear and angular velocity in that frame's axes, m/s and rad/s; NaN where it is not logged
    frame : name of the frame on the base
    """

    time: Array
    position: Array
    orientation: Array
    twist: Array
    frame: str = 'base_link'


@dataclass(frozen=True)
class Thrust:
    """N commanded wrenches.

    Attributes
    ----------
    time : (N,) s, from when on each counts
    wrench : (N, 6) force and torque about the frame's origin in its axes, N and N m
    frame : a link, or the odometry frame
    """

    time: Array
    wrench: Array
    frame: str = 'base_link'


@dataclass(frozen=True)
class Imu:
    """N readings of an IMU.

    Attributes
    ----------
    time : (N,) s
    angular_velocity, linear_acceleration : (N, 3) rad/s, m/s^2 without gravity's pull, in axes of the frame
    frame : link that it is fixed to
    """

    time: Array
    angular_velocity: Array
    linear_acceleration: Array
    frame: str = 'base_link'


@dataclass(frozen=True)
class Recording:
    """A log.

    Attributes
    ----------
    joints, poses, thrust, imu : None is what it does not hold
    robot : URDF of what was flown; empty where the format does not say
    parameters : text of a parameter file of the estimator; empty where there is none
    truth : as `truth.json` has it; empty where there is none
    notes : what a user should know of it, in words
    span : s, begin and end of what of it is of use
    """

    joints: Joints | None = None
    poses: Poses | None = None
    thrust: Thrust | None = None
    imu: Imu | None = None
    robot: str = ''
    parameters: str = ''
    truth: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    span: tuple[float, float] = (-math.inf, math.inf)

    def between(self, begin: float, end: float) -> Recording:
        """Return what lies between two times, s, both included."""
        parts = {
            name: _between(part, begin, end)
            for name in ('joints', 'poses', 'thrust', 'imu')
            if (part := getattr(self, name)) is not None
        }
        return Recording(**{**vars(self), **parts})


def write_recording(recording: Recording, path: Path) -> int:
    """Write a bag, and robot, parameters and truth into its folder; return the number of messages.

    Raises
    ------
    DataError
        There is nothing to write, a time is no stamp, or the folder exists.
    ModelError
        The robot cannot be used.
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
        for topic, kind in _TYPES.items():
            if any(topic == own for _, own, _ in messages):
                bag.add_topic(topic, kind)
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
    moving = [*_imus(recording.imu), *_odometry(recording.poses)]
    found = [*_wrenches(recording.thrust), *moving, *_joint_states(recording.joints)]
    return sorted(found, key=lambda entry: entry[0])


def _stamps(time: Array) -> Iterator[tuple[int, int]]:
    """Yield the number of each reading and its stamp, ns.

    Raises
    ------
    DataError
        It cannot be one.
    """
    bad = ~((time >= 0.0) & (time < _LATEST))
    if np.any(bad):
        raise DataError(f'the log has a time of {time[bad][0]:g} s; accepted: 0 to {_LATEST:g} s')
    yield from enumerate(map(round, (time * 1e9).tolist()))


def _joint_states(joints: Joints | None) -> Iterator[tuple[int, str, Any]]:
    if joints is None:
        return
    none = np.zeros(0)
    for i, stamp in _stamps(joints.time):
        velocity = none if joints.velocity is None else joints.velocity[i]
        message = message_class(_TYPES[JOINT_STATES])(
            header=_header(stamp, ''),
            name=list(joints.names),
            position=joints.position[i],
            velocity=velocity,
            effort=none,
        )
        yield stamp, JOINT_STATES, message


def _odometry(poses: Poses | None) -> Iterator[tuple[int, str, Any]]:
    if poses is None:
        return
    unset = np.zeros(36)  # as ROS has it: not known
    for i, stamp in _stamps(poses.time):
        pose = _of(
            'Pose', position=_xyz('Point', poses.position[i]), orientation=_xyz('Quaternion', poses.orientation[i])
        )
        linear, angular = poses.twist[i, :3], poses.twist[i, 3:]
        twist = _of('Twist', linear=_xyz('Vector3', linear), angular=_xyz('Vector3', angular))
        message = message_class(_TYPES[ODOMETRY])(
            header=_header(stamp, ODOMETRY_FRAME),
            child_frame_id=poses.frame,
            pose=_of('PoseWithCovariance', pose=pose, covariance=unset),
            twist=_of('TwistWithCovariance', twist=twist, covariance=unset),
        )
        yield stamp, ODOMETRY, message


def _imus(imu: Imu | None) -> Iterator[tuple[int, str, Any]]:
    if imu is None:
        return
    unset, none = np.zeros(9), np.zeros(9)
    none[0] = -1.0  # as ROS has it: there is none
    orientation = _of('Quaternion', x=0.0, y=0.0, z=0.0, w=1.0)
    for i, stamp in _stamps(imu.time):
        message = message_class(_TYPES[IMU])(
            header=_header(stamp, imu.frame),
            orientation=orientation,
            orientation_covariance=none,
            angular_velocity=_xyz('Vector3', imu.angular_velocity[i]),
            angular_velocity_covariance=unset,
            linear_acceleration=_xyz('Vector3', imu.linear_acceleration[i]),
            linear_acceleration_covariance=unset,
        )
        yield stamp, IMU, message


def _wrenches(thrust: Thrust | None) -> Iterator[tuple[int, str, Any]]:
    if thrust is None:
        return
    for i, stamp in _stamps(thrust.time):
        force, torque = _xyz('Vector3', thrust.wrench[i, :3]), _xyz('Vector3', thrust.wrench[i, 3:])
        wrench = _of('Wrench', force=force, torque=torque)
        message = message_class(_TYPES[THRUST])(header=_header(stamp, thrust.frame), wrench=wrench)
        yield stamp, THRUST, message


def _header(stamp: int, frame: str) -> Any:
    seconds, nanoseconds = divmod(stamp, 1_000_000_000)
    time = message_class('builtin_interfaces/msg/Time')(sec=seconds, nanosec=nanoseconds)
    return message_class('std_msgs/msg/Header')(stamp=time, frame_id=frame)


def _of(name: str, **fields: Any) -> Any:
    return message_class(f'geometry_msgs/msg/{name}')(**fields)


def _xyz(name: str, values: Sequence[float] | Array) -> Any:
    return _of(name, **dict(zip('xyzw', map(float, values), strict=False)))
