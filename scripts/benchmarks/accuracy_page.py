"""The page docs/accuracy.md: every method beside the statistical limit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.accuracy_words import ERRORS, FRAMES, INTERVALS, INTRODUCTION, LINKED, NOISE, SENSORS, UNITS
from benchmarks.data import ROBOTS, Case
from benchmarks.methods import METHODS
from benchmarks.pages import number, percent, provenance, table
from benchmarks.runs import Job
from benchmarks.summary import Summary
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.sensors.levels import CHANNELS

_MOST = 0.5  # of the runs: where fewer publish, their errors are those of a choice

# By case, then by method: one Summary for each of the case's times.
Results = dict[Case, dict[str, list[Summary]]]


@dataclass(frozen=True)
class Report:
    """Everything a page or a figure shows.

    Attributes
    ----------
    plan : what was run of each case
    results : statistics
    still : the same of the cases that drifting and distant ones compare with, over as few runs
    bounds : (T, 10) for each case, of the per-sample model with all sensors
    linked : the same of the whole trajectory with the case's own sensors
    truths : (10,) physical parameters of each robot
    methods : their names
    """

    plan: dict[Case, Job]
    results: Results
    still: Results
    bounds: dict[Case, Array]
    linked: dict[Case, Array]
    truths: dict[str, Array]
    methods: tuple[str, ...]

    def plain(self, robot: str) -> list[Case]:
        """Return a robot's cases near the origin of a frame in which it does not drift."""
        return [case for case in self.plan if case.robot == robot and case.plain]

    def robots(self) -> list[str]:
        """Return the robots that were run."""
        return [robot for robot in ROBOTS if self.plain(robot)]


def page(report: Report, figure: str) -> str:
    """Return the page as Markdown."""
    parts = [
        INTRODUCTION.format(provenance=provenance(_seeds(report)), figure=figure),
        ERRORS,
        *(_errors(report, robot) for robot in report.robots()),
        INTERVALS,
        _intervals(report),
        UNITS,
        _units(report),
    ]
    if found := [method for method in report.methods if METHODS[method].finds_noise]:
        parts += [NOISE, *(_noise(report, method) for method in found)]
    if 'trajectory' in report.methods:
        parts += [LINKED, _linked(report)]
    if any(_poor(case) for case in report.plan):
        parts += [SENSORS, _sensors(report)]
    if any(case.drift or case.offset for case in report.plan):
        parts += [FRAMES.format(seeds=_fewest(report)), _frames(report)]
    return '\n'.join(parts) + '\n'


def lines(report: Report) -> Iterator[str]:
    """Yield one line of text for each case, method and time."""
    for case, job in report.plan.items():
        for method in report.methods:
            for time, summary in zip(job.times, report.results[case].get(method, ()), strict=False):
                intervals = ''
                if summary.reports_std:
                    intervals = (
                        f'  coverage {np.nanmin(summary.coverage):.2f} ... {np.nanmax(summary.coverage):.2f}, '
                        f'NEES {summary.nees:.2f} in ({summary.nees_band[0]:.2f}, {summary.nees_band[1]:.2f})'
                    )
                yield (
                    f'{case.name:32s} {method:26s} {time:3.0f} s  RMSE/bound {number(summary.median):>5s}, '
                    f'worst {number(summary.worst):>5s} {summary.worst_name:5s}  published '
                    f'{percent(summary.determined):>5s}{intervals}'
                )


def _ratio(summary: Summary) -> str:
    if not np.isfinite(summary.median):
        return '-'
    return f'{number(summary.median)} ({number(summary.worst)}){"" if summary.determined > _MOST else " *"}'


def _errors(report: Report, robot: str) -> str:
    rows = [
        [
            f'{case.level}, {time:.0f} s',
            *(_ratio(report.results[case][method][index]) for method in report.methods),
        ]
        for case in report.plain(robot)
        for index, time in enumerate(report.plan[case].times)
    ]
    return f'**{ROBOTS[robot]}**\n\n{table(["encoders, after", *report.methods], rows)}\n'


def _intervals(report: Report) -> str:
    rows = [
        [
            f'{robot}, {case.level}, {time:.0f} s',
            method,
            percent(float(np.nanmean(summary.coverage))),
            f'{percent(float(np.nanmin(summary.coverage)))} to {percent(float(np.nanmax(summary.coverage)))}',
            number(summary.nees),
            f'{number(summary.nees_band[0])} to {number(summary.nees_band[1])}',
            percent(summary.determined),
            percent(summary.converged),
            f'{summary.alarms} of {summary.estimates}',
        ]
        for robot in report.robots()
        for case in report.plain(robot)
        for method in report.methods
        for time, summary in zip(report.plan[case].times, report.results[case][method], strict=True)
        if summary.reports_std
    ]
    header = ['robot, encoders, after', 'method', 'coverage', 'by parameter', 'NEES', 'its 95 % band']
    header += ['published', 'converged', 'false alarms']
    return table(header, rows) + '\n'


