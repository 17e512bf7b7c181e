"""The run of the filter: a start by repeated passes over the first windows, then one step a window."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.stats import chi2

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.trajectory.chain import ANGULAR, BODY, LINEAR, PARAMETERS, window_model
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
# The guess that the first pass is linearised at: a ball of part of the known bodies' mass and size, at rest.
_GUESSED_MASS, _GUESSED_RADIUS = 0.3, 0.25
_MOMENTUM = slice(LINEAR.start, ANGULAR.stop)
# Chance that an undisturbed window counts as a jump of the momentum.
_FALSE_ALARM = 1e-8
_JUMP = 0.01  # standard deviation of a jump, in typical sizes of the momentum
# How much better (log-likelihood) the data must be explained with a random walk than without.
_MARGIN = 6.0


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


class Tracker:
    """Follows momentum, body and time offset through the windows, under several hypotheses of what drifts.

    The linear models are absolute, so each window may keep the linearisation point it was first seen at. While the run
    is young all windows are linearised again at the latest estimate, as often as it takes to settle.

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
                self._next_pass = int(np.ceil(_GROWTH * len(self._young)))
                if self._next_pass > self._kept:
                    self._young = None
                return
        if self._tracks:
            self._tracks = self._step(self._tracks, window, self._point(self._tracks))

    def preview(self, window: Window | None) -> None:
        """Take what a window without its later neighbours tells into the latest state, but not into the run."""
        self._latest = self._tracks
        if self._tracks and window is not None:
            self._latest = self._step((_best(self._tracks),), window, self._point(self._tracks))

    def _point(self, tracks: tuple[Track, ...]) -> Array:
        """Return the parameters to linearise at."""
        return self._variables.state(_best(tracks).belief)[0][PARAMETERS]

    def _settle(self, windows: list[Window]) -> None:
        """Pass over all windows again and again, each time linearised at the result, until it moves no more."""
        mass = BODY.start - PARAMETERS.start
        point = self._point(self._tracks) if self._tracks else self._guess()
        if point[mass] <= 0.0:
            point = self._guess()
        for _ in range(_PASSES):
            tracks = tuple(Track(walk, self._variables.open(force=walk.force != 'none')) for walk in self._walks)
            for window in windows:
                tracks = self._step(tracks, window, point)
            self._tracks = tracks
            mean, covariance = self._variables.state(_best(tracks).belief)
            step = mean[PARAMETERS] - point
            while point[mass] + step[mass] <= 0.0:
                step = 0.5 * step
            point = point + step
            if np.all(np.abs(step) < _SETTLED * np.sqrt(np.diag(covariance)[PARAMETERS])):
                return

    def _step(self, tracks: tuple[Track, ...], window: Window, point: Array) -> tuple[Track, ...]:
        model = window_model(self._kernel, window, point, self._uncertain)
        step = prepare(model, self._variables)
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

    def _guess(self) -> Array:
        """Return the parameters of a ball of a part of the known mass, without momentum."""
        known = self._kernel.known
        mass = _GUESSED_MASS * float(np.sum(known[:, 0]))
        length = float(np.sum(np.linalg.norm(self._kernel.model.positions, axis=1)))
        point = np.zeros(len(self._variables.basis))
        point[BODY.start] = mass
        point[[BODY.start + 4, BODY.start + 7, BODY.start + 9]] = mass * (_GUESSED_RADIUS * max(length, 0.1)) ** 2
        return point[PARAMETERS]


def _best(tracks: tuple[Track, ...]) -> Track:
    first = tracks[0]
    other = max(tracks, key=lambda track: track.belief.evidence)
    return other if other.belief.evidence > first.belief.evidence + _MARGIN else first


def _surprised(belief: Belief) -> bool:
    return belief.last_surprise > _limit(belief.last_measured)


@cache
def _limit(measured: int) -> float:
    return float(chi2.isf(_FALSE_ALARM, measured))
