"""Pieces of a page that needs nothing else: text, tables, style, and drawings whose colours follow the page."""

from __future__ import annotations

import io
import math
import re
import warnings
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mbaid_ros.cli import one_line
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import BAND, rounded

NO_NUMBER = '\N{EN DASH}'
PLUS_MINUS = '\N{PLUS-MINUS SIGN} 95 %'
_SHORT_CELL = 10  # characters of a cell that is not wrapped: a unit, a yes
_NUMBER_STARTS = f'-+.0123456789{NO_NUMBER}\N{PLUS-MINUS SIGN}'


class Colour:
    """Colours that a drawing is made with; CSS variables of the same names take their place."""

    INK, FAINT, FIRST, SECOND, THIRD = '#010101', '#020202', '#030303', '#040404', '#050505'
    TRUTH, PAGE, LINE, ALARM = '#060606', '#070707', '#080808', '#090909'


SERIES = ((Colour.FIRST, '-'), (Colour.SECOND, '--'), (Colour.THIRD, '-.'))  # distinguished by the line as well
TIME = 'time [s]'

_WIDTH = 9.6  # inches
_TITLE, SMALL = 11, 9.5  # of which a phone shows nine pixels
_LEFT, _RIGHT, _ABOVE, _BELOW = 0.78, 0.12, 0.28, 0.40  # inches around axes

_STYLE = files(__package__).joinpath('style.css').read_text('utf-8')


def text(value: object) -> str:
    """Return a string of any origin as HTML text on one line, control characters written out."""
    return escape(one_line(str(value)))


def number(value: float, digits: int = 6) -> str:
    """Return a number for a cell; a dash where there is none."""
    return NO_NUMBER if not math.isfinite(value) else f'{value:.{digits}g}'


def table(head: Sequence[str], rows: Sequence[Sequence[str]], kind: str = '') -> str:
    """Return a table of plain strings; a column whose cells all start like numbers is aligned like them."""
    numeric = [
        any(row[column] for row in rows) and all(not row[column] or row[column][0] in _NUMBER_STARTS for row in rows)
        for column in range(len(head))
    ]
    lines = [_row('th', head, numeric), *(_row('td', row, numeric) for row in rows)]
    begin = f'<table class="{kind}">' if kind else '<table>'
    return f'<div class="scroll">{begin}{"".join(lines)}</table></div>'


def _row(tag: str, cells: Sequence[str], numeric: Sequence[bool]) -> str:
    content = []
    for column, (cell, aligned) in enumerate(zip(cells, numeric, strict=True)):
        kind = 'n' if aligned else 'short' if column and len(cell) <= _SHORT_CELL else ''
        content.append(f'<{tag} class="{kind}">{text(cell)}</{tag}>' if kind else f'<{tag}>{text(cell)}</{tag}>')
    return f'<tr>{"".join(content)}</tr>'


def estimates(names: Sequence[str], values: Array, stds: Array, units: Sequence[str]) -> list[tuple[str, ...]]:
    """Return rows of name, value, 95 % band and unit."""
    columns = zip(names, values, stds, units, strict=True)
    return [(name, *rounded(value, std, NO_NUMBER), unit) for name, value, std, unit in columns]


def paragraph(content: str, kind: str = '') -> str:
    """Return a paragraph of plain text."""
    return f'<p class="{kind}">{text(content)}</p>' if kind else f'<p>{text(content)}</p>'


def figure(drawing: str, caption: str = '') -> str:
    """Return a figure with a caption of plain text."""
    below = f'<figcaption>{text(caption)}</figcaption>' if caption else ''
    return f'<figure>{drawing}{below}</figure>'


def listed(items: Sequence[str], kind: str = '') -> str:
    """Return a list of plain texts, nothing for none."""
    if not items:
        return ''
    return f'<ul class="{kind}">{"".join(f"<li>{text(item)}</li>" for item in items)}</ul>'


def folded(title: str, content: str) -> str:
    """Return a content that shows when its title is clicked."""
    return f'<details><summary>{text(title)}</summary>{content}</details>'


def page(title: str, parts: Sequence[str]) -> str:
    """Return an HTML page of a plain title and the parts of its body."""
    viewport = '<meta name="viewport" content="width=device-width, initial-scale=1">'
    head = f'<meta charset="utf-8">{viewport}<title>{text(title)}</title><style>{_STYLE}</style>'
    body = '\n'.join(part for part in (f'<h1>{text(title)}</h1>', *parts) if part)
    return f'<!DOCTYPE html>\n<html lang="en">\n<head>{head}</head>\n<body>\n{body}\n</body>\n</html>\n'


