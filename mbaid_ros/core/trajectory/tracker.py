"""The run of the filter: a start by repeated passes over the first windows, then one step a window."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.stats import chi2

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.trajectory.chain import ANGULAR, BODY, LINEAR, PARAMETERS, window_model, window_models
from mbaid_ros.core.trajectory.filter import (
    Belief,
    Coordinates,
    Step,
    Walk,
    advance,
    jolted,
    prepare,
    unlinked,
    update,
)
from mbaid_ros.core.trajectory.nodes import Window

_PASSES = 12
_SETTLED = 0.1  # standard deviations
_GROWTH = 1.5
# The guesses that the first passes are linearised at: balls of part of the known bodies' mass and size, at rest.
_GUESSED_MASSES, _GUESSED_RADIUS = (0.1, 0.3, 1.0), 0.25
_CERTAIN = 0.15  # relative standard deviation of the mass, below which a start counts
_RETRY = 2  # windows after which one that does not count is tried again
_APART = 3.0  # standard deviations, from which two starts have come to different points
# Mean normalised innovation squared from which the model is wrong rather than the run unlucky.
LARGEST_SURPRISE = 1.5
# Chance of a start as surprising as that, from which another one is tried.
_UNLIKELY = 0.01
_MOMENTUM = slice(LINEAR.start, ANGULAR.stop)
# Chance that an undisturbed window counts as a jump of the momentum.
_FALSE_ALARM = 1e-8
_JUMP = 0.01  # standard deviation of a jump, in typical sizes of the momentum
# How much better (log-likelihood) the data must be explained with a random walk than without.
_MARGIN = 10.0


@dataclass(frozen=True)
class Jump:
    """A jump of the momentum.

    Attributes
    ----------
    time : s since the first sample, start of the window in which it was noticed
    before : (6,) (P, L) until then, about the run's origin
    """

    time: float
    before: Array


@dataclass(frozen=True)
class Track:
    """One hypothesis: a random walk, the belief under it, and the jumps it has met."""

    walk: Walk
    belief: Belief
    jumps: tuple[Jump, ...] = ()
    just_jumped: bool = False


@dataclass(frozen=True)
class _Start:
    """What repeated passes over the first windows have led to.

    Attributes
    ----------
    point : (u,) parameters to linearise at
    track : the hypothesis that was followed, in the last pass
    settled : whether that pass moved them by next to nothing
    """

    point: Array
    track: Track
    settled: bool

    @property
    def sound(self) -> bool:
        """Whether the result also explains the windows."""
        belief = self.track.belief
        return self.settled and belief.surprise < float(chi2.isf(_UNLIKELY, belief.measured))


def _merit(start: _Start) -> tuple[bool, float]:
    return start.settled, start.track.belief.evidence


class Tracker:
    """Follows momentum, body and time offset through the windows, under several hypotheses of what drifts.

    The linear models are absolute, so each window may keep the linearisation point it was first seen at. While the run
    is young all windows are linearised again at the latest estimate, as often as it takes to settle.

    Attributes
    ----------
    planar : whether it takes the motion for planar
    settled : whether the latest passes over the young run have come to one point that stays

    Parameters
    ----------
    kernel : MomentumKernel
    variables : Coordinates
    uncertain : indices of the known bodies whose errors are among the variables
    walks : the hypotheses; the first is the one to beat
    start, kept : windows before the first estimate, and how many are linearised again while the run is young
    """

    def __init__(
        self,
        kernel: MomentumKernel,
        variables: Coordinates,
        uncertain: tuple[int, ...],
        walks: tuple[Walk, ...],
        pace: tuple[int, int],
    ) -> None:
        self._kernel = kernel
        self._variables = variables
        self._uncertain = uncertain
        self._walks = walks
        self._next_pass, self._kept = pace
        self._young: list[Window] | None = []
        self._tracks: tuple[Track, ...] = ()
        self._latest: tuple[Track, ...] = ()  # with the window that is still open
        self.planar = len(variables.measured) < 6
        self.settled = False

    @property
    def started(self) -> bool:
        """Whether there is a state."""
        return bool(self._latest)

    @property
    def best(self) -> Track:
        """The hypothesis to report: the first, unless another one explains the data far better."""
        return _best(self._latest)

    def state(self) -> tuple[Array, Array]:
        """Return mean (s,) and covariance (s, s) of the latest state under the best hypothesis."""
        return self._variables.state(self.best.belief)

    def open_variance(self) -> Array:
        """Return the (s,) variances of the state when nothing is known."""
        return self._variables.open_variance

    def add(self, window: Window) -> None:
        """Take the next window."""
        if self._young is not None:
            self._young.append(window)
            if len(self._young) >= self._next_pass:
                self._settle(self._young)
                self._next_pass = self._after(len(self._young))
                if self._next_pass > self._kept:
                    self._grow_up()
                return
        if self._tracks:
            self._tracks = self._step(self._tracks, window, self._point(self._tracks))

    def _grow_up(self) -> None:
        """Linearise no window again from now on; but while the start is unsound, begin anew with the later half."""
        belief = _best(self._tracks).belief
        if self._young is None or (self.settled and belief.surprise < LARGEST_SURPRISE * belief.measured):
            self._young = None
            return
        self._young = self._young[len(self._young) // 2 :]
        self._next_pass = self._after(len(self._young))

    def _after(self, windows: int) -> int:
        """Return at how many windows to pass over all of them again."""
        return int(np.ceil(_GROWTH * windows)) if self.settled else windows + _RETRY

    def preview(self, window: Window | None) -> None:
        """Take what a window without its later neighbours tells into the latest state, but not into the run."""
        self._latest = self._tracks
        if self._tracks and window is not None:
            self._latest = self._step((_best(self._tracks),), window, self._point(self._tracks))

    def _point(self, tracks: tuple[Track, ...]) -> Array:
        """Return the parameters to linearise at."""
        return self._variables.state(_best(tracks).belief)[0][PARAMETERS]

    def _settle(self, windows: list[Window]) -> None:
        """Pass over all windows again, linearised ever nearer to what they say; from the guesses where that is poor."""
        first, starts = self._walks[:1], []
        if self.settled and not self._massless(self._point(self._tracks)):
            starts = [self._repeat(windows, self._point(self._tracks), first)]
        if not starts or not starts[0].sound:
            starts += [self._repeat(windows, guess, first) for guess in self._guesses()]
        start = max(starts, key=_merit)
        self.settled = self._certain(start) and not any(self._rivals(start, other) for other in starts)
        self._tracks = self._pass(windows, start.point, self._walks)
        best = _best(self._tracks)
        if best.walk is self._walks[0]:
            return
        # At another hypothesis's own solution it must still be the better one; else its lead was the linearisation's.
        other = self._repeat(windows, start.point, (best.walk,))
        if self._certain(other) and _merit(other) > (start.settled, start.track.belief.evidence + _MARGIN):
            self.settled, self._tracks = True, self._pass(windows, other.point, self._walks)
        else:
            self._tracks = tuple(_levelled(track, self._tracks[0]) for track in self._tracks)

    def _certain(self, start: _Start) -> bool:
        """Tell whether a start has settled, on a mass far enough from zero for what is linear to be near the truth."""
        mean, covariance = self._variables.state(start.track.belief)
        mass = BODY.start
        return start.settled and bool(np.sqrt(covariance[mass, mass]) < _CERTAIN * mean[mass])

    def _rivals(self, start: _Start, other: _Start) -> bool:
        """Tell whether another start has come to quite another point that explains the windows about as well."""
        covariance = self._variables.state(start.track.belief)[1]
        apart = np.abs(other.point - start.point) > _APART * np.sqrt(np.diag(covariance)[PARAMETERS])
        as_good = other.track.belief.evidence > start.track.belief.evidence - _MARGIN
        return as_good and bool(np.any(apart))

    def _repeat(self, windows: list[Window], point: Array, walks: tuple[Walk, ...]) -> _Start:
        """Pass over the windows until the first hypothesis moves no more, at most a dozen times."""
        for _ in range(_PASSES):
            track = self._pass(windows, point, walks)[0]
            mean, covariance = self._variables.state(track.belief)
            step = mean[PARAMETERS] - point
            while self._massless(point + step):
                step = 0.5 * step
            point = point + step
            if np.all(np.abs(step) < _SETTLED * np.sqrt(np.diag(covariance)[PARAMETERS])):
                return _Start(point, track, settled=True)
        return _Start(point, track, settled=False)

    def _pass(self, windows: list[Window], point: Array, walks: tuple[Walk, ...]) -> tuple[Track, ...]:
        tracks = tuple(Track(walk, self._variables.open(force=walk.force != 'none')) for walk in walks)
        for window, model in zip(windows, window_models(self._kernel, windows, point, self._uncertain), strict=True):
            step = prepare(model, self._variables)
            tracks = tuple(self._follow(track, window, step) for track in tracks)
        return tracks

    @staticmethod
    def _massless(point: Array) -> bool:
        return bool(point[BODY.start - PARAMETERS.start] <= 0.0)

    def _step(self, tracks: tuple[Track, ...], window: Window, point: Array) -> tuple[Track, ...]:
        step = prepare(window_model(self._kernel, window, point, self._uncertain), self._variables)
        return tuple(self._follow(track, window, step) for track in tracks)

    def _follow(self, track: Track, window: Window, step: Step) -> Track:
        """Return a track after a window; a momentum that must have jumped is let jump, once."""
        variables = self._variables
        before = unlinked(track.belief, variables) if window.fresh else track.belief
        belief = update(before, step)
        jumps, jumped = track.jumps, False
        if _surprised(belief) and not track.just_jumped and belief.measured > belief.last_measured:
            # A jump counts against a hypothesis as much as it is rare, and explains its window as well as usual.
            evidence = belief.evidence + 0.5 * (belief.last_surprise - belief.last_measured) + np.log(_FALSE_ALARM)
            sizes = _JUMP * np.sqrt(variables.open_variance[_MOMENTUM])
            belief = update(jolted(before, step, variables, sizes), step)
            if _surprised(belief):
                # More than a jump: nothing links this window to the ones before.
                belief = update(unlinked(jolted(before, step, variables, sizes), variables), step)
            belief = replace(belief, evidence=float(evidence))
            jumps, jumped = (*jumps, Jump(window.start, variables.spread[_MOMENTUM] @ before.mean)), True
        belief = advance(belief, step, variables, track.walk)
        return Track(track.walk, belief, jumps, just_jumped=jumped)

    def _guesses(self) -> list[Array]:
        """Return the parameters of balls of some parts of the known mass, without momentum."""
        known = self._kernel.known
        length = float(np.sum(np.linalg.norm(self._kernel.model.positions, axis=1)))
        guesses: list[Array] = []
        for part in _GUESSED_MASSES:
            mass = part * float(np.sum(known[:, 0]))
            point = np.zeros(len(self._variables.basis))
            point[BODY.start] = mass
            point[[BODY.start + 4, BODY.start + 7, BODY.start + 9]] = mass * (_GUESSED_RADIUS * max(length, 0.1)) ** 2
            guesses.append(point[PARAMETERS])
        return guesses


def _best(tracks: tuple[Track, ...]) -> Track:
    first = tracks[0]
    other = max(tracks, key=lambda track: track.belief.evidence)
    return other if other.belief.evidence > first.belief.evidence + _MARGIN else first


def _levelled(track: Track, first: Track) -> Track:
    """Return a track without a lead over the first."""
    evidence = min(track.belief.evidence, first.belief.evidence)
    return replace(track, belief=replace(track.belief, evidence=evidence))


def _surprised(belief: Belief) -> bool:
    return belief.last_surprise > _limit(belief.last_measured)


@cache
def _limit(measured: int) -> float:
    return float(chi2.isf(_FALSE_ALARM, measured))
