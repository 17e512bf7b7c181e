"""Samples cut into windows by their stamps alone, so that live and replayed data give the same windows."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.samples import Samples, Stamps


class Windows:
    """Collects samples and releases each window once a later sample has arrived.

    Parameters
    ----------
    length : float
        Length of a window, s; window k holds the samples with k <= time / length < k + 1.
    """

    def __init__(self, length: float) -> None:
        self._length = length
        self._parts: list[Samples] = []

    def push(self, samples: Samples) -> list[Samples]:
        """Take samples and return the windows that they close, in order; empty windows are left out."""
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
        """Return the samples of the window that is still open, as a window."""
        parts, self._parts = self._parts, []
        return [Samples.concatenate(parts)] if parts else []

    def _numbers(self, samples: Samples) -> Stamps:
        # A nanosecond of slack: 0.5 s after the first sample is in window 1, however the division rounds.
        return np.floor((samples.time + 1e-9) / self._length).astype(np.int64)
