"""Stamps that are plainly wrong, in the order of arrival: batches stamped on arrival, and clocks that were set."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import Stamps

_SKIPPED = 10  # intervals, before which the mean is not known
_FEWEST = 60  # intervals that show a pattern
_SHORT, _BATCHED = 0.2, 0.4  # part of the mean interval that is short; share of such ones: of random ones it is a fifth
_STEP = 50_000_000  # ns, that a clock is set by at least: less is jitter, or messages that overtake each other
_LONGEST = 200_000_000  # ns between readings around a step: of slower ones the motion is not known
_EVEN = 0.5  # part of the usual interval, that those around a step differ by: others are no regular stamps
_GAP = 5.0  # usual intervals that make a gap
_STEADY, _MISSING = 0.2, 0.3  # part by which the speed changes over a gap, and of its motion that is there at most
_FAR = 50.0  # standard deviations that a gap's motion should be at least
_AROUND = 6  # readings that a step is looked at with, before and after

Found = tuple[str, int, str]  # symptom, from which stamp on (ns), and in words


class StampPattern:
    """Follows the stamps of one kind of messages; the result does not depend on how they are cut into calls.

    Parameters
    ----------
    what : the messages, in words
    noise : standard deviation of the positions, rad or m
    """

    def __init__(self, what: str, noise: float) -> None:
        self._what, self._noise = what, noise
        self._first, self._count, self._short = 0, 0, 0
        self._stamp: Stamps = np.zeros(0, dtype=np.int64)
        self._position: Array = np.zeros((0, 0))

    def add(self, stamp: Stamps, position: Array) -> Iterator[Found]:
        """Add readings (N,), (N, k), in the order of arrival; yield the faults of their stamps."""
        if not len(stamp):
            return
        if not self._count:
            self._first, self._position = int(stamp[0]), position[:0]
        begin = self._count - len(self._stamp)  # number of the first of the readings that are kept
        yield from self._batches(stamp)
        self._stamp = np.concatenate((self._stamp, stamp))
        self._position = np.concatenate((self._position, position))
        interval = np.diff(self._stamp)
        usual = np.maximum(_STEP, _GAP * np.concatenate((interval[:1], interval[:-1])))
        for place in np.flatnonzero((interval < -_STEP) | (interval > usual)).tolist():
            if _AROUND - 1 <= place <= len(interval) - _AROUND and begin + place > _FEWEST:
                yield from self._step(place, (int(self._stamp[place]) - self._first) / (begin + place))
        keep = 2 * _AROUND - 1
        self._stamp, self._position = self._stamp[-keep:], self._position[-keep:]

    def _batches(self, stamp: Stamps) -> Iterator[Found]:
        """Yield that most messages are stamped right after each other, and then none for long."""
        joined = np.concatenate((self._stamp[-1:], stamp))
        interval = np.diff(joined)
        number = self._count + 1 + np.arange(len(stamp))  # readings up to each
        mean = (stamp - self._first) / np.maximum(number - 1, 1)
        interval = np.concatenate((np.full(len(stamp) - len(interval), np.iinfo(np.int64).max), interval))
        short = self._short + np.cumsum((interval < _SHORT * mean) & (interval > 0) & (number > _SKIPPED))
        self._count, self._short = int(number[-1]), int(short[-1])
        batched = np.flatnonzero((number > _FEWEST) & (short > _BATCHED * number))
        if len(batched):
            size = 1.0 / max(1.0 - short[batched[0]] / (number[batched[0]] - _SKIPPED), 0.01)
            text = (
                f'{self._what} come in batches of about {size:.0f}, stamped right after each other: stamped on '
                'arrival, not when they were measured; stamp them in the driver'
            )
            yield f'batches: {self._what}', int(stamp[batched[0]]), text

    def _step(self, place: int, usual: float) -> Iterator[Found]:
        """Yield that a clock was set between the reading at a place and the next one; `usual` interval in ns."""
        around = np.diff(self._stamp[place - _AROUND + 1 : place + _AROUND + 1]).astype(float)
        step = float(around[_AROUND - 1])
        around = np.delete(around, _AROUND - 1)
        if np.any(around > _LONGEST) or np.any(np.abs(around - usual) > _EVEN * usual):
            return
        at, since = 1e-9 * (int(self._stamp[place]) - self._first), int(self._stamp[place + _AROUND])
        if step < 0.0:
            back = 1e-9 * (float(np.mean(around)) - step)
            text = (
                f'the stamps of {self._what} went back by {back:.2g} s at {at:.1f} s: a clock was set; readings '
                'stamped twice are left out, later ones are wrong if no other clock was set'
            )
            yield f'set back: {self._what}', since, text
        elif self._goes_on(place, step):
            text = f'the stamps of {self._what} went forward by {1e-9 * step:.2g} s at {at:.1f} s without the motion: '
            yield f'set forward: {self._what}', since, f'{text}a clock was set'

    def _goes_on(self, place: int, step: float) -> bool:
        """Return whether the readings around a gap (ns) move as if it were none."""
        stamp, position = self._stamp.astype(float), self._position
        before, after = (
            (position[one] - position[other]) / (stamp[one] - stamp[other])
            for one, other in ((place, place - _AROUND + 1), (place + _AROUND, place + 1))
        )
        speed = 0.5 * (before + after)
        steady = np.abs(after - before) < _STEADY * np.abs(speed)
        expected = np.abs(speed * step)
        moved = np.abs(position[place + 1] - position[place])
        plain = steady & (expected > _FAR * self._noise)
        return bool(np.any(plain)) and bool(np.all(moved[plain] < _MISSING * expected[plain]))
