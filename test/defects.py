"""Streams of messages of a simulated robot, and what goes wrong with them on their way.

The messages are plain objects with the fields of ROS messages: what is tested takes any that have them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.session.session import Session
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import Truth
from observed import MID, configured_motion
from simulated import CONFIG, robot

EPOCH = 1_700_000_000_000_000_000  # ns
JOINTS, ODOMETRY = 'joint_states', 'odom'
FINE = 500.0  # Hz, of the motion that sensors sample


@dataclass(frozen=True)
class Arrival:
    """A message on its way: where and when (ns) it arrives."""

    topic: str
    time: int
    message: Any


Defect = Callable[[list[Arrival]], list[Arrival]]


@cache
def fine_motion(name: str, seconds: float) -> Truth:
    """Return the run that config/ describes for a robot, at 500 Hz."""
    return configured_motion(name, seconds, FINE)


def header(stamp: int, frame: str = '') -> Any:
    seconds, nanoseconds = divmod(stamp, 1_000_000_000)
    return SimpleNamespace(stamp=SimpleNamespace(sec=seconds, nanosec=nanoseconds), frame_id=frame)


def stamp_of(arrival: Arrival) -> int:
    stamp = arrival.message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def joint_state(stamp: int, names: Sequence[str], position: Any, velocity: Any) -> Any:
    return SimpleNamespace(
        header=header(stamp), name=list(names), position=position, velocity=velocity, effort=np.zeros(0)
    )


def _fields(names: str, values: Array) -> Any:
    return SimpleNamespace(**dict(zip(names, map(float, values), strict=True)))


def odometry(stamp: int, child: str, pose: Array, twist: Array, covariances: tuple[Array, Array]) -> Any:
    """Return an Odometry of a pose (position, quaternion) and a twist (linear, angular)."""
    place = SimpleNamespace(position=_fields('xyz', pose[:3]), orientation=_fields('xyzw', pose[3:]))
    motion = SimpleNamespace(linear=_fields('xyz', twist[:3]), angular=_fields('xyz', twist[3:]))
    return SimpleNamespace(
        header=header(stamp, 'odom'),
        child_frame_id=child,
        pose=SimpleNamespace(pose=place, covariance=covariances[0].ravel()),
        twist=SimpleNamespace(twist=motion, covariance=covariances[1].ravel()),
    )


def arrivals(
    name: str, seconds: float, seed: int, joint_times: Array | None = None, odometry_times: Array | None = None
) -> list[Arrival]:
    """Return what sensors of the middle quality say of a robot's run of config/, in the order of its stamps.

    Parameters
    ----------
    name : of a robot
    seconds : length
    seed : of the noise
    joint_times, odometry_times : s, multiples of 2 ms: when each is measured; every 10 ms where not given
    """
    truth, model, sensors = fine_motion(name, seconds), robot(name), Sensors(MID, seed)
    every = np.arange(0.0, seconds - 1e-9, 0.01)
    places = [np.round((every if t is None else t) * FINE).astype(int) for t in (joint_times, odometry_times)]
    joints, base = sensors.joints(truth[places[0]]), sensors.base(truth[places[1]])
    covariances = base.pose_covariance, base.twist_covariance
    result = [
        Arrival(JOINTS, 0, joint_state(_stamp(time), model.joint_names, position, velocity))
        for time, position, velocity in zip(joints.time, joints.position, joints.velocity, strict=True)
    ]
    pose = np.concatenate((base.position, base.orientation), axis=1)
    twist = np.concatenate((base.linear_velocity, base.angular_velocity), axis=1)
    result += [
        Arrival(ODOMETRY, 0, odometry(_stamp(time), model.base_link, pose[index], twist[index], covariances))
        for index, time in enumerate(base.time)
    ]
    return in_order([replace(arrival, time=stamp_of(arrival)) for arrival in result])


def _stamp(time: float) -> int:
    return EPOCH + round(time * 1e9)


def in_order(messages: list[Arrival]) -> list[Arrival]:
    """Return messages in the order in which they arrive."""
    return sorted(messages, key=lambda arrival: arrival.time)


def changed(topic: str, change: Callable[[Any], None]) -> Defect:
    """Return the defect that changes a copy of every message of a topic."""

    def apply(messages: list[Arrival]) -> list[Arrival]:
        result = []
        for arrival in messages:
            message = arrival.message
            if arrival.topic == topic:
                message = copy(message)
                change(message)
            result.append(replace(arrival, message=message))
        return result

    return apply


def estimates(
    name: str, messages: Sequence[Arrival], parameters: dict[str, object] | None = None, at_once: int = 1_000_000
) -> tuple[list[Estimate], Session]:
    """Return what a session makes of messages, handed over so many at a time."""
    config = build(EstimatorConfig, {**EXACT, **(parameters or {})})
    session = Session(config, (CONFIG / f'{name}.urdf').read_text(encoding='utf-8'))
    result = []
    for index, arrival in enumerate(messages, start=1):
        take = session.add_joint_state if arrival.topic == JOINTS else session.add_odometry
        take(arrival.message)
        if index % at_once == 0:
            result += session.process()
    return result + session.process(), session


# What goes wrong


def shifted(seconds: float) -> Callable[[Any], None]:
    """Return the change that moves a message's stamp."""

    def change(message: Any) -> None:
        stamp = message.header.stamp
        message.header = header(
            int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec) + round(seconds * 1e9), message.header.frame_id
        )

    return change