def _units(report: Report) -> str:
    rows = []
    for robot in report.robots():
        truth = report.truths[robot]
        for case in report.plain(robot):
            for label, errors in _last_errors(report, case):
                mass, com, inertia = _in_units(errors, truth)
                rows.append([f'{robot}, {case.level}', label, number(mass, 4), number(com, 3), number(inertia, 3)])
    return table(['robot, encoders', 'method', 'mass, %', 'CoM, mm', 'inertia, %'], rows) + '\n'


def _noise(report: Report, method: str) -> str:
    rows = []
    for case in [case for robot in report.robots() for case in report.plain(robot)]:
        for time, summary in zip(report.plan[case].times, report.results[case][method], strict=True):
            rms = np.sqrt(np.nanmean((summary.noise - 1.0) ** 2, axis=0))
            rows.append([f'{case.name}, {time:.0f} s', *(percent(each) for each in rms)])
    return table(['robot, encoders, after', *(channel.replace('_', ' ') for channel in CHANNELS)], rows) + '\n'


def _last_errors(report: Report, case: Case) -> Iterator[tuple[str, Array]]:
    """Yield the bound's and every method's (10,) errors at the last time."""
    yield 'bound', report.bounds[case][-1]
    for method in report.methods:
        yield method, report.results[case][method][-1].rmse


def _poor(case: Case) -> bool:
    return not case.plain and not case.drift and not case.offset


def _linked(report: Report) -> str:
    groups: dict[tuple[float, ...], list[list[str]]] = {}
    for case in [case for case in report.linked if not _poor(case)]:
        summaries = report.results[case]['trajectory']
        limits = report.linked[case]
        over = [summary.rmse / limit for summary, limit in zip(summaries, limits, strict=True)]
        row = [
            case.name,
            *(f'{number(float(np.nanmedian(x)))} ({number(float(np.nanmax(x)))})' for x in over),
            *(number(float(np.nanmedian(x / y))) for x, y in zip(limits, report.bounds[case], strict=True)),
        ]
        groups.setdefault(report.plan[case].times, []).append(row)
    tables = []
    for instants, group in groups.items():
        times = [f'{time:.0f} s' for time in instants]
        tables.append(table(['robot, encoders', *times, *(f'limits at {time}' for time in times)], group))
    return '\n\n'.join(tables) + '\n'


def _sensors(report: Report) -> str:
    rows = [
        [
            case.name,
            method,
            f'{time:.0f} s',
            _ratio(summary),
            *_against(summary, limit),
        ]
        for case in report.plan
        if _poor(case)
        for method in report.methods
        for time, summary, limit in zip(
            report.plan[case].times, report.results[case].get(method, ()), report.linked[case], strict=False
        )
    ]
    header = ['robot, encoders, what differs', 'method', 'after', 'RMSE / bound', '/ limit of these sensors']
    return table([*header, 'coverage', 'NEES', 'its 95 % band'], rows) + '\n'


def _against(summary: Summary, limit: Array) -> tuple[str, ...]:
    """Return the RMSE over a limit, coverage, NEES and its band; dashes where nothing was published."""
    if not summary.reports_std:
        return ('-',) * 4
    band = f'{number(summary.nees_band[0])} to {number(summary.nees_band[1])}'
    ratio, covered = float(np.nanmedian(summary.rmse / limit)), float(np.nanmean(summary.coverage))
    return number(ratio), percent(covered), number(summary.nees), band


def _in_units(errors: Array, truth: Array) -> tuple[float, float, float]:
    """Return mass in %, the CoM's largest coordinate in mm, and inertia in %, the largest I_ij over sqrt(I_ii I_jj)."""
    size = np.sqrt(truth[[4, 4, 4, 7, 7, 9]] * truth[[4, 7, 9, 7, 9, 9]])
    inertia = errors[4:] / size
    return (
        100.0 * float(errors[0] / truth[0]),
        1e3 * float(np.nanmax(errors[1:4], initial=0.0)) if np.any(np.isfinite(errors[1:4])) else np.nan,
        100.0 * float(np.nanmax(inertia)) if np.any(np.isfinite(inertia)) else np.nan,
    )


def _frames(report: Report) -> str:
    rows, methods = [], [method for method in report.methods if not METHODS[method].finds_noise]
    for case in [*report.still, *(case for case in report.plan if case.drift or case.offset)]:
        results = report.results if case.drift or case.offset else report.still
        rows.append([f'{case.robot}, {_frame(case)}', *(_ratio(results[case][method][-1]) for method in methods)])
    return table(['robot, frame', *methods], sorted(rows, key=lambda row: row[0].partition(',')[0])) + '\n'


def _frame(case: Case) -> str:
    if case.offset:
        return f'{case.offset / 1e3:g} km away'
    return f'drifts {1e3 * case.drift:g} mm/s' if case.drift else 'at rest at the origin'


def _fewest(report: Report) -> int:
    return min(job.seeds for job in report.plan.values())


def _seeds(report: Report) -> str:
    parts = []
    for robot in report.robots():
        most = report.plan[report.plain(robot)[0]].seeds
        runs = {name: METHODS[name].runs(most, plain=True) for name in report.methods}
        fewer = [f'{count} for {name}' for name, count in runs.items() if count < most]
        parts.append(f'{most} seeds for {robot}' + (f' ({", ".join(fewer)})' if fewer else ''))
    return ', '.join(parts)
