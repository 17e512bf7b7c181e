"""The result of an inquiry: candidate causes, ranked by the log-likelihood that they gain."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.diagnosis.readings import CHANNELS, Roughness
from mbaid_ros.core.filter.bank import HypothesisFilter
from mbaid_ros.core.filter.square_root import SquareRootInformation
from mbaid_ros.core.results.status import LARGEST_NIS, SENSORS, Cause, Innovations

# Log-likelihood, the odds of bank.MARGIN: a smaller gain is not reported, and a smaller lead is no lead.
WORTH = 10.0
_TOO_SMALL = 1.3  # times the declared noise, from which the declared one is wrong: declarations are no better
_OUTLIERS = 0.002  # share of the poses, from which they are named: single ones do no harm, they are left out
NOISE = 'noise.'  # prefix of the names of noise parameters
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
    """The result of an inquiry."""

    causes: tuple[CandidateCause, ...]  # the likeliest first
    innovations: Innovations  # of the pass without jumps
    misfit: float  # half of the sum of its normalised innovations squared, beyond what there should be

    @property
    def leading(self) -> CandidateCause | None:
        """The cause with a mechanism, if nothing of another kind explains the data nearly as well."""
        first = next((each for each in self.causes if each.physical), None)
        if first is None:
            return None
        others = (each for each in self.causes if each is not first and not (each.of_twist and first.of_twist))
        rivals = (each.gain + WORTH if each.physical else CATCH_ALL * each.gain for each in others)
        return first if first.gain > max(rivals, default=0.0) else None


def ranked(
    inquired: Mapping[str, tuple[float, bool]],
    innovations: Innovations,
    misfit: float,
    rough: Roughness,
) -> tuple[Cause, ...]:
    """Return the candidate causes, the likeliest first.

    Parameters
    ----------
    inquired : by text the gain of each, and whether it has a mechanism
    innovations : of a pass in which nothing explains anything
    misfit : log-likelihood that is missing there
    rough : the noise by the samples
    """
    noise = _noise(innovations, rough)
    if noise:  # a pass with more of the noise that samples show has gained by that noise
        of_passes = [gain for text, (gain, _) in inquired.items() if text.startswith(NOISE)]
        noise = [Cause(each.text, max(each.gain, *of_passes)) if of_passes else each for each in noise]
        inquired = {text: found for text, found in inquired.items() if not text.startswith(NOISE)}
    causes = [Cause(text, gain if physical else CATCH_ALL * gain) for text, (gain, physical) in inquired.items()]
    causes += noise
    if rough.outliers > _OUTLIERS:
        share = f'{1e2 * rough.outliers:.1g}'
        causes.append(Cause(f'{share} % of the poses are outliers: check the tracking of the odometry', misfit))
    return tuple(sorted(causes, key=lambda cause: -cause.gain))


def _noise(innovations: Innovations, rough: Roughness) -> list[Cause]:
    """Return that noise values are too small, if the samples are as noisy as that."""
    large = [place for place, factor in enumerate(rough.factor) if factor > _TOO_SMALL]
    if not large:
        return []
    listed = ', '.join(f'noise.{CHANNELS[place]} {rough.factor[place]:.1f} times' for place in large)
    ratio = np.maximum(np.nan_to_num(innovations.ratio, nan=1.0), 1.0)
    explained = ratio - 1.0 - np.log(ratio)
    of_base = [place for place in large if CHANNELS[place] in SENSORS]
    if len(of_base) == len(large):  # the joints' noise is in every sensor's innovations
        explained = np.where(np.isin(np.arange(len(SENSORS)), of_base), explained, 0.0)
    gain = 0.5 * float(innovations.count @ explained)
    advice = 'correct them, or the covariances in the messages, or set noise.estimate'
    return [Cause(f'the noise values are too small: {listed}; {advice}', gain)]


def gained(text: str, filtered: HypothesisFilter, base: SquareRootInformation) -> CandidateCause:
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
