"""The start of the filter: repeated passes over the first windows, from several guesses, until one point stays."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.consistency import is_physical, project
from mbaid_ros.core.robot.scale import unknown_scale
from mbaid_ros.core.trajectory.bank import (
    LONGEST,
    LONGEST_AT_A_GUESS,
    MARGIN,
    Bank,
    Track,
    best,
    clamped,
    far_better,
    follow,
)
from mbaid_ros.core.trajectory.belief import Belief, Moments
from mbaid_ros.core.trajectory.linearisation_cache import LinearisationCache
from mbaid_ros.core.trajectory.state import ANGULAR, BODY, LINEAR, Layout, Point, near_part
from mbaid_ros.core.trajectory.turning import angular_momentum
from mbaid_ros.core.trajectory.variables import Variables
from mbaid_ros.core.trajectory.whitened import WhitenedWindow
from mbaid_ros.core.trajectory.windows import Stack, Window, stacked
from mbaid_ros.core.unknowns.hypotheses import Hypothesis

_PASSES = 12
# Where the innovations squared are so many times what they should be in the mean, and as many passes in a row have not
# made them less, no further one will.
HOPELESS, _IDLE = 10.0, 3
_SETTLED = 0.1  # standard deviations
# The guesses that the first passes are linearised at: balls of part of the known bodies' mass and size, at rest. The
# size is that of at most so many links: an unknown body is not the larger, the more joints lead to it.
_GUESSED_MASSES, _GUESSED_RADIUS, _LINKS = (0.1, 0.3, 1.0), 0.25, 7
_CERTAIN = 0.15  # relative standard deviation of the mass, below which a start counts
_APART = 3.0  # standard deviations, from which two starts have come to different points
# Chance of a start as surprising as that, from which another one is tried.
_UNLIKELY = 0.01
_MASS = BODY.start - LINEAR.start
_BODY_PLACES = np.arange(BODY.start, BODY.stop)
_PLAIN = 1.0  # standard deviations that the noise of the rows may move a result by
_STACK = 10  # windows linearised at a time: one piece of work
_LINEARISED = 5  # work of linearising a window, where that of one step of the filter is 1


@dataclass(frozen=True)
class Found:
    """What a search has come to.

    Attributes
    ----------
    bank : of all hypotheses
    point : at which they are linearised
    settled : whether that is one that stays
    """

    bank: Bank
    point: Point
    settled: bool


@dataclass(frozen=True, eq=False)
class _Result:
    """What repeated passes have led to.

    Attributes
    ----------
    point : the solution of the last pass
    passed : what that pass was over
    track : the hypothesis that was followed in it
    moments : of its belief
    deviation : standard deviations of the parameters
    settled : whether that pass moved them by next to nothing
    held : whether its mass was held
    """

    point: Point
    passed: _Pass
    track: Track
    moments: Moments
    deviation: Array
    settled: bool
    held: bool

    @property
    def sound(self) -> bool:
        """Whether the result also explains the windows."""
        belief = self.track.belief
        return self.settled and belief.nis < chi_square.limit(_UNLIKELY, belief.measured)

    @property
    def certain(self) -> bool:
        """Whether it has settled, on a mass far enough from zero for what is linear to be near the truth."""
        return self.settled and bool(self.deviation[_MASS] < _CERTAIN * self.point.parameters[_MASS])

    @property
    def merit(self) -> tuple[bool, float]:
        """What results are compared by: where they have not settled, the windows are not what they say they are."""
        return not self.held, self.track.belief.log_likelihood - (0.0 if self.settled else MARGIN)

    def near(self, point: Point, deviations: float) -> bool:
        """Tell whether a point is less than some standard deviations away in all parameters."""
        return bool(np.all(np.abs(point.parameters - self.point.parameters) <= deviations * self.deviation))

    def rivals(self, other: _Result) -> bool:
        """Tell whether another result is at quite another point that explains the windows about as well."""
        as_good = other.track.belief.log_likelihood > self.track.belief.log_likelihood - MARGIN
        return as_good and not self.near(other.point, _APART)


@dataclass(frozen=True)
class _Pass:
    """Windows in order, each as it is and linearised, all at one point."""

    point: Point
    windows: list[tuple[Window, WhitenedWindow]]


# What is done bit by bit: it yields how much work each bit was, in steps of the filter, and at last what it has found.
Search = Iterator[int | Found]


@dataclass(frozen=True)
class MultiStart:
    """Passes over windows that are all linearised at one point.

    Attributes
    ----------
    layout : of the state
    variables : of the filter
    linearised : linearises windows
    hypotheses : the first is the one to beat
    """

    layout: Layout
    variables: Variables
    linearised: LinearisationCache
    hypotheses: tuple[Hypothesis, ...]

    def search(self, windows: list[Window], points: Sequence[Callable[[], Point | None]]) -> Search:
        """Linearise windows ever nearer to what they say, from a point; from the guesses where that leads nowhere.

        Parameters
        ----------
        windows : in order; those that are added while the search goes on are only followed
        points : make what has been found earlier, or None; each is asked only where the one before leads nowhere
        """
        count = len(windows)
        stacks = [stacked(windows[k : min(k + _STACK, count)]) for k in range(0, count, _STACK)]
        results: list[_Result] = []
        sound = other_leads = False
        for begin in points:
            point = begin()
            if point is None or _massless(point.parameters):
                continue
            found = yield from self._repeat(stacks, point, self._fresh(self.hypotheses[0]))
            if found is not None:
                results, sound = [*results, found], found.sound
                passed, bank, other_leads = yield from self._hypotheses(stacks, found)
            if sound or other_leads:
                break
        if not (sound or other_leads):
            results += yield from self._from_guesses(stacks)
            if not results:
                raise np.linalg.LinAlgError('no start leads to a robot that can be')
            passed, bank, other_leads = yield from self._hypotheses(stacks, max(results, key=lambda each: each.merit))
        result = max(results, key=lambda each: each.merit)
        settled = other_leads or (result.certain and not any(result.rivals(other) for other in results))
        while count < len(windows):
            more = windows[count : count + _STACK]
            passed = yield from self._pass([stacked(more)], passed.point)
            count += len(more)
            bank = yield from self._follow(passed, bank)
        yield Found(bank, passed.point, settled)

    def _from_guesses(self, stacks: list[list[Stack]]) -> Generator[int, None, list[_Result]]:
        """Return what the windows lead to with the guessed masses, and from the best of these with any mass.

        Where noise is in the rows as much as motion is, one point may stay, with narrow intervals, although bodies of
        quite another mass explain the windows as well: those tell.
        """
        held: list[_Result] = []
        for guess in self._guesses([window for stack in stacks[0] for window in stack.windows]):
            fresh = self._fresh(self.hypotheses[0], LONGEST_AT_A_GUESS, float(guess.parameters[_MASS]))
            result = yield from self._repeat(stacks, guess, fresh, held=True)
            held += [] if result is None else [result]
        free: list[_Result] = []
        for start in sorted(held, key=lambda each: each.merit, reverse=True):
            fresh = self._fresh(self.hypotheses[0], LONGEST_AT_A_GUESS)
            result = yield from self._repeat(stacks, start.point, fresh)
            free += [] if result is None else [result]
            if result is not None and result.certain:
                break
        return free + held

    def _hypotheses(self, stacks: list[list[Stack]], result: _Result) -> Generator[int, None, tuple[_Pass, Bank, bool]]:
        """Return the windows as linearised for the hypothesis to lead, all hypotheses, and whether it is not the first.

        At its own solution another hypothesis must explain the windows and still be the better one; else its lead was
        the linearisation's. And where the first explains the windows too, what the other gains must not come from noise
        in its rows.
        """
        first, *others = self.hypotheses
        passed, longest = result.passed, result.track.longest
        bank: Bank = (result.track,)
        if others:
            beside = yield from self._follow(passed, tuple(self._fresh(each, longest) for each in others))
            bank = (result.track, *beside)
        leading = best(bank).hypothesis
        if leading is first:
            return passed, bank, False
        other = yield from self._repeat(stacks, result.point, self._fresh(leading, longest))
        if other is None:
            return passed, clamped(bank), False
        needed = not result.sound or self._plain(other)
        if not (needed and other.certain and other.sound and far_better(other.track, result.track)):
            return passed, clamped(bank), False
        bank = yield from self._follow(other.passed, tuple(self._fresh(each, longest) for each in self.hypotheses))
        return other.passed, bank, True

    def _repeat(
        self, stacks: list[list[Stack]], point: Point, fresh: Track, *, held: bool = False
    ) -> Generator[int, None, _Result | None]:
        """Pass over the windows until they move the point no more, at most a dozen times; None where none can be made.

        Parameters
        ----------
        stacks : of the windows
        point : to begin at
        fresh : a hypothesis before the first window
        held : whether its mass is held
        """
        result: _Result | None = None
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
        self, stacks: list[list[Stack]], point: Point, fresh: Track, *, held: bool
    ) -> Generator[int, None, _Result]:
        """Pass over the windows once."""
        passed = yield from self._pass(stacks, point)
        (track,) = yield from self._follow(passed, (fresh,))
        moments = Moments.of(track.belief, self.variables)
        deviation = moments.deviation[self.layout.parameters]
        state = self._real(moments)
        step: Array = state[self.layout.parameters] - point.parameters
        step *= near_part(point.parameters, step)
        state[self.layout.parameters] = point.parameters + step
        settled = bool(np.all(np.abs(step) < _SETTLED * deviation))
        after = self.layout.point(state, moments.deviation)
        return _Result(after, passed, track, moments, deviation, settled=settled, held=held)

    def _real(self, moments: Moments) -> Array:
        """Return the likeliest state (s,) whose body can exist; in a plane, which leaves most of it open, the mean."""
        body = moments.mean[BODY]
        if self.layout.plane is not None or is_physical(body):
            return moments.mean.copy()
        scale = unknown_scale(self.layout.kernel)[:10]
        nearest, _ = project(body, moments.covariance(_BODY_PLACES), scale)
        # What else is uncertain follows the body, as far as it is correlated.
        own = moments.factor[BODY] / scale[:, None]
        return np.asarray(moments.mean + moments.factor @ np.linalg.lstsq(own, (nearest - body) / scale)[0])

    def _pass(self, stacks: list[list[Stack]], point: Point) -> Generator[int, None, _Pass]:
        """Linearise all windows at one point."""
        windows: list[tuple[Window, WhitenedWindow]] = []
        for part in stacks:
            more = self.linearised.all_whitened(part, point)
            yield _LINEARISED * len(more)
            windows += more
        return _Pass(point, windows)

    def _plain(self, result: _Result) -> bool:
        """Tell whether the noise of the rows hardly matters; else, that less is left says little."""
        shift = np.abs(result.moments.shift[self.layout.parameters])
        return bool(np.all(shift <= _PLAIN * result.deviation))

    def _fresh(self, hypothesis: Hypothesis, longest: int = LONGEST, mass: float | None = None) -> Track:
        """Return a hypothesis before the first window, of any mass or near one, whose jumps may take some windows."""
        extra = self.variables.force.shape[1] if hypothesis.force != 'none' else 0
        return Track(hypothesis, Belief.prior(self.variables, extra, mass), longest=longest)

    def _follow(self, passed: _Pass, bank: Bank) -> Generator[int, None, Bank]:
        """Follow hypotheses over windows."""
        for window, white in passed.windows:
            bank = follow(bank, window, white, self.variables)
            for _ in bank:
                yield 1
        return bank

    def _guesses(self, windows: Sequence[Window]) -> list[Point]:
        """Return the parameters of balls: of the mass that is declared, or of parts of the known mass.

        At rest; where a gyro alone tells the motion in some windows, in a robot that turns as it says.
        """
        kernel = self.layout.kernel
        declared = float(self.variables.mean[BODY.start])
        parts = [part * float(np.sum(kernel.known[:, 0])) for part in _GUESSED_MASSES]
        lengths = np.linalg.norm(kernel.model.positions, axis=1)
        length = float(np.sum(lengths)) * min(1.0, _LINKS / max(len(lengths), 1))
        guesses: list[Point] = []
        for mass in [declared] if declared > 0.0 else parts:
            state = np.concatenate((np.zeros(BODY.stop), self.layout.known.mean))
            state[BODY.start] = mass
            state[[BODY.start + 4, BODY.start + 7, BODY.start + 9]] = mass * (_GUESSED_RADIUS * max(length, 0.1)) ** 2
            state[ANGULAR] = angular_momentum(kernel, state[BODY], windows)
            guesses.append(self.layout.point(state))
        return guesses


def _massless(parameters: Array) -> bool:
    return bool(parameters[_MASS] <= 0.0)
