"""Write in measured/accuracy.md what a second kind of sensors gains; with --broken print which broken one is named.

python scripts/benchmark_sensors.py --seeds 20 --store FOLDER --output docs
python scripts/benchmark_sensors.py --broken --seeds 1 --first 1 --store FOLDER
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from benchmarks.broken_sensors import BROKEN, Broken
from benchmarks.broken_sensors import run as run_broken
from benchmarks.data import Case, motion
from benchmarks.frame import PUBLISHED, Frame, Runs, median_and_most, number, percent, provenance, statuses, table
from benchmarks.sensor_bounds import sensors_bound
from benchmarks.sensors import PAIRS, ROBOT, Pair, drawn, run
from mbaid_ros.core.geometry import Array

_SECONDS = 20.0
_INTERVAL = 1.96  # standard deviations
_FAR = 5.0  # standard deviations: an error beyond is wrong
_ODOMETRY = 10.0  # Hz


@dataclass(frozen=True)
class Outcome(Runs):
    """Errors and standard deviations (N, 10), NaN where withheld, and statuses (N,)."""

    error: Array
    std: Array
    status: Array


@dataclass(frozen=True)
class Named(Runs):
    """Statuses (N,), largest errors in standard deviations, first causes, and places of the true sensor in causes."""

    status: Any
    largest: Array
    first: Any
    place: Array


def main() -> None:
    """Run the benchmark."""
    frame = Frame(__doc__, 'measured/accuracy.md', seeds=20, broken=False, first=0)
    if frame.arguments.broken:
        _broken(frame)
    else:
        _further(frame)


def _further(frame: Frame) -> None:
    """Measure two kinds of sensors, and the first of them alone."""
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
    qualities = [_quality(pair, outcome, both=outcome is both) for outcome in (first, both)]
    return [pair.name, *qualities[0], *qualities[1], number(float(np.nanmedian(first.std / both.std)))]


def _quality(pair: Pair, outcome: Outcome, *, both: bool) -> list[str]:
    """Return how many runs publish, the coverage, and the error over the standard deviation and over the bound."""
    relative = outcome.error / outcome.std
    known = np.isfinite(relative)
    rmse = np.sqrt(np.nanmean(outcome.error**2, axis=0))
    covered = float(np.mean(np.abs(relative[known]) < _INTERVAL)) if known.any() else np.nan
    sensors = drawn(pair, 0, both=both)
    truth = motion(ROBOT)
    bound = sensors_bound(
        Case(ROBOT, 'mid'), truth[truth.time < _SECONDS + 1e-6], sensors, _ODOMETRY if pair.odometry else 0.0
    )
    return [
        percent(float(np.mean(np.isin(outcome.status, PUBLISHED)))),
        percent(covered),
        number(float(np.nanmedian(rmse / np.sqrt(np.nanmean(outcome.std**2, axis=0))))),
        median_and_most(rmse / bound),
    ]


def _broken(frame: Frame) -> None:
    """Break each sensor of six in turn, and print whether the first cause names it."""
    chosen = frame.chosen(BROKEN, lambda broken: broken.name)
    files = {broken.name: f'{broken.name} from {frame.arguments.first}' for broken in chosen}
    lines, right, wrong, runs = [], 0, 0, 0
    for name, named in frame.outcomes(Named, partial(_run_from, frame.arguments.first), files):
        lines.append(_broken_row(_BY_NAME[name], named))
        print(' | '.join(lines[-1]), flush=True)
        right += int(np.sum(named.place == 1))
        wrong += int(np.sum(named.largest > _FAR))
        runs += len(named.place)
    summary = (
        f'**The broken sensor stands first in {right} of {runs} runs ({percent(right / runs)}); {wrong} are silently '
        f'wrong by more than {_FAR:g} standard deviations.**'
    )
    print(f'{summary}\n\n{table(_BROKEN, lines, words=True)}\n\n{provenance()}')


def _run_from(first: int, name: str, seed: int) -> object:
    return run_broken(_BY_NAME[name], first + seed)


def _broken_row(broken: Broken, named: Named) -> list[str]:
    return [
        broken.sensor,
        broken.error,
        statuses(named.status),
        number(float(np.nanmax(named.largest)), 1) if np.isfinite(named.largest).any() else '-',
        ', '.join(str(place or '-') for place in named.place.tolist()),
        str(named.first[0]).replace('|', '/'),
    ]


_BY_NAME: Mapping[str, Broken] = {broken.name: broken for broken in BROKEN}
_OF_EACH = 'published', 'within 95 %', 'RMSE over deviation', 'RMSE over bound'
_HEADER = (
    'first sensor, and second',
    *(f'first: {each}' for each in _OF_EACH),
    *(f'both: {each}' for each in _OF_EACH),
    'gain',
)
_BROKEN = 'sensor', 'error', 'status', 'largest error', 'place', 'named first'

if __name__ == '__main__':
    main()
