"""Every hypothesis updated by one window, with the jumps of the momentum under it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mbaid_ros.core.contracts import Hypothesis
from mbaid_ros.core.filter.gaussian import SquareRootInformation, update_together
from mbaid_ros.core.filter.linearise import WhitenedWindow
from mbaid_ros.core.filter.time_update import advance, at_window_start, momentum_inflation, pose_reset
from mbaid_ros.core.geometry import Array, chi_square_limit
from mbaid_ros.core.state import MOMENTUM, Variables
from mbaid_ros.core.windows import Window

MARGIN = 10.0  # log-likelihood by which a hypothesis must beat the first: odds of 20,000 to 1
_FALSE_ALARM = 1e-8  # chance that an undisturbed window counts as a jump: one in a year and a half of windows
# Windows in a row that one jump may take: a pulse across a border is in both. From a guessed start, more are its fault.
LONGEST, LONGEST_AT_A_GUESS, NO_JUMPS = 2, 1, 0
_REMEMBERED = 4  # jumps of which the information before is kept: more are no changes of the target
_JUMP = 0.3  # typical momenta: standard deviation of a jump, next to no prior
WhitenedWindows = list[tuple[Window, WhitenedWindow]]  # in order, each as it is and linearised


@dataclass(frozen=True)
class Jump:
    """A jump of the momentum."""

    time: float  # s since the first sample, start of the window in which it was noticed
    before: Array  # (6,) (P, L) before it, about the run's origin
    gaussian: SquareRootInformation | None  # a window earlier; of the first jumps of a run only
    force_impulse: Array  # as of `HypothesisFilter`, until then


@dataclass(frozen=True, eq=False)
class HypothesisFilter:
    """The filter of one hypothesis, and the jumps of the momentum under it."""

    hypothesis: Hypothesis
    gaussian: SquareRootInformation
    jumps: tuple[Jump, ...] = ()
    jump_length: int = 0  # number of consecutive windows with a jump, up to the latest
    inflations: int = 0  # number of windows with a jump
    longest_jump: int = LONGEST  # windows that one jump may take
    previous: SquareRootInformation | None = None  # before the latest window
    # (p, f) change of the momentum by a constant force so far, in the filter's variables
    force_impulse: Array = field(default_factory=lambda: np.zeros(()))

    def after_gap(self, window: Window, white: WhitenedWindow) -> HypothesisFilter:
        """Return the same at the start of a window, with the change by a constant force in a gap before it."""
        if self.hypothesis.force == 'none' or not window.gap:
            return self
        return replace(self, force_impulse=self.force_impulse + white.impulse_in_gap(self.hypothesis.force, window))

    def advanced(self, step: SquareRootInformation, white: WhitenedWindow) -> HypothesisFilter:
        """Return the same at the next window's first knot, where it shares the root of `step`."""
        force = self.hypothesis.force
        impulse = self.force_impulse if force == 'none' else self.force_impulse + white.force_impulse(force)
        return replace(self, gaussian=self.gaussian.sharing(step), force_impulse=impulse)

    def updated(self, before: SquareRootInformation, after: SquareRootInformation) -> HypothesisFilter:
        """Return the same with the Gaussian after a window, from the root of `before`."""
        return replace(self, gaussian=after, jump_length=0, previous=self.gaussian.sharing(before))

    def jumped_in(
        self, window: Window, before: SquareRootInformation, after: SquareRootInformation, variables: Variables
    ) -> HypothesisFilter:
        """Return the same as `updated` by a window in which the momentum jumps."""
        jumps, previous = self.jumps, self.gaussian.sharing(before)
        if not self.jump_length:
            mean = previous.mean_and_shift()[0][: len(variables.scale)]
            earlier = self.previous if len(jumps) < _REMEMBERED else None
            jumps = (*jumps, Jump(window.start, variables.to_state[MOMENTUM] @ mean, earlier, self.force_impulse))
        filtered, length = self.updated(before, after), self.jump_length + 1
        return replace(filtered, jumps=jumps, jump_length=length, inflations=self.inflations + 1)

    @property
    def misfit(self) -> float:
        """Sum of the normalised innovations squared, and the penalty of its jumps."""
        return self.gaussian.nis - 2.0 * self.inflations * float(np.log(_FALSE_ALARM))


Bank = tuple[HypothesisFilter, ...]


def leader(bank: Bank) -> HypothesisFilter:
    """Return the hypothesis to report: the first, unless another has a far higher likelihood."""
    leading = max(bank, key=lambda filtered: filtered.gaussian.log_likelihood)
    return leading if leading.gaussian.log_likelihood > bank[0].gaussian.log_likelihood + MARGIN else bank[0]


