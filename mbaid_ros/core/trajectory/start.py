"""The start of the filter: repeated passes over the first windows, from several guesses, until one point stays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.trajectory.chain import BODY, PARAMETERS, Point, window_models
from mbaid_ros.core.trajectory.filter import Coordinates, Walk, prepare
from mbaid_ros.core.trajectory.nodes import Window
from mbaid_ros.core.trajectory.tracks import MARGIN, Track, best, far_better, follow, levelled

_PASSES = 12
_SETTLED = 0.1  # standard deviations
# The guesses that the first passes are linearised at: balls of part of the known bodies' mass and size, at rest.
_GUESSED_MASSES, _GUESSED_RADIUS = (0.1, 0.3, 1.0), 0.25
_CERTAIN = 0.15  # relative standard deviation of the mass, below which a start counts
_APART = 3.0  # standard deviations, from which two starts have come to different points
# Chance of a start as surprising as that, from which another one is tried.
_UNLIKELY = 0.01
_MASS = BODY.start - PARAMETERS.start


@dataclass(frozen=True)
class _Result:
    """What repeated passes have led to.

    Attributes
    ----------
    point : where to linearise
    track : the hypothesis that was followed, in the last pass
    settled : whether that pass moved it by next to nothing
    """

    point: Point
    track: Track
    settled: bool

    @property
    def sound(self) -> bool:
        """Whether the result also explains the windows."""
        belief = self.track.belief
        return self.settled and belief.surprise < chi_square.limit(_UNLIKELY, belief.measured)

    @property
    def merit(self) -> tuple[bool, float]:
        """What results are compared by."""
        return self.settled, self.track.belief.evidence


@dataclass(frozen=True)
class Start:
    """Passes over windows that are all linearised at one point.

    Attributes
    ----------
    kernel : MomentumKernel
    variables : Coordinates
    uncertain : indices of the known bodies whose errors are among the variables
    walks : the hypotheses; the first is the one to beat
    """

    kernel: MomentumKernel
    variables: Coordinates
    uncertain: tuple[int, ...]
    walks: tuple[Walk, ...]

    def settle(self, windows: Sequence[Window], point: Point | None) -> tuple[tuple[Track, ...], Point, bool]:
        """Linearise windows ever nearer to what they say, from a point; from the guesses where that leads nowhere.

        Parameters
        ----------
        windows : in order
        point : found earlier; None where there is none

        Returns
        -------
        tracks of all hypotheses, the point at which they are linearised, and whether that is one that stays
        """
        first = self.walks[0]
        results = [] if point is None or _massless(point.parameters) else [self._repeat(windows, point, first)]
        if not results or not results[0].sound:
            results += [self._repeat(windows, guess, first) for guess in self._guesses()]
        result = max(results, key=lambda each: each.merit)
        settled = self._certain(result) and not any(self._rivals(result, other) for other in results)
        tracks = self._pass(windows, result.point, self.walks)
        leading = best(tracks)
        if leading.walk is first:
            return tracks, result.point, settled
        # At another hypothesis's own solution it must still be the better one; else its lead was the linearisation's.
        other = self._repeat(windows, result.point, leading.walk)
        if self._certain(other) and far_better(other.track, result.track):
            return self._pass(windows, other.point, self.walks), other.point, True
        return levelled(tracks), result.point, settled

    def _repeat(self, windows: Sequence[Window], point: Point, walk: Walk) -> _Result:
        """Pass over the windows until they move the point no more, at most a dozen times."""
        for _ in range(_PASSES):
            (track,) = self._pass(windows, point, (walk,))
            mean, covariance = self.variables.state(track.belief)
            step = mean[PARAMETERS] - point.parameters
            while _massless(point.parameters + step):
                step = 0.5 * step
            point = replace(Point.of(mean), parameters=point.parameters + step)
            if np.all(np.abs(step) < _SETTLED * np.sqrt(np.diag(covariance)[PARAMETERS])):
                return _Result(point, track, settled=True)
        return _Result(point, track, settled=False)

    def _pass(self, windows: Sequence[Window], point: Point, walks: tuple[Walk, ...]) -> tuple[Track, ...]:
        tracks = tuple(Track(walk, self.variables.open(force=walk.force != 'none')) for walk in walks)
        for window, model in zip(windows, window_models(self.kernel, windows, point, self.uncertain), strict=True):
            step = prepare(model, self.variables)
            tracks = tuple(follow(track, window, step, self.variables) for track in tracks)
        return tracks

    def _certain(self, result: _Result) -> bool:
        """Tell whether a result has settled, on a mass far enough from zero for what is linear to be near the truth."""
        mean, covariance = self.variables.state(result.track.belief)
        mass = BODY.start
        return result.settled and bool(np.sqrt(covariance[mass, mass]) < _CERTAIN * mean[mass])

    def _rivals(self, result: _Result, other: _Result) -> bool:
        """Tell whether another result is at quite another point that explains the windows about as well."""
        covariance = self.variables.state(result.track.belief)[1]
        apart = np.abs(other.point.parameters - result.point.parameters) > _APART * np.sqrt(
            np.diag(covariance)[PARAMETERS]
        )
        as_good = other.track.belief.evidence > result.track.belief.evidence - MARGIN
        return as_good and bool(np.any(apart))

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
