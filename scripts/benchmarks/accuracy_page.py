"""The page docs/accuracy.md and its figure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.accuracy import Summary, Times
from benchmarks.data import ROBOTS, Case, target
from benchmarks.frame import number, percent, provenance, table
from benchmarks.methods import METHODS
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.sensor_levels import CHANNELS

FIGURE = 'accuracy.svg'
_MOST = 0.5  # of the runs: if fewer publish, their errors are those of a selection
_WIDTH = 0.8  # of the bars of one group
Results = dict[Case, dict[str, list[Summary]]]  # by case and method, a Summary for each time


@dataclass(frozen=True)
class Report:
    """All numbers of the page and the figure."""

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


def page(report: Report) -> str:
    """Return the page as Markdown."""
    errors = [
        f'**{ROBOTS[robot]}**\n\n{table(["encoders, after", *METHODS], _errors(report, robot))}\n'
        for robot in report.robots
    ]
    parts = [_INTRODUCTION.format(provenance=provenance(_seeds(report)), figure=FIGURE), _ERRORS, *errors]
    parts += [_INTERVALS, table(_INTERVALS_HEADER, _intervals(report)), _UNITS]
    parts.append(table(['robot, encoders', 'method', 'mass, %', 'CoM, mm', 'inertia, %'], _units(report)))
    names = [channel.replace('_', ' ') for channel in CHANNELS]
    parts += [_NOISE, table(['robot, encoders, after', *names], _noise(report)), _LINKED, _linked(report)]
    if report.poor:
        parts += [_SENSORS, table(_SENSORS_HEADER, _sensors(report))]
    if report.still:
        methods = [method for method in METHODS if not METHODS[method].finds_noise]
        parts += [_FRAMES, table(['robot, frame', *methods], _frames(report, methods))]
    return '\n'.join(f'{part}\n' if part.startswith('|') else part for part in parts)


def lines(report: Report) -> Iterator[str]:
    """Yield one line of text for each case, method and time."""
    for case in report.plan:
        for method in report.results[case]:
            for time, summary in report.timed(case, method):
                intervals = ''
                if summary.reports_std:
                    low, high = np.nanmin(summary.coverage), np.nanmax(summary.coverage)
                    band = '({:.2f}, {:.2f})'.format(*summary.nees_band)
                    intervals = f'  coverage {low:.2f} ... {high:.2f}, NEES {summary.nees:.2f} in {band}'
                ratio = f'{number(summary.median):>5s}, worst {number(summary.worst):>5s} {summary.worst_name:5s}'
                published = f'published {percent(summary.determined):>5s}'
                yield f'{case.name:32s} {method:26s} {time:3.0f} s  RMSE/bound {ratio}  {published}{intervals}'


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
    parts = []
    for robot in report.robots:
        most = report.plan[report.plain(robot)[0]][1]
        runs = {name: method.runs(most, plain=True) for name, method in METHODS.items()}
        fewer = [f'{count} for {name}' for name, count in runs.items() if count < most]
        parts.append(f'{most} seeds for {robot}' + (f' ({", ".join(fewer)})' if fewer else ''))
    return ', '.join(parts)


def draw(report: Report, path: Path) -> None:
    """Write the figure: error over the bound at the end, and coverage at all times, a column for each robot."""
    # Text stays text, and nothing depends on the date.
    with mpl.rc_context({'svg.fonttype': 'none', 'svg.hashsalt': 'accuracy', 'font.size': 9}):
        figure = Figure(figsize=(4.0 * len(report.robots), 6.0), layout='constrained')
        axes = figure.subplots(2, len(report.robots), squeeze=False)
        for column, robot in enumerate(report.robots):
            _draw_errors(axes[0, column], report, robot)
            _draw_coverage(axes[1, column], report, robot)
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc='outside lower center', ncols=min(len(labels), 5), frameon=False)
        figure.savefig(path, metadata={'Date': None})


def _draw_errors(axes: Axes, report: Report, robot: str) -> None:
    """Draw the median over the parameters as bars and the worst of them as marks."""
    cases, width = report.plain(robot), _WIDTH / len(METHODS)
    for index, method in enumerate(METHODS):
        last = [report.results[case][method][-1] for case in cases]
        place = np.arange(len(cases)) + (index + 0.5) * width - 0.5 * _WIDTH
        axes.bar(place, [summary.median for summary in last], width, color=f'C{index}', label=method)
        axes.plot(place, [summary.worst for summary in last], 'k_')
    axes.axhline(1.0, color='k', linewidth=0.8, linestyle='--')
    axes.set(yscale='log', title=ROBOTS[robot])
    axes.set_xticks(np.arange(len(cases)), [case.level for case in cases])
    end = report.plan[cases[0]][0][-1]
    axes.set_ylabel(f'RMSE over bound at {end:.0f} s\n(bar: median, mark: worst parameter)')


def _draw_coverage(axes: Axes, report: Report, robot: str) -> None:
    """Draw the pooled coverage as points and the range over the parameters as bars."""
    cases, labels = report.plain(robot), []
    for case in cases:
        times = [f'{time:.0f}' for time in report.plan[case][0]]
        times[len(times) // 2] += f'\n{case.level}'
        labels += times
    honest = [method for method in METHODS if any(each.reports_std for each in report.results[cases[0]][method])]
    for offset, method in enumerate(honest):
        covered = [
            each.coverage if each.reports_std else [np.nan] for case in cases for each in report.results[case][method]
        ]
        pooled = np.array([float(np.mean(x)) if np.isnan(x).all() else np.nanmean(x) for x in covered])
        limits = np.array([(np.fmin.reduce(x), np.fmax.reduce(x)) for x in covered])
        place = np.arange(len(covered)) + 0.2 * (offset - 0.5 * (len(honest) - 1))
        colour, spread = f'C{list(METHODS).index(method)}', np.abs(limits.T - pooled)
        axes.errorbar(place, 100.0 * pooled, 100.0 * spread, fmt='o', color=colour, markersize=4)
    axes.axhline(95.0, color='k', linewidth=0.8, linestyle='--')
    axes.set_ylim(min(80.0, axes.get_ylim()[0]), 100.5)
    axes.set_xticks(np.arange(len(labels)), labels)
    axes.set_xlabel('after, s')
    axes.set_ylabel('coverage of the 95 % intervals, %')


_INTERVALS_HEADER = (
    *('robot, encoders, after', 'method', 'coverage', 'by parameter', 'NEES', 'its 95 % band', 'published'),
    *('converged', 'false alarms'),
)
_SENSORS_HEADER = (
    *('robot, encoders, what differs', 'method', 'after', 'RMSE / bound', '/ limit of these sensors', 'coverage'),
    *('NEES', 'its 95 % band'),
)
_INTRODUCTION = """\
# Accuracy

