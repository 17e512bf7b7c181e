"""Batch initialisation: the first windows are relinearised together until their linearisation may be frozen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Generic

import numpy as np

from mbaid_ros.core.filter.bank import HypothesisFilter
from mbaid_ros.core.filter.batch import HOPELESS, BatchIteration, Outcome, Work
from mbaid_ros.core.filter.square_root import MeanAndCovariance, SquareRootInformation
from mbaid_ros.core.filter.start import MultiStart, Start
from mbaid_ros.core.filter.state import BODY, BODY_PLACES, Layout, Point
from mbaid_ros.core.filter.time_update import Hypothesis
from mbaid_ros.core.filter.window import Window, in_stacks
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.results.reporting import Curvature
from mbaid_ros.core.results.status import LARGEST_NIS
from mbaid_ros.core.robot.momentum import body_sizes
from mbaid_ros.core.unknowns.flexible import SpringErrors, resolved

# Growth of the windows until the next search, so that all searches together cost three times the last; where the target
# has a prior, at which it is linear until the data move it, five times.
_GROWTH, _GROWTH_DESCRIBED = 1.5, 1.25
FIRST = 10  # windows before the first search: 5 s of motion, from which a batch start converges
_AT_REST = 4  # windows before the first motion that are kept: noise alone is in their rows
# Windows after which a search that has not converged is repeated, and the least part of all that is: so the work of a
# window stays about the same.
_RETRY, _RETRY_PART = 2, 0.1
_FREEZE = 40  # windows above which the linearisation is frozen if it is good enough
# Ratio of standard deviations of the body, now and when its windows were linearised, below which they are checked anew.
_SHARPER = 0.7
# Relative deviation of the body, in all directions seen, below which the linearisation may be frozen: the remainder of
# second order is a tenth of it.
_KNOWN = 0.1
# Steps of the filter that a task may take between two windows: while there is an estimate, and before.
_SHARE, _FIRST_SHARE = 300, 1200
# The same without limit. Where the target has a prior, windows are rare, and each may leave the linear range.
AT_ONCE = 10**9


SLICE = 30  # steps of the filter, about, in one slice: a few milliseconds
_STATE_SIZE = 96  # numbers of the state, for as many of which a step costs one more


class BackgroundTask(Generic[Outcome]):
    """A computation in slices, with a budget of steps for each window.

    Parameters
    ----------
    size : of the state; steps of a large one count more
    """

    def __init__(self, size: int) -> None:
        self._cost = 1 + size // _STATE_SIZE
        self._work: Work[Outcome] | None = None
        self._budget = 0  # steps left before the next window

    @property
    def under_way(self) -> bool:
        """Whether there is no outcome yet."""
        return self._work is not None

    @property
    def is_due(self) -> bool:
        """Whether some of the budget is left to be used before the next window."""
        return self._budget > 0

    def begin(self, work: Work[Outcome] | None) -> None:
        """Begin this computation instead of any other, or none."""
        self._work, self._budget = work, 0

    def allot_steps(self, steps: int) -> None:
        """Set the budget until the next window, in steps."""
        self._budget = steps if self.under_way else 0

    def run_slice(self) -> Outcome | None:
        """Run one slice; return the outcome if that completes the computation."""
        done = 0
        while self._work is not None and done < min(self._budget, SLICE):
            work, self._work = self._work, None  # a computation that raises is over
            try:
                done += self._cost * next(work)
            except StopIteration as end:
                self._budget = 0
                outcome: Outcome = end.value
                return outcome
            self._work = work
        self._budget = max(self._budget - done, 0) if self.under_way else 0
        return None


class Initialisation:
    """Searches the linearisation point of the first windows in the background, ever more of them.

    Parameters
    ----------
    batch : iterates over the windows
    hypotheses : the first is the one to beat
    kept : windows that are kept at most

    Attributes
    ----------
    windows : to be relinearised, in order
    accepted : whether the latest search has been accepted
    linearised_until : s, start of the last window of that search
    """

    def __init__(self, batch: BatchIteration, hypotheses: tuple[Hypothesis, ...], kept: int) -> None:
        self._batch = batch
        self._multi_start = MultiStart(batch, hypotheses)
        self._kept = kept
        self.windows: list[Window] = []
        self.accepted = self._confirmed = False  # confirmed by the search after it
        self.linearised_until = -np.inf
        self._consistent = True  # whether the latest search explains its windows
        self._due = FIRST  # number of windows at which the next search begins
        self._searched = 0  # windows in the latest search
        self._search = BackgroundTask[Start](batch.layout.size)
        self._curvature_task = BackgroundTask[Curvature](batch.layout.size)
        self._displacement_task = BackgroundTask[Curvature](batch.layout.size)
        self._tasks = self._search, self._curvature_task, self._displacement_task
        self._curvature: Curvature | None = None  # about the solution of a search
        self._displacement: Curvature | None = None  # of the solution from where its windows are linearised
        self._covariance: Array | None = None  # of the body when all windows were linearised last; None: not all are

    @property
    def converged(self) -> bool:
        """Whether the latest search has been accepted, and the nonlinearity about its solution is known."""
        return self.accepted and self._curvature is not None

    @property
    def searching(self) -> bool:
        """Whether a search is under way."""
        return self._search.under_way

    @property
    def is_due(self) -> bool:
        """Whether work is left to be done before the next window."""
        return any(task.is_due for task in self._tasks)

    def curvatures(self, *, consistent: bool) -> tuple[Curvature, ...]:
        """Return the nonlinearity of the windows; about the present estimate only where the model explains the data."""
        known = (self._curvature, self._displacement if consistent else None)
        return tuple(each for each in known if each is not None)

    def add(
        self, window: Window, points: Sequence[Callable[[], Point | None]], *, joints_moved: bool, lost: bool = False
    ) -> None:
        """Add a window, and begin a search where one is due; none as long as no joint has moved.

        A search is due, too, where the solution of a target with a prior explains the windows no more.
        """
        self.windows.append(window)
        if self._search.under_way:
            return
        if not joints_moved:
            self.windows = self.windows[-_AT_REST:]
        elif len(self.windows) >= self._due or (lost and self._consistent and self._batch.variables.has_body_prior):
            self._searched = len(self.windows)
            self._search.begin(self._multi_start.search(self.windows, points))
        elif not self.converged and len(self.windows) > self._kept:
            self._drop(len(self.windows) // 2)
            self._due = min(self._due, len(self.windows) + _RETRY)

    def allot(self) -> None:
        """Allot the work until the next window."""
        steps = _SHARE if self.converged and not self._displaced else _FIRST_SHARE
        if self._batch.variables.has_body_prior:
            steps = AT_ONCE
        for task in self._tasks:
            task.allot_steps(steps)

    def run_slice(self, *, consistent: bool) -> Start | Curvature | None:
        """Run one slice; return a start to take over, or the nonlinearity about the last one.

        Parameters
        ----------
        consistent : whether the model explains the data: else no point is that where the windows are near linear
        """
        if self._curvature_task.is_due:
            curvature = self._curvature_task.run_slice()
            self._curvature = curvature or self._curvature
            return curvature
        if self._displacement_task.is_due:
            displacement = self._displacement_task.run_slice()
            if displacement is not None:
                self._displacement = displacement
                self._covariance = None if self._covariance is None else displacement.covariance
                if consistent and displacement.is_nonlinear:
                    self._search_soon()
            return None
        try:
            return self._search.run_slice()
        except np.linalg.LinAlgError:  # no robot that can exist: later windows may help
            self._due = self._searched + _RETRY
            return None

    def take_over(self, start: Start, filtered: HypothesisFilter) -> None:
        """Go on from the outcome of a search, of which this hypothesis is the best."""
        anew = not self.converged
        self._consistent = filtered.gaussian.nis < LARGEST_NIS * filtered.gaussian.measured
        self.accepted, self._confirmed = start.accepted, start.accepted and not anew
        self.linearised_until = self.windows[self._searched - 1].start
        self._due = self._next_search(self._searched, filtered.gaussian)
        self._curvature = None if anew else self._curvature
        self._curvature_task.begin(start.curvature)
        self._curvature_task.allot_steps(_FIRST_SHARE if anew else 0)
        self._displacement_task.begin(None)
        self._covariance = start.covariance
        if not self._is_sharper(filtered):
            self._displacement = None  # of windows as they were linearised before

    def may_freeze(self, gaussian: SquareRootInformation) -> bool:
        """Return whether the windows may keep their linearisation for good; else drop those that lead nowhere together.

        Parameters
        ----------
        gaussian : after all windows
        """
        if self._search.under_way or not (self._confirmed or not self.accepted):
            return False
        linear = self.accepted and self._is_linear(gaussian)
        if self._due <= (min(_FREEZE, self._kept) if linear else self._kept):
            return False
        self._displacement_task.begin(None)
        self._displacement = None
        if self.accepted and gaussian.nis < LARGEST_NIS * gaussian.measured:
            self.windows = []
            return True
        self._drop(self._searched // 2)
        self._due = self._next_search(len(self.windows), gaussian)
        return False

    def check_displacement(self, filtered: HypothesisFilter) -> None:
        """Begin to linearise the windows at the estimate where the body is known so much better than when they were."""
        if self.accepted and not self._displacement_task.under_way and self._is_sharper(filtered):
            self._displacement_task.begin(self._batch.displacement(in_stacks(self.windows), filtered))

    def restart(self) -> None:
        """Give up all solutions; windows that are kept are searched again."""
        for task in self._tasks:
            task.begin(None)
        self._curvature = self._displacement = None
        self.accepted = False
        if self.windows:
            self._search_soon()
        else:
            self._due = FIRST

    def _search_soon(self) -> None:
        self._due = min(self._due, len(self.windows))

    @property
    def _displaced(self) -> bool:
        return self._displacement is not None and self._displacement.is_nonlinear

    def _is_linear(self, gaussian: SquareRootInformation) -> bool:
        """Return whether the remainder of second order is small, wherever the windows are linearised."""
        if self._curvature is None or self._curvature.is_nonlinear or self._displaced:
            return False
        distribution = MeanAndCovariance.from_gaussian(gaussian, self._batch.variables)
        seconds = self.windows[-1].start - self.windows[0].start
        layout = self._batch.layout
        if layout.kernel.springs.count and not resolved_frequencies(layout, distribution.deviation, seconds).all():
            return False
        factor = distribution.factor_of(self._batch.variables.to_state[BODY])
        body, deviation = distribution.mean[BODY], np.sqrt(np.add.reduce(factor**2, axis=1))
        return bool(body[0] > 0.0 and np.all(deviation < _KNOWN * body_sizes(body)))

    def _is_sharper(self, filtered: HypothesisFilter) -> bool:
        if self._covariance is None:
            return False
        now = MeanAndCovariance.from_gaussian(filtered.gaussian, self._batch.variables).covariance(BODY_PLACES)
        return bool(np.any(now.diagonal() < _SHARPER**2 * self._covariance.diagonal()))

    def _drop(self, first: int) -> None:
        self.windows, self._covariance = self.windows[first:], None

    def _next_search(self, windows: int, gaussian: SquareRootInformation) -> int:
        """Return at how many windows to search again: soon where that may yet be accepted."""
        if self._batch.variables.has_body_prior:
            return int(np.ceil(_GROWTH_DESCRIBED * windows))
        soon = not (self.accepted or gaussian.nis > HOPELESS * gaussian.measured)
        return int(np.ceil(windows + max(_RETRY, _RETRY_PART * windows) if soon else _GROWTH * windows))


def resolved_frequencies(layout: Layout, deviation: Array, seconds: float) -> Flags:
    """Return which passive joints' frequencies (f,) the data of some seconds resolve, the state to (s,) deviations."""
    springs = layout.kernel.springs
    relative: Array = np.zeros(springs.count)
    if not springs.count:
        return relative > 0.0
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        if isinstance(unknown, SpringErrors):
            relative = np.abs(unknown.factor @ deviation[place])[::2]
    return resolved(springs.frequency, springs.damping_ratio, relative, seconds)
