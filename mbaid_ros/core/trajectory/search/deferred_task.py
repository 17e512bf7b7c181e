"""Work that is done bit by bit between windows: so much of it a window, however the calls are spread."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Generic, TypeVar

Result = TypeVar('Result')

SLICE = 30  # steps of the filter, more or less, that are done at a time: a few milliseconds
_UNKNOWNS = 96  # numbers of the state, for as many of which a step counts once more: it takes as much longer


class DeferredTask(Generic[Result]):
    """Something to find out, which yields how much work each bit was, in steps of the filter, and at last its result.

    Parameters
    ----------
    size : of the state; steps of a large one count more
    """

    def __init__(self, size: int) -> None:
        self._cost = 1 + size // _UNKNOWNS
        self._bits: Iterator[int | Result] | None = None
        self._owed = 0  # steps that are to be done before the next window

    @property
    def under_way(self) -> bool:
        """Whether there is no result yet."""
        return self._bits is not None

    @property
    def owing(self) -> bool:
        """Whether some of it is to be done before the next window."""
        return self._owed > 0

    def begin(self, bits: Iterator[int | Result] | None) -> None:
        """Begin with this and nothing else, or with nothing."""
        self._bits, self._owed = bits, 0

    def owe(self, steps: int) -> None:
        """Owe so many steps, more or less, before the next window."""
        self._owed = steps if self.under_way else 0

    def work_off(self) -> Result | None:
        """Do a slice of what is owed, and return the result if that leads to it."""
        done = 0
        while self._bits is not None and done < min(self._owed, SLICE):
            bits, self._bits = self._bits, None  # what raises is over
            bit = next(bits)
            if not isinstance(bit, int):
                self._owed = 0
                return bit
            self._bits = bits
            done += self._cost * bit
        self._owed = max(self._owed - done, 0) if self.under_way else 0
        return None
