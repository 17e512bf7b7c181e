"""The run of the filter: a start over the first windows, then one step a window."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mbaid_ros.core.filter.bank import (
    Bank,
    HypothesisFilter,
    best,
    update_bank,
    update_hypothesis,
)
from mbaid_ros.core.filter.batch import BackgroundTask, BatchIteration
from mbaid_ros.core.filter.gaussian import MeanAndCovariance, SquareRootInformation
from mbaid_ros.core.filter.initialisation import InitialisationWindow, LinearityCheck
from mbaid_ros.core.filter.linearisation_point import LinearisationPoint
from mbaid_ros.core.filter.start import MultiStart, Start
from mbaid_ros.core.filter.state import Layout, Point
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.filter.whitened import LinearisationCache
from mbaid_ros.core.filter.window import Window
from mbaid_ros.core.results.reporting import Curvature
from mbaid_ros.core.results.status import LARGEST_NIS
from mbaid_ros.core.unknowns.environment import Hypothesis

# Steps of the filter, more or less, that a search may take between two windows: while there is an estimate, and
# before, when nothing else is to be had.
_SHARE, _FIRST_SHARE = 300, 1200
_TELLING = 8  # windows that tell whether a jump was a push: if the target has moved, so many do not fit


class FilterRun:
    """Follows the state through the windows, under several hypotheses of what acts or drifts.

    That is pose error, momentum, body and all unknowns of the layout.

    The linear models are absolute, so each window may keep the linearisation point it was first seen at. While the run
    is young all windows are linearised again at the latest estimate, as often as it takes to settle.

    Attributes
    ----------
    planar : whether it takes the motion for planar

    Parameters
    ----------
    layout : of the state
    variables : of the filter
    hypotheses : the first is the one to beat
    pace : windows before the first estimate, and how many are linearised again while the run is young
    """

    def __init__(
        self,
        layout: Layout,
        variables: Variables,
        hypotheses: tuple[Hypothesis, ...],
        pace: tuple[int, int],
    ) -> None:
        self._layout = layout
        self._variables = variables
        self._linearised = LinearisationCache(layout, variables)
        passes = BatchIteration(layout, variables, self._linearised)
        self._start = MultiStart(passes, hypotheses)
        self._young = InitialisationWindow(*pace)
        self._bank: Bank | None = None
        self._latest: HypothesisFilter | None = None  # the best, with the window that is still open
        self._search = BackgroundTask[Start](layout.size)
        self._linearity = LinearityCheck(passes)
        self._begun, self._length = -np.inf, 0.0  # s, start and length of the latest window
        self._offered: Callable[[], Point] | None = None  # a start that another method has found
        self._held = LinearisationPoint(layout, variables)
        self.planar = len(variables.measured) < 6

    @property
    def started(self) -> bool:
        """Whether there is a state."""
        return self._latest is not None

    @property
    def settled(self) -> bool:
        """Whether the latest passes have come to one point that stays, and how near linear all is there is known."""
        return self._young.stays and self._linearity.known

    def curvatures(self, *, explained: bool) -> tuple[Curvature, ...]:
        """Return how near linear the windows are about where the run stands, explained by its model or not."""
        return self._linearity.curvatures(explained=explained)

    @property
    def searching(self) -> bool:
        """Whether a search is under way."""
        return self._search.under_way

    @property
    def best(self) -> HypothesisFilter:
        """The hypothesis to report: the first, unless another one explains the data far better."""
        assert self._latest is not None, 'there is a start'
        return self._latest

    @property
    def delayed(self) -> bool:
        """Whether the joints' stamps have turned out late, or early."""
        return self._held.point is not None and self._held.point.side.delay != 0.0

    @property
    def lead(self) -> float:
        """How much better (log-likelihood) the hypothesis to report explains the data than the first."""
        if self._bank is None:
            return 0.0
        return best(self._bank).belief.log_likelihood - self._bank[0].belief.log_likelihood

    def moments(self) -> MeanAndCovariance:
        """Return the latest state under the best hypothesis."""
        return MeanAndCovariance.of(self.best.belief, self._variables)

    def moments_of_first(self) -> MeanAndCovariance:
        """Return the state under the first hypothesis, which lets nothing drift."""
        assert self._bank is not None, 'there is a start'
        return MeanAndCovariance.of(self._bank[0].belief, self._variables)

    @property
    def unexplained(self) -> bool:
        """Whether there is no start, or it leaves much of the windows unexplained."""
        if self._latest is None:
            return True
        belief = self._latest.belief
        return belief.nis > LARGEST_NIS * belief.measured or len(self._latest.jumps) > 0

    @property
    def jumped(self) -> tuple[float, ...]:
        """When the momentum seemed to jump, s, if nothing drifts."""
        return () if self._bank is None else tuple(jump.time for jump in self._bank[0].jumps)

    def belief_before(self, time: float, slack: float) -> SquareRootInformation | None:
        """Return what was believed, if nothing drifts, before a jump of the momentum near a time, s."""
        jumps = () if self._bank is None else self._bank[0].jumps
        return next((jump.belief for jump in jumps if abs(jump.time - time) <= slack), None)

    @property
    def unconfirmed(self) -> tuple[float, ...]:
        """When the momentum seems to have jumped, s, while that may be something else.

        After a push all is as it was, but if the target has moved in the grasp, the next windows will not fit. And a
        window that moves a joint for the first time may show no more than that a young run is linearised elsewhere:
        until the next pass over it.
        """
        passed = np.inf if self._young.grown_up else self._young.passed
        since = min(passed, self._begun - _TELLING * self._length)
        return tuple(jump.time for jump in self.best.jumps if jump.time > since)

    @property
    def point(self) -> Point:
        """The point that the run has come to, if nothing drifts."""
        return self._point(self.moments_of_first())

    def expect(self, windows: Sequence[Window]) -> None:
        """Take the windows that are going to come, in the order of their turn."""
        self._linearised.expect(windows)

    def take(self, ready: Window | None, still_open: Window | None, *, moved: bool) -> None:
        """Take the next window into the run, and what the one after it tells already into the latest state only.

        Parameters
        ----------
        ready : a window with all its neighbours; None where there is none
        still_open : the window after it, without its later neighbours
        moved : whether a joint has moved so far; before, no start is looked for
        """
        while self.work_off():
            pass
        if ready is not None and not self._young.grown_up:
            self._young.windows.append(ready)
            if not self._search.under_way:
                self._begin(moved=moved)
        told = self.settled and not self._linearity.displaced
        for task in (self._search, self._linearity):
            task.owe(_SHARE if told else _FIRST_SHARE)
        if self._bank is None:
            return
        # Once for both windows: a point one window old is as good.
        point = self._held.moved_with(best(self._bank).belief)
        if ready is not None:
            self._bank = update_bank(self._bank, ready, self._linearised.whitened(ready, point), self._variables)
            self._follow(best(self._bank))
        latest, newest = best(self._bank), still_open or ready
        if newest is not None:
            self._begun, self._length = newest.start, newest.length
        if still_open is not None:
            white = self._linearised.whitened(still_open, point)
            # Where nothing acts or drifts, the pose error alone goes on from its first knot.
            if latest.hypothesis.disturbed:
                (latest,) = update_bank((latest,), still_open, white, self._variables)
            else:
                latest = update_hypothesis(latest, still_open, white, self._variables)
        self._latest = latest

    def offer(self, point: Callable[[], Point]) -> None:
        """Take what makes a point that the next search may begin at."""
        self._offered = point

    def restart(self) -> None:
        """Give up what the run has come to; windows that are still kept are searched again."""
        self._search.begin(None)
        self._linearity.forget()
        self._bank = self._latest = None
        self._young.restart()

    def work_off(self) -> bool:
        """Do a part of what the search has to do before the next window; return whether some is left."""
        if self._linearity.owing:
            if self._linearity.work_off() and not self.unexplained:
                self._young.search_soon()
            if self._linearity.judged and not self._young.judged:
                self._grow_up()
            return True
        try:
            found = self._search.work_off()
        except np.linalg.LinAlgError:
            # What it was linearised at is no robot that can be: later windows may tell more.
            self._young.retry()
            found = None
        if found is not None:
            self._take_over(found)
        return self._search.owing or self._linearity.owing

    def _follow(self, track: HypothesisFilter) -> None:
        """Find out whether the best hypothesis has left the point where the windows of a young run are near linear."""
        if self._young.stays and self._young.whole and not self._young.grown_up:
            self._linearity.follow(self._young.windows, track)

    def _begin(self, *, moved: bool) -> None:
        """Begin to linearise all of the young run again if it is time to."""
        if not moved:
            self._young.rest()
        elif self._young.due:
            begins = [self._found] if self.settled else []
            begins += [] if self._offered is None else [self._offered]
            self._search.begin(self._start.search(self._young.begin_search(), begins))
        elif not self.settled:
            self._young.shorten()

    def _take_over(self, found: Start) -> None:
        """Go on from what has been found; how near linear windows are about that tells whether the run has grown up."""
        anew = not self.settled
        self._bank = found.bank
        leading = best(found.bank)
        self._young.take_over(leading.belief, stays=found.settled, anew=anew)
        self._linearity.begin(found.curvature, found.covariance, leading, anew=anew)
        self._linearity.owe(_FIRST_SHARE if anew else 0)
        self._held.begin(found.point)
        if not found.settled:
            self._grow_up()

    def _grow_up(self) -> None:
        """Linearise nothing again where all is told and the young run is long enough."""
        assert self._bank is not None, 'there is a start'
        self._young.judged = True
        if self._search.under_way or not self._young.may_grow_up:
            return
        belief = best(self._bank).belief
        linear = self._young.stays and self._linearity.may_stay(belief)
        if self._young.grow_up(belief, linear=linear):
            self._linearity.grow_up()

    def _found(self) -> Point | None:
        """Return the point of the best hypothesis."""
        if self._bank is None:
            return None
        return self._point(MeanAndCovariance.of(best(self._bank).belief, self._variables))

    def _point(self, moments: MeanAndCovariance) -> Point:
        return self._layout.point(moments.mean, moments.deviation)
