"""The hypothesis bank: what may act or drift, each hypothesis followed by a filter of its own over the same windows."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.filter.gaussian import SquareRootInformation
from mbaid_ros.core.filter.square_root import (
    advance,
    momentum_inflation,
    pose_reset,
    update,
)
from mbaid_ros.core.filter.state import MOMENTUM
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.filter.whitened import WhitenedWindow
from mbaid_ros.core.filter.window import Window
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.unknowns.environment import Hypothesis

# Log-likelihood by which another hypothesis must explain the data better than the first: odds of 20,000 to 1.
MARGIN = 10.0
# Chance that an undisturbed window counts as a jump of the momentum: one in a year and a half of windows.
_FALSE_ALARM = 1e-8
# Windows in a row that one jump may take: a pulse across a border is in both. At a guess one: more in a row are the
# guess's fault.
LONGEST, LONGEST_AT_A_GUESS = 2, 1
_REMEMBERED = 4  # jumps, of which the belief before is kept: more of them are no changes of the target
_JUMP = 0.3  # standard deviation of a jump, in typical sizes of the momentum: next to no prior of its size


@dataclass(frozen=True)
class Jump:
    """A jump of the momentum.

    Attributes
    ----------
    time : s since the first sample, start of the window in which it was noticed
    before : (6,) (P, L) until then, about the run's origin
    belief : a window earlier, which nothing of it has touched; of the first jumps of a run only
    pushed : as of the track, until then
    """

    time: float
    before: Array
    belief: SquareRootInformation | None
    pushed: Array


@dataclass(frozen=True, eq=False)
class HypothesisFilter:
    """One hypothesis: what acts or drifts, the belief under it, and the jumps it has met.

    `pushed` is what a constant force has made of the momentum in all windows, for each of its numbers: (p, f), in the
    filter's variables.
    """

    hypothesis: Hypothesis
    belief: SquareRootInformation
    jumps: tuple[Jump, ...] = ()
    jumped: int = 0  # windows in a row, the last one among them, that the momentum has jumped in
    inflations: int = 0  # windows in all
    longest: int = LONGEST  # windows that one jump may take
    previous: SquareRootInformation | None = None  # before the latest window
    pushed: Array = field(default_factory=lambda: np.zeros(()))  # of any shape: nothing yet

    def after(self, belief: SquareRootInformation) -> HypothesisFilter:
        """Return the same with another belief."""
        return HypothesisFilter(
            self.hypothesis,
            belief,
            self.jumps,
            self.jumped,
            self.inflations,
            self.longest,
            self.previous,
            self.pushed,
        )

    def advanced(self, white: WhitenedWindow, variables: Variables) -> HypothesisFilter:
        """Return the same at the next window's first knot."""
        after = self.after(advance(self.belief, white, variables, self.hypothesis))
        if self.hypothesis.force == 'none':
            return after
        return replace(after, pushed=self.pushed + white.push(self.hypothesis.force))

    @property
    def misfit(self) -> float:
        """Sum of the normalised innovations squared, and what its jumps count against it."""
        return self.belief.nis - 2.0 * self.inflations * float(np.log(_FALSE_ALARM))


Bank = tuple[HypothesisFilter, ...]


def best(bank: Bank) -> HypothesisFilter:
    """Return the hypothesis to report: the first, unless another one explains the data far better."""
    leading = max(bank, key=lambda track: track.belief.log_likelihood)
    return leading if leading.belief.log_likelihood > bank[0].belief.log_likelihood + MARGIN else bank[0]


def update_bank(bank: Bank, window: Window, white: WhitenedWindow, variables: Variables) -> Bank:
    """Return the hypotheses at the first knot after a window; a momentum that must have jumped is let jump, once."""
    return tuple(update_hypothesis(each, window, white, variables).advanced(white, variables) for each in bank)


def update_hypothesis(
    track: HypothesisFilter, window: Window, white: WhitenedWindow, variables: Variables
) -> HypothesisFilter:
    """Return a hypothesis at the window's first knot."""
    before = pose_reset(track.belief, variables) if window.fresh else track.belief
    after = update(before, white)
    unlikely = after.last_nis > _limit(after.last_measured) and after.measured > after.last_measured
    if not unlikely or track.jumped == track.longest:
        return HypothesisFilter(
            track.hypothesis, after, track.jumps, 0, track.inflations, track.longest, before, track.pushed
        )
    likelihood = _as_usual(after)
    loose = momentum_inflation(before, white, variables, _JUMP * variables.typical_momentum)
    belief = update(loose, white)
    if belief.last_nis > _limit(belief.last_measured):
        # More than a jump: nothing links this window to the ones before.
        belief = update(pose_reset(loose, variables), white)
    jumps = track.jumps
    if not track.jumped:
        mean = before.least_squares[: len(variables.scale)]
        untouched = track.previous if len(jumps) < _REMEMBERED else None
        jumps = (*jumps, Jump(window.start, variables.spread[MOMENTUM] @ mean, untouched, track.pushed))
    return replace(
        track,
        belief=replace(belief, log_likelihood=likelihood),
        previous=before,
        jumps=jumps,
        jumped=track.jumped + 1,
        inflations=track.inflations + 1,
    )


def as_usual(belief: SquareRootInformation, white: WhitenedWindow) -> float:
    """Return the log-likelihood after a window that something rare explains as well as usual."""
    return _as_usual(update(belief, white))


def _as_usual(after: SquareRootInformation) -> float:
    # A jump counts against a hypothesis as much as it is rare, and explains its window as well as usual.
    return after.log_likelihood + 0.5 * (after.last_nis - after.last_measured) + float(np.log(_FALSE_ALARM))


def far_better(other: HypothesisFilter, first: HypothesisFilter) -> bool:
    """Tell whether a hypothesis explains the data far better than the first one, each linearised at its own solution.

    With more unknowns or more noise than the first, it can gain likelihood by smaller innovations alone. What it gains
    without them comes from what it is linearised at.
    """
    gain = other.belief.log_likelihood - first.belief.log_likelihood
    return gain > MARGIN and first.misfit - other.misfit > 2.0 * MARGIN


def clamped(bank: Bank) -> Bank:
    """Return the hypotheses without any lead over the first."""
    most = bank[0].belief.log_likelihood
    return tuple(
        replace(track, belief=replace(track.belief, log_likelihood=min(track.belief.log_likelihood, most)))
        for track in bank
    )


def _limit(measured: int) -> float:
    return chi_square.limit(_FALSE_ALARM, measured)
