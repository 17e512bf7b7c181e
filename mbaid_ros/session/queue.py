"""When to work through the messages that have come."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from mbaid_ros.cdr import Packets
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.sensors.streams import OTHER_CLOCK, Gate
from mbaid_ros.messages import stamps_of

PART = 300  # messages worked through at once while a window is open: each time costs as much as reading a hundred

# Parts of a window before its end, at which what has come is worked through.
_LEFT = (0.75, 0.5, 0.3, 0.05)
_CLOSING = 0.1  # of a window, before its end


class Schedule:
    """Tells when a part of a window is to be worked through, so that little is left to do at its end.

    That makes no difference to the numbers.

    Parameters
    ----------
    window : s
    """

    def __init__(self, window: float) -> None:
        self._left = [round(1e9 * part * window) for part in _LEFT]
        self._closing = round(1e9 * _CLOSING * window)
        self._worked = (-1, 0)  # end of the window that was last worked in, and how many of the times of `_LEFT` passed

    def is_due(self, stamp: int, end: int) -> bool:
        """Tell whether to work with a message of this stamp (ns), in the window that ends at `end`; once each time."""
        passed = sum(stamp >= end - left for left in self._left) if stamp < end else 1
        if not passed or (end, passed) <= self._worked:
            return False
        self._worked = (end, passed)
        return True

    def is_closing(self, stamp: int, end: int) -> bool:
        """Tell whether the last messages of a window are coming: its estimate is the next thing to do."""
        return stamp >= end - self._closing


STOPPED = 'after the stop by a jump of the stamps'


class MessageQueue:
    """Collects the messages of all topics, each in the order of arrival.

    Parameters
    ----------
    topics : that are heard
    config : EstimatorConfig

    Attributes
    ----------
    problem : why nothing is taken any more; empty while it is
    """

    def __init__(self, topics: Collection[str], config: EstimatorConfig) -> None:
        self._threshold = round(config.time_jump_threshold * 1e9)
        self._stops = config.time_jump == 'error'
        ignore = config.time_jump == 'ignore'
        self._gates = {name: Gate(self._threshold, ignore_jumps=ignore) for name in topics}
        self._epoch = 0
        self._dropped: Counter[str] = Counter()
        self.problem = ''

    @property
    def dropped(self) -> Counter[str]:
        """Messages that were not taken, by cause."""
        return sum((gate.dropped for gate in self._gates.values()), Counter(self._dropped))

    @property
    def newest(self) -> dict[str, int | None]:
        """The latest stamp of each topic, ns; None before its first."""
        return {name: gate.newest for name, gate in self._gates.items()}

    @property
    def latest(self) -> int | None:
        """The latest stamp of all, ns; None before the first."""
        return max((gate.newest for gate in self._gates.values() if gate.newest is not None), default=None)

    @property
    def waiting(self) -> dict[str, int]:
        """How many messages of each topic wait, packets of several counted as one."""
        return {name: len(gate.messages) for name, gate in self._gates.items()}

    def take(self, name: str, stamp: int, message: Any) -> str | None:
        """Take a message; where stamps have turned out to jump back before it, return what is to be told.

        That is empty where another topic jumped first, or where nothing is taken any more. What came before the jump
        waits until it is worked through; `settle` then adds what came after it.
        """
        gate = self._gates[name]
        behind = gate.epoch != self._epoch
        if (behind or self.problem) and not self._takes(stamp):
            return None
        jump = gate.take(stamp, message)
        if jump:
            return self._jumped(name, jump)
        if behind and gate.messages and gate.messages[-1] is message:
            gate.epoch = self._epoch
        return None

    def settle(self, name: str, message: Any) -> None:
        """Take the messages that have shown a jump back, the last of which is `message`."""
        self._gates[name].settle(message)

    def take_at_once(self, messages: Mapping[str, Sequence[Any]]) -> bool:
        """Take messages of all topics, where nothing is to be decided about any of them; return whether that is so.

        Parameters
        ----------
        messages : by topic, in the order in which they came: a list, or packets that stay together
        """
        stamps = {name: stamps_of(part) for name, part in messages.items()}
        gates = self._gates.items()
        if self.problem or not all(gate.epoch == self._epoch and gate.passes(stamps[name]) for name, gate in gates):
            return False
        for name, gate in gates:
            part = messages[name]
            gate.take_regular(stamps[name], [part] if isinstance(part, Packets) else part)
        return True

    def take_all(self) -> dict[str, list[Any]]:
        """Return what waits, by topic, and forget it."""
        return {name: gate.take_all() for name, gate in self._gates.items()}

    def _takes(self, stamp: int) -> bool:
        """Tell whether a message is taken although its topic has not jumped back with another one."""
        if self.problem:
            self._dropped[STOPPED] += 1
            return False
        jumped = [gate.newest for gate in self._gates.values() if gate.epoch == self._epoch and gate.newest is not None]
        if jumped and stamp > max(jumped) + self._threshold:
            self._dropped[OTHER_CLOCK] += 1
            return False
        return True

    def _jumped(self, name: str, amount: int) -> str:
        """Return why to start again; the second topic to jump back only follows the first."""
        gate = self._gates[name]
        told = f'stamps on {name} jumped back by {amount * 1e-9:.6g} s (a bag or simulation started again, a clock set)'
        if self._stops:
            self.problem = f'{told}; stopped, as time_jump: error says'
        elif gate.epoch > self._epoch:
            self._epoch = gate.epoch
            return told
        return ''
