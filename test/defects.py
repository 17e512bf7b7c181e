"""Streams of messages of a simulated robot, and what goes wrong with them on their way."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from benchmarks.honesty import readings
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.parameters import build
from mbaid_ros.session.session import Session
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import Truth
from observed import MID, configured_motion
from recorded import header, joint_state, odometry, of
from sessions import fed
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


def stamp_of(arrival: Arrival) -> int:
    stamp = arrival.message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def arrivals(
    name: str,
    seconds: float,
    seed: int,
    joint_times: Array | None = None,
    odometry_times: Array | None = None,
    *,
    read: readings.Defect = lambda found, _rng: found,
) -> list[Arrival]:
    """Return what sensors of the middle quality say of a robot's run of config/, in the order of its stamps.

    Parameters
    ----------
    name : of a robot
    seconds : length
    seed : of the noise
    joint_times, odometry_times : s, multiples of 2 ms: when each is measured; every 10 ms where not given
    read : the defect of the readings
    """
    truth, model, sensors = fine_motion(name, seconds), robot(name), Sensors(MID, seed)
    every = np.arange(0.0, seconds - 1e-9, 0.01)
    places = [np.round((every if t is None else t) * FINE).astype(int) for t in (joint_times, odometry_times)]
    clean = readings.Readings(truth[places[1]], sensors.joints(truth[places[0]]), sensors.base(truth[places[1]]))
    found = read(clean, np.random.default_rng(seed))
    joints, base = found.joints, found.base
    covariances = np.array((base.pose_covariance, base.twist_covariance))
    result = [
        Arrival(JOINTS, 0, joint_state(model.joint_names, position, velocity, stamp=_stamp(time)))
        for time, position, velocity in zip(joints.time, joints.position, joints.velocity, strict=True)
    ]
    parts = (base.position, base.orientation, base.linear_velocity, base.angular_velocity)
    result += [
        Arrival(ODOMETRY, 0, odometry(numbers, covariances, stamp=_stamp(time), child=model.base_link))
        for time, numbers in zip(base.time, np.concatenate(parts, axis=1), strict=True)
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
    return fed(session, ((arrival.topic, arrival.message) for arrival in messages), at_once), session


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
    nothing = of('Vector3', np.full(3, np.nan))
    twist = replace(message.twist.twist, linear=nothing, angular=copy(nothing))
    message.twist = replace(message.twist, twist=twist, covariance=np.zeros(36))


def no_covariance(message: Any) -> None:
    scaled_covariances(0.0)(message)


def scaled_covariances(factor: float) -> Callable[[Any], None]:
    """Return the change that multiplies the covariances of an Odometry."""

    def change(message: Any) -> None:
        for name in ('pose', 'twist'):
            part = getattr(message, name)
            setattr(message, name, replace(part, covariance=factor * part.covariance))

    return change


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
    turned = of('Quaternion', factor * np.array([values.x, values.y, values.z, values.w]))
    message.pose = replace(message.pose, pose=replace(message.pose.pose, orientation=turned))


def map_corrected(message: Any) -> None:
    """Correct the map three times, by 20 to 200 mm and up to 5 degrees, each for all later poses."""
    pose, stamp = message.pose.pose, message.header.stamp
    since = stamp.sec + 1e-9 * stamp.nanosec - 1e-9 * EPOCH
    place = np.array([getattr(pose.position, axis) for axis in 'xyz'])
    turn = np.array([getattr(pose.orientation, axis) for axis in 'xyzw'])
    for begin, axis, angle, step in ((3.2, 0, 0.0, 0.02), (6.42, 1, 0.09, 0.1), (9.0, 2, -0.02, 0.2)):
        if since > begin:
            turned = quaternions.exp(angle * np.eye(3)[axis])
            place = quaternions.rotate(turned, place) + step * np.eye(3)[axis - 1]
            turn = quaternions.product(turned, turn)
    moved = replace(pose, position=of('Point', place), orientation=of('Quaternion', turn))
    message.pose = replace(message.pose, pose=moved)


def navigation(constant: float, declared: float) -> readings.Defect:
    """Return readings of a navigation filter: all errors last (s), and so many times their size is declared."""

    def defect(found: readings.Readings, rng: np.random.Generator) -> readings.Readings:
        base, truth = readings.correlated(constant, found, rng).base, found.truth
        linear, angular = (
            getattr(truth, f'base_{name}')
            + readings.coloured(getattr(base, name) - getattr(truth, f'base_{name}'), truth.time, constant)
            for name in ('linear_velocity', 'angular_velocity')
        )
        covariances = {
            f'{part}_covariance': declared**2 * getattr(base, f'{part}_covariance') for part in ('pose', 'twist')
        }
        return replace(found, base=replace(base, linear_velocity=linear, angular_velocity=angular, **covariances))

    return defect


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
        covariances = np.array((message.pose.covariance, message.twist.covariance))
        moved = odometry(np.concatenate((pose, twist)), covariances, child=frame)
        message.__dict__.update(vars(moved), header=message.header)

    return changed(ODOMETRY, change)