def stamped(message: Any, stamp: int) -> Any:
    """Return a message with another stamp."""
    result = copy(message)
    result.header = header(stamp, message.header.frame_id)
    return result


def no_rates(message: Any) -> None:
    message.velocity = np.zeros(0)


def nan_rates(message: Any) -> None:
    message.velocity = np.full(len(message.position), np.nan)


def no_twist(message: Any) -> None:
    nothing = np.full(3, np.nan)
    twist = SimpleNamespace(linear=_fields('xyz', nothing), angular=_fields('xyz', nothing))
    message.twist = SimpleNamespace(twist=twist, covariance=np.zeros(36))


def no_covariance(message: Any) -> None:
    message.pose = SimpleNamespace(pose=message.pose.pose, covariance=np.zeros(36))
    message.twist = SimpleNamespace(twist=message.twist.twist, covariance=np.zeros(36))


def permuted_and_extra(message: Any) -> None:
    """Turn the joints round, between joints of another device."""
    message.name = ['gripper_left', *message.name[::-1], 'gripper_right']
    message.position = np.concatenate(([0.1], message.position[::-1], [0.2]))
    message.velocity = np.concatenate(([0.0], message.velocity[::-1], [0.0]))


def wrapped(message: Any) -> None:
    """Give angles as if from an encoder of one turn that begins in the middle of the motion."""
    message.position = np.mod(message.position - 0.5, 2.0 * np.pi) + 0.5


