"""The start of the filter: repeated passes over the first windows, from several guesses, until one point stays."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.trajectory.belief import Coordinates
from mbaid_ros.core.trajectory.chain import BODY, PARAMETERS, Point
from mbaid_ros.core.trajectory.filter import Walk
from mbaid_ros.core.trajectory.linearised import Linearised
from mbaid_ros.core.trajectory.steps import Step
from mbaid_ros.core.trajectory.tracks import MARGIN, Track, Tracks, far_better, follow, levelled
from mbaid_ros.core.trajectory.windows import Stack, Window, stacked

_PASSES = 12
_SETTLED = 0.1  # standard deviations
# The guesses that the first passes are linearised at: balls of part of the known bodies' mass and size, at rest. The
# size is that of at most so many links: an unknown body is not the larger, the more joints lead to it.
_GUESSED_MASSES, _GUESSED_RADIUS, _LINKS = (0.1, 0.3, 1.0), 0.25, 7
_CERTAIN = 0.15  # relative standard deviation of the mass, below which a start counts
_APART = 3.0  # standard deviations, from which two starts have come to different points
# Chance of a start as surprising as that, from which another one is tried.
_UNLIKELY = 0.01
_MASS = BODY.start - PARAMETERS.start
_PLAIN = 1.0  # standard deviations that the noise of the rows may move a result by
_PART = 10  # windows whose linearisation counts as one piece of work
_STACK = 30  # windows linearised at a time: one numpy call costs much the same for thirty as for ten
_LINEARISED = 5  # work of linearising a window, where that of one step of the filter is 1


@dataclass(frozen=True)
class Found:
    """What a search has come to.

    Attributes
    ----------
    tracks : of all hypotheses
    point : at which they are linearised
    settled : whether that is one that stays
    """

    tracks: Tracks
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
    deviation : standard deviations of the parameters
    settled : whether that pass moved them by next to nothing
    held : whether its mass was held
    """

    point: Point
    passed: _Pass
    track: Track
    deviation: Array
    settled: bool
    held: bool

    @property
    def sound(self) -> bool:
        """Whether the result also explains the windows."""
        belief = self.track.belief
        return self.settled and belief.surprise < chi_square.limit(_UNLIKELY, belief.measured)

    @property
    def certain(self) -> bool:
        """Whether it has settled, on a mass far enough from zero for what is linear to be near the truth."""
        return self.settled and bool(self.deviation[_MASS] < _CERTAIN * self.point.parameters[_MASS])

    @property
    def merit(self) -> tuple[bool, float]:
        """What results are compared by: where they have not settled, the windows are not what they say they are."""
        return not self.held, self.track.belief.evidence - (0.0 if self.settled else MARGIN)

    def near(self, point: Point, deviations: float) -> bool:
        """Tell whether a point is less than some standard deviations away in all parameters."""
        return bool(np.all(np.abs(point.parameters - self.point.parameters) <= deviations * self.deviation))

    def rivals(self, other: _Result) -> bool:
        """Tell whether another result is at quite another point that explains the windows about as well."""
        as_good = other.track.belief.evidence > self.track.belief.evidence - MARGIN
        return as_good and not self.near(other.point, _APART)


@dataclass(frozen=True)
class _Pass:
    """Windows in order with their steps, all linearised at one point."""

    point: Point
    steps: list[tuple[Window, Step]]


# What is done bit by bit: it yields how much work each bit was, in steps of the filter, and at last what it has found.
Search = Iterator[int | Found]


