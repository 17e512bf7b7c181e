"""Whether joint velocities are the rates of the positions: zero, constant or in other units they are not.

In each window the integral of a velocity is compared with the positions. The check needs no model of the robot. Where
the two contradict each other the velocities are left out; they are taken from the positions then, where a method needs
them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mbaid_ros.core.errors import listing
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.sensors.noise import median

_FEWEST = 6  # samples of a window
_PART = 0.5  # of the motion, by positions or velocities, from which a difference is no filter's or stamp's
_MOVES = 5e-4  # rad or m, from which the motion in a window counts: less are steps of an encoder, or a filter's tail
_FAR = 7.0  # standard deviations of the difference, from which it is no noise
_SURE = 3  # windows, from which the velocities are wrong all along
_MOST = 0.25  # share of the windows with motion, that contradict at least then
_OF_SECOND = 0.6745 * np.sqrt(6.0)  # median size of a second difference of white noise, in standard deviations


class JointRates:
    """Leaves out joint velocities that contradict the positions.

    Parameters
    ----------
    names : of the joints
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._wrong = np.zeros(len(self._names), dtype=np.int64)  # windows that contradict, by joint
        self._moved = np.zeros(len(self._names), dtype=np.int64)  # windows in which a joint moves
        self._left_out: Flags = np.zeros(len(self._names), dtype=bool)
        self._zero: Flags = np.ones(len(self._names), dtype=bool)  # whether the velocity was zero all along

    def applied(self, window: Samples) -> Samples:
        """Return the next window, without velocities that are no rates."""
        velocity, time = window.joint_velocity, window.time
        if len(window) < _FEWEST or not velocity.shape[1] or window.missing_rates[0]:
            return window
        step = np.diff(time)[:, None]
        turned = np.cumsum(0.5 * step * (velocity[1:] + velocity[:-1]), axis=0)
        turned = np.concatenate((np.zeros((1, velocity.shape[1])), turned))
        position = window.joint_position
        size = np.maximum(np.std(position, axis=0), np.std(turned, axis=0))
        noise = np.hypot(_noise(position), np.mean(step) * np.sqrt(len(window)) * _noise(velocity))
        moves = size > np.maximum(_FAR * noise, _MOVES)
        wrong = moves & (np.std(position - turned, axis=0) > np.maximum(_FAR * noise, _PART * size))
        self._wrong += wrong
        self._moved += moves
        self._zero &= ~np.any(velocity, axis=0)
        self._left_out |= (self._wrong >= _SURE) & (self._wrong > _MOST * self._moved)
        if np.any(wrong | self._left_out):
            return replace(window, joint_velocity=np.full_like(velocity, np.nan))
        return window

    @property
    def contradiction(self) -> str:
        """Which velocities are no rates of the positions, in a sentence; empty where none is known to be."""
        wrong = self._left_out
        if not np.any(wrong):
            return ''
        zero = bool(np.all(self._zero[wrong]))
        names = listing(name for name, each in zip(self._names, wrong, strict=True) if each)
        how = 'zero while the positions change' if zero else 'no rates of the positions'
        return f'the velocities of {names} are {how}: velocities are taken from the positions; correct the driver'


def _noise(values: Array) -> Array:
    """Return the standard deviation of white noise in the columns of (N, n), by second differences."""
    return np.asarray(median(np.abs(np.diff(values, 2, axis=0))) / _OF_SECOND)
