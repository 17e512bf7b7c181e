"""When to work through the messages that have come."""

from __future__ import annotations

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
