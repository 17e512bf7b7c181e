"""Faults that closed windows show without an identification: wrong frames, units and rates, a base held.

A free base moves against the arm. Window by window its position p is compared with the offset c of the common centre
of mass from it, by the known links: without forces p + c moves along a straight line. A held base has no part of c.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbaid_ros.core.diagnosis.rate_checks import GyroFrame, JointRates, TwistFrame
from mbaid_ros.core.geometry import Array, rotate
from mbaid_ros.core.results.status import Reason, notes
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.samples import Samples

_FEWEST = 10  # windows
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


class HeldBase:
    """Follows windows, and reports once if the base is held.

    Parameters
    ----------
    kernel : the known links of the robot
    """

    def __init__(self, kernel: MomentumKernel) -> None:
        self._kernel = kernel
        self._pushed: Array = np.zeros(6)  # by thrust, at the end of the latest window
        self._begin()
        # Of an unknown base, or a robot without moving parts, the known links determine no reaction.
        self._done = kernel.target.body == 0 or kernel.model.joints == 0

    def _begin(self) -> None:
        self._count = 0
        self._bends: Array = np.zeros(2)  # sums of squared second differences of p and c
        self._squares: Array = np.zeros((9, 9))  # products of (1, t, t^2), p and c, sums over the windows
        self._latest: list[Array] = []  # the means of the latest windows
        self._origin: Array = np.zeros(6)

    def update(self, windows: Sequence[Samples]) -> list[Reason | None]:
        """Add windows; return for each a reason, of one alone, when the base is known to be held."""
        if self._done or not windows:
            return [None] * len(windows)
        return [self._add(*each) for each in zip(windows, self._centres(windows), strict=True)]

    def _centres(self, windows: Sequence[Samples]) -> Array:
        """Return the mean offsets (W, 3) of the known links' centre of mass from the base in windows."""
        places = [np.linspace(0, len(window) - 1, min(_READ, len(window))).astype(np.intp) for window in windows]
        rotation, joints = (
            np.concatenate([getattr(window, name)[place] for window, place in zip(windows, places, strict=True)])
            for name in ('base_rotation', 'joint_position')
        )
        placed, known = self._kernel.kinematics.configure(rotation, joints), self._kernel.known
        moments = rotate(placed.rotation, known[:, 1:4]) + known[:, :1] * placed.position
        count = np.array([len(place) for place in places])
        centre = np.sum(moments, axis=1) / np.sum(known[:, 0])
        return np.asarray(np.add.reduceat(centre, np.cumsum(count) - count) / count[:, None])

    def _add(self, window: Samples, centre: Array) -> Reason | None:
        """Add a window, and the mean offset (3,) of the centre of mass; return as `update` does."""
        if self._done:
            return None
        if not np.all(np.isfinite(window.pose_covariance[:, 0, 0])):
            self._done = True  # nothing measures where it is
            return None
        pushed, self._pushed = np.any(window.impulse != self._pushed), window.impulse[-1]
        if pushed:  # thrust moves the base
            self._begin()
            return None
        both = np.concatenate((np.mean(window.base_position, axis=0), centre))
        if not self._latest:
            self._origin = both
        self._latest = [*self._latest[-2:], both]
        if len(self._latest) == 3:
            self._bends += np.sum(np.diff(self._latest, 2, axis=0).reshape(2, 3) ** 2, axis=1)
        time = float(np.mean(window.time))
        row = np.concatenate(([1.0, time, time**2], both - self._origin))
        self._squares += np.outer(row, row)
        self._count += 1
        if self._count < _FEWEST or not self._is_held():
            return None
        self._done = True
        return Reason(HELD, 'conflict', _CERTAIN)

    def _is_held(self) -> bool:
        """Return whether the base stays where it is, apart from noise, beside the centre of mass."""
        scale = np.sqrt(np.diag(self._squares)[:3])
        trend = self._squares[:3, :3] / scale / scale[:, None]
        across = self._squares[:3, 3:] / scale[:, None]
        left = self._squares[3:, 3:] - across.T @ np.linalg.solve(trend, across)
        base, centre = float(np.trace(left[:3, :3])), float(np.trace(left[3:, 3:]))
        if centre < self._count * _MOVED**2 or base > _REACTION**2 * centre or self._bends[1] > centre:
            return False  # nothing moves, the base reacts, or the arm seems to leap, as in degrees
        if base < _ROUNDING * centre:
            return True
        together = abs(float(np.trace(left[:3, 3:])))
        return together < _CORRELATION * np.sqrt(base * centre) and self._bends[0] > _WHITE * base


