"""The executable `noise_at_rest`: the sensors' noise, from their readings of a robot whose joints are braked."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from mbaid_ros.bags import BagReader
from mbaid_ros.cli import warn
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.geometry import Array, log
from mbaid_ros.core.joints.stream import TurnCounter, joint_channels
from mbaid_ros.core.noise import TYPICAL
from mbaid_ros.core.odometry.stream import POSE, AttachedFrame, OdometryReader, PoseReader, source_of
from mbaid_ros.core.outliers import JOINT_OUTLIER, Outliers
from mbaid_ros.core.samples import BaseStream, JointStream, SensorNoise, Stamps, stamps_of
from mbaid_ros.errors import DataError, listing
from mbaid_ros.replay.inputs import Inputs, between

_FEWEST = 50  # messages
_SHORTEST = 5.0  # s of rest: in less, a cubic takes the slow part of the noise for motion
_NEAR = 200_000_000  # ns between readings that are compared for outliers
_DEGREE = 3
_BLOCK = 0.5  # s, over which motion is looked for: noise averages out, and a joint that moves gets somewhere
_FEWEST_IN_BLOCK = 10
_ROUNDING = 1e-12  # rad or m: less than any sensor's step, more than double precision leaves of equal readings
_MOVED = 3.0  # standard deviations of a single sample; the noise of a block's mean is far below one


@dataclass(frozen=True)
class MeasuredNoise:
    """Standard deviations by channel, NaN where nothing was measured, and warnings, one line each."""

    stds: dict[str, float]
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class _Readings:
    """The readings in a bag, in the order of their stamps, as an estimator reads them."""

    names: Array  # (k,) of the joints
    joints: JointStream
    base: BaseStream
    origin: int  # ns, stamp of the first message of the joints

    def seconds(self, stream: JointStream | BaseStream) -> Array:
        """Return the stamps of a stream, (n,) s since the origin."""
        return np.asarray(1e-9 * (stream.stamp - self.origin))

    def between(self, begin: float, end: float) -> _Readings:
        """Return the readings from a time to another, s."""
        joints, base = self.seconds(self.joints), self.seconds(self.base)
        inside = (begin <= joints) & (joints <= end), (begin <= base) & (base <= end)
        return replace(self, joints=self.joints[inside[0]], base=self.base[inside[1]])


def print_noise(arguments: argparse.Namespace) -> int:
    """Print the noise as a parameter file and return the exit code."""
    inputs = Inputs.from_arguments(arguments, EstimatorConfig())
    measured = measure(arguments.bag, inputs.joint_states, inputs.odometry, between(arguments))
    warn('noise_at_rest', measured.warnings)
    known = any(map(math.isfinite, measured.stds.values()))
    print('/**:\n  ros__parameters:' + ('\n    noise:' if known else ' {}'))
    for name, std in measured.stds.items():
        print(f'      {name}: {std:.1e}' if math.isfinite(std) else f'      # {name}: not measured')
    return 0


def measure(bag: str, joint_states: str, base: str, part: tuple[float, float] = (0.0, math.inf)) -> MeasuredNoise:
    """Return the noise of each channel while the joints rest, from two topics of a bag.

    `base` names the topic of Odometry or poses; empty is /odom or else /pose.

    Raises DataError: The bag cannot be used, or the joints do not rest for `_SHORTEST`.
    """
    readings, warnings = _read(bag, joint_states, base, part)
    readings, unsteady = _without_wheels(readings)
    warnings += [f"bag '{bag}': {name} turns, and not at constant speed: it is left out" for name in unsteady]
    time = readings.seconds(readings.joints)
    begin, end, moved = _longest_rest(time, readings.joints.position)
    moving = f'{listing(readings.names[moved])} {"moves" if len(moved) == 1 else "move"}'
    if end - begin < _SHORTEST:
        raise DataError(
            f"bag '{bag}' is of no robot at rest: {f'{moving}, ' if moved else ''}all joints rest for "
            f'{end - begin:.2g} s at most; accepted: {_SHORTEST:g} s with the joints braked'
        )
    if moved:
        rest = f'{begin:.3g} s to {end:.3g} s of {time[-1]:.3g} s'
        warnings.append(f"bag '{bag}': {moving}; measured from {rest}, where all joints rest")
        readings = readings.between(begin, end)
        if min(len(readings.joints), len(readings.base)) < _FEWEST:
            raise DataError(
                f"bag '{bag}' has fewer than {_FEWEST} messages of a topic from {rest}; there all joints rest"
            )
    joints, located = readings.joints, readings.base
    of_base = {
        'base_position': located.position,
        'base_orientation': log(located.rotation[0].T @ located.rotation),
        'base_linear_velocity': located.linear_velocity,
        'base_angular_velocity': located.angular_velocity,
    }
    channels = {'joint_position': joints.position, 'joint_velocity': joints.velocity, **of_base}
    stds = {name: _scatter(values) for name, values in channels.items()}
    loose = [name for name, values in of_base.items() if _is_not_white(readings.seconds(located), values)]
    if loose:
        warnings.append(
            f"bag '{bag}': {listing(loose)} {'is' if len(loose) == 1 else 'are'} not noise about a smooth curve alone: "
            'the base was pushed or tumbles fast, or errors are correlated; the value is too large or not meaningful'
        )
    if math.isnan(stds['joint_position']) and joints.position.size:
        text = 'no reading of a joint changes: leave noise.joint_position out, or set a step of the encoder / 3.5'
        warnings.append(f"bag '{bag}': {text}")
    return MeasuredNoise(stds, tuple(warnings))


def _read(bag: str, joint_states: str, base: str, part: tuple[float, float]) -> tuple[_Readings, list[str]]:
    """Return the readings in a bag between two times, s from its first message, and warnings about it."""
    with BagReader(bag, *part) as recording:
        joint_states, odom = Inputs(joint_states, base).topics(recording)[:2]
        joints = [message for _, message, _ in recording.read([joint_states])]
        located = [message for _, message, _ in recording.read([odom])]
        poses = PoseReader('', '')
        bases = [pose for each in located for pose in ([each] if source_of(each) == 'odom' else poses.read(each))]
        warnings = list(dict.fromkeys(recording.warnings))
    for topic, messages in ((joint_states, joints), (odom, bases)):
        if len(messages) < _FEWEST:
            raise DataError('; '.join([f"bag '{bag}' has fewer than {_FEWEST} messages of '{topic}'", *warnings]))
    where, base_where = (f"topic '{topic}' of bag '{bag}'" for topic in (joint_states, odom))
    names, stream, lines = _joint_stream(joints, where)
    stream_of_base, others = _base_stream(bases, base_where)
    warnings += [f"bag '{bag}': {line}" for line in (*lines, *others)]
    return _Readings(names, stream, stream_of_base, int(stamps_of(joints[:1])[0])), warnings


def _joint_stream(joints: Sequence[Any], where: str) -> tuple[Array, JointStream, list[str]]:
    """Return names and readings of the joints, without turns and outliers, and notes on omitted readings."""
    names, stamps = _names(joints, where), _stamps(joints, where)
    position: Array = np.array([joint.position for joint in joints], dtype=float)
    velocity: Array = np.array([joint.velocity for joint in joints], dtype=float)
    if not position.shape[1]:
        return names, JointStream(stamps, position, velocity), []
    if not velocity.shape[1]:
        velocity = np.full_like(position, np.nan)
    known = np.sum(np.isfinite(position), axis=0) >= _FEWEST
    lines = [f'{name} has no position in most messages (NaN)' for name in names[~known]]
    position, velocity = position[:, known], velocity[:, known]
    usable = np.all(np.isfinite(position), axis=1)
    stream = JointStream(stamps[usable], position[usable], velocity[usable])
    if len(stream.stamp):
        stream.position[:] -= 2.0 * np.pi * TurnCounter(stream.position.shape[1]).turn_counts(stream)
    gate = Outliers[JointStream](_NEAR, joint_channels(float(TYPICAL[0])), JOINT_OUTLIER)
    stream = gate.push(stream) or stream[:0]
    lines += [f'{count} messages not used: {cause}' for cause, count in gate.dropped.items() if count]
    if len(stream.stamp) < _FEWEST:
        raise DataError('; '.join([f'{where} has fewer than {_FEWEST} messages with positions of all joints', *lines]))
    return names[known], stream, lines


def _base_stream(bases: Sequence[Any], where: str) -> tuple[BaseStream, list[str]]:
    """Return the readings of the base as an estimator reads them, without outliers, and notes on omitted readings."""
    _stamps(bases, where)
    frame = AttachedFrame(np.eye(3), np.zeros(3))
    reader = OdometryReader({}, frame, (), 'inertial', SensorNoise(*TYPICAL.tolist()))
    stream, dropped = reader.read(bases)
    if stream is not None:
        gate = Outliers[BaseStream](_NEAR, POSE)
        stream = gate.push(stream)
        dropped += gate.dropped
    lines = [f'{count} messages not used: {cause}' for cause, count in sorted(dropped.items())]
    if stream is None or len(stream.stamp) < _FEWEST:
        raise DataError('; '.join([f'{where} has fewer than {_FEWEST} poses that can be used', *lines]))
    return stream, lines


def _names(joints: Sequence[Any], topic: str) -> Array:
    """Return the names of the joints, (k,), which must be the same in each message, as the numbers of readings."""
    names = list(joints[0].name)
    for joint in joints:
        if list(joint.name) != names:
            raise DataError(f'messages on {topic} name other joints; accepted: the same in each')
        positions, velocities = len(joint.position), len(joint.velocity)
        if not {positions, velocities} <= {0, len(names)}:
            raise DataError(
                f'a message on {topic} has {len(names)} names, {positions} positions and {velocities} velocities; '
                'accepted: as many as names, or none'
            )
    return np.array(names)


def _stamps(messages: Sequence[Any], topic: str) -> Stamps:
    """Return the stamps of messages, ns; refuse stamps that go back or were never filled in."""
    stamps = stamps_of(messages)
    back = np.flatnonzero(np.diff(stamps) < 0)
    if back.size:
        before, after = 1e-9 * stamps[back[0] : back[0] + 2]
        raise DataError(
            f'a message on {topic} is stamped {after:.3f} s, after one of {before:.3f} s; accepted: stamps that do not '
            'go back'
        )
    lasting = 1e-9 * float(stamps[-1] - stamps[0])
    if lasting < _SHORTEST:
        raise DataError(
            f'messages on {topic} last {lasting:.2g} s by their stamps; accepted: {_SHORTEST:g} s with the joints '
            'braked'
        )
    return stamps


def _without_wheels(readings: _Readings) -> tuple[_Readings, list[str]]:
    """Return the readings without joints that turn all along, and the names of those of changing speed.

    A wheel at constant speed is at rest. Its positions show the jitter of the stamps, and count only without others.
    """
    time, position = readings.seconds(readings.joints), readings.joints.position
    if not position.size:
        return readings, []
    wheels = np.abs(position[-1] - position[0]) > 2.0 * np.pi
    line = np.polynomial.polynomial.polyvander(time, 1)
    steady = position - line @ np.linalg.lstsq(line, position, rcond=None)[0]
    unsteady = wheels & np.isin(np.arange(len(wheels)), _longest_rest(time, steady)[2])
    left = ~wheels if not np.all(wheels) else ~unsteady
    if not np.any(wheels) or not np.any(left):
        return readings, []
    kept = np.where(wheels, steady, position)[:, left]
    joints = replace(readings.joints, position=kept, velocity=readings.joints.velocity[:, left])
    return replace(readings, names=readings.names[left], joints=joints), readings.names[unsteady].tolist()


def _scatter(values: Array) -> float:
    """Return the standard deviation about a cubic of the noisiest column of (n, k); NaN where nothing was measured.

    That of the rounding to steps is the least; a column that never changes shows neither.
    """
    values = values[np.all(np.isfinite(values), axis=1)]
    step = _resolution(values)
    values, step = values[:, np.isfinite(step)], step[np.isfinite(step)]
    if values.size == 0 or len(values) < _FEWEST:
        return float('nan')
    stds = np.std(_about_a_curve(values, _DEGREE), axis=0, ddof=_DEGREE + 1)
    return float(np.max(np.maximum(stds, step / math.sqrt(12.0))))


def _is_not_white(time: Array, values: Array) -> bool:
    """Return whether the residuals of (n, k) about a cubic are not white: a disturbance, correlated errors."""
    if values.size == 0 or not np.all(np.isfinite(values)):
        return False
    blocks = _blocks(time)
    rest = _about_a_curve(values, _DEGREE)
    means = np.array([np.mean(rest[block], axis=0) for block in blocks])
    return bool(np.any(np.abs(means) > _MOVED * _noise(rest, blocks)))


def _longest_rest(time: Array, position: Array) -> tuple[float, float, list[int]]:
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
    """Return the smallest step of each column that is no rounding, infinite if none: an encoder may go to and fro."""
    steps = np.abs(np.diff(values, axis=0))
    return np.asarray(np.min(np.where(steps > _ROUNDING, steps, np.inf), axis=0, initial=np.inf))


def _about_a_curve(values: Array, degree: int) -> Array:
    curve = np.polynomial.polynomial.polyvander(np.linspace(-1.0, 1.0, len(values)), degree)
    return np.asarray(values - curve @ np.linalg.lstsq(curve, values, rcond=None)[0])
