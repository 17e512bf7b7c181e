"""The executable `noise_at_rest`: the sensors' noise, from their readings of a robot whose joints are braked."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from mbaid_ros.cli import warn
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.errors import DataError, listing
from mbaid_ros.core.geometry import Array
from mbaid_ros.replay.inputs import Inputs, between
from mbaid_ros.replay.rest_readings import FEWEST, SHORTEST, Recording, read_recording

_DEGREE = 3
_BLOCK = 0.5  # s, over which motion is looked for: noise averages out, and a joint that moves gets somewhere
_FEWEST_IN_BLOCK = 10
_ROUNDING = 1e-12  # rad or m: less than any sensor's step, more than double precision leaves of equal readings
_MOVED = 3.0  # standard deviations of a single sample; the noise of a block's mean is far below one


@dataclass(frozen=True)
class Measured:
    """Standard deviations by channel, NaN where nothing was measured, and warnings, one line each."""

    stds: dict[str, float]
    warnings: tuple[str, ...]


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


def measure(bag: str, joint_states: str, base: str, part: tuple[float, float] = (0.0, math.inf)) -> Measured:
    """Return the noise of each channel while the joints rest, from two topics of a bag.

    Raises DataError: The bag cannot be used, or the joints do not rest for `SHORTEST`.
    """
    recording, warnings = read_recording(bag, joint_states, base, part)
    recording, unsteady = without_wheels(recording)
    warnings += [f"bag '{bag}': {name} turns, and not at constant speed: it is left out" for name in unsteady]
    time = recording.joint_time
    begin, end, moved = longest_rest(time, recording.joint_channels['joint_position'])
    moving = f'{listing(recording.joints[joint] for joint in moved)} {"moves" if len(moved) == 1 else "move"}'
    if end - begin < SHORTEST:
        raise DataError(
            f"bag '{bag}' is of no robot at rest: {f'{moving}, ' if moved else ''}all joints rest for "
            f'{end - begin:.2g} s at most; accepted: {SHORTEST:g} s with the joints braked'
        )
    if moved:
        rest = f'{begin:.3g} s to {end:.3g} s of {time[-1]:.3g} s'
        warnings.append(f"bag '{bag}': {moving}; measured from {rest}, where all joints rest")
        recording = recording.between(begin, end)
        if min(len(recording.joint_time), len(recording.base_time)) < FEWEST:
            raise DataError(
                f"bag '{bag}' has fewer than {FEWEST} messages of a topic from {rest}; there all joints rest"
            )
    loose = [name for name, values in recording.base_channels.items() if wanders(recording.base_time, values)]
    if loose:
        warnings.append(
            f"bag '{bag}': {listing(loose)} {'is' if len(loose) == 1 else 'are'} not noise about a smooth curve alone: "
            'the base was pushed or tumbles fast, or errors are correlated; the value is too large or not meaningful'
        )
    channels = {**recording.joint_channels, **recording.base_channels}
    stds = {name: scatter(values) for name, values in channels.items()}
    if math.isnan(stds['joint_position']) and channels['joint_position'].size:
        text = 'no reading of a joint changes: leave noise.joint_position out, or declare the step of the encoder / 3.5'
        warnings.append(f"bag '{bag}': {text}")
    return Measured(stds, tuple(warnings))


def without_wheels(recording: Recording) -> tuple[Recording, list[str]]:
    """Return the readings without joints that turn all along, and the names of those of changing speed.

    A wheel at constant speed is at rest. Its positions show the jitter of the stamps, and count only without others.
    """
    time, position = recording.joint_time, recording.joint_channels['joint_position']
    if not len(time) or not position.shape[1]:
        return recording, []
    wheels = np.abs(position[-1] - position[0]) > 2.0 * np.pi
    line = np.polynomial.polynomial.polyvander(time, 1)
    steady = position - line @ np.linalg.lstsq(line, position, rcond=None)[0]
    _, _, moved = longest_rest(time, steady)
    unsteady = wheels & np.isin(np.arange(len(wheels)), moved)
    left = ~wheels if not np.all(wheels) else ~unsteady
    if not np.any(wheels) or not np.any(left):
        return recording, []
    channels = recording.joint_channels | {'joint_position': np.where(wheels, steady, position)}
    kept = {name: values[:, left] if values.shape[1] else values for name, values in channels.items()}
    names = np.array(recording.joints)
    return replace(recording, joints=tuple(names[left].tolist()), joint_channels=kept), names[unsteady].tolist()


def scatter(values: Array) -> float:
    """Return the standard deviation about a cubic of the noisiest column of (n, k); NaN where nothing was measured.

    That of the rounding to steps is the least; a column that never changes shows neither.
    """
    values = values[np.all(np.isfinite(values), axis=1)]
    step = _resolution(values)
    values, step = values[:, np.isfinite(step)], step[np.isfinite(step)]
    if values.size == 0 or len(values) < FEWEST:
        return float('nan')
    stds = np.std(_about_a_curve(values, _DEGREE), axis=0, ddof=_DEGREE + 1)
    return float(np.max(np.maximum(stds, step / math.sqrt(12.0))))


def wanders(time: Array, values: Array) -> bool:
    """Return whether the residuals of (n, k) about a cubic are no noise alone: a push, lasting errors."""
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
    """Return the smallest step of each column that is no rounding, infinite if none: an encoder may go to and fro."""
    steps = np.abs(np.diff(values, axis=0))
    return np.asarray(np.min(np.where(steps > _ROUNDING, steps, np.inf), axis=0, initial=np.inf))


def _about_a_curve(values: Array, degree: int) -> Array:
    curve = np.polynomial.polynomial.polyvander(np.linspace(-1.0, 1.0, len(values)), degree)
    return np.asarray(values - curve @ np.linalg.lstsq(curve, values, rcond=None)[0])
