"""Write measured/accuracy.md: errors of all methods over the Cramér-Rao bound, and the coverage of their intervals.

Without --seeds, servicer7 has 200 seeds and the other robots 100. A method's `share` may make them fewer.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.accuracy import METHODS, Summary, Times, monte_carlo, summarise
from benchmarks.bounds import bound, trajectory_bound
from benchmarks.data import LEVELS, ROBOTS, Case, motion, target
from benchmarks.frame import Frame, median_and_most, number, percent, provenance, table
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.noise import CHANNELS

_SEEDS = {'servicer7': 200, 'ets7': 100, 'table1': 100}
_OTHER_SEEDS, _SLOW_SEEDS = 50, 100  # at most, of cases that are not plain, and of slow odometry
_TIMES = {'table1': (20.0, 60.0)}
_TIMES_IN_SPACE = (2.0, 5.0, 10.0, 20.0, 60.0)
_EXAMPLE = 'servicer7'  # the robot of all cases that are not plain
_SENSORS: list[dict[str, Any]] = [{'sensors': 'poses'}, {'wander': 1e-3}, {'correlated': 0.3}]
_SENSORS_MID: list[dict[str, Any]] = [{'outliers': 0.01}, {'outliers': 0.05}, {'every': 10}]
_MOST = 0.5  # of the runs: if fewer publish, their errors are those of a selection
_AFTER, _BANDS = 'robot, encoders', 'NEES | its 95 % band'
_INTERVALS = f'{_AFTER}, after | method | coverage | by parameter | {_BANDS} | published | converged | false alarms'
_POOR = f'{_AFTER}, difference | method | after | RMSE / bound | / limit of these sensors | coverage | {_BANDS}'
Results = dict[Case, dict[str, list[Summary]]]  # by case and method, a Summary for each time


@dataclass(frozen=True)
class Report:
    """All numbers of the page."""

    plan: dict[Case, tuple[Times, int]]  # times and number of seeds
    results: Results
    bounds: dict[Case, Array]  # (T, 10) of the per-sample model with all sensors
    linked: dict[Case, Array]  # (T, 10) of the whole trajectory with the case's own sensors

    def plain(self, robot: str) -> list[Case]:
        """Return a robot's plain cases."""
        return [case for case in self.plan if case.robot == robot and case.plain]

    @property
    def robots(self) -> list[str]:
        """Robots with plain cases."""
        return [robot for robot in ROBOTS if self.plain(robot)]

    def chosen(self, *, plain: bool) -> list[Case]:
        """Return the plain cases, or those with fewer or worse sensors."""
        return [case for case in self.plan if case.plain == plain]

    def timed(self, case: Case, method: str) -> Iterator[tuple[float, Summary]]:
        """Yield times and statistics."""
        yield from zip(self.plan[case][0], self.results[case][method], strict=True)


def tables(report: Report) -> dict[str, str]:
    """Return the tables of the page by their names."""
    header = ['encoders, after', *METHODS]
    errors = [f'**{ROBOTS[robot]}**\n\n{table(header, _errors(report, robot))}' for robot in report.robots]
    seeds = ', '.join(f'{report.plan[report.plain(robot)[0]][1]} seeds for {robot}' for robot in report.robots)
    channels = [channel.replace('_', ' ') for channel in CHANNELS]
    texts = {
        'errors': '\n\n'.join([provenance(seeds), *errors]),
        'intervals': table(_INTERVALS.split(' | '), _intervals(report)),
        'noise': table(['robot, encoders, after', *channels], _noise(report)),
        'linked': _linked(report),
    }
    if report.chosen(plain=False):
        texts['sensors'] = table(_POOR.split(' | '), _sensors(report))
    return texts


def _ratio(summary: Summary) -> str:
    few = ' *' if np.any(np.isfinite(summary.ratio)) and not summary.determined > _MOST else ''
    return f'{median_and_most(summary.ratio)}{few}'


def _errors(report: Report, robot: str) -> Iterator[list[str]]:
    for case in report.plain(robot):
        for index, time in enumerate(report.plan[case][0]):
            cells = [_ratio(report.results[case][method][index]) for method in METHODS]
            yield [f'{case.level}, {time:.0f} s', *cells]


