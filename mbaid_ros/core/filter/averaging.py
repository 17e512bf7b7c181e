"""From closed windows of samples to windows of knots with their neighbours."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from mbaid_ros.core.filter.knots import AFTER, BEFORE, Knots, averages, bridged
from mbaid_ros.core.filter.window import Window, WindowNoise, window_noises, with_truncation
from mbaid_ros.core.geometry import Array, crossed, skew
from mbaid_ros.core.samples import Samples, SensorNoise

_KNOT = 0.05  # s, wanted spacing of knots: errors of the fourth-order formulas are then below the noise
# Knots in a period of the fastest passive joint, everything else held: a free robot swings up to twice as fast.
_KNOTS_A_PERIOD = 10.0
_FEWEST_KNOTS = 5  # of a window: the window before it needs four of them
# Range of a joint's knots from which it has moved, in deviations of one sample: noise reaches nine in an hour.
_MOVED = 10.0


@dataclass(frozen=True)
class Averaged:
    """The windows that a new one completes: the one before it with all its neighbours, itself without later ones.

    `joints_moved`: whether a joint has moved by more than its noise by then.
    """

    ready: Window | None
    still_open: Window | None
    joints_moved: bool


class KnotAveraging:
    """Averages closed windows to a chain of knots, with a latency of one window.

    Parameters
    ----------
    noise : of the joint sensors, and of the base where the samples carry none
    length : s, of a window
    gyro : rad/s/sqrt(Hz), density of the noise of an IMU's angular velocity
    orientation_measured : whether anything but the gyro measures the orientation of the base
    fastest : Hz, highest natural frequency of passive joints; 0 without any

    Attributes
    ----------
    origin : (3,) m, first position of the base, which all positions are relative to
    """

    def __init__(
        self,
        noise: SensorNoise,
        length: float,
        gyro: float = 0.0,
        *,
        orientation_measured: bool = True,
        fastest: float = 0.0,
    ) -> None:
        self._wanted = min(_KNOT, 1.0 / (_KNOTS_A_PERIOD * fastest)) if fastest else _KNOT
        self._alike = fastest > 0.0  # a spring adds up errors that alternate with the number of samples in a knot
        self._orientation_measured = orientation_measured
        self._course: Array = np.zeros(36)
        self._gyro = gyro
        self._noise = noise
        self._length = length
        self.origin: Array = np.zeros(3)
        self._knots_per_window = 0
        self._number = -1
        self._end: float | None = None  # s, of the last window that had all its neighbours
        self._kept: Knots | None = None  # of the last two windows of the call before
        self._linked = 0  # number of windows without a gap up to the last, at most three
        self._latest: WindowNoise | None = None  # of the last of them
        self._lowest: Array = np.array(np.inf)
        self._highest: Array = np.array(-np.inf)
        self._moved = False

    def average(self, windows: list[Samples]) -> list[Averaged]:
        """Return the windows that closed ones complete."""
        if not self._knots_per_window:
            self.origin = windows[0].base_position[0].copy()
            self._knots_per_window = knots_per_window(windows[0], self._length, self._wanted, alike=self._alike)
        length, count = self._length, self._knots_per_window
        numbers = [int(np.floor((window.time[0] + 1e-9) / length)) for window in windows]
        new = averages(windows, np.array(numbers) * length, length / count, count, self.origin)
        if not self._orientation_measured:
            new = self._followed(new, count)
        knots = new if self._kept is None else Knots.concatenate([self._kept, new])
        joint_position = new.joint_position.reshape(len(windows), count, -1)
        extremes = [extreme.reduce(joint_position, axis=1) for extreme in (np.fmin, np.fmax)]
        empty = knots.empty.tolist()
        averaged = []
        each = zip(numbers, window_noises(windows, self._noise, self._gyro), *extremes, strict=True)
        for place, (number, noise, lowest, highest) in enumerate(each, start=len(knots) // count - len(windows)):
            ready, still_open = self._collect(knots, empty, place, number, noise)
            if self._linked and not self._moved:
                self._lowest, self._highest = np.minimum(self._lowest, lowest), np.maximum(self._highest, highest)
                self._moved = bool(np.any(self._highest - self._lowest > _MOVED * noise.joint_position))
            averaged.append(Averaged(ready, still_open, self._moved))
        self._kept = knots[-2 * count :]
        return averaged

    def _followed(self, knots: Knots, count: int) -> Knots:
        """Return knots with the effect of the gyro's errors on the orientation, window by window."""
        parts = []
        for begin in range(0, len(knots), count):
            followed, self._course = _with_course(knots[begin : begin + count], self._length / count, self._course)
            parts.append(followed)
        return Knots.concatenate(parts)

    def _collect(
        self, knots: Knots, empty: list[bool], place: int, number: int, noise_now: WindowNoise
    ) -> tuple[Window | None, Window | None]:
        """Return the window before the one at `place` among the knots, now with all its neighbours, and that window.

        Parameters
        ----------
        knots, empty : of this window and those around it, and which are empty
        place, number, noise_now : of the window among these, and in the run; its noise
        """
        count = self._knots_per_window
        begin, end = place * count, (place + 1) * count
        gap = any(empty[begin:end]) and any(one and other for one, other in pairwise(empty[begin:end]))
        if gap or number != self._number + 1 or (self._linked and empty[begin - 1] and empty[begin]):
            self._linked = 0  # a gap: only momentum and body carry over
        self._number = number
        if gap or (empty[begin] and not self._linked):
            return None, None
        self._linked = min(self._linked + 1, 3)
        noise, self._latest = self._latest, noise_now
        ready = None
        if self._linked > 1 and noise is not None:
            ready = self._window(knots, empty, place - 1, AFTER, noise)
            self._end = ready.start + ready.length
        still_open = None if empty[end - 1] else self._window(knots, empty, place, 0, noise_now)
        return ready, still_open

    def _window(self, knots: Knots, empty: list[bool], place: int, after: int, noise: WindowNoise) -> Window:
        """Return a window with `after` knots after it; the last interval of one without a successor is missing."""
        count = self._knots_per_window
        earlier = self._linked > (2 if after else 1)
        begin, end = place * count, (place + 1) * count + after
        first = begin - BEFORE if earlier else begin
        # An empty knot is bridged from both sides: drop one at an outer end.
        if earlier and empty[first]:
            first += 1
        if after and empty[end - 1]:
            end -= 1
        parts = knots[first:end]
        if any(empty[first:end]):
            parts = bridged(parts)
        start = (self._number - (1 if after else 0)) * self._length
        return Window(
            knots=parts,
            inside=slice(begin - first, begin - first + count - (0 if end > begin + count else 1)),
            spacing=self._length / count,
            noise=with_truncation(noise, parts, at_an_end=not (earlier and after)),
            start=start,
            fresh=not earlier,
            origin=self.origin,
            gap=0.0 if earlier or self._end is None else start - self._end,
        )


