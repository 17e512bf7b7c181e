"""Curves over a run: parameters, momentum, residual, identifiability."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import BAND, PARAMETERS, Estimate, determined
from mbaid_ros.core.results.verdict import LARGEST_RESIDUAL
from mbaid_ros.replay.read_back import Truth
from mbaid_ros.replay.report.markup import (
    SERIES,
    SMALL,
    TIME,
    Colour,
    curve,
    entitle,
    legend,
    level,
    new_axes,
    scale,
    svg,
)
from mbaid_ros.replay.report.tables import SHOWN_UNITS
from mbaid_ros.replay.whole_run import Run

_PLOTTED = 800  # points of a curve: more than a screen resolves
_SHORTEST = 1e-9  # s, that a time axis spans
_STATUS_COLOURS = {'converged': Colour.FIRST, 'estimating': Colour.FAINT, 'inconsistent': Colour.ALARM}


def thinned(run: Run) -> Sequence[Estimate]:
    """Return as many estimates of a run as a screen resolves, with the last one."""
    return (*run.history[: -1 : max(1, len(run.history) // _PLOTTED)], run.history[-1])


def convergence(run: Run, truth: Truth | None, name: str) -> str:
    """Return the curve of each parameter that was ever determined."""
    history = thinned(run)
    time = _times(history)
    values = np.array([estimate.parameters for estimate in history])
    stds = np.array([estimate.std for estimate in history])
    shown = np.flatnonzero(np.any(np.isfinite(values), axis=0)).tolist()
    chart, every = new_axes(-(-len(shown) // 2), 2, 1.7, sharex=True)
    axes = every[: len(shown)]
    for axis in every[len(shown) :]:  # the last row may have a place left
        axis.remove()
    for axis, index in zip(axes, shown, strict=True):
        value, spread = values[:, index], BAND * stds[:, index]
        curve(axis, time, value, stds[:, index])
        scale(axis, value, value - spread, value + spread)
        if truth is not None:
            level(axis, truth.parameters[index])
        entitle(axis, f'{PARAMETERS[index]} [{SHOWN_UNITS[index]}]')
        _mark_events(axis, run)
        axis.set_xlim(0.0, max(time[-1], _SHORTEST))
        axis.tick_params(labelbottom=True)
    for axis in axes[-2:]:  # the lowest of each column
        axis.set_xlabel(TIME, color=Colour.INK, fontsize=SMALL)
    return svg(chart, f'{name} convergence', 'Estimate of each parameter over time with its 95 % band')


def momentum(run: Run, truth: Truth | None, name: str) -> str:
    """Return the total momentum and, where the method has it, the residual over time."""
    history = thinned(run)
    time = _times(history)
    values = np.array([estimate.momentum for estimate in history])
    stds = np.sqrt(np.array([np.diag(estimate.momentum_covariance) for estimate in history]))
    residual = np.array([estimate.residual for estimate in history])
    parts: list[tuple[str, slice]] = [('linear [N s]', slice(0, 3)), ('angular [N m s]', slice(3, 6))]
    # Where nothing was determined, the momentum was not either, despite its prior.
    parts = [part for part in parts if run.reached and np.any(np.isfinite(values[:, part[1]]))]
    with_residual = bool(np.any(np.isfinite(residual)))
    if not parts and not with_residual:
        return ''
    chart, axes = new_axes(len(parts) + with_residual, 1, 2.0, sharex=True)
    for axis, (title, which) in zip(axes, parts, strict=False):
        _vector(axis, time, values[:, which], stds[:, which])
        if truth is not None:
            for value in truth.momentum[which][determined(values[-1, which], stds[-1, which])]:
                level(axis, value, width=1.0)
        entitle(axis, f'Total momentum, {title}')
        _mark_events(axis, run)
    if with_residual:
        _residual(axes[-1], time, residual, run)
    _time_axis(axes[-1], time)
    return svg(chart, f'{name} momentum', 'Total momentum and residual over time')


def swing(run: Run, name: str) -> str:
    """Return how far each passive joint swings in each window, least to highest; nothing without any."""
    history = [estimate for estimate in thinned(run) if estimate.flexible]
    if not history:
        return ''
    time, joints = _times(history), [joint.joint for joint in history[-1].flexible]
    chart, axes = new_axes(len(joints), 1, 1.5, sharex=True)
    for place, (axis, joint) in enumerate(zip(axes, joints, strict=True)):
        least, highest = np.array([estimate.flexible[place].swing for estimate in history]).T
        axis.fill_between(time, least, highest, color=Colour.FIRST, alpha=0.6, linewidth=0.8)
        scale(axis, least, highest, always=(0.0,))
        entitle(axis, f'Deflection of {joint} [rad or m]')
        _mark_events(axis, run)
    _time_axis(axes[-1], time)
    return svg(chart, f'{name} swing', 'Deflection of each passive joint over time')


def _time_axis(axis: Axes, time: Array) -> None:
    axis.set_xlim(0.0, max(time[-1], _SHORTEST))
    axis.set_xlabel(TIME, color=Colour.INK, fontsize=SMALL)


def _vector(axis: Axes, time: Array, values: Array, stds: Array) -> None:
    known = determined(values[-1], stds[-1])
    for value, std, style, label, there in zip(values.T, stds.T, SERIES, 'xyz', known, strict=True):
        if there:
            curve(axis, time, value, std, style, label)
    values, stds = values[:, known], stds[:, known]
    scale(axis, *values.T, *(values - BAND * stds).T, *(values + BAND * stds).T)
    legend(axis, 3)


def _residual(axis: Axes, time: Array, residual: Array, run: Run) -> None:
    axis.plot(time, residual, color=Colour.FIRST, linewidth=1.3)
    level(axis, 1.0, Colour.FAINT, '--', 1.0)
    always = [0.0, 1.0]
    if np.nanmax(residual) > 0.5 * LARGEST_RESIDUAL:
        level(axis, LARGEST_RESIDUAL, Colour.SECOND, '--', 1.0)
        always.append(LARGEST_RESIDUAL)
    scale(axis, residual, always=always)
    axis.set_ylim(bottom=0.0)
    entitle(axis, 'Residual [\N{GREEK SMALL LETTER SIGMA}]: 1 means noise as specified')
    _mark_events(axis, run)


def identifiability(run: Run, name: str) -> str:
    """Return when which parameter was determined, and the status."""
    history = run.history
    edges = np.array([0.0, *(estimate.time for estimate in history)])
    flags = np.array([estimate.identifiable for estimate in history])
    chart, (axis,) = new_axes(1, 1, 2.6)
    rows = len(PARAMETERS)
    for row in range(rows):
        axis.broken_barh([(0.0, float(edges[-1]))], (row - 0.36, 0.72), facecolor=Colour.LINE)
        axis.broken_barh(_spans(edges, flags[:, row]), (row - 0.36, 0.72), facecolor=Colour.FIRST)
    statuses = [estimate.status for estimate in history]
    for status in dict.fromkeys(statuses):
        spans = _spans(edges, np.array([each == status for each in statuses]))
        axis.broken_barh(spans, (rows - 0.36, 0.72), facecolor=_STATUS_COLOURS.get(status, Colour.LINE))
        begin, length = max(spans, key=lambda span: span[1])
        if length > 0.14 * edges[-1]:
            colour = Colour.INK if status not in {'converged', 'inconsistent'} else Colour.PAGE
            middle, words = begin + 0.5 * length, status.replace('_', ' ')
            axis.text(middle, rows, words, ha='center', va='center', fontsize=8, color=colour)
    axis.set_yticks(range(rows + 1), (*PARAMETERS, 'status'))
    axis.set_ylim(rows + 0.6, -0.6)
    axis.set_xlim(0.0, max(float(edges[-1]), _SHORTEST))
    axis.grid(visible=False)
    _mark_events(axis, run, named=False)  # the name would lie on the bars
    entitle(axis, '', TIME)
    return svg(chart, f'{name} identifiability', 'When the data determined which parameter')


def _spans(edges: Array, flags: Array) -> list[tuple[float, float]]:
    """Return (begin, length) of the stretches in which a flag holds; flag i holds from edge i to edge i + 1."""
    steps = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(int), [0]))))
    return [(float(edges[a]), float(edges[b] - edges[a])) for a, b in steps.reshape(-1, 2)]


def _mark_events(axis: Axes, run: Run, *, named: bool = True) -> None:
    """Draw a line where the momentum changed: events, and the capture."""
    marks: list[tuple[float, str, str, str]]
    marks = [(event.time, event.kind, Colour.SECOND, '-.') for event in run.final.events]
    if run.capture is not None:
        marks.append((run.capture.time, 'capture', Colour.THIRD, '-'))
    for time, name, colour, line in marks:
        axis.axvline(time, color=colour, linestyle=line, linewidth=1.2)
        if named:
            axis.annotate(
                name, (time, 1.0), xycoords=('data', 'axes fraction'), xytext=(3, -9), textcoords='offset points',
                fontsize=8, color=colour,
            )  # fmt: skip


def _times(history: Sequence[Estimate]) -> Array:
    return np.array([estimate.time for estimate in history])
