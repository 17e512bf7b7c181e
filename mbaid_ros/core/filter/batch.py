"""Work that is done bit by bit between windows: so much of it a window, however the calls are spread."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.filter.bank import (
    LONGEST,
    MARGIN,
    Bank,
    HypothesisFilter,
    update_bank,
)
from mbaid_ros.core.filter.gaussian import MeanAndCovariance, SquareRootInformation
from mbaid_ros.core.filter.state import (
    BODY,
    BODY_PLACES,
    LINEAR,
    Layout,
    Point,
    near_part,
)
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.filter.whitened import LINEARISED, LinearisationCache, WhitenedWindow
from mbaid_ros.core.filter.window import Stack, Window
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.physical_consistency import IMPOSSIBLE, is_physical, project
from mbaid_ros.core.results.reporting import Curvature
from mbaid_ros.core.robot.kernel import unknown_scale
from mbaid_ros.core.unknowns.hypotheses import Hypothesis

Outcome = TypeVar('Outcome')

SLICE = 30  # steps of the filter, more or less, that are done at a time: a few milliseconds
_UNKNOWNS = 96  # numbers of the state, for as many of which a step counts once more: it takes as much longer


class BackgroundTask(Generic[Outcome]):
    """Something to find out, which yields how much work each bit was, in steps of the filter, and at last its result.

    Parameters
    ----------
    size : of the state; steps of a large one count more
    """

    def __init__(self, size: int) -> None:
        self._cost = 1 + size // _UNKNOWNS
        self._bits: Iterator[int | Outcome] | None = None
        self._owed = 0  # steps that are to be done before the next window

    @property
    def under_way(self) -> bool:
        """Whether there is no result yet."""
        return self._bits is not None

    @property
    def owing(self) -> bool:
        """Whether some of it is to be done before the next window."""
        return self._owed > 0

    def begin(self, bits: Iterator[int | Outcome] | None) -> None:
        """Begin with this and nothing else, or with nothing."""
        self._bits, self._owed = bits, 0

    def owe(self, steps: int) -> None:
        """Owe so many steps, more or less, before the next window."""
        self._owed = steps if self.under_way else 0

    def work_off(self) -> Outcome | None:
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


MASS = BODY.start - LINEAR.start  # its place among the parameters

_PASSES = 12  # at most: what has come to no point by then seldom does
# Where the innovations squared are so many times what they should be in the mean, and as many passes in a row have
# not made them less, no further one will: the next search waits for half as much data again.
HOPELESS, _IDLE = 10.0, 3
_SETTLED = 0.1  # standard deviations: further passes change nothing that is published
# Relative standard deviation of the mass, below which a start counts: beyond, the centre of mass as a quotient is far
# from Gaussian.
_CERTAIN = 0.15
_APART = 3.0  # standard deviations, from which two starts have come to different points
# Chance of a start as surprising as that, from which another one is tried: a search for nothing once in a hundred.
_UNLIKELY = 0.01
# Points, drawn from what is believed, at which a solution is tried: by three, what moves by a whole standard
# deviation is missed once in five to eighteen times.
_ELSEWHERE = 3
# Standard deviations that a step of Newton's may move a parameter by where it moves another by too many: passes will
# not come to a point at once, and the step is a part of the way.
_DISPLACED = 0.25


@dataclass(frozen=True)
class Relinearised:
    """Windows in order, each as it is and linearised, all at one point."""

    point: Point
    windows: list[tuple[Window, WhitenedWindow]]


@dataclass(frozen=True, eq=False)
class BatchResult:
    """What repeated passes have led to.

    Attributes
    ----------
    point : the solution of the last pass
    passed : what that pass was over
    track : the hypothesis that was followed in it
    moments : of its belief
    deviation : standard deviations of the parameters
    settled : whether that pass moved them by next to nothing
    possible : whether its body is near enough to one that can exist
    held : whether its mass was held
    """

    point: Point
    passed: Relinearised
    track: HypothesisFilter
    moments: MeanAndCovariance
    deviation: Array
    settled: bool
    possible: bool
    held: bool

    @property
    def sound(self) -> bool:
        """Whether the result also explains the windows."""
        belief = self.track.belief
        return self.settled and self.possible and belief.nis < chi_square.limit(_UNLIKELY, belief.measured)

    @property
    def certain(self) -> bool:
        """Whether it has settled on a real body, its mass far enough from zero for what is linear to be near."""
        known = bool(self.deviation[MASS] < _CERTAIN * self.point.parameters[MASS])
        return self.settled and self.possible and known

    @property
    def merit(self) -> tuple[bool, float]:
        """What results are compared by: where they have not settled, the windows are not what they say they are."""
        return not self.held, self.track.belief.log_likelihood - (0.0 if self.settled else MARGIN)

    def near(self, point: Point, deviations: float) -> bool:
        """Tell whether a point is less than some standard deviations away in all parameters."""
        return bool(np.all(np.abs(point.parameters - self.point.parameters) <= deviations * self.deviation))

    def rivals(self, other: BatchResult) -> bool:
        """Tell whether another result is at quite another point that explains the windows about as well."""
        as_good = other.track.belief.log_likelihood > self.track.belief.log_likelihood - MARGIN
        return as_good and not self.near(other.point, _APART)


@dataclass(frozen=True)
class BatchIteration:
    """Makes passes.

    Attributes
    ----------
    layout : of the state
    variables : of the filter
    linearised : linearises windows
    """

    layout: Layout
    variables: Variables
    linearised: LinearisationCache

    def repeat(
        self, stacks: list[list[Stack]], point: Point, fresh: HypothesisFilter, *, held: bool = False
    ) -> Generator[int, None, BatchResult | None]:
        """Pass over the windows until they move the point no more, at most a dozen times; None where none can be made.

        Parameters
        ----------
        stacks : of the windows
        point : to begin at
        fresh : a hypothesis before the first window
        held : whether its mass is held
        """
        result: BatchResult | None = None
        least, idle = np.inf, 0
        for _ in range(_PASSES):
            try:
                result = yield from self._solve(stacks, point, fresh, held=held)
            except np.linalg.LinAlgError:
                # It has led away to a robot that cannot be: nothing follows from it.
                return None if result is None else replace(result, point=result.passed.point, settled=False)
            point = result.point
            misfit = result.track.misfit / max(result.track.belief.measured, 1)
            least, idle = min(misfit, least), 0 if misfit < least else idle + 1
            if result.settled or (least > HOPELESS and idle >= _IDLE):
                break
        return result

    def _solve(
        self, stacks: list[list[Stack]], point: Point, fresh: HypothesisFilter, *, held: bool
    ) -> Generator[int, None, BatchResult]:
        """Pass over the windows once."""
        passed = yield from self.over(stacks, point)
        (track,) = yield from self.run(passed, (fresh,))
        moments = MeanAndCovariance.of(track.belief, self.variables)
        deviation = moments.deviation[self.layout.parameters]
        state, correction = self._real(moments)
        # What wanders is linearised at nothing, wherever it is at last.
        step: Array = self.layout.settled(state, moments.deviation)[self.layout.parameters] - point.parameters
        settled = bool(np.all(np.abs(step) < _SETTLED * deviation))  # a step that is cut short has settled nothing
        step *= near_part(point.parameters, step)
        state[self.layout.parameters] = point.parameters + step
        after = self.layout.point(state, moments.deviation)
        return BatchResult(
            after, passed, track, moments, deviation, settled=settled, possible=correction < IMPOSSIBLE, held=held
        )

    def _real(self, moments: MeanAndCovariance) -> tuple[Array, float]:
        """Return the likeliest state (s,) whose body can exist, and how many standard deviations away that is.

        In a plane, which leaves most of a body open, the mean.
        """
        body = moments.mean[BODY]
        if self.layout.plane is not None or is_physical(body):
            return moments.mean.copy(), 0.0
        scale = unknown_scale(self.layout.kernel)[:10]
        nearest, distance = project(body, moments.covariance(BODY_PLACES), scale)
        # What else is uncertain follows the body, as far as it is correlated.
        own = moments.factor[BODY] / scale[:, None]
        state = moments.mean + moments.factor @ np.linalg.lstsq(own, (nearest - body) / scale)[0]
        return np.asarray(state), distance

    def over(self, stacks: list[list[Stack]], point: Point) -> Generator[int, None, Relinearised]:
        """Linearise all windows at one point."""
        windows: list[tuple[Window, WhitenedWindow]] = []
        for part in stacks:
            more = self.linearised.all_whitened(part, point)
            yield LINEARISED * len(more)
            windows += more
        return Relinearised(point, windows)

    def fresh(self, hypothesis: Hypothesis, longest: int = LONGEST, mass: float | None = None) -> HypothesisFilter:
        """Return a hypothesis before the first window, of any mass or near one, whose jumps may take some windows."""
        extra = self.variables.force.shape[1] if hypothesis.force != 'none' else 0
        return HypothesisFilter(hypothesis, SquareRootInformation.prior(self.variables, extra, mass), longest=longest)

    def curvature(self, stacks: list[list[Stack]], track: HypothesisFilter) -> Iterator[int | Curvature]:
        """Find out how far the solution of windows moves where they are linearised elsewhere in its interval.

        Parameters
        ----------
        stacks : of the windows
        track : a hypothesis after them, linearised at its own solution
        """
        moments = MeanAndCovariance.of(track.belief, self.variables)
        draws = np.random.default_rng(0)
        shifts: list[Array] = []
        for _ in range(_ELSEWHERE):
            step = moments.factor @ draws.standard_normal(moments.factor.shape[1])
            part = near_part(moments.mean[self.layout.parameters], step[self.layout.parameters])
            shift = yield from self._shift(stacks, track, moments, part * step)
            shifts.append(shift / part**2)  # of second order in the step
        yield Curvature(np.array(shifts), moments.covariance(BODY_PLACES))

    def displacement(self, stacks: list[list[Stack]], track: HypothesisFilter) -> Iterator[int | Curvature]:
        """Find out how far the solution of windows moves where all are linearised at itself: a step of Newton's.

        Parameters
        ----------
        stacks : of the windows
        track : a hypothesis after them, each linearised wherever the run was by then
        """
        moments = MeanAndCovariance.of(track.belief, self.variables)
        shift = yield from self._shift(stacks, track, moments, np.zeros(len(moments.mean)))
        found = Curvature(shift[None], moments.covariance(BODY_PLACES))
        yield replace(found, largest=_DISPLACED) if found.anywhere else found

    def _shift(
        self, stacks: list[list[Stack]], track: HypothesisFilter, moments: MeanAndCovariance, step: Array
    ) -> Generator[int, None, Array]:
        """Return how far the body (10,) moves where windows are linearised a step (s,) from the solution of a track."""
        try:
            point = self.layout.point(moments.mean + step, moments.deviation)
            passed = yield from self.over(stacks, point)
            (moved,) = yield from self.run(passed, (self.fresh(track.hypothesis, track.longest),))
            shift: Array = MeanAndCovariance.of(moved.belief, self.variables).mean - moments.mean
        except np.linalg.LinAlgError:
            shift = moments.deviation  # no robot that can be: it may be anywhere in its interval
        return shift[BODY]

    def run(self, passed: Relinearised, bank: Bank) -> Generator[int, None, Bank]:
        """Follow hypotheses over windows."""
        for window, white in passed.windows:
            bank = update_bank(bank, window, white, self.variables)
            for _ in bank:
                yield 1
        return bank
