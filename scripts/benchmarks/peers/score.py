"""The score of a method: errors over the bound, intervals, answers that are silently wrong, and cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.peers.runs import Outcome
from mbaid_ros.core.geometry import Array
from mbaid_ros.replay.campaigns.statistics import QUANTILE

FAR = 5.0  # standard deviations: an error beyond is wrong
FAR_ALONE = 0.1  # the same without standard deviations: of mass, radius of gyration or mean moment
COVERED = (0.9, 0.98)  # share of 95 % intervals that hold the truth, where they are right
_MANY = 100  # intervals: of fewer, all may hold the truth by chance


@dataclass(frozen=True)
class Truth:
    """The (10,) true parameters of a run, and the standard deviations that no unbiased method surpasses."""

    parameters: Array
    bound: Array  # NaN for what the motion leaves open

    @property
    def sizes(self) -> Array:
        """Sizes that errors are compared with, (10,)."""
        mass, moment = self.parameters[0], np.mean(self.parameters[[4, 7, 9]])
        return np.concatenate(([mass], np.full(3, np.sqrt(1.5 * moment / mass)), np.full(6, moment)))


@dataclass(frozen=True)
class Score:
    """The runs of a method together; NaN where there is none."""

    runs: int
    answers: int  # with a number that the method trusts
    ratio: Array  # of each run: root mean square over the parameters of error over bound; NaN without an answer
    covered: float  # share of the 95 % intervals that hold the truth
    intervals: int
    wrong: int  # answers that are wrong with a small interval
    failures: tuple[str, ...]  # why there was no answer
    processor: float  # s, median
    wall: float
    memory: float  # MB, largest

    @property
    def median(self) -> float:
        """Median error over the bound."""
        return median(self.ratio)

    @property
    def holds(self) -> bool:
        """Whether the intervals hold the truth as often as claimed."""
        return bool(self.covered >= COVERED[0] and (self.covered <= COVERED[1] or self.intervals < _MANY))


def median(values: Sequence[float] | Array) -> float:
    """Return the median of the numbers that are there; NaN if none is."""
    return float(np.nanmedian(values)) if np.any(np.isfinite(values)) else np.nan


def score(outcomes: Sequence[Outcome], truths: Sequence[Truth]) -> Score:
    """Return the score of some runs."""
    ratios, inside, wrong, failures = [], [], 0, []
    for outcome, truth in zip(outcomes, truths, strict=True):
        open_ones = ~np.isfinite(truth.bound)
        error, std = np.array(outcome.parameters) - truth.parameters, np.array(outcome.std)
        error[open_ones] = std[open_ones] = np.nan
        given = np.isfinite(error)
        if outcome.failure or outcome.doubt or not given.any():
            failures.append(outcome.failure or outcome.doubt or 'nothing is determined')
            ratios.append(np.nan)
            continue
        ratios.append(np.sqrt(np.mean((error[given] / truth.bound[given]) ** 2)))
        sure = given & np.isfinite(std)
        inside += (np.abs(error[sure]) < QUANTILE * std[sure]).tolist()
        limit = np.where(sure, FAR * std, FAR_ALONE * truth.sizes)
        wrong += bool(np.any(np.abs(error[given]) > limit[given]))
    return Score(
        runs=len(outcomes),
        answers=len(outcomes) - len(failures),
        ratio=np.array(ratios),
        covered=float(np.mean(inside)) if inside else np.nan,
        intervals=len(inside),
        wrong=wrong,
        failures=tuple(failures),
        processor=float(np.median([each.processor for each in outcomes])),
        wall=float(np.median([each.wall for each in outcomes])),
        memory=float(np.max([each.memory for each in outcomes])),
    )
