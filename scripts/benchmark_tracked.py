"""Write in measured/accuracy.md what the poses of a target before its capture are worth, and whether intervals hold.

python scripts/benchmark_tracked.py --seeds 50 --store FOLDER --output docs
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.frame import Frame, Runs, number, percent, provenance, table
from benchmarks.tracked import CAPTURE, REST, caught, estimates
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate

_INTERVAL = 1.96  # standard deviations
_MARGIN = 1.0  # s, of the run after the last time
_GROUPS = {'mass': (slice(0, 1), 1.0), 'centre': (slice(1, 4), 1e3), 'inertia': (slice(4, 10), 1.0)}


@dataclass(frozen=True)
class Row:
    """A robot, a speed of approach in m/s, and times after the capture, s, whose estimates count."""

    robot: str
    approach: float
    times: tuple[float, ...]

    @property
    def name(self) -> str:
        """The name of its file."""
        return f'{self.robot}-{1e3 * self.approach:g}-{self.times[-1]:g}'


ROWS = [
    Row(robot, approach, times)
    for times in ((REST,), (REST + 10.0, REST + 30.0, REST + 60.0))
    for robot in ('servicer7', 'table1')
    for approach in (0.005, 0.05)
]


@dataclass(frozen=True)
class Outcome(Runs):
    """Errors and standard deviations (N, 2, T, 10), with and without the poses, NaN where withheld."""

    error: Array
    std: Array


def run(row: Row, seed: int) -> Outcome:
    """Return the outcome of a seed."""
    made = caught(row.robot, seed, row.approach, after=row.times[-1] + _MARGIN)
    both = [numbers(estimates(made, tracked=tracked), made.together, row.times) for tracked in (True, False)]
    return Outcome(*np.moveaxis(np.array(both), 2, 0))


def numbers(found: list[Estimate], true: Array, times: tuple[float, ...]) -> Array:
    """Return error and standard deviation (T, 2, 10) of the last estimate by each time; NaN where it is withheld."""
    rows = []
    for time in times:
        last = [each for each in found if each.time <= CAPTURE + time][-1]
        given = last.identifiable if last.status != 'inconsistent' else np.zeros(10, dtype=bool)
        rows.append(np.where(given, np.array((last.parameters - true, last.std)), np.nan))
    return np.array(rows)


def lines(row: Row, outcome: Outcome) -> Iterator[list[str]]:
    """Yield the lines of a row, one a time."""
    for place, time in enumerate(row.times):
        error, std = outcome.error[:, :, place], outcome.std[:, :, place]
        motion = 'at rest' if time == REST else f'{time - REST:g} s'
        yield [
            f'{row.robot}, {1e3 * row.approach:g} mm/s',
            motion,
            str(len(error)),
            *(_size(unit * error[:, :, part]) for part, unit in _GROUPS.values()),
            _ratio(error),
            *(_coverage(error[:, index] / std[:, index]) for index in (0, 1)),
        ]


def _size(error: Array) -> str:
    """Return the root mean square of errors (N, 2, k) and the share of runs that publish any, with and without."""
    cells = []
    for each in (error[:, 0], error[:, 1]):
        known = np.isfinite(each)
        rms = float(np.sqrt(np.mean(each[known] ** 2))) if known.any() else np.nan
        cells.append(f'{number(rms)} ({percent(float(np.mean(known.any(axis=1))))})')
    return ' / '.join(cells)


def _ratio(error: Array) -> str:
    """Return the median over the numbers of rms errors (N, 2, 10) with over without, in runs that publish both."""
    both = np.isfinite(error).sum(axis=1) == error.shape[1]
    square = np.sum(np.where(both[:, None], error, 0.0) ** 2, axis=0)[:, both.any(axis=0)]
    return number(float(np.sqrt(np.median(square[0] / square[1])))) if square.size else '-'


def _coverage(relative: Array) -> str:
    """Return the share of errors over their standard deviations (N, 10) within 95 %, and the largest."""
    given = np.abs(relative[np.isfinite(relative)])
    return f'{percent(float(np.mean(given < _INTERVAL)))} ({given.max():.1f})' if given.size else '-'


_HEADER = (
    'robot, approach',
    'motion',
    'runs',
    'mass, kg',
    'centre, mm',
    'inertia, kg m²',
    'error with / without',
    'within 95 %: with',
    'without',
)


def main() -> None:
    """Run the benchmark."""
    frame = Frame(__doc__, 'measured/accuracy.md', seeds=50)
    rows = frame.chosen(ROWS, lambda row: row.name)
    found = [
        line
        for row, outcome in frame.outcomes(Outcome, run, {row: row.name for row in rows})
        for line in lines(row, outcome)
    ]
    text = table(_HEADER, found)
    print(text)
    frame.write(tracked=f'{text}\n\n{provenance()}')


if __name__ == '__main__':
    main()
