"""How far a simulated run is by the clock of this machine: no further than it can be told without a gap."""

from __future__ import annotations

import math
import time
from collections.abc import Callable


class Pace:
    """The time of a run that goes a number of times as fast as this machine's clock.

    Where the machine does not keep up, or stands still for a while, the run is late from then on: what it would have to
    say all at once to make up for that is more than is kept for its subscribers.

    Parameters
    ----------
    factor : simulated seconds in a second
    most : simulated seconds from one look to the next, at most
    clock : gives s of this machine, which never go back
    """

    def __init__(self, factor: float, most: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._factor, self._most, self._clock = factor, most, clock
        self._begin = math.nan  # s of the machine at time 0 of the run
        self._reached = 0.0
        self.late = 0.0  # s of the machine, by which the run is later than it would be

    @property
    def begun(self) -> bool:
        """Whether the run has begun."""
        return not math.isnan(self._begin)

    def begin(self) -> None:
        """Let the run begin now."""
        self._begin = self._clock()

    def now(self) -> float:
        """Return the time of the run, s."""
        now = (self._clock() - self._begin) * self._factor
        missed = (now - self._reached - self._most) / self._factor
        if missed > 0.0:
            self._begin, self.late = self._begin + missed, self.late + missed
            now = self._reached + self._most
        self._reached = now
        return now
