"""Faults of joint states and poses as robots really publish them, put into the messages of the shipped bag."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mbaid_ros.bags import BagReader, BagWriter

ROOT = Path(__file__).resolve().parents[2]
BAG, ROBOT = ROOT / 'bags' / 'servicer7_mid', ROOT / 'config' / 'servicer7.urdf'
JOINTS, ODOM = '/joint_states', '/odom'

Timed = tuple[str, Any, int]
RANDOM = np.random.default_rng(7)


def messages() -> list[Timed]:
    """Return joint states and odometry of the bag."""
    with BagReader(BAG) as bag:
        return list(bag.read([JOINTS, ODOM]))


def write(path: Path, given: Sequence[Timed]) -> Path:
    """Write a bag."""
    types = {JOINTS: 'sensor_msgs/msg/JointState', ODOM: 'nav_msgs/msg/Odometry'}
    with BagWriter(path) as bag:
        for topic in dict.fromkeys(topic for topic, _, _ in given):
            bag.add_topic(topic, types[topic])
        for topic, message, time in given:
            bag.write(topic, message, time)
    return path


def stamp(message: Any, nanoseconds: int) -> None:
    """Stamp a message."""
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(nanoseconds, 10**9)


def changed(of_joints: Callable[..., None] | None = None, of_base: Callable[..., None] | None = None) -> Any:
    """Return a maker of a bag whose messages are changed in place, by their number and time (s)."""

    def make(folder: Path) -> tuple[Path, Path]:
        given = messages()
        for topic, change in ((JOINTS, of_joints), (ODOM, of_base)):
            for number, (_, message, time) in enumerate(each for each in given if each[0] == topic):
                if topic == JOINTS:
                    message.position, message.velocity = np.array(message.position), np.array(message.velocity)
                if change is not None:
                    change(message, number, 1e-9 * time)
        return write(folder / 'bag', given), ROBOT

    return make


def pose_of(message: Any, position: Any, quaternion: Any) -> None:
    """Give an Odometry another pose."""
    pose = message.pose.pose
    pose.position.x, pose.position.y, pose.position.z = map(float, position)
    pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w = map(float, quaternion)


def untwisted(message: Any) -> None:
    """Take the twist out of an Odometry."""
    for part in (message.twist.twist.linear, message.twist.twist.angular):
        part.x = part.y = part.z = np.nan


def zeros(message: Any, number: int, _time: float) -> None:
    """Let the joints read zero once in 300 messages."""
    if number % 300 == 150:
        message.position[:] = 0.0


def ticks(message: Any, _number: int, _time: float) -> None:
    """Publish ticks of an encoder, without velocities."""
    message.position[:] = np.round(message.position * 4096.0 / (2.0 * np.pi) + 2048.0)
    message.velocity = np.zeros(0)


def nan_joint(message: Any, _number: int, _time: float) -> None:
    """Let joint4 read NaN."""
    message.position[3] = np.nan


def no_velocity(message: Any, _number: int, _time: float) -> None:
    """Publish velocities of zero."""
    message.velocity[:] = 0.0


def lost(message: Any, _number: int, time: float) -> None:
    """Lose the base for three seconds."""
    if 20.0 <= time < 23.0:
        pose_of(message, (0, 0, 0), (0, 0, 0, 1))


def bolted(message: Any, _number: int, _time: float) -> None:
    """Let the base stay where it is, with noise."""
    quaternion = Rotation.from_rotvec(5e-5 * RANDOM.standard_normal(3)).as_quat()
    pose_of(message, 1e-3 * RANDOM.standard_normal(3), quaternion)
    for part, noise in ((message.twist.twist.linear, 1e-3), (message.twist.twist.angular, 1e-4)):
        part.x, part.y, part.z = (noise * RANDOM.standard_normal(3)).tolist()


def mixed_axes(message: Any, _number: int, _time: float) -> None:
    """Publish positions in other axes, without a twist."""
    untwisted(message)
    place = message.pose.pose.position
    place.y, place.z = -place.z, place.y


def turned(message: Any, _number: int, _time: float) -> None:
    """Locate a frame turned by 90 degrees, without a twist."""
    untwisted(message)
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    other = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]) * Rotation.from_euler('z', 90, degrees=True)
    pose_of(message, (place.x, place.y, place.z), other.as_quat())


def set_back(message: Any, _number: int, time: float) -> None:
    """Set the clock back by 0.4 s after 30 s."""
    if time >= 30.0:
        stamp(message, round(1e9 * time) - 400_000_000)


def batched(message: Any, number: int, _time: float) -> None:
    """Stamp five poses at a time on arrival, without twists."""
    untwisted(message)
    first = number - number % 5
    stamp(message, 20_000_000 * (first + 4) + 100_000 * (number - first))


def held(folder: Path) -> tuple[Path, Path]:
    """Return joints that are new only every tenth of a second."""
    last: list[Any] = []

    def hold(message: Any, number: int, _time: float) -> None:
        if number % 5 == 0:
            last[:] = [message.position.copy(), message.velocity.copy()]
        message.position[:], message.velocity[:] = last

    made: tuple[Path, Path] = changed(hold)(folder)
    return made


def second_stream(folder: Path) -> tuple[Path, Path]:
    """Return every message of the joints followed by one of zeros."""
    given = []
    for topic, message, time in messages():
        given.append((topic, message, time))
        if topic == JOINTS:
            other = deepcopy(message)
            other.position, other.velocity = np.zeros(7), np.zeros(7)
            given.append((topic, other, time))
    return write(folder / 'bag', given), ROBOT


def in_parts(folder: Path) -> tuple[Path, Path]:
    """Return a first message with all joints, and then two parts."""
    given = []
    for topic, message, time in messages():
        if topic == JOINTS and time > 0:
            for part in (slice(0, 4), slice(4, 7)):
                some = deepcopy(message)
                for field in ('name', 'position', 'velocity'):
                    setattr(some, field, getattr(message, field)[part])
                given.append((topic, some, time))
        else:
            given.append((topic, message, time))
    return write(folder / 'bag', given), ROBOT


def with_part(name: str, inertia: float, mass: float, angle: Callable[[float], float], speed: float, every: int) -> Any:
    """Return a maker that adds a light joint on the base, in messages of its own where they are fewer."""

    def make(folder: Path) -> tuple[Path, Path]:
        link = f'<link name="{name}_link"><inertial><mass value="{mass}"/><inertia ixx="{inertia}" ixy="0" ixz="0" '
        link += f'iyy="{inertia}" iyz="0" izz="{inertia}"/></inertial></link><joint name="{name}" type="continuous">'
        link += f'<parent link="base_link"/><child link="{name}_link"/><axis xyz="0 0 1"/></joint></robot>'
        robot = folder / 'robot.urdf'
        robot.write_text(ROBOT.read_text().replace('</robot>', link))
        given, number = [], 0
        for topic, message, time in messages():
            given.append((topic, message, time))
            if topic == JOINTS:
                number += 1
                own = message if every == 1 else deepcopy(message)
                shown = float(np.angle(np.exp(1j * angle(1e-9 * time)))) + 1e-4 * RANDOM.standard_normal()
                if every > 1:
                    own.name, own.position, own.velocity = [], np.zeros(0), np.zeros(0)
                own.name = [*own.name, name]
                own.position, own.velocity = np.append(own.position, shown), np.append(own.velocity, speed)
                if every > 1 and number % every == 0:
                    given.append((topic, own, time))
        return write(folder / 'bag', given), robot

    return make
