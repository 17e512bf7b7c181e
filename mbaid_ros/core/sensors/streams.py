"""Streams in order: stamps that jump or are not set, late and repeated ones, and windows of samples.

Two consecutive messages have to agree before a jump counts: a single stamp far from its neighbours is an error of that
message. All decisions follow from the order of arrival alone.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import Counter
from collections.abc import Sequence
from typing import Any, Generic, TypeVar

import numpy as np

from mbaid_ros.core.samples import BaseStream, ImuStream, JointStream, Samples, Stamps

ZERO_STAMP = 'stamp is zero'
STRAY_STAMP = 'stamp far from those before and after'
OTHER_CLOCK = 'stamp from before the other topic jumped back in time'


class Gate:
    """Collects the messages of one stream.

    Parameters
    ----------
    threshold : ns, difference between consecutive stamps that counts as a jump

    Attributes
    ----------
    messages : those that have passed, in the order of arrival
    newest : ns, latest stamp that passed; None before the first
    epoch : number of jumps back so far
    dropped : messages that did not pass, by cause
    """

    def __init__(self, threshold: int) -> None:
        self._threshold = threshold
        self._suspect: tuple[int, Any] | None = None
        self.messages: list[Any] = []
        self.newest: int | None = None
        self.epoch = 0
        self.dropped: Counter[str] = Counter()

    def add(self, stamp: int, message: Any) -> int:
        """Add a message; return the size (ns) of a jump back in time before it, else 0.

        After a jump back, `messages` holds those before it; `confirm_jump` adds those after it.
        """
        newest = self.newest
        if newest is not None and not -self._threshold <= stamp - newest <= self._threshold:
            return self._far(stamp, message, newest)
        if stamp == 0 and newest is not None:  # a run of simulated time may begin with it, once
            self.dropped[ZERO_STAMP] += 1
            return 0
        if self._suspect is not None:
            self._drop_suspect()
        self.messages.append(message)
        if newest is None or stamp > newest:
            self.newest = stamp
        return 0

    def all_pass(self, stamp: Stamps) -> bool:
        """Return whether messages with these stamps (N,) all pass at once."""
        if not len(stamp):
            return True
        if self.newest is None or self._suspect is not None:
            return False
        steps = stamp - self._newest_before(stamp)
        return bool(np.all(np.abs(steps) <= self._threshold) and np.all(stamp != 0))

    def add_regular(self, stamp: Stamps, messages: Sequence[Any]) -> None:
        """Add messages that all pass according to `all_pass`, with their stamps (N,); some may be together."""
        if len(stamp):
            self.messages += messages
            self.newest = max(int(self._newest_before(stamp)[-1]), int(stamp[-1]))

    def confirm_jump(self, message: Any) -> None:
        """Pass the two messages after a jump back: the one held, and `message`, which confirmed it."""
        if self._suspect is not None:
            self.messages += (self._suspect[1], message)
            self._suspect = None

    def pop_all(self) -> list[Any]:
        """Return the messages that have passed and forget them."""
        messages, self.messages = self.messages, []
        return messages

    def _newest_before(self, stamp: Stamps) -> Stamps:
        """Return the latest stamp before each of some messages that all pass."""
        return np.maximum.accumulate(np.concatenate((np.array([self.newest], dtype=np.int64), stamp[:-1])))

    def _far(self, stamp: int, message: Any, newest: int) -> int:
        """Add a message whose stamp is far from the newest."""
        if stamp == 0:
            self.dropped[ZERO_STAMP] += 1
            return 0
        held = self._suspect
        agrees = held is not None and (held[0] > newest) == (stamp > newest) and stamp >= held[0] - self._threshold
        if held is None or not agrees:
            self._drop_suspect()
            self._suspect = (stamp, message)
            return 0
        if held[0] > newest:  # time goes on after a gap
            self._suspect = None
            self.messages.append(held[1])
            self.newest = held[0]
            return self.add(stamp, message)
        self.epoch += 1
        self.newest = max(held[0], stamp)
        return newest - held[0]

    def _drop_suspect(self) -> None:
        if self._suspect is not None:
            self._suspect = None
            self.dropped[STRAY_STAMP] += 1


LATE = 'stamp before one that was already used'
REPEATED = 'stamp repeated'

# A message that was this much late shows that others may be a little later still.
_MARGIN = 1.5

Stream = TypeVar('Stream', JointStream, BaseStream, ImuStream)


class Reorder(Generic[Stream]):
    """Puts one stream in order; the result does not depend on how it is cut into calls.

    Nothing waits until a stamp comes late for the first time. That one is lost; from then on measurements wait as long
    as it was late, and half as much again.

    Parameters
    ----------
    limit : ns, longest time that a measurement may wait for others

    Attributes
    ----------
    hold : ns, time that measurements wait now
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._waiting: Stream | None = None  # in order
        self._newest: int | None = None
        self._released: int | None = None
        self.hold = 0
        self.dropped: Counter[str] = Counter()

    def push(self, stream: Stream | None) -> Stream | None:
        """Add measurements; return those released, in order, None if there are none."""
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
        """Return the indices of the measurements released, in order, and of those that wait on."""
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
        """Return whether a stamp is new and not too late; adapt the waiting time to one that is late."""
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


class Windows:
    """Collects samples and releases each window of a length (s) once a later sample has arrived.

    Window k holds the samples with k <= time / length < k + 1.
    """

    def __init__(self, length: float) -> None:
        self._length = length
        self._parts: list[Samples] = []

    def push(self, samples: Samples) -> list[Samples]:
        """Add samples; return the windows that they close, in order, without empty ones."""
        number = self._numbers(samples)
        last = self._numbers(self._parts[-1])[-1] if self._parts else number[0]
        starts = np.flatnonzero(np.diff(number, prepend=last))
        closed = []
        begin = 0
        for start in starts:
            if start > begin:
                self._parts.append(samples[begin:start])
            closed.append(Samples.concatenate(self._parts))
            self._parts = []
            begin = start
        self._parts.append(samples[begin:])
        return closed

    def flush(self) -> list[Samples]:
        """Return the open window."""
        parts, self._parts = self._parts, []
        return [Samples.concatenate(parts)] if parts else []

    def _numbers(self, samples: Samples) -> Stamps:
        # A nanosecond of slack: 0.5 s after the first sample is in window 1, however the division rounds.
        return np.floor((samples.time + 1e-9) / self._length).astype(np.int64)
