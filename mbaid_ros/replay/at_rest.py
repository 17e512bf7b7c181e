"""The executable `noise_at_rest`: the sensors' noise, from their readings of a robot whose joints are braked."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from mbaid_ros.bags import BagReader
from mbaid_ros.cli import warn
from mbaid_ros.core.errors import DataError, listing
from mbaid_ros.core.geometry import Array
from mbaid_ros.messages import numbers_of
from mbaid_ros.replay.inputs import JOINT_STATE_TYPE, ODOMETRY_TYPE

FEWEST = 50  # messages
SHORTEST = 5.0  # s of rest: in less, a cubic takes the slow part of the noise for motion
_DEGREE = 3
_BLOCK = 0.5  # s, over which motion is looked for: noise averages out, and a joint that moves gets somewhere
_FEWEST_IN_BLOCK = 10
_MOVED = 3.0  # standard deviations of a single sample; what noise leaves of a block's mean is far below one


@dataclass(frozen=True)
class Recording:
    """The readings in a bag.

    Attributes
    ----------
    joint_time, base_time : (n,), (m,) s, stamps since the first one of the joints
    joint_channels : by name, (n, k) each; (n, 0) where nothing was measured
    base_channels : by name, (m, 3) each; orientations as rotation vectors from the first one
    """

    joints: tuple[str, ...]
    joint_time: Array
    base_time: Array
    joint_channels: dict[str, Array]
    base_channels: dict[str, Array]

    def between(self, begin: float, end: float) -> Recording:
        """Return the readings from a time to another, s."""
        joints, bases = ((begin <= time) & (time <= end) for time in (self.joint_time, self.base_time))
        return Recording(
            self.joints,
            self.joint_time[joints],
            self.base_time[bases],
            {name: values[joints] for name, values in self.joint_channels.items()},
            {name: values[bases] for name, values in self.base_channels.items()},
        )


@dataclass(frozen=True)
class Measured:
    """Standard deviations by channel, NaN where nothing was measured, and warnings, one line each."""

    stds: dict[str, float]
    warnings: tuple[str, ...]


def print_noise(arguments: argparse.Namespace) -> int:
    """Print the noise as a parameter file and return the exit code."""
    measured = measure(arguments.bag, arguments.joint_states, arguments.odom)
    warn('noise_at_rest', measured.warnings)
    print('/**:\n  ros__parameters:\n    noise:')
    for name, std in measured.stds.items():
        print(f'      {name}: {std:.1e}' if math.isfinite(std) else f'      # {name}: not measured')
    return 0


def measure(bag: str, joint_states: str, odom: str) -> Measured:
    """Return the noise of each channel while the joints rest, from two topics of a bag.

    Raises
    ------
    DataError
        The bag cannot be used, or the joints do not rest for `SHORTEST`.
    """
    recording, warnings = _read(bag, joint_states, odom)
    time = recording.joint_time
    begin, end, moved = longest_rest(time, recording.joint_channels['joint_position'])
    moving = f'{listing(recording.joints[joint] for joint in moved)} {"moves" if len(moved) == 1 else "move"}'
    if end - begin < SHORTEST:
        raise DataError(
            f"bag '{bag}' is of no robot at rest: {f'{moving}, ' if moved else ''}all joints rest for "
            f'{end - begin:.2g} s at most; accepted: {SHORTEST:g} s with the joints braked'
        )
    if moved:
        part = f'{begin:.3g} s to {end:.3g} s of {time[-1]:.3g} s'
        warnings.append(f"bag '{bag}': {moving}; measured from {part}, where all joints rest")
        recording = recording.between(begin, end)
        if min(len(recording.joint_time), len(recording.base_time)) < FEWEST:
            raise DataError(
                f"bag '{bag}' has fewer than {FEWEST} messages of a topic from {part}; there all joints rest"
            )
    loose = [name for name, values in recording.base_channels.items() if wanders(recording.base_time, values)]
    if loose:
        warnings.append(
            f"bag '{bag}': {listing(loose)} {'is' if len(loose) == 1 else 'are'} not noise about a smooth curve alone: "
            'the base was pushed or tumbles fast, or errors last for a while; the number is too large or means little'
        )
    channels = {**recording.joint_channels, **recording.base_channels}
    return Measured({name: scatter(values) for name, values in channels.items()}, tuple(warnings))


def _read(bag: str, joint_states: str, odom: str) -> tuple[Recording, list[str]]:
    """Return the readings in a bag, and warnings about it."""
    with BagReader(bag) as recording:
        for topic, kind in ((joint_states, JOINT_STATE_TYPE), (odom, ODOMETRY_TYPE)):
            recording.require(topic, kind)
        joints = [message for _, message, _ in recording.read([joint_states])]
        bases = [message for _, message, _ in recording.read([odom])]
        warnings = list(dict.fromkeys(recording.warnings))
    for topic, messages in ((joint_states, joints), (odom, bases)):
        if len(messages) < FEWEST:
            raise DataError('; '.join([f"bag '{bag}' has fewer than {FEWEST} messages of '{topic}'", *warnings]))
    where, base_where = (f"topic '{topic}' of bag '{bag}'" for topic in (joint_states, odom))
    names, begin = _names(joints, where), _stamp(joints[0])
    joint_time, base_time = _times(joints, begin, where), _times(bases, begin, base_where)
    try:
        position, orientation, linear, angular = np.split(np.array(list(map(numbers_of, bases))), [3, 7, 10], axis=1)
        turns = Rotation.from_quat(orientation)
        found = Recording(
            joints=names,
            joint_time=joint_time,
            base_time=base_time,
            joint_channels={
                'joint_position': np.array([joint.position for joint in joints]),
                'joint_velocity': np.array([joint.velocity for joint in joints]),
            },
            base_channels={
                'base_position': position,
                'base_orientation': (turns[0].inv() * turns).as_rotvec(),
                'base_linear_velocity': linear,
                'base_angular_velocity': angular,
            },
        )
    except ValueError as error:  # messages of unequal lengths, no rotation
        raise DataError(f"bag '{bag}' cannot be used: {error}") from error
    return found, warnings


def _names(joints: Sequence[Any], topic: str) -> tuple[str, ...]:
    """Return the names of the joints, which must be the same in each message, as the numbers of readings."""
    names = tuple(joints[0].name)
    for joint in joints:
        if tuple(joint.name) != names:
            raise DataError(f'messages on {topic} name other joints; accepted: the same in each')
        positions, velocities = len(joint.position), len(joint.velocity)
        if not {positions, velocities} <= {0, len(names)}:
            raise DataError(
                f'a message on {topic} has {len(names)} names, {positions} positions and {velocities} velocities; '
                'accepted: as many as names, or none'
            )
    return names


def _times(messages: Sequence[Any], origin: int, topic: str) -> Array:
    """Return the stamps of messages, s since an origin in ns; refuse stamps that go back or were never filled in."""
    stamps = np.array([_stamp(message) for message in messages])
    back = np.flatnonzero(np.diff(stamps) < 0)
    if back.size:
        before, after = 1e-9 * stamps[back[0] : back[0] + 2]
        raise DataError(
            f'a message on {topic} is stamped {after:.3f} s, after one of {before:.3f} s; accepted: stamps that do not '
            'go back'
        )
    lasting = 1e-9 * float(stamps[-1] - stamps[0])
    if lasting < SHORTEST:
        raise DataError(
            f'messages on {topic} last {lasting:.2g} s by their stamps; accepted: {SHORTEST:g} s with the joints braked'
        )
    return np.asarray(1e-9 * (stamps - origin))


def _stamp(message: object) -> int:
    stamp = message.header.stamp  # type: ignore[attr-defined]
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def scatter(values: Array) -> float:
    """Return the standard deviation about a cubic of the noisiest column of (n, k); NaN where nothing was measured."""
    values = values[np.all(np.isfinite(values), axis=1)]
    if values.size == 0 or len(values) < FEWEST:
        return float('nan')
    return float(np.max(np.std(_about_a_curve(values, _DEGREE), axis=0, ddof=_DEGREE + 1)))


def wanders(time: Array, values: Array) -> bool:
    """Tell whether what is left of (n, k) about a cubic is no noise alone: a push, a fast tumble, errors that last."""
    if values.size == 0 or not np.all(np.isfinite(values)):
        return False
    blocks = _blocks(time)
    rest = _about_a_curve(values, _DEGREE)
    means = np.array([np.mean(rest[block], axis=0) for block in blocks])
    return bool(np.any(np.abs(means) > _MOVED * _noise(rest, blocks)))


def longest_rest(time: Array, position: Array) -> tuple[float, float, list[int]]:
    """Return begin and end (s) of the longest stretch in which no joint moves, and the columns of joints that move.

    `time` is (n,) s, in order; `position` is (n, k).
    """
    known = np.all(np.isfinite(position), axis=1)
    if position[known].size == 0:
        return float(time[0]), float(time[-1]), []
    time, position = time[known], position[known]
    blocks = _blocks(time)
    means = np.array([np.mean(position[block], axis=0) for block in blocks])
    allowed = 2.0 * _MOVED * _noise(position, blocks) + 2.0 * _resolution(position)
    best, first = (0, 0), 0
    for last in range(len(blocks)):
        while np.any(np.ptp(means[first : last + 1], axis=0) > allowed):
            first += 1
        best = max(best, (first, last), key=lambda stretch: stretch[1] - stretch[0])
    moved = np.flatnonzero(np.ptp(means, axis=0) > allowed)
    return float(time[blocks[best[0]][0]]), float(time[blocks[best[1]][-1]]), moved.tolist()


def _blocks(time: Array) -> list[npt.NDArray[np.intp]]:
    """Return the places of the samples in consecutive blocks, of half a second where that is enough of them."""
    count = max(1, min(int((time[-1] - time[0]) / _BLOCK), len(time) // _FEWEST_IN_BLOCK))
    return np.array_split(np.arange(len(time)), count)


def _noise(values: Array, blocks: Sequence[npt.NDArray[np.intp]]) -> Array:
    """Return the usual standard deviation of each column within a block, motion taken away as a parabola."""
    return np.asarray(np.median([np.std(_about_a_curve(values[block], 2), axis=0) for block in blocks], axis=0))


def _resolution(values: Array) -> Array:
    """Return the smallest step of each column that is not 0: an encoder may go to and fro between two numbers."""
    steps = np.abs(np.diff(values, axis=0))
    return np.asarray(np.min(np.where(steps > 0.0, steps, np.inf), axis=0, initial=np.inf))


def _about_a_curve(values: Array, degree: int) -> Array:
    curve = np.polynomial.polynomial.polyvander(np.linspace(-1.0, 1.0, len(values)), degree)
    return np.asarray(values - curve @ np.linalg.lstsq(curve, values, rcond=None)[0])