def joined(bank: Bank) -> Bank:
    """Return hypotheses from one prior; the first shares the root of a force's if the momentum jumped under neither."""
    first, *others = bank
    for other in others:
        if not (first.jumps or other.jumps or first.hypothesis.disturbed or other.hypothesis.random_walk.size):
            return replace(first, gaussian=first.gaussian.sharing(other.gaussian)), *others
    return bank


def update_bank(
    bank: Bank, window: Window, white: WhitenedWindow, variables: Variables, *, advancing: bool = True
) -> Bank:
    """Return hypotheses updated by a window, at the first knot after it, or as yet in it unless `advancing`.

    Hypotheses that share a root, and walk alike, are updated together. The momentum jumps where the window is too
    unlikely without.
    """
    groups: dict[tuple[int, float, float], list[int]] = {}
    for index, filtered in enumerate(bank):
        key = id(filtered.gaussian.conditional), filtered.hypothesis.momentum, filtered.hypothesis.position
        groups.setdefault(key, []).append(index)
    after = list(bank)
    for indices in groups.values():
        group = [bank[index].after_gap(window, white) for index in indices]
        before = at_window_start(group[0].gaussian, window, white, variables, group[0].hypothesis)
        found = update_together(before, [filtered.gaussian for filtered in group], white)
        jumped = _with_jumps(group, found, before, window, white, variables)
        steps: dict[int, SquareRootInformation] = {}  # to the next knot, by the root that hypotheses share by now
        for index, filtered, usual in zip(indices, group, found, strict=True):
            updated = jumped[filtered] if filtered in jumped else filtered.updated(before, usual)
            root = id(updated.gaussian.conditional)
            if advancing and root not in steps:
                steps[root] = advance(updated.gaussian, white, variables, updated.hypothesis)
            after[index] = updated.advanced(steps[root], white) if advancing else updated
    return tuple(after)


def _with_jumps(
    group: Sequence[HypothesisFilter],
    found: Sequence[SquareRootInformation],
    before: SquareRootInformation,
    window: Window,
    white: WhitenedWindow,
    variables: Variables,
) -> dict[HypothesisFilter, HypothesisFilter]:
    """Return those of a group under which the momentum jumps in a window, as updated by it; they share a root.

    `found` is the group as updated without jumps, from the root of `before`.
    """
    limit = chi_square_limit(_FALSE_ALARM, len(white.value))
    jumping = {
        filtered: usual
        for filtered, usual in zip(group, found, strict=True)
        if usual.last_nis > limit
        and usual.measured > usual.last_measured
        and filtered.jump_length != filtered.longest_jump
    }
    if not jumping:
        return {}
    loose = momentum_inflation(before, white, variables, _JUMP * variables.typical_momentum)
    jumped = dict(zip(jumping, update_together(loose, [filtered.gaussian for filtered in jumping], white), strict=True))
    broken = [filtered for filtered in jumping if jumped[filtered].last_nis > limit]
    if broken:  # more than a jump of the momentum: of the pose error, too
        reset = pose_reset(loose, variables)
        jumped |= zip(broken, update_together(reset, [filtered.gaussian for filtered in broken], white), strict=True)
    return {
        filtered: filtered.jumped_in(
            window, before, replace(jumped[filtered], log_likelihood=rare_event_likelihood(usual)), variables
        )
        for filtered, usual in jumping.items()
    }


def rare_event_likelihood(after: SquareRootInformation) -> float:
    """Return the log-likelihood after a window that a rare event explains: as well as expected, but improbably."""
    return after.log_likelihood + 0.5 * (after.last_nis - after.last_measured) + float(np.log(_FALSE_ALARM))


def far_likelier(other: HypothesisFilter, first: HypothesisFilter) -> bool:
    """Return whether a hypothesis explains the data far better than the first one, each linearised at its own solution.

    It must gain by smaller innovations: any other gain comes from the point of linearisation.
    """
    gain = other.gaussian.log_likelihood - first.gaussian.log_likelihood
    return gain > MARGIN and first.misfit - other.misfit > 2.0 * MARGIN


def cap_likelihood(bank: Bank) -> Bank:
    """Return the hypotheses with at most the likelihood of the first."""
    most = bank[0].gaussian.log_likelihood
    return tuple(
        replace(
            filtered, gaussian=replace(filtered.gaussian, log_likelihood=min(filtered.gaussian.log_likelihood, most))
        )
        for filtered in bank
    )
