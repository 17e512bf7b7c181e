"""What the runs of a condition come to: verdicts, coverage, and whether they are silently wrong."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from benchmarks.honesty.runs import PUBLISHED, REFUSED, Outcome
from benchmarks.honesty.true_causes import TRUE_CAUSES, rank
from mbaid_ros.replay.campaigns.monte_carlo import QUANTILE

FAR = 5.0  # standard deviations: beyond, something is wrong
_FEWEST_COVERED = 0.6  # of the parameters, over the seeds


@dataclass(frozen=True)
class Verdict:
    """The runs of a condition, taken together.

    Attributes
    ----------
    statuses : how often each was the last
    covered : share of the 95 % intervals that hold the truth, of the runs with a good last status; NaN without any
    largest : largest error of any of their parameters, in standard deviations; NaN without any
    jointly : the same of all parameters of a run together, in those of a single one that is as unlikely
    ever, ever_at : largest error of any parameter in any estimate that was published and is no first one, in standard
        deviations, and when, s; 0 without any
    young : the same of first ones
    windows, alarms : number of estimates of all runs, and of those that are inconsistent
    named : the cause or warning that most of the runs name first; empty for none
    silently_wrong : whether they say `converged` or `estimating` and are wrong
    places : at which place each run names the true cause, 0 where it does not; of runs that are right and name nothing
        none, and none of conditions with nothing to be named
    """

    statuses: Counter[str]
    covered: float
    largest: float
    jointly: float
    ever: float
    ever_at: float
    young: float
    windows: int
    alarms: int
    named: str
    silently_wrong: bool
    places: tuple[int, ...]


def judged(outcome: Outcome, condition: str = '') -> Verdict:
    """Return the verdict on the runs of a condition, by its name."""
    good = np.isin(outcome.status, PUBLISHED)[:, None]
    given = good & np.isfinite(outcome.error) & (outcome.std > 0.0)
    deviation = np.abs(outcome.error[given] / outcome.std[given])
    covered = float(np.mean(deviation < QUANTILE)) if len(deviation) else np.nan
    largest = float(np.max(deviation)) if len(deviation) else np.nan
    together = outcome.jointly[good[:, 0] & np.isfinite(outcome.jointly)]
    jointly = float(np.max(together)) if len(together) else np.nan
    return Verdict(
        statuses=Counter(outcome.status.tolist()),
        covered=covered,
        largest=largest,
        jointly=jointly,
        ever=float(np.max(outcome.worst)),
        ever_at=float(outcome.worst_at[np.argmax(outcome.worst)]),
        young=float(np.max(outcome.young)),
        windows=int(np.sum(outcome.windows)),
        alarms=int(np.sum(outcome.alarms)),
        named=Counter(outcome.named.tolist()).most_common(1)[0][0],
        silently_wrong=bool(np.fmax(largest, jointly) > FAR or covered < _FEWEST_COVERED),
        places=_places(outcome, condition),
    )


def _places(outcome: Outcome, condition: str) -> tuple[int, ...]:
    if condition not in TRUE_CAUSES:
        return ()
    runs = zip(outcome.status, outcome.causes, strict=True)
    return tuple(
        rank(condition, told.split('\n')) for status, told in runs if told or status not in (*PUBLISHED, REFUSED)
    )
