"""The windows of a run while it is young: all of them are linearised again, until where they are may stay."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbaid_ros.core.filter.bank import HypothesisFilter
from mbaid_ros.core.filter.batch import HOPELESS, BackgroundTask, BatchIteration
from mbaid_ros.core.filter.gaussian import MeanAndCovariance, SquareRootInformation
from mbaid_ros.core.filter.state import BODY, BODY_PLACES
from mbaid_ros.core.filter.window import Window, in_stacks
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.reporting import Curvature
from mbaid_ros.core.results.status import LARGEST_NIS
from mbaid_ros.core.robot.model_errors import body_sizes

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


class InitialisationWindow:
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

    def take_over(self, belief: SquareRootInformation, *, stays: bool, anew: bool) -> None:
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

    def grow_up(self, belief: SquareRootInformation, *, linear: bool) -> bool:
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

    def _after(self, windows: int, belief: SquareRootInformation) -> int:
        """Return at how many windows to pass over all of them again: soon where that may yet lead to a point."""
        soon = not (self.stays or belief.nis > HOPELESS * belief.measured)
        return int(np.ceil(windows + max(_RETRY, _RETRY_PART * windows) if soon else _GROWTH * windows))


# What is left of any standard deviation of the body when its windows are linearised anew: they were linearised where
# that was hardly known. It halves the variance; sooner hardly anything has moved.
_SHARPER = 0.7
# Relative deviation of the body, in all directions seen, below which windows may stay: a tenth of it is second order.
_KNOWN = 0.1


class LinearityCheck:
    """Follows how far a young run owes its estimate to where its windows are linearised.

    Parameters
    ----------
    passes : over the windows
    """

    def __init__(self, passes: BatchIteration) -> None:
        self._passes = passes
        self._elsewhere = BackgroundTask[Curvature](passes.layout.size)
        self._anew = BackgroundTask[Curvature](passes.layout.size)
        self._curvature: Curvature | None = None  # about where a search has led
        self._displacement: Curvature | None = None  # from there on, where all windows are linearised at the estimate
        self._linearised: Array = np.zeros((10, 10))  # covariance of the body when all windows were linearised last

    @property
    def known(self) -> bool:
        """Whether there is a solution of which it is known."""
        return self._curvature is not None

    @property
    def judged(self) -> bool:
        """Whether it is known of what the latest search has led to."""
        return self.known and not self._elsewhere.under_way

    @property
    def displaced(self) -> bool:
        """Whether the estimate has left the point where its windows are near linear."""
        return self._displacement is not None and self._displacement.anywhere

    def curvatures(self, *, explained: bool) -> tuple[Curvature, ...]:
        """Return all that is known of it.

        Parameters
        ----------
        explained : whether the model explains the data: else no point is that where windows are near linear
        """
        found = (self._curvature, self._displacement if explained else None)
        return tuple(each for each in found if each is not None)

    @property
    def owing(self) -> bool:
        """Whether some of it is to be found out before the next window."""
        return self._elsewhere.owing or self._anew.owing

    def owe(self, steps: int) -> None:
        """Owe so many steps of the filter, more or less, of each task before the next window."""
        self._elsewhere.owe(steps)
        self._anew.owe(steps)

    def work_off(self) -> bool:
        """Do a slice of what is owed; return whether that has shown the estimate to be displaced."""
        if self._elsewhere.owing:
            self._curvature = self._elsewhere.work_off() or self._curvature
            return False
        found = self._anew.work_off()
        if found is None:
            return False
        self._displacement, self._linearised = found, found.covariance
        return found.anywhere

    def may_stay(self, belief: SquareRootInformation) -> bool:
        """Tell whether what the windows leave open at second order is small, wherever they are linearised."""
        if self._curvature is None or self._curvature.anywhere or self.displaced:
            return False
        variables = self._passes.variables
        moments = MeanAndCovariance.of(belief, variables)
        factor = moments.factor_of(variables.spread[BODY])
        body, seen = moments.mean[BODY], np.sqrt(np.add.reduce(factor**2, axis=1))
        return bool(body[0] > 0.0 and np.all(seen < _KNOWN * body_sizes(body)))

    def begin(
        self, curvature: Iterator[int | Curvature] | None, covariance: Array, track: HypothesisFilter, *, anew: bool
    ) -> None:
        """Begin with what a search has led to.

        Parameters
        ----------
        curvature : finds out how near linear its windows are about that; None where it has not settled
        covariance : (10, 10) of the body when they were linearised
        track : the best hypothesis by now
        anew : whether the solution before did not stay
        """
        if anew:
            self._curvature = None
        self._elsewhere.begin(curvature)
        self._anew.begin(None)
        self._linearised = covariance
        if not self._sharper(self._covariance(track)):
            self._displacement = None  # of windows as they were linearised before

    def forget(self) -> None:
        """Forget the solution."""
        self._elsewhere.begin(None)
        self._curvature = None
        self.grow_up()

    def grow_up(self) -> None:
        """Follow the estimate no more: no window is linearised again."""
        self._anew.begin(None)
        self._displacement = None

    def follow(self, windows: list[Window], track: HypothesisFilter) -> None:
        """Begin to linearise the windows at the estimate, where that has become so much better known since.

        Parameters
        ----------
        windows : all of the run
        track : the best hypothesis after them
        """
        if not self._anew.under_way and self._sharper(self._covariance(track)):
            self._anew.begin(self._passes.displacement(in_stacks(windows), track))

    def _covariance(self, track: HypothesisFilter) -> Array:
        return MeanAndCovariance.of(track.belief, self._passes.variables).covariance(BODY_PLACES)

    def _sharper(self, covariance: Array) -> bool:
        return bool(np.any(covariance.diagonal() < _SHARPER**2 * self._linearised.diagonal()))
