"""The figure of docs/accuracy.md."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.accuracy_page import Report
from benchmarks.data import ROBOTS
from benchmarks.summary import Summary

_WIDTH = 0.8  # of the bars of one group


def draw(report: Report, path: Path) -> None:
    """Write the figure: error over the bound at the end, and coverage at all times, a column for each robot."""
    robots = report.robots()
    # Text stays text, and nothing depends on when the figure was drawn.
    with mpl.rc_context({'svg.fonttype': 'none', 'svg.hashsalt': 'accuracy', 'font.size': 9}):
        figure = Figure(figsize=(4.0 * len(robots), 6.0), layout='constrained')
        axes = figure.subplots(2, len(robots), squeeze=False)
        for column, robot in enumerate(robots):
            _errors(axes[0, column], report, robot)
            _coverage(axes[1, column], report, robot)
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc='outside lower center', ncols=min(len(labels), 5), frameon=False)
        figure.savefig(path, metadata={'Date': None} if path.suffix == '.svg' else None)


def _errors(axes: Axes, report: Report, robot: str) -> None:
    """Draw the median over the parameters as bars and the worst of them as marks."""
    cases = report.plain(robot)
    width = _WIDTH / len(report.methods)
    for index, method in enumerate(report.methods):
        last = [report.results[case][method][-1] for case in cases]
        place = np.arange(len(cases)) + (index + 0.5) * width - 0.5 * _WIDTH
        axes.bar(place, [summary.median for summary in last], width, color=f'C{index}', label=method)
        axes.plot(place, [summary.worst for summary in last], 'k_')
    axes.axhline(1.0, color='k', linewidth=0.8, linestyle='--')
    axes.set(yscale='log', title=ROBOTS[robot])
    axes.set_xticks(np.arange(len(cases)), [f'{case.level}' for case in cases])
    axes.set_ylabel(f'RMSE over bound at {report.plan[cases[0]].times[-1]:.0f} s\n(bar: median, mark: worst parameter)')


def _coverage(axes: Axes, report: Report, robot: str) -> None:
    """Draw the pooled coverage as points and the range over the parameters as bars."""
    cases = report.plain(robot)
    honest = [method for method in report.methods if _reports(report.results[cases[0]][method])]
    labels = [label for case in cases for label in _labels(case.level, report.plan[case].times)]
    for offset, method in enumerate(honest):
        summaries = [summary for case in cases for summary in report.results[case][method]]
        pooled = np.array([np.nanmean(summary.coverage) if summary.reports_std else np.nan for summary in summaries])
        limits = np.array(
            [(np.nanmin(x.coverage), np.nanmax(x.coverage)) if x.reports_std else (np.nan, np.nan) for x in summaries]
        )
        place = np.arange(len(summaries)) + 0.2 * (offset - 0.5 * (len(honest) - 1))
        spread = np.abs(limits.T - pooled)
        colour = f'C{report.methods.index(method)}'
        axes.errorbar(place, 100.0 * pooled, 100.0 * spread, fmt='o', color=colour, markersize=4)
    axes.axhline(95.0, color='k', linewidth=0.8, linestyle='--')
    axes.set_ylim(min(80.0, axes.get_ylim()[0]), 100.5)
    axes.set_xticks(np.arange(len(labels)), labels)
    axes.set_xlabel('after, s')
    axes.set_ylabel('coverage of the 95 % intervals, %')


def _labels(level: str, times: Sequence[float]) -> list[str]:
    """Return a label for each of the times, with the level below the middle one."""
    labels = [f'{time:.0f}' for time in times]
    labels[len(labels) // 2] += f'\n{level}'
    return labels


def _reports(summaries: list[Summary]) -> bool:
    return any(summary.reports_std for summary in summaries)
