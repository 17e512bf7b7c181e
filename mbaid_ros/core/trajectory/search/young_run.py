"""The windows of a run while it is young: all of them are linearised again, until where they are may stay."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.trajectory.filter.belief import Belief
from mbaid_ros.core.trajectory.search.passes import HOPELESS
from mbaid_ros.core.trajectory.windows.window import Window
from mbaid_ros.core.verdict.judgement import LARGEST_NIS

# Growth of a young run until all of it is linearised again, or searched again where a search explains next to
# nothing: a half more data tell enough of where to linearise, and all passes together cost three times the last.
_GROWTH = 1.5
_AT_REST = 4  # windows before the first motion that it is begun with: noise alone is in their rows
# Windows after which a start that has not settled is tried again, and what part of all it is at least: that the work
# of a window stays about the same.
_RETRY, _RETRY_PART = 2, 0.1
# Windows: where the next pass would be over more, a run is grown up if it may stay linearised as it is: what is left
# of second order is a tenth of a standard deviation then.
_GROWN = 40


class YoungRun:
    """Keeps the windows that are linearised again, and tells when all of them are to be, and when never more.

    Attributes
    ----------
    windows : in order; none of a run that has grown up
    grown_up : whether no window is linearised again
    whole : whether what the filter has come to is of these windows and of nothing else
    stays : whether the latest passes over them have come to one point
    judged : whether it is known how near linear they are about that point
    passed : s, start of the last window that the latest pass has linearised

    Parameters
    ----------
    first : windows before the first search
    kept : windows that are kept at most
    """

    def __init__(self, first: int, kept: int) -> None:
        self.windows: list[Window] = []
        self.grown_up = self.whole = self.stays = self.judged = False
        self.passed = -np.inf
        self._first, self._kept = first, kept
        self._next = first  # windows at which all are passed over again
        self._searched = 0  # windows that the latest search passes over
        self._confirmed = False  # whether the passes before had come to one point, too

    @property
    def due(self) -> bool:
        """Whether it is time to pass over all windows again."""
        return len(self.windows) >= self._next

    def rest(self) -> None:
        """Keep no more than the last windows before the first motion."""
        self.windows = self.windows[-_AT_REST:]

    def begin_search(self) -> list[Window]:
        """Return the windows that a search is begun over; those that come meanwhile are added to them."""
        self._searched = len(self.windows)
        return self.windows

    def search_soon(self) -> None:
        """Have all windows searched again as soon as the next one has come."""
        self._next = min(self._next, len(self.windows))

    def retry(self) -> None:
        """Have them searched again a little later than by the search that has led nowhere."""
        self._next = self._searched + _RETRY

    def shorten(self) -> None:
        """Begin with the later half where so many windows have come to no point."""
        if len(self.windows) > self._kept:
            self._keep_from(len(self.windows) // 2)
            self._next = min(self._next, len(self.windows) + _RETRY)

    def restart(self) -> None:
        """Give up what has been found in the windows, if any are kept."""
        self.grown_up = self.stays = False
        if self.windows:
            self.search_soon()
        else:
            self._next = self._first

    def take_over(self, belief: Belief, *, stays: bool, anew: bool) -> None:
        """Go on from what a search has found.

        Parameters
        ----------
        belief : after all windows
        stays : whether its passes have come to one point
        anew : whether those before had not: a start is confirmed once before it counts, however late it was found
        """
        self.stays, self._confirmed = stays, stays and not anew
        self.whole, self.judged = True, False
        self.passed = self.windows[self._searched - 1].start
        self._next = self._after(self._searched, belief)

    @property
    def may_grow_up(self) -> bool:
        """Whether what has been found tells if windows may stay linearised as they are, or lead nowhere together."""
        return not self.grown_up and (self._confirmed or not self.stays)

    def grow_up(self, belief: Belief, *, linear: bool) -> bool:
        """Linearise nothing again from some length on, or begin with the later half where that would be unsound.

        Parameters
        ----------
        belief : after all windows
        linear : whether they are near enough linear wherever they are linearised

        Returns
        -------
        bool
            Whether the run is long enough for either.
        """
        if self._next <= (min(_GROWN, self._kept) if linear else self._kept):
            return False
        if self.stays and belief.nis < LARGEST_NIS * belief.measured:
            self.windows, self.grown_up = [], True
        else:
            self._keep_from(self._searched // 2)
            self._next = self._after(len(self.windows), belief)
        return True

    def _keep_from(self, first: int) -> None:
        self.windows, self.whole = self.windows[first:], False

    def _after(self, windows: int, belief: Belief) -> int:
        """Return at how many windows to pass over all of them again: soon where that may yet lead to a point."""
        soon = not (self.stays or belief.nis > HOPELESS * belief.measured)
        return int(np.ceil(windows + max(_RETRY, _RETRY_PART * windows) if soon else _GROWTH * windows))
