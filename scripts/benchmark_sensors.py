"""Write in measured/accuracy.md what a second kind of sensors gains, and whether the intervals hold.

python scripts/benchmark_sensors.py --seeds 20 --store FOLDER --output docs
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.frame import PUBLISHED, Frame, Runs, median_and_most, number, percent
from benchmarks.sensors import PAIRS, Pair, run
from mbaid_ros.core.geometry import Array

_SECONDS = 20.0
_INTERVAL = 1.96  # standard deviations


@dataclass(frozen=True)
class Outcome(Runs):
    """Errors and standard deviations (N, 10), NaN where withheld, and statuses (N,)."""

    error: Array
    std: Array
    status: Array


def main() -> None:
    """Run the benchmark."""
    frame = Frame(__doc__, 'measured/accuracy.md', seeds=20)
    pairs = frame.chosen(PAIRS, lambda pair: pair.name)
    files = {
        (pair, both, _SECONDS): f'{pair.name}-{"both" if both else "first"}' for pair in pairs for both in (False, True)
    }
    first: dict[Pair, Outcome] = {}

    def both() -> Iterator[tuple[Pair, Outcome]]:
        for (pair, second, _), outcome in frame.outcomes(Outcome, run, files):
            if second:
                yield pair, outcome
            first[pair] = outcome

    frame.tabulate(
        _HEADER,
        both(),
        lambda pair, outcome: _row(pair, first[pair], outcome),
        name='further',
        note=f'runs of {_SECONDS:g} s',
    )


def _row(pair: Pair, first: Outcome, both: Outcome) -> list[str]:
    return [pair.name, *_quality(first), *_quality(both), number(float(np.nanmedian(first.std / both.std)))]


def _quality(outcome: Outcome) -> list[str]:
    """Return how many runs publish, the coverage, and the error over the standard deviation."""
    relative = outcome.error / outcome.std
    known = np.isfinite(relative)
    rmse = np.sqrt(np.nanmean(outcome.error**2, axis=0)) / np.sqrt(np.nanmean(outcome.std**2, axis=0))
    covered = float(np.mean(np.abs(relative[known]) < _INTERVAL)) if known.any() else np.nan
    return [percent(float(np.mean(np.isin(outcome.status, PUBLISHED)))), percent(covered), median_and_most(rmse)]


_OF_EACH = 'published', 'within 95 %', 'RMSE over deviation'
_HEADER = (
    'first sensor, and second',
    *(f'first: {each}' for each in _OF_EACH),
    *(f'both: {each}' for each in _OF_EACH),
    'gain',
)

if __name__ == '__main__':
    main()
