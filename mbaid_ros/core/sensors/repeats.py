"""Readings that come again under a new stamp, without new information: repeated poses, joints that a driver holds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Generic

import numpy as np

from mbaid_ros.core.geometry import Flags
from mbaid_ros.core.sensors.outliers import POSE, Channels, Stream

REPEATED_POSE = 'pose repeated'
JOINTS_HELD = 'joint positions repeated under a new stamp'
STILL = 1_000_000_000  # ns that the same reading has to last to be that of something at rest


class Repeats(Generic[Stream]):
    """Passes the first of equal readings on, in order, and the others only if they last.

    The result does not depend on how the stream is cut into calls.

    Parameters
    ----------
    channels : of the stream
    cause : under which readings are counted
    together : whether the channels, two at least, change at once where a reading is held. An encoder with coarse steps
        repeats readings, too, but its joints change at different times: nothing is dropped from then on

    Attributes
    ----------
    dropped : readings that were not passed on
    interval : s, between the latest two readings that differ
    """

    def __init__(
        self, channels: Sequence[Channels] = POSE, cause: str = REPEATED_POSE, *, together: bool = False
    ) -> None:
        self._channels, self._cause, self._together = channels, cause, together
        self._last: Stream | None = None  # latest reading
        self._since = 0  # ns, when its value came
        self._waiting: Stream | None = None  # those with its value, until it is known whether they pass
        self._moving: Flags = np.zeros(1, dtype=bool)  # channels that have changed
        self._apart = False  # whether some have changed without the others
        self.interval = 0.0
        self.dropped: Counter[str] = Counter()

    @property
    def waiting_since(self) -> int | None:
        """Stamp (ns) of the first reading that waits; None if none does."""
        return None if self._waiting is None else int(self._waiting.stamp[0])

    def push(self, stream: Stream | None) -> Stream | None:
        """Add readings in the order of their stamps; return those passed on, None if there are none."""
        if stream is None or not len(stream.stamp):
            return None
        changed, first = self._changed(stream), self._last is None
        if self._waiting is not None:
            changed = np.pad(changed, ((len(self._waiting.stamp), 0), (0, 0)))
            stream = stream.concatenate((self._waiting, stream))
        new = np.any(changed, axis=1)
        new[0] |= first
        number = np.cumsum(new)  # of the value, 0 for that of the readings before
        since = np.concatenate(([self._since], stream.stamp[new]))
        until = since.copy()
        until[number] = stream.stamp  # the last assignment stays: the latest stamp
        passing = new | ((until - since >= STILL) | self._coarse(changed[new]))[number]
        undecided = ~passing & (number == number[-1])
        self.dropped[self._cause] += int(np.sum(~passing & ~undecided))
        if len(since) > 1:
            self.interval = 1e-9 * int(since[-1] - since[-2])
        self._since, self._last = int(since[-1]), stream[-1:]
        self._waiting = stream[undecided] if np.any(undecided) else None
        return stream[passing] if np.any(passing) else None

    def _changed(self, stream: Stream) -> Flags:
        """Return which channels of N readings differ from those of the one before, (N, c)."""
        joined = stream.concatenate((stream[:1] if self._last is None else self._last, stream))
        values = [channel.values(joined) for channel in self._channels]
        return np.concatenate([np.any(each[1:] != each[:-1], axis=2) for each in values], axis=1)

    def _coarse(self, changes: Flags) -> Flags:
        """Return for the value before each of G changes (G, c), and the one after them, whether its repeats are new."""
        if not self._together:
            return np.zeros(len(changes) + 1, dtype=bool)
        before = np.broadcast_to(self._moving, (1, changes.shape[1]))
        moving: Flags = np.logical_or.accumulate(np.concatenate((before, changes)))
        apart = np.any(moving[:-1] & ~changes, axis=1) & np.any(changes, axis=1)
        apart = np.logical_or.accumulate(np.append(apart, False)) | self._apart
        self._moving, self._apart = moving[-1], bool(apart[-1])
        # One channel by itself: as well one with coarse steps.
        return np.asarray(apart | np.append(np.sum(changes, axis=1) < 2, False))
