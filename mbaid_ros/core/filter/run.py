"""The point at which windows are linearised: held until the estimate has moved, then moved along."""

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
from mbaid_ros.core.filter.start import MultiStart, Start
from mbaid_ros.core.filter.state import (
    BODY,
    Layout,
    Point,
    near_part,
)
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.filter.whitened import LinearisationCache
from mbaid_ros.core.filter.window import Window
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.reporting import Curvature
from mbaid_ros.core.results.verdict import LARGEST_NIS
from mbaid_ros.core.unknowns.hypotheses import Hypothesis

# Squared Mahalanobis distance, of some twenty to two hundred numbers, that the estimate may move before windows are
# linearised elsewhere: directions that nothing sees gain less information by that than their priors have. Then what
# moves are the directions known as well as this, relative to typical sizes, and those that are so far off that their
# square, what is left of second order, is more than a tenth of a standard deviation. An unknown's unit is about 1 %
# of its size.
_HELD, _WELL_KNOWN, _CURVED, _UNIT = 16.0, 1e-3, 0.1, 0.01


class LinearisationPoint:
    """Linearisation point of the windows to come.

    Each window sees nothing along some directions g: of all masses and momenta growing together, say, or of CoM and
    odometry mount displaced together. Linearised at another point these are others, and together the windows would tell
    of either. So what is well known stays near the estimate in every combination of its numbers, and what is hardly
    known stays where it is, unless it is far.

    Attributes
    ----------
    point : at which windows are linearised at present; None before there is a start

    Parameters
    ----------
    layout : of the state
    variables : of the filter
    """

    def __init__(self, layout: Layout, variables: Variables) -> None:
        self._layout = layout
        self._variables = variables
        self.point: Point | None = None
        self._reference: Array = np.zeros(layout.size)  # the estimate when it was last moved

    def begin(self, point: Point) -> None:
        """Go on from a point that a search has found."""
        self.point = point
        self._reference[self._layout.parameters] = point.parameters
        self._reference[self._layout.readings] = point.readings

    def moved_with(self, belief: SquareRootInformation) -> Point:
        """Return the point for what is believed now: another one where docs/trajectory.md, eq. 6, holds."""
        assert self.point is not None, 'there is a start'
        moments = MeanAndCovariance.of(belief, self._variables)
        gather, root = self._variables.gather[self._variables.lasting], self._known(belief.root)
        distance = root @ (gather @ (moments.mean - self._reference))
        if distance @ distance > _HELD:
            self._move(moments, root)
        return self.point

    def _move(self, moments: MeanAndCovariance, root: Array) -> None:
        """Move the point with the estimate, along the eigenvectors of its information R^T R.

        Parameters
        ----------
        moments : of the state
        root : square-root information of all but the pose error, what wanders and a constant force
        """
        assert self.point is not None, 'there is a start'
        layout, variables, held = self._layout, self._variables, self.point
        lasting = variables.lasting
        state = moments.mean.copy()
        state[layout.parameters] = held.parameters
        state[layout.readings] = held.readings
        # Beside a body that is heavier than the robot, what is typical of the robot is little.
        heavier = float(moments.mean[BODY.start] / variables.typical_mass)
        unit = np.full(root.shape[1], 1.0 / max(1.0, heavier))
        unit[np.arange(len(variables.scale))[lasting] >= variables.own] = _UNIT
        information, directions = np.linalg.eigh((root / unit).T @ (root / unit))
        deviation = 1.0 / np.sqrt(np.maximum(information, 1.0))
        offset = directions.T @ (unit * (variables.gather[lasting] @ (moments.mean - state)))
        moving = (deviation < _WELL_KNOWN) | (offset**2 > _CURVED * deviation)
        state += variables.spread[:, lasting] @ (directions @ np.where(moving, offset, 0.0) / unit)
        step = state[layout.parameters] - held.parameters
        part = near_part(held.parameters, step)
        state[layout.parameters] = held.parameters + part * step
        if part == 1.0:
            self._reference = moments.mean.copy()
        # What follows has to be linked to the windows before: at their readings.
        self.point = layout.beside(state, held)

    def _known(self, root: Array) -> Array:
        """Return the square-root information of all but the pose error, what wanders and a constant force."""
        variables = self._variables
        first, count = variables.poses, len(variables.scale)
        others = np.concatenate((np.arange(count, len(root)), variables.wandering)).astype(int)
        if not others.size:
            return root[first:, first:count]
        order = np.concatenate((others, np.arange(count)[variables.lasting]))
        triangle = np.asarray(np.linalg.qr(root[first:, order], mode='r'))
        return triangle[len(others) : len(order), len(others) :]


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
