"""The result of a search: candidate causes, ranked by the log-likelihood that they gain."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.filter.bank import HypothesisFilter
from mbaid_ros.core.filter.square_root import SquareRootInformation
from mbaid_ros.core.results.status import LARGEST_NIS, Cause, Innovations

# Log-likelihood, the odds of bank.MARGIN: a smaller gain is not reported, and a smaller lead is no lead.
WORTH = 10.0
_TOO_SMALL = 1.3  # times the declared noise, from which the declared one is wrong: declarations are no better
# Share that counts of the gain of a cause without a mechanism: where both explain all, one with a mechanism leads.
CATCH_ALL = 0.95


# Of how many the gain is found by passes of their own, and of how many of one kind: three links or joints will do.
_REFINED, _ALIKE = 5, 3


@dataclass(frozen=True)
class Change:
    """A target that has moved in the grasp, or was exchanged for another."""

    time: float  # s since the first sample, start of the window in which it was noticed
    exchanged: bool  # whether mass and momentum have changed as well


@dataclass(frozen=True)
class CandidateCause:
    """One candidate cause."""

    text: str  # in words
    gain: float  # how much likelier that makes the data (log-likelihood)
    physical: bool = True  # whether it has a mechanism; a random walk follows anything
    change: Change | None = None  # what has become of the target, where that leaves nothing unexplained
    of_twist: bool = False  # whether it is something wrong with the base's twist, which poses can do without


@dataclass(frozen=True)
class IsolationResult:
    """The result of a search."""

    causes: tuple[CandidateCause, ...]  # the likeliest first
    innovations: Innovations  # of the pass without jumps

    @property
    def leading(self) -> CandidateCause | None:
        """The cause with a mechanism, if nothing of another kind explains the data nearly as well."""
        first = next((each for each in self.causes if each.physical), None)
        if first is None:
            return None
        others = (each for each in self.causes if each is not first and not (each.of_twist and first.of_twist))
        rivals = (each.gain + WORTH if each.physical else CATCH_ALL * each.gain for each in others)
        return first if first.gain > max(rivals, default=0.0) else None


def ranked(gains: Mapping[str, tuple[float, bool]], innovations: Innovations, joint_noise: float) -> tuple[Cause, ...]:
    """Return the candidate causes, the likeliest first.

    Parameters
    ----------
    gains : by text the gain of each, and whether it has a mechanism
    innovations : of a pass in which nothing explains anything
    joint_noise : how many times as noisy as declared the joints are by their samples
    """
    causes = [Cause(text, gain if physical else CATCH_ALL * gain) for text, (gain, physical) in gains.items()]
    if joint_noise > _TOO_SMALL:
        # The joints' noise is in every sensor's innovations. That of the base is estimated.
        ratio = np.maximum(np.nan_to_num(innovations.ratio, nan=1.0), 1.0)
        text = (
            f'the noise values are too small: noise.joint_position {joint_noise:.1f} times; correct it, or set '
            'noise.estimate'
        )
        causes.append(Cause(text, 0.5 * float(innovations.count @ (ratio - 1.0 - np.log(ratio)))))
    return tuple(sorted(causes, key=lambda cause: -cause.gain))


def candidate_cause(text: str, filtered: HypothesisFilter, base: SquareRootInformation) -> CandidateCause:
    """Return the gain of a cause over a pass without it."""
    return CandidateCause(text, filtered.gaussian.log_likelihood - base.log_likelihood)


def likeliest_kinds(gains: Mapping[str, float]) -> list[str]:
    """Return the causes that are worth a pass of their own, the likeliest first."""
    found: list[str] = []
    kinds: Counter[str] = Counter()
    for cause in sorted(gains, key=lambda each: -gains[each]):
        kind = cause.partition(':')[0]
        kinds[kind] += 1
        if kinds[kind] <= _ALIKE:
            found.append(cause)
    return found[:_REFINED]


def explains(filtered: HypothesisFilter) -> bool:
    """Return whether a pass leaves innovations of the size that the noise explains."""
    return filtered.gaussian.nis < LARGEST_NIS * filtered.gaussian.measured
