"""The tables of docs/measured/accuracy.md."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.accuracy import Summary, Times
from benchmarks.data import ROBOTS, Case, target
from benchmarks.frame import number, percent, provenance, table
from benchmarks.methods import METHODS
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.sensors.levels import CHANNELS

_MOST = 0.5  # of the runs: if fewer publish, their errors are those of a selection
Results = dict[Case, dict[str, list[Summary]]]  # by case and method, a Summary for each time


@dataclass(frozen=True)
class Report:
    """All numbers of the page."""

    plan: dict[Case, tuple[Times, int]]  # times and number of seeds
    results: Results
    still: Results  # of the case that drifting and distant ones are compared with, over as few runs
    bounds: dict[Case, Array]  # (T, 10) of the per-sample model with all sensors
    linked: dict[Case, Array]  # (T, 10) of the whole trajectory with the case's own sensors

    def plain(self, robot: str) -> list[Case]:
        """Return a robot's plain cases."""
        return [case for case in self.plan if case.robot == robot and case.plain]

    @property
    def robots(self) -> list[str]:
        """Robots with plain cases."""
        return [robot for robot in ROBOTS if self.plain(robot)]

    @property
    def all_plain(self) -> list[Case]:
        """Plain cases of all robots."""
        return [case for robot in self.robots for case in self.plain(robot)]

    @property
    def poor(self) -> list[Case]:
        """Cases with fewer or worse sensors."""
        return [case for case in self.plan if not case.plain and not case.moved]

    def timed(self, case: Case, method: str) -> Iterator[tuple[float, Summary]]:
        """Yield times and statistics."""
        yield from zip(self.plan[case][0], self.results[case][method], strict=True)


def tables(report: Report) -> dict[str, str]:
    """Return the tables of the page by their names."""
    errors = [
        f'**{ROBOTS[robot]}**\n\n{table(["encoders, after", *METHODS], _errors(report, robot))}'
        for robot in report.robots
    ]
    channels = [channel.replace('_', ' ') for channel in CHANNELS]
    methods = [method for method in METHODS if not METHODS[method].finds_noise]
    texts = {
        'errors': '\n\n'.join([provenance(_seeds(report)), *errors]),
        'intervals': table(_INTERVALS, _intervals(report)),
        'units': table(['robot, encoders', 'method', 'mass, %', 'CoM, mm', 'inertia, %'], _units(report)),
        'noise': table(['robot, encoders, after', *channels], _noise(report)),
        'linked': _linked(report),
    }
    if report.poor:
        texts['sensors'] = table(_SENSORS, _sensors(report))
    if report.still:
        texts['frames'] = table(['robot, frame', *methods], _frames(report, methods))
    return texts


def _ratio(summary: Summary) -> str:
    if not np.isfinite(summary.median):
        return '-'
    return f'{number(summary.median)} ({number(summary.worst)}){"" if summary.determined > _MOST else " *"}'


def _band(summary: Summary) -> str:
    return f'{number(summary.nees_band[0])} to {number(summary.nees_band[1])}'


def _errors(report: Report, robot: str) -> Iterator[list[str]]:
    for case in report.plain(robot):
        for index, time in enumerate(report.plan[case][0]):
            cells = [_ratio(report.results[case][method][index]) for method in METHODS]
            yield [f'{case.level}, {time:.0f} s', *cells]


def _intervals(report: Report) -> Iterator[list[str]]:
    for case in report.all_plain:
        for method in METHODS:
            for time, summary in report.timed(case, method):
                if summary.reports_std:
                    covered = [float(of(summary.coverage)) for of in (np.nanmean, np.nanmin, np.nanmax)]
                    yield [
                        f'{case.robot}, {case.level}, {time:.0f} s',
                        method,
                        percent(covered[0]),
                        f'{percent(covered[1])} to {percent(covered[2])}',
                        number(summary.nees),
                        _band(summary),
                        percent(summary.determined),
                        percent(summary.converged),
                        f'{summary.alarms} of {summary.estimates}',
                    ]


