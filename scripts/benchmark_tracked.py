"""Print errors and coverage after the capture of a body that was tracked, with and without its poses.

    python scripts/benchmark_tracked.py servicer7 0.05 --seeds 12 --after 34

Encoders and odometry of the middle kind at 20 Hz, poses of the body with 5 mm and 5 mrad at 5 Hz for 60 s, 3 deg/s.
"""

import argparse
import sys

import numpy as np

from benchmarks.frame import table
from benchmarks.tracked import AFTER, CAPTURE, REST, caught, estimates
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate

_AT_REST = 2.5  # s after the capture, with the arm at rest
_INTERVAL = 1.96  # standard deviations
_GROUPS = {'mass': slice(0, 1), 'centre of mass': slice(1, 4), 'inertia': slice(4, 10)}


def times(after: float) -> list[float]:
    """Return the times after the capture, s, of which estimates count."""
    return [_AT_REST, *(REST + motion for motion in (10.0, 30.0, 60.0) if REST + motion < after)]


def errors(found: list[Estimate], true: Array, moments: list[float]) -> Array:
    """Return error and standard deviation (T, 2, 10) of the last estimate by each time; NaN where it is withheld."""
    rows = []
    for moment in moments:
        last = [each for each in found if each.time <= CAPTURE + moment][-1]
        given = last.identifiable if last.status != 'inconsistent' else np.zeros(10, dtype=bool)
        both = np.array((last.parameters - true, last.std))
        rows.append(np.where(given, both, np.nan))
    return np.array(rows)


def main() -> None:
    """Print the table of one robot and one speed of approach."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('robot', choices=('servicer7', 'table1'))
    parser.add_argument('approach', type=float, help='m/s')
    parser.add_argument('--seeds', type=int, default=50)
    parser.add_argument('--after', type=float, default=AFTER, help='s, after the capture')
    given = parser.parse_args()
    moments = times(given.after)
    results: list[list[Array]] = [[], []]
    for seed in range(given.seeds):
        run = caught(given.robot, seed, given.approach, after=given.after)
        for place, tracked in enumerate((True, False)):
            results[place].append(errors(estimates(run, tracked=tracked), run.together, moments))
            print(given.robot, given.approach, seed, tracked, results[place][-1].tolist(), file=sys.stderr, flush=True)
    rows = []
    for place, name in enumerate(('tracked', 'not tracked')):
        every = np.array(results[place])  # (seeds, T, 2, 10)
        for index, moment in enumerate(moments):
            for group, part in _GROUPS.items():
                error, std = every[:, index, 0, part], every[:, index, 1, part]
                known = np.isfinite(error)
                if not known.any():
                    rows.append([name, f'{moment:g} s', group, '0 %', '-', '-', '-'])
                    continue
                within = float(np.mean(np.abs(error[known]) < _INTERVAL * std[known]))
                rms, most = float(np.sqrt(np.mean(error[known] ** 2))), float(np.max(np.abs(error / std)[known]))
                rows.append(
                    [
                        name,
                        f'{moment:g} s',
                        group,
                        f'{np.mean(known):.0%}',
                        f'{rms:.3g}',
                        f'{within:.0%}',
                        f'{most:.1f}',
                    ]
                )
    header = ['poses', 'after the capture', 'parameters', 'published', 'rms error', 'within 95 %', 'largest deviation']
    print(table(header, rows))


if __name__ == '__main__':
    main()
