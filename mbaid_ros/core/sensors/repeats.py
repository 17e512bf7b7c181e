"""Readings that come again without new information: repeated poses, and joints that a driver holds.

The result does not depend on how the stream is cut into calls. A reading that lasts is that of something at rest.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Generic

import numpy as np

from mbaid_ros.core.geometry import Flags
from mbaid_ros.core.samples import JointStream
from mbaid_ros.core.sensors.outliers import POSE, Channels, Stream

REPEATED_POSE = 'pose repeated'
STILL = 1_000_000_000  # ns that the same pose has to last to be that of a base at rest


class Repeats(Generic[Stream]):
    """Passes the first of equal readings on, in order, and the others only if they last.

    Attributes
    ----------
    dropped : readings that were not passed on
    """

    def __init__(self, channels: Sequence[Channels] = POSE) -> None:
        self._channels = channels
        self._last: Stream | None = None  # latest reading
        self._since = 0  # ns, when its value came
        self._waiting: Stream | None = None  # those with its value, until it is known whether they pass
        self.dropped: Counter[str] = Counter()

    def push(self, stream: Stream | None) -> Stream | None:
        """Add readings in the order of their stamps; return those passed on, None if there are none."""
        if stream is None or not len(stream.stamp):
            return None
        new = self._new(stream)
        if np.all(new) and self._waiting is None:
            self._last, self._since = stream[-1:], int(stream.stamp[-1])
            return stream
        waiting = 0 if self._waiting is None else len(self._waiting.stamp)
        joined = stream if self._waiting is None else stream.concatenate((self._waiting, stream))
        passing, undecided = self._decide(joined, np.concatenate((np.zeros(waiting, dtype=bool), new)))
        self.dropped[REPEATED_POSE] += int(np.sum(~passing & ~undecided))
        self._last, self._waiting = stream[-1:], joined[undecided] if np.any(undecided) else None
        return joined[passing] if np.any(passing) else None

    def _new(self, stream: Stream) -> Flags:
        """Return which readings differ from the one before, (N,)."""
        joined = stream.concatenate((stream[:1] if self._last is None else self._last, stream))
        values = [channel.values(joined) for channel in self._channels]
        new = np.any([np.any(each[1:] != each[:-1], axis=(1, 2)) for each in values], axis=0)
        new[0] |= self._last is None
        return np.asarray(new)

    def _decide(self, stream: Stream, new: Flags) -> tuple[Flags, Flags]:
        """Return which readings pass, and which have to wait until it is known how long their value lasts.

        `stream` holds those that have waited and the next ones, `new` (N,) which of them differ from the one before.
        """
        number = np.cumsum(new)  # of the value, 0 for that of the readings before
        since = np.concatenate(([self._since], stream.stamp[new]))
        until = since.copy()
        until[number] = stream.stamp  # the last assignment stays: the latest stamp
        lasts = until - since >= STILL
        self._since = int(since[-1])
        passing = new | lasts[number]
        return passing, ~passing & (number == number[-1])


JOINTS_HELD = 'joint positions repeated under a new stamp'

_CYCLES = 3  # times that all joints moved at once after a repeat, from which a driver is known to hold readings


class HeldJoints:
    """Drops joint readings that a driver repeats under new stamps while the joints move on.

    All joints that move change at once then. An encoder with coarse steps repeats readings, too, but its joints change
    at different times: nothing is dropped of it. A reading that lasts is that of joints at rest. The result does not
    depend on how the stream is cut into calls.

    Attributes
    ----------
    dropped : readings that were not passed on
    interval : s, between the latest two readings that differ
    """

    def __init__(self) -> None:
        self._last: JointStream | None = None  # latest reading
        self._since = 0  # ns, stamp from which on that has been read
        self._moving: Flags = np.zeros(0, dtype=bool)  # joints that have changed
        self._cycles = 0
        self._held: bool | None = None  # None while it is not known
        self._waiting: list[tuple[JointStream, bool]] = []  # with whether each is repeated, until that is known
        self.interval = 0.0
        self.dropped: Counter[str] = Counter()

    @property
    def waiting_since(self) -> int | None:
        """Stamp (ns) of the first reading that waits; None if none does."""
        return int(self._waiting[0][0].stamp[0]) if self._waiting else None

    def push(self, stream: JointStream | None) -> JointStream | None:
        """Add readings in the order of their stamps; return those passed on, None if there are none."""
        if stream is None or not len(stream.stamp) or self._held is False:
            return stream
        last = stream[:1] if self._last is None else self._last
        changed = np.diff(np.concatenate((last.position, stream.position)), axis=0) != 0.0
        if self._last is None:
            changed[0] = True
            self._since = int(stream.stamp[0])
            self._moving = np.zeros(stream.position.shape[1], dtype=bool)
        self._last = stream[-1:]
        if not self._waiting and np.all(changed):
            self._moving, self._since = self._moving | changed[-1], int(stream.stamp[-1])
            return stream
        passed = [
            each for place in range(len(changed)) for each in self._decide(stream[place : place + 1], changed[place])
        ]
        return stream.concatenate(passed) if passed else None

    def _decide(self, reading: JointStream, changed: Flags) -> list[JointStream]:
        """Return the readings that pass once another one (1, n) has come, of which some joints (n,) have changed."""
        stamp = int(reading.stamp[0])
        repeated = not np.any(changed)
        known = self._held is not None
        if repeated:
            known |= stamp - self._since >= STILL  # the joints rest
        else:
            if np.any(self._moving & ~changed):
                self._held, known = False, True
            elif np.sum(changed) < 2:
                known = True  # one joint by itself: as well one with coarse steps
            elif self._waiting:
                self._cycles += 1
                self._held = True if self._cycles >= _CYCLES else self._held
                known = self._held is True
            self.interval = 1e-9 * (stamp - self._since)
            self._moving, self._since = self._moving | changed, stamp
        self._waiting.append((reading, repeated and stamp - self._since < STILL))
        if not known and any(again for _, again in self._waiting):
            return []
        waiting, self._waiting = self._waiting, []
        kept = [each for each, again in waiting if not (again and self._held)]
        self.dropped[JOINTS_HELD] += len(waiting) - len(kept)
        return kept