def _with_course(knots: Knots, spacing: float, begin: Array) -> tuple[Knots, Array]:
    """Return knots oriented by the gyro alone with the effect of its errors, and that (36,) at the end of the last.

    Parameters
    ----------
    knots, spacing : in a row, s
    begin : (36,) before the first of them
    """
    rate = np.gradient(knots.gyro, spacing, axis=0)
    errors = np.zeros((len(knots), 3, 12))
    errors[:, :, :3], errors[:, :, 6:9], errors[:, :, 9:] = np.eye(3), skew(rate), crossed(rate)
    errors[:, [0, 1, 2], [3, 4, 5]] = rate
    # After an empty knot the chain begins anew.
    steps = np.nan_to_num(spacing * (knots.base_rotation @ errors)).reshape(len(knots), -1)
    sums = np.cumsum(np.concatenate((begin[None], steps)), axis=0)
    return replace(knots, course=0.5 * (sums[1:] + sums[:-1])), sums[-1]


def knots_per_window(window: Samples, length: float, wanted: float, *, alike: bool = False) -> int:
    """Return the number of knots in a window of a length in s: as wanted, s apart, and no fewer samples than knots.

    Knots that are to be alike have as many samples each, if these come evenly.
    """
    spacing = float(np.median(np.diff(window.time))) if len(window) > 1 else length
    count, samples = max(round(length / max(wanted, spacing)), _FEWEST_KNOTS), round(length / spacing)
    return next((each for each in range(count, samples + 1) if samples % each == 0), count) if alike else count
