"""Drawings as SVG elements whose colours follow the page: light, dark or print."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.parameters import BAND

# Colours that a drawing is made with, and the CSS variables that take their place.
_VARIABLES = {
    '#010101': 'var(--ink)',
    '#020202': 'var(--faint)',
    '#030303': 'var(--first)',
    '#040404': 'var(--second)',
    '#050505': 'var(--third)',
    '#060606': 'var(--truth)',
    '#070707': 'var(--page)',
    '#080808': 'var(--line)',
    '#090909': 'var(--alarm)',
}
INK, FAINT, FIRST, SECOND, THIRD, TRUTH, PAGE, LINE, ALARM = _VARIABLES
SERIES = ((FIRST, '-'), (SECOND, '--'), (THIRD, '-.'))  # told apart by the line as well

WIDTH = 9.6  # inches
_TITLE, _SMALL = 10, 8
_LEFT, _RIGHT, _ABOVE, _BELOW = 0.78, 0.12, 0.28, 0.40  # inches around axes


def new_axes(rows: int, columns: int, height: float, **options: Any) -> tuple[Figure, Sequence[Axes]]:
    """Return a figure with plain axes, row by row; `height` is that of a row in inches."""
    full = 0.15 + height * rows
    figure = Figure(figsize=(WIDTH, full))
    grid = figure.subplots(rows, columns, squeeze=False, **options)
    # Margins in inches: title above, labels below and to the left. A layout engine would take most of the time.
    inner_height, inner_width = height - _ABOVE - _BELOW, WIDTH / columns - _LEFT - _RIGHT
    figure.subplots_adjust(
        left=_LEFT / WIDTH,
        right=1.0 - _RIGHT / WIDTH,
        top=1.0 - (0.05 + _ABOVE) / full,
        bottom=(0.1 + _BELOW) / full,
        hspace=(_ABOVE + _BELOW) / inner_height,
        wspace=(_LEFT + _RIGHT) / inner_width,
    )
    for axis in grid.flat:
        plain(axis)
    return figure, list(grid.flat)


def plain(axis: Axes) -> None:
    """Give axes the look of the page."""
    axis.set_facecolor('none')
    axis.tick_params(colors=INK, labelsize=_SMALL)
    axis.spines[['top', 'right']].set_visible(False)
    for spine in axis.spines.values():
        spine.set_color(FAINT)
    axis.grid(color=LINE, linewidth=0.6)
    axis.set_axisbelow(True)
    axis.ticklabel_format(axis='y', useOffset=False)


def entitle(axis: Axes, title: str, below: str = '') -> None:
    """Write a title, and a label of the horizontal axis."""
    axis.set_title(title, color=INK, fontsize=_TITLE, loc='left', parse_math=False)
    axis.set_xlabel(below, color=INK, fontsize=_SMALL, parse_math=False)


def legend(axis: Axes, columns: int = 1) -> None:
    """Name the curves, beside the title: within the axes the names would cover some of them."""
    shown = axis.legend(
        fontsize=_SMALL, ncols=columns, labelcolor=INK, frameon=False, loc='lower right', bbox_to_anchor=(1.0, 0.97)
    )
    for entry in shown.get_texts():
        entry.set_parse_math(False)


def curve(
    axis: Axes, time: Array, value: Array, std: Array, style: tuple[str, str] = SERIES[0], label: str = ''
) -> None:
    """Draw a course with its band of 95 %."""
    colour, line = style
    axis.plot(time, value, color=colour, linestyle=line, linewidth=1.3, label=label or None)
    axis.fill_between(time, value - BAND * std, value + BAND * std, color=colour, alpha=0.18, linewidth=0.0)


def scale(axis: Axes, *courses: Array, always: Sequence[float] = ()) -> None:
    """Let the later two thirds of the courses set the scale: the first estimates of a recursion are far off."""
    late = np.concatenate([course[len(course) // 3 :] for course in courses])
    late = late[np.isfinite(late)]
    if not len(late):
        return
    low, high = (float(edge) for edge in np.percentile(late, [1, 99]))
    for value in always:
        low, high = min(low, value), max(high, value)
    margin = 0.15 * (high - low) or 0.05 * abs(high) or 1e-6
    axis.set_ylim(low - margin, high + margin)


def svg(figure: Figure, name: str, title: str) -> str:
    """Return a figure as an element of the page.

    Parameters
    ----------
    figure : Figure
    name : keeps the names within the element apart from those of other figures
    title : what a screen reader says
    """
    buffer = io.StringIO()
    with mpl.rc_context({'svg.hashsalt': f'mbaid_ros {name}', 'svg.fonttype': 'none'}), warnings.catch_warnings():
        warnings.simplefilter('ignore')  # a letter that the measuring font lacks: the browser has it
        figure.savefig(buffer, format='svg', transparent=True, metadata={'Date': None, 'Creator': None})
    element = buffer.getvalue()
    element = element[element.index('<svg') :]
    element = re.sub(r'<metadata>.*?</metadata>', '', element, flags=re.DOTALL)
    element = re.sub(r'<g id="[^"]*"', '<g', element)  # nothing refers to groups, and other figures have the same
    for colour, variable in _VARIABLES.items():
        element = element.replace(colour, variable)
    return element.replace('<svg', f'<svg role="img" aria-label="{title}"', 1)
