"""Hypotheses of what acts or drifts, each followed by a filter of its own over the same windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.trajectory.belief import Belief, Coordinates
from mbaid_ros.core.trajectory.chain import ANGULAR, LINEAR
from mbaid_ros.core.trajectory.filter import Walk, advance, jolted, unlinked, update
from mbaid_ros.core.trajectory.steps import Step
from mbaid_ros.core.trajectory.windows import Window

# How much better (log-likelihood) the data must be explained by another hypothesis than by the first.
MARGIN = 10.0
_MOMENTUM = slice(LINEAR.start, ANGULAR.stop)
# Chance that an undisturbed window counts as a jump of the momentum.
_FALSE_ALARM = 1e-8
_JUMP = 0.01  # standard deviation of a jump, in typical sizes of the momentum


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
    """One hypothesis: what acts or drifts, the belief under it, and the jumps it has met."""

    walk: Walk
    belief: Belief
    jumps: tuple[Jump, ...] = ()
    just_jumped: bool = False

    @property
    def misfit(self) -> float:
        """Sum of the normalised innovations squared, and what its jumps count against it."""
        return self.belief.surprise - 2.0 * len(self.jumps) * float(np.log(_FALSE_ALARM))


def follow(track: Track, window: Window, step: Step, variables: Coordinates) -> Track:
    """Return a track after a window; a momentum that must have jumped is let jump, once."""
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


def best(tracks: Sequence[Track]) -> Track:
    """Return the first track, unless another one explains the data far better."""
    first = tracks[0]
    other = max(tracks, key=lambda track: track.belief.evidence)
    return other if other.belief.evidence > first.belief.evidence + MARGIN else first


def far_better(other: Track, first: Track) -> bool:
    """Tell whether a hypothesis explains the data far better than the first one, each linearised at its own solution.

    With more unknowns or more noise than the first, it can gain likelihood by smaller innovations alone. What it gains
    without them comes from what it is linearised at.
    """
    gain = other.belief.evidence - first.belief.evidence
    return gain > MARGIN and first.misfit - other.misfit > 2.0 * MARGIN


def levelled(tracks: Sequence[Track]) -> list[Track]:
    """Return the tracks without any lead over the first."""
    most = tracks[0].belief.evidence
    return [replace(track, belief=replace(track.belief, evidence=min(track.belief.evidence, most))) for track in tracks]


def _surprised(belief: Belief) -> bool:
    return belief.last_surprise > _limit(belief.last_measured)


@cache
def _limit(measured: int) -> float:
    return chi_square.limit(_FALSE_ALARM, measured)
