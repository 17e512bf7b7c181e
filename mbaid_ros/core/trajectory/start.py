"""The start of the filter: repeated passes over the first windows, from several guesses, until one point stays."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.trajectory.chain import BODY, PARAMETERS, Point
from mbaid_ros.core.trajectory.filter import Coordinates, Walk
from mbaid_ros.core.trajectory.linearised import Linearised
from mbaid_ros.core.trajectory.tracks import MARGIN, Track, best, far_better, follow, levelled
from mbaid_ros.core.trajectory.windows import Stack, Window, stacked

_PASSES = 12
_SETTLED = 0.1  # standard deviations
_SAME = 1.0  # standard deviations, below which a guess has led to a result that is known
# The guesses that the first passes are linearised at: balls of part of the known bodies' mass and size, at rest. The
# third lies between the first two, and is of use where these lead apart.
_GUESSED_MASSES, _GUESSED_RADIUS = (0.1, 1.0, 0.3), 0.25
_CERTAIN = 0.15  # relative standard deviation of the mass, below which a start counts
_APART = 3.0  # standard deviations, from which two starts have come to different points
# Chance of a start as surprising as that, from which another one is tried.
_UNLIKELY = 0.01
_MASS = BODY.start - PARAMETERS.start
_PART = 10  # windows passed over at a time
_LINEARISED = 2  # work of linearising a window, where that of one step of the filter is 1


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
    point : where to linearise
    track : the hypothesis that was followed, in the last pass
    deviation : standard deviations of the parameters
    settled : whether that pass moved them by next to nothing
    """

    point: Point
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


# What is done bit by bit: it yields how much work each bit was, in steps of the filter.
Search = Generator[int, None, Found]


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

    def search(self, windows: Sequence[Window], point: Point | None) -> Search:
        """Linearise windows ever nearer to what they say, from a point; from the guesses where that leads nowhere.

        Parameters
        ----------
        windows : in order
        point : found earlier; None where there is none
        """
        first = self.walks[0]
        parts = [windows[k : k + _PART] for k in range(0, len(windows), _PART)]
        stacks = [stacked(part) for part in parts]
        results: list[_Result] = []
        if point is not None and not _massless(point.parameters):
            results.append((yield from self._repeat(stacks, point, first)))
        if not results or not results[0].sound:
            results += yield from self._from_guesses(stacks)
        result = max(results, key=lambda each: each.merit)
        settled = result.certain and not any(result.rivals(other) for other in results)
        tracks = yield from self._pass(stacks, result.point, self.walks)
        leading = best(tracks)
        if leading.walk is first:
            return Found(tracks, result.point, settled)
        # At another hypothesis's own solution it must still be the better one; else its lead was the linearisation's.
        other = yield from self._repeat(stacks, result.point, leading.walk)
        if other.certain and far_better(other.track, result.track):
            tracks = yield from self._pass(stacks, other.point, self.walks)
            return Found(tracks, other.point, settled=True)
        return Found(levelled(tracks), result.point, settled)

    def _from_guesses(self, stacks: list[list[Stack]]) -> Generator[int, None, list[_Result]]:
        """Return what the guesses lead to, without the later ones once two have come to the same point."""
        results: list[_Result] = []
        for guess in self._guesses():
            known = [result for result in results if result.certain]
            result = yield from self._repeat(stacks, guess, self.walks[0], known)
            if result in known:
                break
            results.append(result)
        return results

    def _repeat(
        self, stacks: list[list[Stack]], point: Point, walk: Walk, known: Sequence[_Result] = ()
    ) -> Generator[int, None, _Result]:
        """Pass over the windows until they move the point no more, at most a dozen times, or to a known result."""
        for _ in range(_PASSES):
            (track,) = yield from self._pass(stacks, point, (walk,))
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
                return _Result(point, track, deviation, settled=True)
        return _Result(point, track, deviation, settled=False)

    def _pass(
        self, stacks: list[list[Stack]], point: Point, walks: tuple[Walk, ...]
    ) -> Generator[int, None, tuple[Track, ...]]:
        """Follow hypotheses over all windows, linearised at one point."""
        tracks = [Track(walk, self.variables.open(force=walk.force != 'none')) for walk in walks]
        for part in stacks:
            steps = self.linearised.steps(part, point)
            yield _LINEARISED * len(steps)
            for place, track in enumerate(tracks):
                for window, step in steps:
                    track = follow(track, window, step, self.variables)  # noqa: PLW2901
                tracks[place] = track
                yield len(steps)
        return tuple(tracks)

    def _guesses(self) -> list[Point]:
        """Return the parameters of balls of some parts of the known mass, without momentum."""
        known = self.kernel.known
        length = float(np.sum(np.linalg.norm(self.kernel.model.positions, axis=1)))
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
