"""Monte Carlo over sensor noise: the methods' errors beside the Cramér-Rao bound, and whether their intervals hold.

usage: benchmark_accuracy.py [--seeds N] [--quick] [--robots R ...] [--levels L ...] [--methods M ...]
       [--sections S ...] [--store FOLDER] [--output FOLDER]
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks import accuracy_page, figures, pages
from benchmarks.bound import bound
from benchmarks.data import LEVELS, ROBOTS, Case, kernel, motion, moved
from benchmarks.driver import add_run_arguments, parser_of
from benchmarks.methods import METHODS
from benchmarks.runs import Job, Outcome, monte_carlo
from benchmarks.summary import summarise
from benchmarks.trajectory_bound import trajectory_bound
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.momentum import physical

_SEEDS, _QUICK_SEEDS = {'servicer7': 200, 'ets7': 100, 'table1': 100}, 8
_OTHER_SEEDS, _SLOW_SEEDS = 50, 100  # of what is not a plain case, and of slow odometry
_TIMES = {'table1': (20.0, 60.0)}
_TIMES_IN_SPACE = (2.0, 5.0, 10.0, 20.0, 60.0)
_DRIFTS = (0.01, 0.1)  # m/s
_OFFSETS = (1e5, 7e6)  # m
_WANDER = 1e-3  # m / sqrt(s)
_CORRELATED = 0.3  # s
_OUTLIERS = (0.01, 0.05)
_EVERY = 10  # joint states for an Odometry
_SECTIONS = ('frames', 'sensors')
_EXAMPLE = 'servicer7'  # the robot of these
_FIGURE = 'accuracy.svg'


def main() -> int:
    """Run the benchmark and return the exit code."""
    arguments = _parse()
    fixed = arguments.seeds or (_QUICK_SEEDS if arguments.quick else None)
    robots, methods = tuple(arguments.robots), tuple(arguments.methods)
    plan = {
        Case(robot, level): Job(_TIMES.get(robot, _TIMES_IN_SPACE), fixed or _SEEDS[robot])
        for robot in robots
        for level in arguments.levels
    }
    if not arguments.quick:
        others = {'frames': _frames, 'sensors': _sensors}
        for section in arguments.sections:
            plan |= {
                other: Job(job.times, min(job.seeds, _SLOW_SEEDS if other.every > 1 else _OTHER_SEEDS))
                for case, job in plan.items()
                for other in others[section](case)
            }
    truths = {robot: physical(kernel(robot).target.parameters) for robot in robots}
    outcomes = monte_carlo(plan, truths, methods, arguments.processes, arguments.store)
    motions = {case: moved(motion(case.robot), case) for case in plan}
    bounds = {case: bound(_measured(case), motions[case], job.times) for case, job in plan.items()}
    linked = {
        case: trajectory_bound(case, motions[case], job.times)
        for case, job in plan.items()
        if not case.drift and not case.offset
    }
    results = {
        case: {method: summarise(outcome, truths[case.robot], bounds[case]) for method, outcome in by_method.items()}
        for case, by_method in outcomes.items()
    }
    report = accuracy_page.Report(plan, results, _still(outcomes, truths, bounds), bounds, linked, truths, methods)
    for line in accuracy_page.lines(report):
        print(line)
    if arguments.output:
        pages.write(arguments.output, 'accuracy.md', accuracy_page.page(report, _FIGURE))
        figures.draw(report, arguments.output / _FIGURE)
    return 0


def _measured(case: Case) -> Case:
    """Return the case whose bound of the per-sample model a case is compared with: the same with all sensors."""
    return Case(case.robot, case.level, case.drift, case.offset)


def _sensors(case: Case) -> list[Case]:
    """Return a plain case with fewer sensors, and with odometry whose errors are not white."""
    if case.robot != _EXAMPLE or not case.plain:
        return []
    odd: list[dict[str, Any]] = [{'sensors': 'poses'}, {'wander': _WANDER}, {'correlated': _CORRELATED}]
    if case.level == 'mid':
        odd += [{'correlated': _CORRELATED, 'sensors': 'poses'}, *({'outliers': share} for share in _OUTLIERS)]
        odd += [{'every': _EVERY}]
    return [replace(case, **each) for each in odd]


def _frames(case: Case) -> list[Case]:
    """Return a case of mid noise seen from other frames."""
    if case.robot != _EXAMPLE or case.level != 'mid' or not case.plain:
        return []
    drifting = [replace(case, drift=drift) for drift in _DRIFTS]
    return drifting + [replace(case, offset=offset) for offset in _OFFSETS]


def _still(
    outcomes: dict[Case, dict[str, Outcome]], truths: dict[str, Array], bounds: dict[Case, Array]
) -> accuracy_page.Results:
    """Return the statistics of the cases that others are frames of, over no more runs than those have."""
    still: accuracy_page.Results = {}
    for case in [case for case in outcomes if _frames(case) and _frames(case)[0] in outcomes]:
        frame = outcomes[_frames(case)[0]]
        still[case] = {
            method: summarise(outcome[: len(frame[method].parameters)], truths[case.robot], bounds[case])
            for method, outcome in outcomes[case].items()
            if method in frame
        }
    return still


def _parse() -> argparse.Namespace:
    parser = parser_of(__doc__)
    add_run_arguments(parser, _SEEDS)
    parser.add_argument('--quick', action='store_true', help=f'{_QUICK_SEEDS} seeds, no drift, near the origin')
    parser.add_argument('--robots', nargs='+', choices=list(ROBOTS), default=list(ROBOTS))
    parser.add_argument('--levels', nargs='+', choices=list(LEVELS), default=list(LEVELS), help='encoder noise')
    parser.add_argument(
        '--methods', nargs='+', choices=list(METHODS), default=[name for name in METHODS if not METHODS[name].extra]
    )
    parser.add_argument('--sections', nargs='*', choices=_SECTIONS, default=_SECTIONS, help='besides the plain cases')
    parser.add_argument('--output', type=Path, metavar='FOLDER', help='write accuracy.md and its figure there')
    return parser.parse_args()


if __name__ == '__main__':
    sys.exit(main())