@dataclass(frozen=True)
class Start:
    """Passes over windows that are all linearised at one point.

    Attributes
    ----------
    kernel : MomentumKernel
    variables : Coordinates
    linearised : makes the steps of the filter
    walks : the hypotheses; the first is the one to beat
    """

    kernel: MomentumKernel
    variables: Coordinates
    linearised: Linearised
    walks: tuple[Walk, ...]

    def search(self, windows: list[Window], point: Point | None) -> Search:
        """Linearise windows ever nearer to what they say, from a point; from the guesses where that leads nowhere.

        Parameters
        ----------
        windows : in order; those that are added while the search goes on are only followed
        point : found earlier; None where there is none
        """
        count = len(windows)
        stacks = [stacked(windows[k : min(k + _STACK, count)]) for k in range(0, count, _STACK)]
        results: list[_Result] = []
        sound = other_leads = False
        if point is not None and not _massless(point.parameters):
            result = yield from self._repeat(stacks, point, self.walks[0])
            results, sound = [result], result.sound
            passed, tracks, other_leads = yield from self._hypotheses(stacks, result)
        if not (sound or other_leads):
            results += yield from self._from_guesses(stacks)
            result = max(results, key=lambda each: each.merit)
            passed, tracks, other_leads = yield from self._hypotheses(stacks, result)
        settled = other_leads or (result.certain and not any(result.rivals(other) for other in results))
        while count < len(windows):
            more = windows[count : count + _PART]
            passed = yield from self._pass([stacked(more)], passed.point)
            count += len(more)
            tracks = yield from self._follow(passed, tracks)
        yield Found(tracks, passed.point, settled)

    def _from_guesses(self, stacks: list[list[Stack]]) -> Generator[int, None, list[_Result]]:
        """Return what the windows lead to with the guessed masses, and from the best of these with any mass.

        Where noise is in the rows as much as motion is, one point may stay, with narrow intervals, although bodies of
        quite another mass explain the windows as well: those tell.
        """
        held: list[_Result] = []
        for guess in self._guesses():
            result = yield from self._repeat(stacks, guess, self.walks[0], held=True)
            held.append(result)
        free: list[_Result] = []
        for start in sorted(held, key=lambda each: each.merit, reverse=True):
            result = yield from self._repeat(stacks, start.point, self.walks[0])
            free.append(result)
            if result.certain:
                break
        return free + held

    def _hypotheses(
        self, stacks: list[list[Stack]], result: _Result
    ) -> Generator[int, None, tuple[_Pass, Tracks, bool]]:
        """Return the windows as linearised for the hypothesis to lead, all hypotheses, and whether it is not the first.

        At its own solution another hypothesis must explain the windows and still be the better one; else its lead was
        the linearisation's. And where the first explains the windows too, what the other gains must not come from noise
        in its rows.
        """
        first, *others = self.walks
        passed, tracks = result.passed, Tracks.of([result.track])
        if others:
            beside = yield from self._follow(passed, Tracks.of([self._fresh(walk) for walk in others]))
            tracks = Tracks.of([result.track, *beside])
        leading = tracks.best.walk
        if leading is first:
            return passed, tracks, False
        other = yield from self._repeat(stacks, result.point, leading)
        needed = not result.sound or self._plain(other)
        if not (needed and other.certain and other.sound and far_better(other.track, result.track)):
            return passed, levelled(tracks), False
        tracks = yield from self._follow(other.passed, Tracks.of([self._fresh(walk) for walk in self.walks]))
        return other.passed, tracks, True

    def _repeat(
        self, stacks: list[list[Stack]], point: Point, walk: Walk, *, held: bool = False
    ) -> Generator[int, None, _Result]:
        """Pass over the windows until they move the point no more, at most a dozen times; near its mass, if held."""
        mass = float(point.parameters[_MASS]) if held else None
        for _ in range(_PASSES):
            passed = yield from self._pass(stacks, point)
            (track,) = yield from self._follow(passed, Tracks.of([self._fresh(walk, mass)]))
            mean, every_deviation = self.variables.moments(track.belief)
            deviation = every_deviation[PARAMETERS]
            step = mean[PARAMETERS] - point.parameters
            while _massless(point.parameters + step):
                step = 0.5 * step
            point = replace(Point.of(mean, every_deviation), parameters=point.parameters + step)
            if np.all(np.abs(step) < _SETTLED * deviation):
                return _Result(point, passed, track, deviation, settled=True, held=held)
        return _Result(point, passed, track, deviation, settled=False, held=held)

    def _pass(self, stacks: list[list[Stack]], point: Point) -> Generator[int, None, _Pass]:
        """Linearise all windows at one point."""
        steps: list[tuple[Window, Step]] = []
        for part in stacks:
            more = self.linearised.steps(part, point)
            for begin in range(0, len(more), _PART):
                yield _LINEARISED * len(more[begin : begin + _PART])
            steps += more
        return _Pass(point, steps)

    def _plain(self, result: _Result) -> bool:
        """Tell whether the noise of the rows hardly matters; else, that less is left says little."""
        shift = np.abs(self.variables.spread @ result.track.belief.shift)[PARAMETERS]
        return bool(np.all(shift <= _PLAIN * result.deviation))

    def _fresh(self, walk: Walk, mass: float | None = None) -> Track:
        """Return a hypothesis before the first window, of any mass or near one."""
        return Track(walk, self.variables.open(force=walk.force != 'none', mass=mass))

    def _follow(self, passed: _Pass, tracks: Tracks) -> Generator[int, None, Tracks]:
        """Follow hypotheses over windows."""
        for window, step in passed.steps:
            tracks = follow(tracks, window, step, self.variables)
            for _ in range(len(tracks)):
                yield 1
        return tracks

    def _guesses(self) -> list[Point]:
        """Return the parameters of balls of some parts of the known mass, without momentum."""
        known = self.kernel.known
        lengths = np.linalg.norm(self.kernel.model.positions, axis=1)
        length = float(np.sum(lengths)) * min(1.0, _LINKS / max(len(lengths), 1))
        guesses: list[Point] = []
        for part in _GUESSED_MASSES:
            mass = part * float(np.sum(known[:, 0]))
            point = np.zeros(len(self.variables.basis))
            point[BODY.start] = mass
            point[[BODY.start + 4, BODY.start + 7, BODY.start + 9]] = mass * (_GUESSED_RADIUS * max(length, 0.1)) ** 2
            guesses.append(Point(point[PARAMETERS]))
        return guesses


def _massless(parameters: Array) -> bool:
    return bool(parameters[_MASS] <= 0.0)