def new_axes(rows: int, columns: int, height: float, **options: Any) -> tuple[Figure, Sequence[Axes]]:
    """Return a figure with plain axes, row by row; `height` is that of a row in inches."""
    full = 0.15 + height * rows
    chart = Figure(figsize=(_WIDTH, full))
    grid = chart.subplots(rows, columns, squeeze=False, **options)
    # Margins in inches: title above, labels below and to the left. A layout engine would take most of the time.
    chart.subplots_adjust(
        left=_LEFT / _WIDTH,
        right=1.0 - _RIGHT / _WIDTH,
        top=1.0 - (0.05 + _ABOVE) / full,
        bottom=(0.1 + _BELOW) / full,
        hspace=(_ABOVE + _BELOW) / (height - _ABOVE - _BELOW),
        wspace=(_LEFT + _RIGHT) / (_WIDTH / columns - _LEFT - _RIGHT),
    )
    for axis in grid.flat:
        axis.set_facecolor('none')
        axis.tick_params(colors=Colour.INK, labelsize=SMALL)
        axis.spines[['top', 'right']].set_visible(False)
        for spine in axis.spines.values():
            spine.set_color(Colour.FAINT)
        axis.grid(color=Colour.LINE, linewidth=0.6)
        axis.set_axisbelow(True)
        axis.ticklabel_format(axis='y', useOffset=False)
    return chart, list(grid.flat)


def entitle(axis: Axes, title: str, below: str = '') -> None:
    """Write a title, and a label of the horizontal axis."""
    axis.set_title(title, color=Colour.INK, fontsize=_TITLE, loc='left', parse_math=False)
    axis.set_xlabel(below, color=Colour.INK, fontsize=SMALL, parse_math=False)


def legend(axis: Axes, columns: int = 1) -> None:
    """Name the curves, beside the title: within the axes the names would cover some of them."""
    shown = axis.legend(
        fontsize=SMALL,
        ncols=columns,
        labelcolor=Colour.INK,
        frameon=False,
        loc='lower right',
        bbox_to_anchor=(1.0, 0.97),
    )
    for entry in shown.get_texts():
        entry.set_parse_math(False)


def curve(
    axis: Axes, time: Array, value: Array, std: Array, style: tuple[str, str] = SERIES[0], label: str = ''
) -> None:
    """Draw a curve with its band of 95 %."""
    colour, line = style
    axis.plot(time, value, color=colour, linestyle=line, linewidth=1.3, label=label or None)
    axis.fill_between(time, value - BAND * std, value + BAND * std, color=colour, alpha=0.18, linewidth=0.0)


def level(axis: Axes, value: float, colour: str = Colour.TRUTH, line: str = ':', width: float = 1.3) -> None:
    """Draw a horizontal line, by default that of a true value."""
    axis.axhline(value, color=colour, linestyle=line, linewidth=width)


def scale(axis: Axes, *curves: Array, always: Sequence[float] = ()) -> None:
    """Let the later two thirds of the curves set the scale: the first estimates of a recursion are far off."""
    late = np.concatenate([each[len(each) // 3 :] for each in curves])
    late = late[np.isfinite(late)]
    if not len(late):
        return
    low, high = (float(edge) for edge in np.percentile(late, [1, 99]))
    low, high = min((low, *always)), max((high, *always))
    margin = 0.15 * (high - low) or 0.05 * abs(high) or 1e-6
    axis.set_ylim(low - margin, high + margin)


def svg(chart: Figure, name: str, title: str) -> str:
    """Return a figure as an element of the page; `name` keeps its inner names apart, a screen reader reads `title`."""
    buffer = io.StringIO()
    with mpl.rc_context({'svg.hashsalt': f'mbaid_ros {name}', 'svg.fonttype': 'none'}), warnings.catch_warnings():
        warnings.simplefilter('ignore')  # a letter that the measuring font lacks: the browser has it
        chart.savefig(buffer, format='svg', transparent=True, metadata={'Date': None, 'Creator': None})
    element = buffer.getvalue()
    element = element[element.index('<svg') :]
    element = re.sub(r'<metadata>.*?</metadata>', '', element, flags=re.DOTALL)
    element = re.sub(r'<g id="[^"]*"', '<g', element)  # nothing refers to groups, and other figures have the same
    for variable, colour in vars(Colour).items():
        if variable.isupper():
            element = element.replace(colour, f'var(--{variable.lower()})')
    return element.replace('<svg', f'<svg role="img" aria-label="{title}"', 1)
