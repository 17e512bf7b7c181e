"""The first look at a stream of messages, as they arrive: stamps that jump, and stamps that are not set.

Two consecutive messages have to agree before a jump is believed: a single stamp far from those around it is an error of
that message. All decisions follow from the order of arrival alone.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from mbaid_ros.core.samples import Stamps

ZERO_STAMP = 'stamp is zero'
STRAY_STAMP = 'stamp far from those before and after'
JUMPED_BACK = 'stamp before a jump back in time'
OTHER_CLOCK = 'stamp from before the other topic jumped back in time'


class Gate:
    """Collects the messages of one stream until they are worked through.

    Parameters
    ----------
    threshold : ns, difference between consecutive stamps that counts as a jump
    ignore_jumps : whether messages after a jump back are dropped until time has caught up

    Attributes
    ----------
    messages : those that have passed, in the order of arrival
    newest : ns, latest stamp that passed; None before the first
    epoch : number of jumps back so far
    dropped : messages that did not pass, by cause
    """

    def __init__(self, threshold: int, *, ignore_jumps: bool = False) -> None:
        self._threshold = threshold
        self._ignore_jumps = ignore_jumps
        self._suspect: tuple[int, Any] | None = None
        self.messages: list[Any] = []
        self.newest: int | None = None
        self.epoch = 0
        self.dropped: Counter[str] = Counter()

    def take(self, stamp: int, message: Any) -> int:
        """Take a message; return by how much (ns) time has turned out to jump back before it, else 0.

        After a jump back, `messages` holds what came before it; `settle` adds what came after.
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

    def passes(self, stamp: Stamps) -> bool:
        """Tell whether messages with these stamps (N,) would all pass, with nothing to be decided about any of them."""
        if not len(stamp):
            return True
        if self.newest is None or self._suspect is not None:
            return False
        steps = stamp - self._newest_before(stamp)
        return bool(np.all(np.abs(steps) <= self._threshold) and np.all(stamp != 0))

    def take_regular(self, stamp: Stamps, messages: Sequence[Any]) -> None:
        """Take messages that would all pass, as `passes` says, with their stamps (N,); some may be together."""
        if len(stamp):
            self.messages += messages
            self.newest = max(int(self._newest_before(stamp)[-1]), int(stamp[-1]))

    def settle(self, message: Any) -> None:
        """Let the two messages pass that have shown a jump back: the one held, and `message`, which confirmed it."""
        if self._suspect is not None:
            self.messages += (self._suspect[1], message)
            self._suspect = None

    def take_all(self) -> list[Any]:
        """Return the messages that have passed and forget them."""
        messages, self.messages = self.messages, []
        return messages

    def _newest_before(self, stamp: Stamps) -> Stamps:
        """Return the latest stamp before each of the messages with some stamps, if all pass."""
        return np.maximum.accumulate(np.concatenate((np.array([self.newest], dtype=np.int64), stamp[:-1])))

    def _far(self, stamp: int, message: Any, newest: int) -> int:
        """Take a message whose stamp is far from the newest."""
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
            return self.take(stamp, message)
        if self._ignore_jumps:
            self.dropped[JUMPED_BACK] += 2
            self._suspect = None
            return 0
        self.epoch += 1
        self.newest = max(held[0], stamp)
        return newest - held[0]

    def _drop_suspect(self) -> None:
        if self._suspect is not None:
            self._suspect = None
            self.dropped[STRAY_STAMP] += 1
