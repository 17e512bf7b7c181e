"""Long tables as pictures: a table of more than 40 rows becomes an SVG with its rows as CSV beside it."""

import csv
import re
from collections.abc import Sequence
from io import StringIO
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

MOST_ROWS = 40
_TABLE = re.compile(r'(?:^\|.*\|$\n?)+', re.MULTILINE)
_NUMBER = re.compile(r'-?\d+(?:\.\d+)?(?:e\d+)?')
# Columns that are drawn, each in a panel: name, and the value that is right or wanted.
_DRAWN = {'coverage': 95.0, 'NEES': None, '/ limit of these sensors': 1.0}
_LABELS = ('robot, encoders', 'motion', 'frame', 'where', 'after')  # columns, or begins of them, that name a row


def pictured(text: str, page: Path, name: str) -> str:
    """Return a text whose long tables are pictures, and write these and the data beside the page, into `data/`."""

    def replaced(found: re.Match[str]) -> str:
        header, _, *rows = [[cell.strip() for cell in line.strip('| ').split(' | ')] for line in found[0].splitlines()]
        if len(rows) <= MOST_ROWS:
            return found[0]
        file = page.parent / 'data' / f'{page.stem}-{name}'
        file.parent.mkdir(exist_ok=True)
        lines = StringIO()
        csv.writer(lines, lineterminator='\n').writerows([header, *rows])
        file.with_suffix('.csv').write_text(lines.getvalue(), encoding='utf-8')
        _draw(header, rows, file.with_suffix('.svg'))
        alt = ', '.join(column for column in header if column in _DRAWN)
        return f'![{alt}](data/{file.name}.svg)\n\n[All {len(rows)} rows](data/{file.name}.csv) as CSV.\n'

    return _TABLE.sub(replaced, text)


def _draw(header: Sequence[str], rows: Sequence[Sequence[str]], file: Path) -> None:
    """Draw a panel for each column, the rows from top to bottom, the methods in colours."""
    named = [place for place, column in enumerate(header) if column.startswith(_LABELS)]
    labels = [', '.join(row[place] for place in named) for row in rows]
    places = {label: -place for place, label in enumerate(dict.fromkeys(labels))}
    methods = [row[header.index('method')] for row in rows] if 'method' in header else [''] * len(rows)
    columns = [column for column in header if column in _DRAWN]
    style = {'svg.fonttype': 'none', 'svg.hashsalt': file.stem, 'font.size': 8.0}
    with mpl.rc_context(style):
        figure = Figure(figsize=(9.0, 0.7 + 0.15 * len(places)), layout='constrained')
        panels = figure.subplots(1, len(columns), sharey=True, squeeze=False)[0]
        for axes, column in zip(panels, columns, strict=True):
            values = np.array([_number(row[header.index(column)]) for row in rows])
            for method, marker in zip(dict.fromkeys(methods), 'osD^v<>', strict=False):
                own = [place for place, each in enumerate(methods) if each == method]
                heights = [places[labels[place]] for place in own]
                axes.plot(values[own], heights, marker, markersize=4.0, fillstyle='none', label=method)
            if _DRAWN[column] is not None:
                axes.axvline(_DRAWN[column], color='0.6', linewidth=0.8, zorder=0)
            if np.nanmax(values) > 50.0 * max(np.nanmin(values), 1e-9) > 0.0:
                axes.set_xscale('log')
            axes.set_xlabel(f'{column}, %' if rows[-1][header.index(column)].endswith(' %') else column)
            axes.grid(axis='y', color='0.9', linewidth=0.5)
            axes.tick_params(axis='y', left=False)
        panels[0].set_yticks(list(places.values()), list(places))
        panels[0].set_ylim(0.6 - len(places), 0.4)
        if len(set(methods)) > 1:
            figure.legend(*panels[0].get_legend_handles_labels(), loc='outside upper center', ncols=4, frameon=False)
        figure.savefig(file, metadata={'Date': None})


def _number(cell: str) -> float:
    found = _NUMBER.match(cell)
    return float(found[0]) if found else np.nan
