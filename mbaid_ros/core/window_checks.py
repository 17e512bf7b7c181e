"""Faults that closed windows show without an identification: joint velocities that are no rates, a base held.

Joint velocities that contradict the positions are left out; a method that needs them takes them from the positions.

A free base moves against the arm. Window by window its position p is compared with the offset c of the common centre
of mass from it, by the known links: without forces p + c moves along a straight line. A held base has no part of c.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from mbaid_ros.core.diagnosis.rate_checks import twist_check
from mbaid_ros.core.errors import listing
from mbaid_ros.core.geometry import Array, Flags, rotate
from mbaid_ros.core.results.status import Reason
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.sensors.noise import white_noise

# Windows before a first comparison, and part of those compared before that come before the next: fewer add little; the
# latest ones, whose motion is compared.
_FEWEST, _MORE, _KEPT = 10, 0.5, 120
_READ = 5  # samples of a window, of which the mean centre of mass is taken
_MOVED = 1e-3  # m, root mean square, that the centre of mass has to move by at least
_REACTION = 0.15  # times the motion of the centre of mass: the base's, from which it may be free
_CORRELATION = 0.5  # between the two, from which the base reacts, if by less than by the robot description
_WHITE = 3.0  # squared second difference over variance, 6 of white noise: of a motion, which is smooth, it is far less
_ROUNDING = 1e-12  # squared, of the motion of the centre of mass
_CERTAIN = 1e6  # log-likelihood that it counts as: more than a filter finds for any other cause

HELD = (
    'the base does not move while the arm does: it is held or bolted to the ground, or the odometry is that of another '
    'body; the method needs a base that floats'
)
_IS_HELD = Reason(HELD, 'conflict', _CERTAIN)


class HeldBase:
    """Follows windows, and finds whether the base is held.

    Parameters
    ----------
    kernel : the known links of the robot
    """

    def __init__(self, kernel: MomentumKernel) -> None:
        self._kernel = kernel
        self._pushed: Array = np.zeros(6)  # by thrust, at the end of the latest window
        # Of each window since the latest comparison: means of time and p; R and joints of a few samples.
        self._new: list[tuple[Array, Array, Array]] = []
        self._seen: deque[Array] = deque(maxlen=_KEPT)  # (7,) of each window before, means of time, p and c
        self._held = False
        # Of an unknown base, or a robot without moving parts, the known links determine no reaction.
        self._possible = kernel.target.body > 0 and kernel.model.joints > 0

    def update(self, window: Samples) -> Reason | None:
        """Add a window; return a reason from the one on that shows that the base is held."""
        if self._held:
            return _IS_HELD
        self._possible &= bool(np.isfinite(window.pose_covariance[0, 0, 0]))  # else nothing locates it
        if not self._possible:
            return None
        pushed, self._pushed = (window.impulse != self._pushed).any(), window.impulse[-1]
        if pushed:  # thrust moves the base
            self._seen.clear()
            self._new.clear()
            return None
        some = np.arange(_READ) * (len(window) - 1) // (_READ - 1)
        middle = np.concatenate(([window.time.mean()], window.base_position.mean(axis=0)))
        self._new.append((middle, window.base_rotation[some], window.joint_position[some]))
        if len(self._new) < max(_FEWEST, _MORE * len(self._seen)):
            return None
        middles, rotations, joints = map(np.array, zip(*self._new, strict=True))
        self._new.clear()
        self._seen.extend(np.concatenate((middles, self._centres(rotations, joints)), axis=1))
        self._held = _is_held(np.array(self._seen))
        return _IS_HELD if self._held else None

    def _centres(self, rotation: Array, joints: Array) -> Array:
        """Return the mean offsets (W, 3) of the known links' centre of mass from the base, of (W, k) samples."""
        placed = self._kernel.kinematics.configure(rotation.reshape(-1, 3, 3), joints.reshape(-1, joints.shape[2]))
        known = self._kernel.known
        moments = np.sum(rotate(placed.rotation, known[:, 1:4]) + known[:, :1] * placed.position, axis=1)
        return np.asarray(np.mean(moments.reshape(*rotation.shape[:2], 3), axis=1) / np.sum(known[:, 0]))