def _intervals(report: Report) -> Iterator[list[str]]:
    for case in report.chosen(plain=True):
        for method in METHODS:
            for time, summary in report.timed(case, method):
                if np.any(np.isfinite(summary.coverage)):
                    covered = [float(of(summary.coverage)) for of in (np.nanmean, np.nanmin, np.nanmax)]
                    yield [
                        f'{case.robot}, {case.level}, {time:.0f} s',
                        method,
                        percent(covered[0]),
                        f'{percent(covered[1])} to {percent(covered[2])}',
                        number(summary.nees),
                        ' to '.join(map(number, summary.nees_band)),
                        percent(summary.determined),
                        percent(summary.converged),
                        f'{summary.alarms} of {summary.estimates}',
                    ]


def _noise(report: Report) -> Iterator[list[str]]:
    for method in [method for method in METHODS if METHODS[method].finds_noise]:
        for case in report.chosen(plain=True):
            for time, summary in report.timed(case, method):
                rms = np.sqrt(np.nanmean((summary.noise - 1.0) ** 2, axis=0))
                yield [f'{case.name}, {time:.0f} s', *(percent(each) for each in rms)]


def _linked(report: Report) -> str:
    groups: dict[Times, list[list[str]]] = {}
    for case in report.chosen(plain=True):
        limits = report.linked[case]
        over = [summary.rmse / limit for summary, limit in zip(report.results[case]['trajectory'], limits, strict=True)]
        row = [case.name, *map(median_and_most, over)]
        row += [number(float(np.nanmedian(x / y))) for x, y in zip(limits, report.bounds[case], strict=True)]
        groups.setdefault(report.plan[case][0], []).append(row)
    tables = []
    for instants, group in groups.items():
        times = [f'{time:.0f} s' for time in instants]
        tables.append(table(['robot, encoders', *times, *(f'limits at {time}' for time in times)], group))
    return '\n\n'.join(tables)


def _sensors(report: Report) -> Iterator[list[str]]:
    for case in report.chosen(plain=False):
        for method in report.results[case]:
            for (time, summary), limit in zip(report.timed(case, method), report.linked[case], strict=True):
                against = ['-'] * 4
                if np.any(np.isfinite(summary.coverage)):
                    ratio, covered = float(np.nanmedian(summary.rmse / limit)), float(np.nanmean(summary.coverage))
                    band = ' to '.join(map(number, summary.nees_band))
                    against = [number(ratio), percent(covered), number(summary.nees), band]
                yield [case.name, method, f'{time:.0f} s', _ratio(summary), *against]


def main() -> None:
    """Run the benchmark."""
    frame = Frame(__doc__, 'measured/accuracy.md', seeds=0)
    plan: dict[Case, tuple[Times, int]] = {}
    for case in frame.chosen(_cases(), lambda case: case.name):
        count, most = frame.arguments.seeds or _SEEDS[case.robot], _SLOW_SEEDS if case.every > 1 else _OTHER_SEEDS
        plan[case] = _TIMES.get(case.robot, _TIMES_IN_SPACE), count if case.plain else min(count, most)
    outcomes = monte_carlo(frame, plan)
    motions = {case: motion(case.robot) for case in plan}
    # All sensors and white noise: the bound that every case is compared with.
    bounds = {case: bound(Case(case.robot, case.level), motions[case], times) for case, (times, _) in plan.items()}
    linked = {case: trajectory_bound(case, motions[case], times) for case, (times, _) in plan.items()}
    results = {
        case: {
            method: [summarise(outcome.at(k), target(case.robot), limit) for k, limit in enumerate(bounds[case])]
            for method, outcome in by_method.items()
        }
        for case, by_method in outcomes.items()
    }
    report = Report(plan, results, bounds, linked)
    texts = tables(report)
    print(*texts.values(), sep='\n\n')
    frame.write(**texts)


def _cases() -> Iterator[Case]:
    yield from (Case(robot, level) for robot in ROBOTS for level in LEVELS)
    for level in LEVELS:
        odd = [*_SENSORS, *([_SENSORS[0] | _SENSORS[2], *_SENSORS_MID] if level == 'mid' else ())]
        yield from (replace(Case(_EXAMPLE, level), **each) for each in odd)


if __name__ == '__main__':
    main()
