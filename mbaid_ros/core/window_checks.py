"""Faults that closed windows show without an identification: wrong frames, units and rates, a base held.

A free base moves against the arm. Window by window its position p is compared with the offset c of the common centre
of mass from it, by the known links: without forces p + c moves along a straight line. A held base has no part of c.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from mbaid_ros.core.diagnosis.rate_checks import JointRates, twist_check
from mbaid_ros.core.geometry import Array, rotate
from mbaid_ros.core.results.status import Reason
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.samples import Samples

_EVERY, _KEPT = 10, 120  # windows from one comparison to the next; the latest ones, whose motion is compared
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
        if len(self._new) < _EVERY:
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


class Check(Protocol):
    """Something that windows may show to be wrong."""

    def update(self, window: Samples) -> Reason | None:
        """Add the next window; return what the windows until then show."""


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

    def applied(self, windows: Sequence[Samples]) -> list[Samples]:
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
            checked = self._joint_rates.applied(window)
            found.insert(0, self._joint_rates.reason())
        self._reasons[float(window.time[-1])] = [reason for reason in found if reason is not None]
        return checked
