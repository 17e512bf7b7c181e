"""Write measured/accuracy.md: errors of all methods over the Cramér-Rao bound, and the coverage of their intervals.

Without --seeds, servicer7 has 200 seeds and the other robots 100. A method's `share` may make them fewer.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from benchmarks import accuracy_page
from benchmarks.accuracy import Times, monte_carlo, summarise
from benchmarks.bounds import bound, trajectory_bound
from benchmarks.data import LEVELS, ROBOTS, Case, motion, target
from benchmarks.frame import Frame

_SEEDS = {'servicer7': 200, 'ets7': 100, 'table1': 100}
_OTHER_SEEDS, _SLOW_SEEDS = 50, 100  # at most, of cases that are not plain, and of slow odometry
_TIMES = {'table1': (20.0, 60.0)}
_TIMES_IN_SPACE = (2.0, 5.0, 10.0, 20.0, 60.0)
_EXAMPLE = 'servicer7'  # the robot of all cases that are not plain
_SENSORS: list[dict[str, Any]] = [{'sensors': 'poses'}, {'wander': 1e-3}, {'correlated': 0.3}]
_SENSORS_MID: list[dict[str, Any]] = [
    {'correlated': 0.3, 'sensors': 'poses'},
    {'outliers': 0.01},
    {'outliers': 0.05},
    {'every': 10},
]


def main() -> None:
    """Run the benchmark."""
    frame = Frame(__doc__, 'measured/accuracy.md', seeds=0)
    plan = {case: _job(case, frame.arguments.seeds) for case in frame.chosen(_cases(), lambda case: case.name)}
    outcomes = monte_carlo(frame, plan)
    motions = {case: motion(case.robot) for case in plan}
    # All sensors and white noise: the bound that every case is compared with.
    bounds = {case: bound(Case(case.robot, case.level), motions[case], times) for case, (times, _) in plan.items()}
    linked = {case: trajectory_bound(case, motions[case], times) for case, (times, _) in plan.items()}
    results = {
        case: {method: summarise(outcome, target(case.robot), bounds[case]) for method, outcome in by_method.items()}
        for case, by_method in outcomes.items()
    }
    report = accuracy_page.Report(plan, results, bounds, linked)
    texts = accuracy_page.tables(report)
    print(*texts.values(), sep='\n\n')
    frame.write(**texts)


def _cases() -> Iterator[Case]:
    yield from (Case(robot, level) for robot in ROBOTS for level in LEVELS)
    for level in LEVELS:
        odd = [*_SENSORS, *(_SENSORS_MID if level == 'mid' else ())]
        yield from (replace(Case(_EXAMPLE, level), **each) for each in odd)


def _job(case: Case, seeds: int) -> tuple[Times, int]:
    """Return the times of a case and its number of seeds."""
    count = seeds or _SEEDS[case.robot]
    if not case.plain:
        count = min(count, _SLOW_SEEDS if case.every > 1 else _OTHER_SEEDS)
    return _TIMES.get(case.robot, _TIMES_IN_SPACE), count


if __name__ == '__main__':
    main()
