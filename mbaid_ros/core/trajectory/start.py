"""The start of the filter: repeated passes over the first windows, from several guesses, until one point stays."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.trajectory.chain import BODY, PARAMETERS, Point
from mbaid_ros.core.trajectory.filter import Coordinates, Step, Walk
from mbaid_ros.core.trajectory.linearised import Linearised
from mbaid_ros.core.trajectory.tracks import MARGIN, Track, best, far_better, follow, levelled
from mbaid_ros.core.trajectory.windows import Stack, Window, stacked

_PASSES = 12
_SETTLED = 0.1  # standard deviations
# The guesses that the first passes are linearised at: balls of part of the known bodies' mass and size, at rest. The
# size is that of at most so many links: an unknown body is not the larger, the more joints lead to it.
_GUESSED_MASSES, _GUESSED_RADIUS, _LINKS = (0.1, 0.3, 1.0), 0.25, 7
_SAME = 1.0  # standard deviations, below which a guess has led to a result that is known
_CERTAIN = 0.15  # relative standard deviation of the mass, below which a start counts
_APART = 3.0  # standard deviations, from which two starts have come to different points
# Chance of a start as surprising as that, from which another one is tried.
_UNLIKELY = 0.01
_MASS = BODY.start - PARAMETERS.start
_PART = 10  # windows passed over at a time
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

    tracks: tuple[Track, ...]
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
    """

    point: Point
    passed: _Pass
    track: Track
    deviation: Array
    settled: bool

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
        """What results are compared by."""
        return self.settled, self.track.belief.evidence

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
        first, *others = self.walks
        count = len(windows)
        stacks = [stacked(windows[k : min(k + _PART, count)]) for k in range(0, count, _PART)]
        results = yield from self._from([] if point is None else [point], stacks)
        if not any(result.sound for result in results):
            results += yield from self._from(self._guesses(), stacks)
        result = max(results, key=lambda each: each.merit)
        settled = result.certain and not any(result.rivals(other) for other in results)
        passed, tracks = result.passed, [result.track]
        for walk in others:
            track = yield from self._follow(passed, self._fresh(walk))
            tracks.append(track)
        leading = best(tracks).walk
        if leading is not first:
            # At its own solution another hypothesis must still be the better one; else its lead was the
            # linearisation's.
            other = yield from self._repeat(stacks, result.point, leading)
            if other.certain and far_better(other.track, result.track):
                passed, settled = other.passed, True
                for place, walk in enumerate(self.walks):
                    tracks[place] = yield from self._follow(passed, self._fresh(walk))
            else:
                tracks = levelled(tracks)
        while count < len(windows):
            more = windows[count : count + _PART]
            passed = yield from self._pass([stacked(more)], passed.point)
            count += len(more)
            for place, track in enumerate(tracks):
                tracks[place] = yield from self._follow(passed, track)
        yield Found(tuple(tracks), passed.point, settled)

    def _from(self, points: Sequence[Point], stacks: list[list[Stack]]) -> Generator[int, None, list[_Result]]:
        """Return what points lead to, each result once."""
        results: list[_Result] = []
        for point in points:
            if _massless(point.parameters):
                continue
            known = [result for result in results if result.certain]
            result = yield from self._repeat(stacks, point, self.walks[0], known)
            if result not in known:
                results.append(result)
        return results

    def _repeat(
        self, stacks: list[list[Stack]], point: Point, walk: Walk, known: Sequence[_Result] = ()
    ) -> Generator[int, None, _Result]:
        """Pass over the windows until they move the point no more, at most a dozen times, or to a known result."""
        for _ in range(_PASSES):
            passed = yield from self._pass(stacks, point)
            track = yield from self._follow(passed, self._fresh(walk))
            mean, every_deviation = self.variables.moments(track.belief)
            deviation = every_deviation[PARAMETERS]
            step = mean[PARAMETERS] - point.parameters
            while _massless(point.parameters + step):
                step = 0.5 * step
            point = replace(Point.of(mean), parameters=point.parameters + step)
            for result in known:
                if result.near(point, _SAME):
                    return result
            if np.all(np.abs(step) < _SETTLED * deviation):
                return _Result(point, passed, track, deviation, settled=True)
        return _Result(point, passed, track, deviation, settled=False)

    def _pass(self, stacks: list[list[Stack]], point: Point) -> Generator[int, None, _Pass]:
        """Linearise all windows at one point."""
        steps: list[tuple[Window, Step]] = []
        for part in stacks:
            more = self.linearised.steps(part, point)
            yield _LINEARISED * len(more)
            steps += more
        return _Pass(point, steps)

    def _fresh(self, walk: Walk) -> Track:
        """Return a hypothesis before the first window."""
        return Track(walk, self.variables.open(force=walk.force != 'none'))

    def _follow(self, passed: _Pass, track: Track) -> Generator[int, None, Track]:
        """Follow a hypothesis over windows."""
        for window, step in passed.steps:
            track = follow(track, window, step, self.variables)
            yield 1
        return track

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
