"""Faults of joint states and poses as robots really publish them, put into the messages of shipped bags."""

from collections.abc import Callable, Iterable, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from mbaid_ros.bags import BagReader, BagWriter

ROOT = Path(__file__).resolve().parents[2]
JOINTS, ODOM = '/joint_states', '/odom'


class Source(NamedTuple):
    """A shipped bag of a robot in config/ that holds a mass (kg)."""

    bag: str
    robot: str
    mass: float

    @property
    def folder(self) -> Path:
        """Of the bag."""
        return ROOT / 'bags' / self.bag

    @property
    def urdf(self) -> Path:
        """Its robot description."""
        return ROOT / 'config' / f'{self.robot}.urdf'

    @property
    def parameters(self) -> Path:
        """Those of the estimator."""
        return ROOT / 'config' / f'{self.robot}_estimator.yaml'


SERVICER7 = Source('servicer7_mid', 'servicer7', 162.0)
ETS7 = Source('ets7_pose_only', 'ets7', 428.1)

Timed = tuple[str, Any, int]
Made = tuple[Path, Path]  # a bag and a robot description
RANDOM = np.random.default_rng(7)
EVERY = slice(None)


def messages(source: Source) -> list[Timed]:
    """Return joint states and odometry of the bag."""
    with BagReader(source.folder) as bag:
        given = list(bag.read([JOINTS, ODOM]))
    for topic, message, _ in given:
        if topic == JOINTS:
            message.position, message.velocity = np.array(message.position), np.array(message.velocity)
    return given


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


def spoil(given: Sequence[Timed], topic: str, fault: Callable[..., None], *values: Any, **named: Any) -> None:
    """Change the messages of a topic in place, by their number, their time (s) and more values."""
    for number, (_, message, time) in enumerate(each for each in given if each[0] == topic):
        fault(message, number, 1e-9 * time, *values, **named)


def changed(
    folder: Path, source: Source, topics: Sequence[str], fault: Callable[..., None], *values: Any, **named: Any
) -> Made:
    """Return a bag with a fault in all messages of some topics."""
    given = messages(source)
    for topic in topics:
        spoil(given, topic, fault, *values, **named)
    return write(folder / 'bag', given), source.urdf


def parted(
    folder: Path, source: Source, parts: Callable[..., Iterable[tuple[Any, int]]], *values: Any, **named: Any
) -> Made:
    """Return a bag with other messages in place of each joint state, by its number, its time (ns) and more values."""
    given: list[Timed] = []
    number = 0
    for topic, message, time in messages(source):
        if topic == JOINTS:
            given += [(topic, *each) for each in parts(message, number, time, *values, **named)]
            number += 1
        else:
            given.append((topic, message, time))
    return write(folder / 'bag', sorted(given, key=lambda each: each[2])), source.urdf


def pose_of(message: Any, position: Any, quaternion: Any) -> None:
    """Give an Odometry another pose."""
    pose = message.pose.pose
    pose.position.x, pose.position.y, pose.position.z = map(float, position)
    pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w = map(float, quaternion)


def read_pose(message: Any) -> tuple[np.ndarray[Any, Any], Rotation]:
    """Return position and orientation of an Odometry."""
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    return np.array([place.x, place.y, place.z]), Rotation.from_quat([turn.x, turn.y, turn.z, turn.w])


def untwisted(message: Any) -> None:
    """Take the twist out of an Odometry."""
    for part in (message.twist.twist.linear, message.twist.twist.angular):
        part.x = part.y = part.z = np.nan


def dropouts(
    message: Any,
    number: int,
    _time: float,
    every: int,
    joints: Any = EVERY,
    value: float = 0.0,
    *,
    of: str = 'position',
) -> None:
    """Let joints read a value once in so many messages."""
    if number % every == every // 2:
        getattr(message, of)[joints] = value


def units(
    message: Any, _number: int, _time: float, factor: float, offset: float = 0.0, joints: Any = EVERY, *, whole: bool
) -> None:
    """Publish joint positions in other units, without velocities."""
    message.position[joints] = factor * message.position[joints] + offset
    if whole:
        message.position[joints] = np.round(message.position[joints])
    message.velocity = np.zeros(0)


def velocities(message: Any, _number: int, _time: float, of: Callable[[Any, Any], Any], joints: Any = EVERY) -> None:
    """Publish other velocities, a function of positions and velocities."""
    message.velocity[joints] = of(message.position[joints], message.velocity[joints])


def lost(
    message: Any, _number: int, time: float, begin: float, end: float, pose: Sequence[float] = (0, 0, 0, 0, 0, 0, 1)
) -> None:
    """Lose the base for a while (s)."""
    if begin <= time < end:
        pose_of(message, pose[:3], pose[3:])


