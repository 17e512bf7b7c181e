"""Runs in which one sensor of several is broken: its axes, units, stamps, scale, or a slow drift."""

import re
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from benchmarks.data import target
from benchmarks.frame import PUBLISHED
from benchmarks.sensors import HAND, PAIRS, ROBOT, Pair, Spoil, estimates, gyro, numbers_in, pose, pose_in, set_in
from mbaid_ros.core.geometry import Array, exp, quaternion_from_rotation, rotation_from_quaternion

_TURN = exp(np.array([0.0, 0.0, 0.5 * np.pi]))
_LATE = 50_000_000  # ns
_SCALE, _SCALE_STD = 1.01, 1e-3  # and as declared
_SECONDS = 20.0
_DRIFT = np.array([0.6, -0.64, 0.48])  # a direction
_OF_GYRO, _OF_TURN, _OF_PLACE = 1e-4, 2.5e-4, 1e-3  # rad/s^2, rad/s, m/s: 2 mrad/s, 5 mrad and 20 mm in a run
_LONG, _DRIFTS = '1 % too large', 'drifts by 5 mrad'
_WORDS = 160  # characters of a cause
Change = Callable[[Any, float], None]  # of a message and its time, s


def late(message: Any, _time: float) -> None:
    """Stamp a message too late."""
    stamp = message.header.stamp
    seconds, stamp.nanosec = divmod(stamp.nanosec + _LATE, 1_000_000_000)
    stamp.sec += seconds


def _rate(change: Callable[[Array, float], Array], message: Any, time: float) -> None:
    set_in(message.angular_velocity, change(numbers_in(message.angular_velocity), time))


def _placed(change: Callable[[Array, float], Array], message: Any, time: float) -> None:
    position, _ = pose_in(message)
    if position is not None:
        set_in(position, change(numbers_in(position), time))


def _turned(change: Callable[[Array, float], Array], message: Any, time: float) -> None:
    _, turn = pose_in(message)
    if turn is not None:
        turned = change(rotation_from_quaternion(numbers_in(turn, 'xyzw')[None])[0], time)
        set_in(turn, quaternion_from_rotation(turned[None])[0], 'xyzw')


_GYRO_ERRORS: Mapping[str, Change] = {
    'axes turned': partial(_rate, lambda rate, _: _TURN @ rate),
    'degrees': partial(_rate, lambda rate, _: np.rad2deg(rate)),
    '50 ms late': late,
    _LONG: partial(_rate, lambda rate, _: _SCALE * rate),
    'drifts by 2 mrad/s': partial(_rate, lambda rate, time: rate + _OF_GYRO * time * _DRIFT),
}
_TURNS: Mapping[str, Change] = {
    'axes turned': partial(_turned, lambda turned, _: turned @ _TURN),
    '50 ms late': late,
    _DRIFTS: partial(_turned, lambda turned, time: exp(_OF_TURN * time * _DRIFT) @ turned),
}
_PLACES: Mapping[str, Change] = {
    'axes turned': partial(_placed, lambda place, _: _TURN @ place),
    'millimetres': partial(_placed, lambda place, _: 1e3 * place),
    '50 ms late': late,
    _LONG: partial(_placed, lambda place, _: _SCALE * place),
    'drifts by 20 mm': partial(_placed, lambda place, time: place + _OF_PLACE * time * _DRIFT),
}
_POSES: Mapping[str, Change] = {**_PLACES, 'axes turned': _TURNS['axes turned']}
# Topic, errors, how causes call it, and the scale as declared.
_IMU, _HAND = 'imu', 'hand'
_BASE = ((partial(gyro, 'imu', 100.0, 1e-4),), (partial(gyro, 'gyros.hand', 100.0, 1e-4, link=HAND),))
_TRACKER = partial(pose, 'tracker', 2.0, (1.0, 2e-5), measures='orientation')
_CAMERA = partial(pose, 'camera', 5.0, (1e-3, 1.0), measures='position')
_MOCAP = partial(pose, 'mocap', 50.0, (3e-4, 3e-4))
ALL = Pair('all', _BASE[0], (*_BASE[1], _TRACKER, _CAMERA, _MOCAP), odometry=True)


