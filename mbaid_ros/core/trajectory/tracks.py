"""Hypotheses of what acts or drifts, each followed by a filter of its own over the same windows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.trajectory.belief import Belief, Beliefs, Coordinates
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


@dataclass(frozen=True)
class Tracks:
    """Several hypotheses side by side, over the same windows: the walk of each, what is believed, the jumps met."""

    walks: tuple[Walk, ...]
    beliefs: Beliefs
    jumps: tuple[tuple[Jump, ...], ...]
    just_jumped: tuple[bool, ...]

    @staticmethod
    def of(tracks: Sequence[Track]) -> Tracks:
        """Return tracks side by side."""
        return Tracks(
            tuple(track.walk for track in tracks),
            Beliefs.of([track.belief for track in tracks]),
            tuple(track.jumps for track in tracks),
            tuple(track.just_jumped for track in tracks),
        )

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self.walks)

    def __getitem__(self, index: int) -> Track:
        """Return one of them."""
        return Track(self.walks[index], self.beliefs[index], self.jumps[index], just_jumped=self.just_jumped[index])

    def __iter__(self) -> Iterator[Track]:
        """Yield them one by one."""
        return (self[index] for index in range(len(self)))

    @property
    def leading(self) -> int:
        """Which one is the best: the first, unless another one explains the data far better."""
        evidences = self.beliefs.evidences.tolist()
        most = max(evidences)
        return evidences.index(most) if most > evidences[0] + MARGIN else 0

    @property
    def best(self) -> Track:
        """The best one."""
        return self[self.leading]

    @property
    def best_alone(self) -> Tracks:
        """The same without the others."""
        index = self.leading
        part = slice(index, index + 1)
        return Tracks(self.walks[part], self.beliefs.only(index), self.jumps[part], self.just_jumped[part])


Follow = Callable[[Tracks, Window, Step, Coordinates], Tracks]


def follow(tracks: Tracks, window: Window, step: Step, variables: Coordinates) -> Tracks:
    """Return tracks at the node after a window; a momentum that must have jumped is let jump, once."""
    after = met(tracks, window, step, variables)
    return replace(after, beliefs=advance(after.beliefs, step, variables, tracks.walks))


def met(tracks: Tracks, window: Window, step: Step, variables: Coordinates) -> Tracks:
    """Return the same at the window's first node."""
    before = tracks.beliefs
    if window.fresh:
        before = Beliefs.of([unlinked(before[k], variables) for k in range(len(before))])
    after, jumps, jumped = update(before, step), tracks.jumps, (False,) * len(tracks)
    surprising = after.last_surprises > _limit(after.last_measured)
    if surprising.any() and after.measured > after.last_measured:
        may = [bool(surprises) and not just for surprises, just in zip(surprising, tracks.just_jumped, strict=True)]
        each = [
            _jumped(before[k], after[k], window, step, variables) if may[k] else (after[k], ())
            for k in range(len(tracks))
        ]
        after = Beliefs.of([belief for belief, _ in each])
        jumps = tuple((*old, *new) for old, (_, new) in zip(jumps, each, strict=True))
        jumped = tuple(may)
    return Tracks(tracks.walks, after, jumps, jumped)


def _jumped(
    before: Belief, after: Belief, window: Window, step: Step, variables: Coordinates
) -> tuple[Belief, tuple[Jump]]:
    """Return what is believed after a window if the momentum has jumped before it, and the jump.

    Parameters
    ----------
    before, after : what was believed before the window, and is after it without a jump
    """
    # A jump counts against a hypothesis as much as it is rare, and explains its window as well as usual.
    evidence = after.evidence + 0.5 * (after.last_surprise - after.last_measured) + float(np.log(_FALSE_ALARM))
    loose = jolted(before, step, variables, _JUMP * np.sqrt(variables.open_variance[_MOMENTUM]))
    belief = update(Beliefs.of([loose]), step)[0]
    if belief.last_surprise > _limit(belief.last_measured):
        # More than a jump: nothing links this window to the ones before.
        belief = update(Beliefs.of([unlinked(loose, variables)]), step)[0]
    return replace(belief, evidence=evidence), (Jump(window.start, variables.spread[_MOMENTUM] @ before.mean),)


def far_better(other: Track, first: Track) -> bool:
    """Tell whether a hypothesis explains the data far better than the first one, each linearised at its own solution.

    With more unknowns or more noise than the first, it can gain likelihood by smaller innovations alone. What it gains
    without them comes from what it is linearised at.
    """
    gain = other.belief.evidence - first.belief.evidence
    return gain > MARGIN and first.misfit - other.misfit > 2.0 * MARGIN


def levelled(tracks: Tracks) -> Tracks:
    """Return the tracks without any lead over the first."""
    evidences = tracks.beliefs.evidences
    return replace(tracks, beliefs=replace(tracks.beliefs, evidences=np.minimum(evidences, evidences[0])))


@cache
def _limit(measured: int) -> float:
    return chi_square.limit(_FALSE_ALARM, measured)
