"""Write the table of docs/trajectory.md that says how often a run which starts from nothing ends well.

usage: cold_starts.py [--seeds N] [--robots ROBOT ...] [--levels LEVEL ...] [--store FOLDER] [--processes N]
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'scripts'))

from benchmarks.data import LEVELS, Case, kernel, momentum_of, motion, observed  # noqa: E402 - from beside this file
from benchmarks.driver import add_run_arguments, driving, parser_of  # noqa: E402
from benchmarks.methods import Identification  # noqa: E402
from benchmarks.pages import machine, number, percent, replace_marked, table  # noqa: E402
from benchmarks.store import Runs  # noqa: E402
from mbaid_ros.core.geometry import Array  # noqa: E402
from mbaid_ros.core.robot.momentum import physical  # noqa: E402
from mbaid_ros.replay.campaigns.monte_carlo import nees  # noqa: E402

PAGE = ROOT / 'docs' / 'trajectory.md'
SECONDS, METHOD = 20.0, 'trajectory'
DIVERGED = 10.0  # times the expected squared error, in the reported covariance, a parameter


@dataclass(frozen=True)
class Starts(Runs):
    """What a run, or R runs, of `SECONDS` led to.

    Attributes
    ----------
    told : (R,) s, of the first estimate; infinite where there is none
    settled : (R,) s, of the first from which on the squared error stays below `DIVERGED` times what is expected
    nees : (R,) squared error of the last estimate in the reported covariance, a parameter (1 expected)
    mass : (R,) error of the mass at the end, relative
    """

    told: Array
    settled: Array
    nees: Array
    mass: Array


def start(work: tuple[Case, int]) -> Starts:
    """Return what a run led to."""
    case, seed = work
    truth = motion(case.robot)
    truth = truth[: int(np.searchsorted(truth.time, SECONDS + 1e-9))]
    task = Identification(kernel(case.robot), case.noise, momentum_of(case.robot, truth))
    history = task.estimates(METHOD, *observed(truth, case, seed))
    right = physical(kernel(case.robot).target.parameters)
    errors = np.array([nees(estimate, right) for estimate in history])
    times = np.array([estimate.time for estimate in history])
    given = np.isfinite(errors)
    given_at, wrong_at = times[given], times[given & ~(errors < DIVERGED)]
    right_at = given_at[given_at > np.max(wrong_at, initial=-np.inf)]
    return Starts(
        told=np.min(given_at, initial=np.inf),
        settled=np.min(right_at, initial=np.inf),
        nees=errors[-1],
        mass=history[-1].parameters[0] / right[0] - 1.0,
    )


def row(case: Case, starts: Starts) -> list[str]:
    """Return a row of the table."""
    ended = np.isfinite(starts.nees)
    return [
        f'`{case.robot}` {case.level}',
        str(len(starts)),
        percent(float(np.mean(ended))),
        str(int(np.sum(starts.nees >= DIVERGED))),
        f'{number(float(np.median(starts.told)), 1)}, {number(float(np.max(starts.told)), 1)}',
        f'{number(float(np.median(starts.settled)), 1)}, {number(float(np.max(starts.settled)), 1)}',
        number(float(np.nanmean(starts.nees))),
        number(float(np.nanmax(starts.nees)), 1),
        f'{100.0 * float(np.nanmax(np.abs(starts.mass))):.2g} %',
    ]


def main() -> None:
    """Write the table."""
    parser = parser_of(__doc__)
    add_run_arguments(parser, 500, 500)
    parser.add_argument('--robots', nargs='+', default=['servicer7'], metavar='ROBOT', help='default: servicer7')
    parser.add_argument('--levels', nargs='+', choices=list(LEVELS), default=list(LEVELS), help='encoder noise')
    arguments = parser.parse_args()
    cases = [Case(robot, level) for robot in arguments.robots for level in arguments.levels]
    for robot in arguments.robots:
        motion(robot)  # once, for all processes
    rows = []
    with driving(len(cases) * arguments.seeds, arguments.processes, arguments.store) as driver:
        for case in cases:
            work = [(case, seed) for seed in range(arguments.seeds)]
            rows.append(row(case, driver.completed(Starts, f'cold-{case.robot}-{case.level}', work, start)))
            print(' | '.join(rows[-1]), flush=True)
    header = ['run', 'seeds', 'with an estimate', 'diverged', 'first estimate, s: median, latest']
    header += ['settled, s', 'NEES: mean', 'largest', 'largest error of the mass']
    text = f'{table(header, rows)}\n\nMeasured on: {machine()}.'
    replace_marked(PAGE, 'cold starts', 'scripts/cold_starts.py', text)


if __name__ == '__main__':
    main()