def fixed(message: Any, _number: int, time: float, noise: float, speed: float = 0.0) -> None:
    """Let the base stay where it is, or drift steadily, with noise (m, m/s; a tenth of it in rad, rad/s)."""
    turn = Rotation.from_rotvec(0.05 * noise * RANDOM.standard_normal(3))
    pose_of(message, noise * RANDOM.standard_normal(3) + [speed * time, 0, 0], turn.as_quat())
    twist = message.twist.twist
    for part, size, mean in ((twist.linear, noise, speed), (twist.angular, noise / 10, 0.0)):
        part.x, part.y, part.z = (size * RANDOM.standard_normal(3) + [mean, 0.0, 0.0]).tolist()


def axes(message: Any, _number: int, _time: float, position: Any = None, turn: Rotation | None = None) -> None:
    """Publish positions in other axes, a matrix, or locate a frame turned against the base, without a twist."""
    untwisted(message)
    place, rotation = read_pose(message)
    place = place if position is None else np.array(position) @ place
    pose_of(message, place, (rotation if turn is None else rotation * turn).as_quat())


def clock(message: Any, _number: int, time: float, step: float, at: float = 10.0) -> None:
    """Set the clock by a step (s) at a time (s)."""
    if time >= at:
        stamp(message, round(1e9 * (time + step)))


def batched(message: Any, number: int, _time: float, size: int) -> None:
    """Stamp so many messages at a time on arrival."""
    if hasattr(message, 'twist'):
        untwisted(message)
    first = number - number % size
    stamp(message, 20_000_000 * (first + size - 1) + 100_000 * (number - first))


def held(every: int, joints: Any = EVERY) -> Callable[[Any, int, float], None]:
    """Return a fault that lets joints be new only in one of so many messages."""
    last: list[Any] = []

    def fault(message: Any, number: int, _time: float) -> None:
        if number % every == 0:
            last[:] = [message.position.copy(), message.velocity.copy()]
        message.position[joints] = last[0][joints]
        if len(message.velocity):
            message.velocity[joints] = last[1][joints]

    return fault


def second_stream(
    message: Any,
    number: int,
    time: int,
    every: int,
    shift: float,
    of: Callable[[Any], Any],
    *,
    joints: slice = EVERY,
    rates: bool = True,
) -> Iterable[tuple[Any, int]]:
    """Add a second source of joint states, a function of positions, `shift` s after each of so many."""
    yield message, time
    if number % every == every - 1:
        other = deepcopy(message)
        other.name, other.position = list(message.name)[joints], np.asarray(of(message.position))[joints]
        other.velocity = 0.0 * message.velocity[joints] if rates else np.zeros(0)
        late = time + round(1e9 * shift)
        stamp(other, late)
        yield other, late


def in_parts(
    message: Any, number: int, time: int, *cuts: slice, whole: bool = True, last: int = 1
) -> Iterable[tuple[Any, int]]:
    """Publish parts of the joints, the last one of so many, after a first message with all of them."""
    if whole and number == 0:
        yield message, time
        return
    for part in cuts if number % last == last - 1 else cuts[:-1]:
        some = deepcopy(message)
        some.name, some.position = list(message.name)[part], message.position[part]
        some.velocity = message.velocity[part]
        yield some, time


def with_part(
    folder: Path,
    source: Source,
    name: str,
    angle: Callable[[float], float],
    speed: float | None,
    every: int = 1,
    *,
    wrapped: bool = True,
) -> Made:
    """Return a bag with a light joint on the base, in messages of its own where they are fewer; no speed: no rates."""
    link = f'<link name="{name}_link"><inertial><mass value="1e-6"/><inertia ixx="1e-9" ixy="0" ixz="0" iyy="1e-9" '
    link += f'iyz="0" izz="1e-9"/></inertial></link><joint name="{name}" type="continuous">'
    link += f'<parent link="base_link"/><child link="{name}_link"/><axis xyz="0 0 1"/></joint></robot>'
    robot = folder / 'robot.urdf'
    robot.write_text(source.urdf.read_text().replace('</robot>', link))

    def parts(message: Any, number: int, time: int) -> Iterable[tuple[Any, int]]:
        own = message if every == 1 else deepcopy(message)
        shown = angle(1e-9 * time) + 1e-4 * RANDOM.standard_normal()
        shown = float(np.angle(np.exp(1j * shown))) if wrapped else shown
        if every > 1:
            yield message, time
            own.name, own.position, own.velocity = [], np.zeros(0), np.zeros(0)
        own.name, own.position = [*own.name, name], np.append(own.position, shown)
        own.velocity = np.zeros(0) if speed is None else np.append(own.velocity, speed)
        if number % every == every - 1:
            yield own, time

    return parted(folder, source, parts)[0], robot