Errors of the estimates over the smallest errors that the data allow, and the coverage of the reported intervals.
{provenance}
All robots here are exactly their URDF, and declared so; [model-errors.md](model-errors.md) has those that are not.

![Error over the bound and coverage]({figure})

The robots of `config/` move as their `*_simulator.yaml` commands. Joints and odometry come at 100 Hz with white noise,
drawn anew for every robot, level and seed. The base's pose and twist have 1 mm, 1e-4 rad, 1 mm/s and 1e-4 rad/s. The
encoders have 1e-5 rad and 1e-4 rad/s (*low*), 1e-4 rad and 1e-3 rad/s (*mid*), or 1e-3 rad and 1e-2 rad/s (*high*).
Each run lasts 60 s; its estimates are compared at the times of the tables.

The bound is the Cramér-Rao bound of the per-sample model: the momentum equations of every sample, with the noise of its
sensors in all of their terms, and unknown body and total momentum. A method that links the samples, as `trajectory`
does, may lie below. `paper_main` is given the true angular momentum, and the paper's methods assume zero linear
momentum: they know more than the bound does. Their recursion has the paper's forgetting factor of 0.99 a sample.
"""
_ERRORS = """\
## Error over the bound

RMSE over the bound: median over the parameters and (in brackets) the worst of them. A dash: the method determined
nothing in any run. A star: it published every parameter in fewer than half of the runs, a selection.
"""
_INTERVALS = """\
## Reported uncertainty

*Coverage*: share of the reported 95 % intervals that hold the truth, over all parameters, and the smallest and largest
of a parameter. *NEES*: normalised estimation error squared, a parameter (1 is right, more is overconfident), with the
band of 95 % of such averages. *Published*: share of runs with every parameter. *Converged*: share with that status.
*False alarms*: estimates until then with the status `inconsistent`, although nothing is wrong.
"""
_UNITS = """\
## In units

RMSE at the end of the runs: mass, the CoM's worst coordinate, the inertia's worst element over sqrt(I_ii I_jj).
"""
_NOISE = """\
## Estimated noise

`trajectory, noise found` estimates the noise of the sensors from the data. Relative error, root mean square over the
runs:
"""
_LINKED = """\
## Over the bound of the whole trajectory

RMSE of `trajectory` over the bound for methods that link all samples, median (worst), and that bound over the
per-sample one. Its unknowns are body, momentum, first pose and the paths of the joints, cubic splines with a knot each
second (`scripts/benchmarks/bounds.py`).
"""
_SENSORS = """\
## Fewer sensors, odometry whose errors are not white

*Poses alone*: joint positions and base poses without velocities. *Wander*: the odometry's position walks randomly by
1 mm a square root of a second. *Correlated*: the pose errors are an autoregression with that time constant, undeclared.
*Outliers*: that share of the poses is 0.2 m and 5 degrees off. Odometry *at 10 Hz* comes beside joint states at 100 Hz.
RMSE is over the per-sample bound with all sensors and white noise, median (worst); then, median, over the bound of the
whole trajectory for the sensors of the row (with their correlation, without outliers and wander).
"""
_FRAMES = """\
## Drifting, and far from the origin

The same runs at *mid* noise, seen from a frame in which the system drifts, or with the base far from the odometry's
origin. RMSE over the bound at the end of the runs, median (worst), over the same seeds in every row.
"""
