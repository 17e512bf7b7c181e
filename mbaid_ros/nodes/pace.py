"""The time of a run that goes at a multiple of this machine's clock, without a gap."""

from __future__ import annotations

import math
import time
from collections.abc import Callable


class Pace:
    """The time of a run that goes a number of times as fast as this machine's clock.

    If the machine does not keep up, or stands still for a while, the run is late from then on: to catch up it would
    publish more at once than its subscribers' queues hold.

    Parameters
    ----------
    factor, most : simulated seconds in a second, and between two calls of `now` at most
    clock : monotonic, s
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
        """Begin the run now."""
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