class WindowChecks:
    """Follows windows, leaves out rates that contradict the positions, and returns reasons to distrust a run.

    Parameters
    ----------
    twist_frame : 'child' or 'inertial', as the base's twist was read
    held : finds whether the base is held; None does not ask
    joint_rates : leaves out joint velocities that are no rates of the positions; None leaves all in
    gyro : whether an IMU on the base measures
    """

    def __init__(
        self,
        twist_frame: str = 'child',
        held: HeldBase | None = None,
        joint_rates: JointRates | None = None,
        *,
        gyro: bool = False,
    ) -> None:
        self._twist_frame = TwistFrame(twist_frame)
        self._gyro_frame = GyroFrame() if gyro else None
        self._held, self._joint_rates = held, joint_rates
        self._contradictions: dict[float, Reason] = {}  # of the twist's frame, by the end of the latest windows, s
        self._wrong_gyro: tuple[float, Reason] | None = None  # since when (s) the IMU is known to be misread, and how
        self._held_since: tuple[float, Reason] | None = None  # s, and the reason
        self._wrong_rates: list[tuple[float, str]] = []  # since when (s) which velocities are left out, in words

    def applied(self, windows: Sequence[Samples]) -> list[Samples]:
        """Return the next windows without rates that contradict the positions."""
        held = self._held.update(windows) if self._held is not None else [None] * len(windows)
        checked = [self._checked(*each) for each in zip(windows, held, strict=True)]
        contradictions = zip(checked, self._twist_frame.update(checked), strict=True)
        # Poses and twist contradict each other without a model of the robot: as a cause, that comes first.
        self._contradictions = {
            float(window.time[-1]): Reason(text, gain=gain) for window, (text, gain) in contradictions
        }
        return checked

    def run_slice(self) -> None:
        """Look at the frame of the latest window's twist now, not when the next one comes."""
        self._twist_frame.run_slice()

    def reasons(self, time: float, *, with_gyro: bool) -> list[Reason]:
        """Return the findings up to the end of a window, s; `with_gyro` if the method uses the IMU."""
        reasons = notes([text for since, text in self._wrong_rates if since <= time][-1:])
        contradiction = self._contradictions.get(time)
        if contradiction is not None and contradiction.text:
            reasons.append(contradiction)
        if self._wrong_gyro is not None and self._wrong_gyro[0] <= time and with_gyro:
            reasons.append(self._wrong_gyro[1])
        if self._held_since is not None and self._held_since[0] <= time:
            reasons.append(self._held_since[1])
        return reasons

    def _checked(self, window: Samples, held: Reason | None) -> Samples:
        end = float(window.time[-1])
        if self._gyro_frame is not None and self._wrong_gyro is None:
            text = self._gyro_frame.update(window)
            if text:
                self._wrong_gyro = float(window.time[0]), Reason(text, 'conflict', self._gyro_frame.gain)
        if held is not None:
            self._held_since = end, held
        if self._joint_rates is None:
            return window
        checked = self._joint_rates.applied(window)
        text = self._joint_rates.contradiction
        if text and (not self._wrong_rates or self._wrong_rates[-1][1] != text):
            self._wrong_rates.append((end, text))
        return checked
