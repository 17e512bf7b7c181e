"""Measurements put into the order of their stamps, without making well-ordered streams wait."""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import Counter
from typing import Generic, TypeVar

import numpy as np

from mbaid_ros.core.samples import BaseStream, ImuStream, JointStream, Stamps

LATE = 'stamp before one that was already used'
REPEATED = 'stamp repeated'

# A message that was this much late shows that others may be a little later still.
_MARGIN = 1.5

Stream = TypeVar('Stream', JointStream, BaseStream, ImuStream)


class Reorder(Generic[Stream]):
    """Puts one stream in order; the result does not depend on how it is cut into calls.

    Nothing is held back until a stamp comes late for the first time. That one is lost; from then on measurements wait
    as long as it was late, and half as much again.

    Parameters
    ----------
    limit : ns, longest time that a measurement may be held back for others

    Attributes
    ----------
    hold : ns, time that measurements are held back now
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._waiting: Stream | None = None  # in order
        self._newest: int | None = None
        self._released: int | None = None
        self.hold = 0
        self.dropped: Counter[str] = Counter()

    def push(self, stream: Stream | None) -> Stream | None:
        """Take measurements and return those that are released, in order, None if there are none."""
        if stream is None or not len(stream.stamp):
            return None
        if self.hold == 0 and self._in_order(stream.stamp):
            self._newest = self._released = int(stream.stamp[-1])
            return stream
        joined = stream if self._waiting is None else stream.concatenate((self._waiting, stream))
        held = len(joined.stamp) - len(stream.stamp)
        released, waiting = self._sort(joined.stamp.tolist(), held)
        self._waiting = joined[np.array(waiting, dtype=np.intp)]
        return joined[np.array(released, dtype=np.intp)] if released else None

    def _in_order(self, stamp: Stamps) -> bool:
        after = self._released is None or stamp[0] > self._released
        return bool(after and np.all(stamp[1:] > stamp[:-1]))

    def _sort(self, stamps: list[int], held: int) -> tuple[list[int], list[int]]:
        """Return where the measurements that are released stand, in order, and those that wait on."""
        waiting = [(stamp, index) for index, stamp in enumerate(stamps[:held])]
        released: list[int] = []
        for index in range(held, len(stamps)):
            stamp = stamps[index]
            if self._accepted(stamp, waiting):
                insort(waiting, (stamp, index))
                self._newest = stamp if self._newest is None else max(self._newest, stamp)
                ready = bisect_left(waiting, (self._newest - self.hold + 1,))
                if ready:
                    released += (place for _, place in waiting[:ready])
                    self._released = waiting[ready - 1][0]
                    del waiting[:ready]
        return released, [place for _, place in waiting]

    def _accepted(self, stamp: int, waiting: list[tuple[int, int]]) -> bool:
        """Tell whether a stamp is new and not too late; learn from one that is late."""
        place = bisect_left(waiting, (stamp,))
        if stamp == self._released or (place < len(waiting) and waiting[place][0] == stamp):
            self.dropped[REPEATED] += 1
            return False
        if self._released is None or self._newest is None or stamp > self._released:
            return True
        self.dropped[LATE] += 1
        late = self._newest - stamp
        if late <= self._limit:
            self.hold = max(self.hold, min(round(_MARGIN * late), self._limit))
        return False
