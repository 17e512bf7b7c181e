"""When a run is asked what may be wrong with it: while it contradicts its model, bit by bit, ever more rarely."""

from __future__ import annotations

from collections import deque

import numpy as np

from mbaid_ros.core.trajectory.state import Point
from mbaid_ros.core.trajectory.suspicion import Found, Inquiry, Suspicion
from mbaid_ros.core.trajectory.windows import Window

_FIRST, _GROWTH = 24, 1.5  # windows before the first inquiry, and of each next one
_KEPT = 80  # windows that one is over
_SHARE = 300  # steps of the filter, more or less, that it may take between two windows


class Inquiries:
    """Asks a run again and again what may be wrong with it, over its latest windows.

    Attributes
    ----------
    found : by the latest inquiry; None before
    """

    def __init__(self, suspicion: Suspicion) -> None:
        self._suspicion = suspicion
        self._windows: deque[Window] = deque(maxlen=_KEPT)
        self._seen = 0
        self._next = _FIRST
        self._inquiry: Inquiry | None = None
        self.found: Found | None = None

    def take(self, window: Window | None) -> None:
        """Take the next window into those that an inquiry is over."""
        if window is not None:
            self._windows.append(window)
            self._seen += 1

    def follow(self, point: Point | None, *, suspicious: bool) -> None:
        """Do a part of an inquiry, if one is under way or due.

        Parameters
        ----------
        point : that the run has come to, if any
        suspicious : whether anything is to be asked
        """
        if self._inquiry is None and suspicious and self._seen >= self._next:
            self._next = int(np.ceil(_GROWTH * self._seen))
            self._inquiry = self._suspicion.inquire(list(self._windows), point)
        done = 0
        while self._inquiry is not None and done < _SHARE:
            try:
                work = next(self._inquiry)
            except np.linalg.LinAlgError:
                self._inquiry = None  # the point is of no robot that can be: a later one may be
                return
            if isinstance(work, Found):
                self._inquiry, self.found = None, work
            else:
                done += work