def _is_held(seen: Array) -> bool:
    """Return whether a base stays where it is, apart from noise, beside the centre of mass: rows (W, 7) t, p, c."""
    time = seen[:, 0] - np.mean(seen[:, 0])
    trend = np.vander(time / np.max(np.abs(time)), 3)
    left = seen[:, 1:] - trend @ np.linalg.lstsq(trend, seen[:, 1:], rcond=None)[0]
    base, centre = np.split(left, 2, axis=1)
    bends = np.sum(np.diff(left, 2, axis=0) ** 2, axis=0).reshape(2, 3).sum(axis=1)
    base_square, square = float(np.sum(base**2)), float(np.sum(centre**2))
    if square < len(seen) * _MOVED**2 or base_square > _REACTION**2 * square or bends[1] > square:
        return False  # nothing moves, the base reacts, or the arm seems to leap, as in degrees
    if base_square < _ROUNDING * square:
        return True
    together = abs(float(np.sum(base * centre)))
    return bool(together < _CORRELATION * np.sqrt(base_square * square) and bends[0] > _WHITE * base_square)


_FEWEST_READINGS = 6  # samples of a window, for their noise
_PART = 0.5  # of the motion, by positions or velocities, from which a difference is no filter's or stamp's
_MOVES = 5e-4  # rad or m, from which the motion in a window counts: less are steps of an encoder, or a filter's tail
_FAR = 7.0  # standard deviations of the difference, from which it is no noise
_SURE_OF_JOINTS = 3  # windows, from which the velocities are wrong all along
_MOST = 0.25  # share of the windows with motion, that contradict at least then


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

    def with_valid_rates(self, window: Samples) -> Samples:
        """Return the next window, without velocities that are no rates."""
        position, velocity, time = window.joint_position, window.joint_velocity, window.time
        if len(window) < _FEWEST_READINGS or not velocity.shape[1] or window.missing_rates[0]:
            return window
        turned = _path(time, velocity)
        paths = np.concatenate((position, turned, position - turned), axis=1)
        moved, turned, apart = np.std(paths, axis=0).reshape(3, -1)
        size = np.maximum(moved, turned)
        read, of_rates = white_noise(np.concatenate((position, velocity), axis=1), 2).reshape(2, -1)
        noise = np.hypot(read, (time[-1] - time[0]) / (len(time) - 1) * np.sqrt(len(window)) * of_rates)
        moves = size > np.maximum(_FAR * noise, _MOVES)
        wrong = moves & (apart > np.maximum(_FAR * noise, _PART * size))
        self._wrong += wrong
        self._moved += moves
        self._zero &= turned == 0.0
        if wrong.any():
            self._left_out |= (self._wrong >= _SURE_OF_JOINTS) & (self._wrong > _MOST * self._moved)
        if wrong.any() or self._left_out.any():
            return replace(window, joint_velocity=np.full_like(velocity, np.nan))
        return window

    def reason(self) -> Reason | None:
        """Return which velocities contradict the positions; None where none do."""
        wrong = self._left_out
        if not wrong.any():
            return None
        names = listing(name for name, each in zip(self._names, wrong, strict=True) if each)
        how = 'zero while the positions change' if np.all(self._zero[wrong]) else 'no rates of the positions'
        return Reason(
            f'the velocities of {names} are {how}: velocities are taken from the positions; correct the driver'
        )


def _path(time: Array, rate: Array) -> Array:
    """Return the integral of a rate (N, k) since the first of N times (trapezoid)."""
    steps = 0.5 * np.diff(time)[:, None] * (rate[1:] + rate[:-1])
    return np.concatenate((np.zeros((1, rate.shape[1])), np.cumsum(steps, axis=0)))


class Check(Protocol):
    """Something that windows may show to be wrong."""

    def update(self, window: Samples) -> Reason | None:
        """Add the next window; return the findings until then."""


class WindowChecks:
    """Follows windows, leaves out rates that contradict the positions, and returns reasons to distrust a run.

    Parameters
    ----------
    checks : of each window; None asks whether the twist is the rate of the poses
    joint_rates : leaves out joint velocities that are no rates of the positions; None leaves all in
    """

    def __init__(self, checks: Sequence[Check] | None = None, joint_rates: JointRates | None = None) -> None:
        self._checks = [twist_check()] if checks is None else checks
        self._joint_rates = joint_rates
        self._reasons: dict[float, list[Reason]] = {}  # by the end of the latest windows, s

    def with_valid_rates(self, windows: Sequence[Samples]) -> list[Samples]:
        """Return the next windows without rates that contradict the positions."""
        self._reasons.clear()
        return [self._checked(window) for window in windows]

    def reasons(self, time: float) -> list[Reason]:
        """Return the findings up to the end of a window of the latest call, s."""
        return self._reasons.get(time, [])

    def _checked(self, window: Samples) -> Samples:
        found = [check.update(window) for check in self._checks]
        checked = window
        if self._joint_rates is not None:
            checked = self._joint_rates.with_valid_rates(window)
            found.insert(0, self._joint_rates.reason())
        self._reasons[float(window.time[-1])] = [reason for reason in found if reason is not None]
        return checked
