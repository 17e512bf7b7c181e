"""Odometry that repeats the last pose under new stamps until another one comes: no new measurement, and not used.

Poses with noise are never the same to the last bit. A base that stands still without any noise, in a simulation or
where the odometry is rounded, repeats its pose, too: what stays the same for long enough is used as it is.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from mbaid_ros.core.geometry import Flags
from mbaid_ros.core.samples import BaseStream

REPEATED_POSE = 'pose repeated'

STILL = 1_000_000_000  # ns that the same pose has to last to be that of a base at rest


class Repeats:
    """Lets the first of equal poses pass, and the others only if they last; in order, however the stream is cut.

    Attributes
    ----------
    dropped : measurements that did not pass
    """

    def __init__(self) -> None:
        self._last: BaseStream | None = None  # latest measurement
        self._since = 0  # ns, when its pose came
        self._waiting: BaseStream | None = None  # those with its pose, until it is known whether they pass
        self.dropped: Counter[str] = Counter()

    def push(self, base: BaseStream | None) -> BaseStream | None:
        """Take measurements in the order of their stamps and return those that pass, None if there are none."""
        if base is None or not len(base.stamp):
            return None
        new = self._new(base)
        if np.all(new) and self._waiting is None:
            self._last, self._since = base[-1:], int(base.stamp[-1])
            return base
        waiting = 0 if self._waiting is None else len(self._waiting.stamp)
        joined = base if self._waiting is None else BaseStream.concatenate((self._waiting, base))
        passing, open_ = self._sorted(joined, np.concatenate((np.zeros(waiting, dtype=bool), new)))
        self.dropped[REPEATED_POSE] += int(np.sum(~passing & ~open_))
        self._last, self._waiting = base[-1:], joined[open_] if np.any(open_) else None
        return joined[passing] if np.any(passing) else None

    def _new(self, base: BaseStream) -> Flags:
        """Return which measurements have another pose than the one before, (N,)."""
        before = base[:1] if self._last is None else self._last
        position = np.concatenate((before.position, base.position))
        rotation = np.concatenate((before.rotation, base.rotation)).reshape(-1, 9)
        new = np.any(position[1:] != position[:-1], axis=1) | np.any(rotation[1:] != rotation[:-1], axis=1)
        if self._last is None:
            new[0] = True
        return np.asarray(new)

    def _sorted(self, base: BaseStream, new: Flags) -> tuple[Flags, Flags]:
        """Return which measurements pass, and which have to wait until it is known how long their pose lasts.

        Parameters
        ----------
        base : those that have waited, and those that come
        new : which have another pose than the one before
        """
        pose = np.cumsum(new)  # which one, 0 for that of the measurements before
        since = np.concatenate(([self._since], base.stamp[new]))
        until = since.copy()
        until[pose] = base.stamp  # the last assignment stays: the latest stamp
        lasts = until - since >= STILL
        self._since = int(since[-1])
        passing = new | lasts[pose]
        return passing, ~passing & (pose == pose[-1])