@dataclass(frozen=True)
class Broken:
    """A sensor and its error; the run, and how causes name the sensor."""

    pair: Pair = field(hash=False, compare=False)
    topic: str
    error: str
    change: Change = field(hash=False, compare=False)
    named: str
    sensor: str  # in words

    @property
    def name(self) -> str:
        """For tables and files."""
        return f'{self.pair.name}: {self.topic} {self.error}'

    @property
    def declared(self) -> dict[str, object]:
        """The declaration of a scale that is too precise."""
        if self.error != _LONG:
            return {}
        group = {'imu': 'imu', 'hand': 'gyros.hand', 'pose': 'odometry'}.get(self.topic, f'poses.{self.topic}')
        return {f'{group}.scale_std': _SCALE_STD}

    @property
    def made(self) -> dict[str, object]:
        """The errors of the sensor as simulated, without a scale of its own."""
        group = {'imu': 'imu', 'hand': 'gyros.hand'}.get(self.topic)
        return {f'{group}.scale': [0.0, 0.0, 0.0]} if self.declared and group else {}

    def spoil(self) -> Spoil:
        """Return what becomes of a message."""

        def spoilt(topic: str, time: float, message: Any) -> Any:
            if topic != self.topic:
                return message
            message = deepcopy(message)
            self.change(message, time)
            return message

        return spoilt


def _of(pair: Pair, topic: str, errors: Mapping[str, Change], named: str, sensor: str) -> tuple[Broken, ...]:
    return tuple(Broken(pair, topic, error, change, named, sensor) for error, change in errors.items())


BROKEN = (
    *_of(ALL, 'imu', _GYRO_ERRORS, r'\bimu\b|the IMU', 'gyro on the base'),
    *_of(ALL, 'hand', _GYRO_ERRORS, r'\bhand\b', 'gyro on the hand'),
    *_of(ALL, 'tracker', _TURNS, r'\btracker\b', 'star tracker, 2 Hz'),
    *_of(ALL, 'mocap', _POSES, r'\bmocap\b', 'motion capture, 50 Hz'),
    *_of(ALL, 'camera', _PLACES, r'\bcamera\b', 'camera, positions at 5 Hz'),
    *_of(ALL, 'pose', _POSES, r'\bodometry\b', 'odometry, poses at 10 Hz'),
    # Nothing but a gyro beside a tracker, and no other length beside a camera's.
    *_of(
        PAIRS[1], 'tracker', {_DRIFTS: _TURNS[_DRIFTS]}, r'\btracker\b|named poses', 'star tracker beside a gyro alone'
    ),
    *_of(PAIRS[2], 'camera', {_LONG: _PLACES[_LONG]}, r'\bcamera\b', 'camera, the only length'),
)


@dataclass(frozen=True)
class Found:
    """How a run ends."""

    status: str
    largest: float  # error over its standard deviation; NaN where nothing is published
    first: str  # cause, or warning, or what the result says that nothing checks
    place: int  # of the first of these that names the sensor, from 1 on; 0: none
    causes: str  # all of them with their gains, a line each


def run(broken: Broken, seed: int) -> Found:
    """Return the end of a run with a broken sensor."""
    _, found = estimates(
        broken.pair,
        seed,
        both=True,
        seconds=_SECONDS,
        spoil=broken.spoil(),
        simulated=broken.made,
        declared=broken.declared,
    )
    last = found[-1]
    given = last.identifiable & (last.status in PUBLISHED)
    error = np.where(given, np.abs(last.parameters - target(ROBOT)) / last.std, np.nan)
    largest = float(np.nanmax(error)) if given.any() else np.nan
    causes = [cause for cause, _ in last.causes]
    unchecked = '' if last.budget is None else last.budget.unobservable()
    texts = causes or ([f'unobservable with this motion: {unchecked}'] if unchecked else [])
    place = next((at for at, text in enumerate(texts, start=1) if re.search(broken.named, text)), 0)
    lines = '\n'.join(f'{gain:.0f} {cause[:_WORDS]}' for cause, gain in last.causes)
    return Found(last.status, largest, (texts or [''])[0][:_WORDS], place, lines)