def _units(report: Report) -> Iterator[list[str]]:
    for case in report.all_plain:
        last = {method: report.results[case][method][-1].rmse for method in METHODS}
        for label, errors in {'bound': report.bounds[case][-1], **last}.items():
            mass, com, inertia = _in_units(errors, target(case.robot))
            yield [f'{case.robot}, {case.level}', label, number(mass, 4), number(com, 3), number(inertia, 3)]


def _in_units(errors: Array, truth: Array) -> tuple[float, float, float]:
    """Return mass in %, the CoM's largest coordinate in mm, and inertia in %, the largest I_ij over sqrt(I_ii I_jj)."""
    inertia = errors[4:] / np.sqrt(truth[[4, 4, 4, 7, 7, 9]] * truth[[4, 7, 9, 7, 9, 9]])
    com, moment = (float(np.nanmax(part)) if np.isfinite(part).any() else np.nan for part in (errors[1:4], inertia))
    return 100.0 * float(errors[0] / truth[0]), 1e3 * com, 100.0 * moment


def _noise(report: Report) -> Iterator[list[str]]:
    for method in [method for method in METHODS if METHODS[method].finds_noise]:
        for case in report.all_plain:
            for time, summary in report.timed(case, method):
                rms = np.sqrt(np.nanmean((summary.noise - 1.0) ** 2, axis=0))
                yield [f'{case.name}, {time:.0f} s', *(percent(each) for each in rms)]


def _linked(report: Report) -> str:
    groups: dict[Times, list[list[str]]] = {}
    for case in [case for case in report.linked if case not in report.poor]:
        limits = report.linked[case]
        over = [
            summary.rmse / limit for (_, summary), limit in zip(report.timed(case, 'trajectory'), limits, strict=True)
        ]
        row = [case.name, *(f'{number(float(np.nanmedian(x)))} ({number(float(np.nanmax(x)))})' for x in over)]
        row += [number(float(np.nanmedian(x / y))) for x, y in zip(limits, report.bounds[case], strict=True)]
        groups.setdefault(report.plan[case][0], []).append(row)
    tables = []
    for instants, group in groups.items():
        times = [f'{time:.0f} s' for time in instants]
        tables.append(table(['robot, encoders', *times, *(f'limits at {time}' for time in times)], group))
    return '\n\n'.join(tables)


def _sensors(report: Report) -> Iterator[list[str]]:
    for case in report.poor:
        for method in report.results[case]:
            for (time, summary), limit in zip(report.timed(case, method), report.linked[case], strict=True):
                against = ['-'] * 4
                if summary.reports_std:
                    ratio, covered = float(np.nanmedian(summary.rmse / limit)), float(np.nanmean(summary.coverage))
                    against = [number(ratio), percent(covered), number(summary.nees), _band(summary)]
                yield [case.name, method, f'{time:.0f} s', _ratio(summary), *against]


def _frames(report: Report, methods: list[str]) -> list[list[str]]:
    rows = []
    for case, by_method in {
        **report.still,
        **{case: report.results[case] for case in report.plan if case.moved},
    }.items():
        frame = f'drifts {1e3 * case.drift:g} mm/s' if case.drift else 'at rest at the origin'
        frame = f'{case.offset / 1e3:g} km away' if case.offset else frame
        rows.append([f'{case.robot}, {frame}', *(_ratio(by_method[method][-1]) for method in methods)])
    return rows


def _seeds(report: Report) -> str:
    return ', '.join(f'{report.plan[report.plain(robot)[0]][1]} seeds for {robot}' for robot in report.robots)


_INTERVALS = (
    *('robot, encoders, after', 'method', 'coverage', 'by parameter', 'NEES', 'its 95 % band', 'published'),
    *('converged', 'false alarms'),
)
_SENSORS = (
    *('robot, encoders, difference', 'method', 'after', 'RMSE / bound', '/ limit of these sensors', 'coverage'),
    *('NEES', 'its 95 % band'),
)