def odd_quaternion(message: Any) -> None:
    """Scale the quaternion, and turn its sign every other millisecond or so."""
    values = message.pose.pose.orientation
    factor = 1.05 * (1.0 if message.header.stamp.nanosec // 10_000_000 % 2 else -1.0)
    turned = _fields('xyzw', factor * np.array([values.x, values.y, values.z, values.w]))
    place = SimpleNamespace(position=message.pose.pose.position, orientation=turned)
    message.pose = SimpleNamespace(pose=place, covariance=message.pose.covariance)


def thrown(share: float, seed: int) -> Defect:
    """Return the defect that throws a share of the poses off by 0.2 m and 5 degrees."""

    def apply(messages: list[Arrival]) -> list[Arrival]:
        generator = np.random.default_rng(seed)

        def change(message: Any) -> None:
            way = generator.normal(size=(2, 3)) * (generator.random() < share)
            way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
            place, turn = message.pose.pose.position, message.pose.pose.orientation
            position = np.array([place.x, place.y, place.z]) + 0.2 * way[0]
            orientation = quaternions.product(
                quaternions.exp(np.deg2rad(5.0) * way[1]), np.array([turn.x, turn.y, turn.z, turn.w])
            )
            pose = SimpleNamespace(position=_fields('xyz', position), orientation=_fields('xyzw', orientation))
            message.pose = SimpleNamespace(pose=pose, covariance=message.pose.covariance)

        return changed(ODOMETRY, change)(messages)

    return apply


def correlated(name: str, seconds: float, constant: float, seed: int, declared: float = 0.0) -> Defect:
    """Return the defect that gives the poses of a robot's run noise as large as before, with a time constant (s).

    With `declared` as a navigation filter does: the twist has such noise, too, and the covariances declare so many
    times its size.
    """
    truth, generator = fine_motion(name, seconds), np.random.default_rng(seed)

    def apply(messages: list[Arrival]) -> list[Arrival]:
        keep = np.exp(-0.01 / constant)  # from one pose to the next, every 10 ms
        error = generator.normal(size=12 if declared else 6)

        def change(message: Any) -> None:
            nonlocal error
            error = keep * error + np.sqrt(1.0 - keep**2) * generator.normal(size=len(error))
            stamp = message.header.stamp
            place = round((int(stamp.sec) - EPOCH // 1_000_000_000 + stamp.nanosec * 1e-9) * FINE)
            position = truth.base_position[place] + MID.base_position * error[:3]
            turn = quaternions.exp(MID.base_orientation * error[3:6])
            orientation = quaternions.product(turn, truth.base_orientation[place])
            pose = SimpleNamespace(position=_fields('xyz', position), orientation=_fields('xyzw', orientation))
            message.pose = SimpleNamespace(pose=pose, covariance=message.pose.covariance)
            if declared:
                linear = truth.base_linear_velocity[place] + MID.base_linear_velocity * error[6:9]
                angular = truth.base_angular_velocity[place] + MID.base_angular_velocity * error[9:]
                twist = SimpleNamespace(linear=_fields('xyz', linear), angular=_fields('xyz', angular))
                for part, of_it in (('pose', pose), ('twist', twist)):
                    covariance = declared**2 * np.asarray(getattr(message, part).covariance)
                    setattr(message, part, SimpleNamespace(**{part: of_it, 'covariance': covariance}))

        return changed(ODOMETRY, change)(messages)

    return apply


def in_halves(messages: list[Arrival]) -> list[Arrival]:
    """Let two publishers give half of the joints each: the second at the odd samples' stamps, the first at the even."""
    result, odd = [], False
    for arrival in messages:
        if arrival.topic != JOINTS:
            result.append(arrival)
            continue
        message, odd = copy(arrival.message), not odd
        half = slice(0, 4) if odd else slice(4, None)
        for field in ('name', 'position', 'velocity'):
            setattr(message, field, getattr(message, field)[half])
        result.append(replace(arrival, message=message))
    return result


def out_of_order(seed: int, delay: float) -> Defect:
    """Return the defect that delays one message in ten by up to so many seconds on its way."""

    def apply(messages: list[Arrival]) -> list[Arrival]:
        generator = np.random.default_rng(seed)
        late = generator.random(len(messages)) < 0.1
        delays = np.where(late, generator.uniform(0.0, delay, len(messages)), 0.0)
        return in_order([replace(a, time=a.time + round(d * 1e9)) for a, d in zip(messages, delays, strict=True)])

    return apply


def repeated(messages: list[Arrival]) -> list[Arrival]:
    """Let every third message arrive twice."""
    return [arrival for index, one in enumerate(messages) for arrival in [one] * (2 if index % 3 == 0 else 1)]


def lost(seed: int, share: float) -> Defect:
    """Return the defect that loses a share of the messages."""

    def apply(messages: list[Arrival]) -> list[Arrival]:
        kept = np.random.default_rng(seed).random(len(messages)) >= share
        return [arrival for arrival, keep in zip(messages, kept, strict=True) if keep]

    return apply


def with_gaps(messages: list[Arrival]) -> list[Arrival]:
    """Let the odometry stay away for 50 ms every second, and for 300 ms every ten."""

    def there(arrival: Arrival) -> bool:
        since = (arrival.time - EPOCH) * 1e-9
        return arrival.topic == JOINTS or (since % 1.0 >= 0.05 and since % 10.0 >= 0.3)

    return [arrival for arrival in messages if there(arrival)]


def in_bursts(messages: list[Arrival]) -> list[Arrival]:
    """Let joint states arrive twenty at a time, in order, each burst with the last of its messages."""
    return in_order(
        [
            replace(a, time=a.time - (a.time - EPOCH) % 200_000_000 + 200_000_000) if a.topic == JOINTS else a
            for a in messages
        ]
    )


def of_marker(position: Array, quaternion: Array, frame: str) -> Defect:
    """Return the defect that measures another frame, at a place on the base, instead of the base link."""

    def change(message: Any) -> None:
        place, turn = message.pose.pose.position, message.pose.pose.orientation
        linear, angular = message.twist.twist.linear, message.twist.twist.angular
        base = np.array([turn.x, turn.y, turn.z, turn.w])
        rate = np.array([angular.x, angular.y, angular.z])
        velocity = np.array([linear.x, linear.y, linear.z]) + cross(rate, position)
        back = quaternions.conjugate(quaternion)
        pose = np.concatenate(
            (
                np.array([place.x, place.y, place.z]) + quaternions.rotate(base, position),
                quaternions.product(base, quaternion),
            )
        )
        twist = np.concatenate((quaternions.rotate(back, velocity), quaternions.rotate(back, rate)))
        covariances = message.pose.covariance, message.twist.covariance
        stamp = message.header.stamp
        moved = odometry(int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec), frame, pose, twist, covariances)
        message.__dict__.update(vars(moved))

    return changed(ODOMETRY, change)
