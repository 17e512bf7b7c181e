"""Unwrapping of angles, also of wheels that turn by more than a half between two readings."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.samples import JointStream

# rad from one reading to the next by the velocity: compared with the positions, and trusted more than the shorter way.
_COMPARED, _FAST = 0.1, 0.5 * np.pi
_AGREES = 0.5  # rad, and times the step, that positions and velocities may differ by
_TRUSTED = 0.5  # share of the steps compared so far, in which they agree


class TurnCounter:
    """Counts the whole turns that wrapped angles leave out; the count does not depend on how readings are cut.

    A wheel may turn by more than a half between two readings. Where its velocities have agreed with its positions, they
    predict the step, and the number of turns nearest to that counts; else the shorter way.
    """

    def __init__(self, joints: int) -> None:
        self._last: JointStream | None = None  # latest two readings
        self._count, self._step = np.zeros((2, joints))  # turns so far, and those of the latest step
        self._off = np.zeros(joints, dtype=bool)  # whether that step contradicts the velocity
        self._agreed, self._compared = np.zeros((2, joints))  # steps so far

    def turn_counts(self, stream: JointStream) -> Array:
        """Return the whole turns (N, n) to subtract from the next readings."""
        joined = stream if self._last is None else stream.concatenate((self._last, stream))
        new = len(stream.stamp) - (self._last is None)  # steps
        self._last = joined[-2:]
        if not new:
            return np.zeros((len(stream.stamp), len(self._count)))
        step, expected, change = (each[-new:] for each in position_steps(joined))
        left, size = step - expected, np.abs(expected)
        turns = np.round(left / (2.0 * np.pi))
        agrees = np.abs(left - 2.0 * np.pi * turns) < _AGREES * np.minimum(size, 1.0)
        compared = self._compared + np.cumsum(size > _COMPARED, axis=0)
        agreed = self._agreed + np.cumsum(agrees & (size > _COMPARED), axis=0)
        fast = (size > _FAST) & (agreed >= _TRUSTED * compared)
        turns = np.where(fast, turns, np.round(step / (2.0 * np.pi)))
        off = fast & ~(agrees & (change < _AGREES))  # wrong readings may agree by chance
        if np.any(off | self._off):
            self._skip_wrong_readings(joined, turns, off)
        self._compared, self._agreed = compared[-1], agreed[-1]
        self._step, self._off = turns[-1], off[-1]
        counted = self._count + np.cumsum(turns, axis=0)
        before, self._count = self._count, counted[-1]
        return counted if len(counted) == len(stream.stamp) else np.concatenate((before[None], counted))

    def _skip_wrong_readings(self, joined: JointStream, turns: Array, off: Flags) -> None:
        """Count over single wrong readings, in place: the steps to one and back may not add up."""
        step, expected, change = position_steps(joined, 2)
        across = np.round((step - expected) / (2.0 * np.pi))
        agrees = np.abs(step - expected - 2.0 * np.pi * across) + change < _AGREES
        before, skipped = (self._step, self._off), len(off) - len(step)
        for place in range(len(off)):
            if place >= skipped:
                over = before[1] & off[place] & agrees[place - skipped]
                turns[place] = np.where(over, across[place - skipped] - before[0], turns[place])
                off[place] &= ~over
            before = turns[place], off[place]


def position_steps(stream: JointStream, over: int = 1) -> tuple[Array, Array, Array]:
    """Return the steps of the positions from each reading to one of the next, and those by the mean velocity.

    The last result is how far the latter may be off as the velocity changes; without any velocity they are NaN.
    """
    first, last = stream.velocity[:-over], stream.velocity[over:]
    first, last = np.where(np.isnan(first), last, first), np.where(np.isnan(last), first, last)
    elapsed = 1e-9 * (stream.stamp[over:] - stream.stamp[:-over])[:, None]
    step = stream.position[over:] - stream.position[:-over]
    return step, 0.5 * (first + last) * elapsed, 0.5 * np.abs(last - first) * elapsed
