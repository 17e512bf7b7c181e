"""The page docs/measured/benchmark.md: one picture, one table, and the rows behind them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from benchmarks.frame import number, percent, table
from benchmarks.peers.registry import BEST, OURS, Method
from benchmarks.peers.runs import COVERED, Score, median

Scores = Mapping[str, Mapping[str, Score]]  # by method and row
_COLOURS = {True: '#0072b2', False: '#d55e00'}  # of this package, of others: blue and vermilion of Okabe and Ito


def main_table(methods: Sequence[Method], whole: Mapping[str, Score], rows: Scores, same: Mapping[str, float]) -> str:
    """Return the table of all methods over all their runs, the most accurate first."""
    header = [
        *(
            'method',
            'error / bound',
            f'`{BEST}` there',
            'worst row',
            'coverage',
            'rows that hold',
            'silently wrong',
            'no answer',
        ),
        *('time, s', 'memory, MB', 'needs'),
    ]
    lines = []
    for method in sorted(methods, key=lambda each: (np.isnan(whole[each.name].median), whole[each.name].median)):
        own, by_row = whole[method.name], rows[method.name]
        worst = max((each.median for each in by_row.values() if each.answers), default=np.nan)
        answered = [each for each in by_row.values() if each.answers]
        held = sum(each.holds for each in answered)
        sure = np.isfinite(own.covered)
        lines.append(
            (
                f'**`{method.name}`**' if method.name in OURS else f'`{method.name}`',
                number(own.median),
                number(same[method.name]),
                number(worst),
                percent(own.covered),
                f'{held} of {len(answered)}' if sure else '-',
                f'{own.wrong} of {own.answers}',
                f'{own.runs - own.answers} of {own.runs}',
                number(own.processor, 1),
                number(own.memory),
                method.needs,
            )
        )
    return table(header, lines)


def verdict(rows: Scores) -> str:
    """Return the rows in which the default method is not the most accurate, or its coverage is not right."""
    better, uncovered, silent = [], [], []
    for name, own in rows.get(BEST, {}).items():
        found = []
        for method, by_row in rows.items():
            ratio = by_row[name].ratio if name in by_row else np.zeros(0)  # of the first seeds, for a slow method
            here, there = median(own.ratio[: len(ratio)]), median(ratio)
            if there < here:
                found.append((there / here, f'{name} (`{method}`: {number(there)}, `{BEST}` there: {number(here)})'))
        better += [text for _, text in sorted(found)[:1]]
        if not own.answers:
            silent.append(name)
        elif not own.holds:
            uncovered.append(f'{name} ({percent(own.covered)} of {own.intervals})')
    hold = [
        f'`{method}`' for method, by_row in rows.items() if all(each.holds for each in by_row.values() if each.answers)
    ]
    facts = {
        f'Rows in which another method is more accurate than `{BEST}`, the best of them': '; '.join(better),
        f'Rows in which the coverage of `{BEST}` does not hold': '; '.join(uncovered),
        f'Rows without an answer of `{BEST}`': '; '.join(silent),
        'Methods whose coverage holds in every row with an answer': ', '.join(hold),
    }
    return '\n'.join(f'- {fact}: {names or "none"}.' for fact, names in facts.items())


def row_table(methods: Sequence[Method], rows: Scores) -> str:
    """Return runs, and error over bound and coverage of every method, in every row."""
    names = dict.fromkeys(name for by_row in rows.values() for name in by_row)
    lines = []
    for name in names:
        cells = []
        for method in methods:
            own = rows[method.name].get(name)
            if own is None or not own.answers:
                cells.append('-' if own is None else 'no answer')
                continue
            covered = f', {percent(own.covered)}' if np.isfinite(own.covered) else ''
            few = f' ({own.answers} of {own.runs})' if own.answers < own.runs else ''
            cells.append(f'{number(own.median)}{covered}{few}')
        lines.append((name, str(max(each[name].runs for each in rows.values() if name in each)), *cells))
    return table(('row', 'runs', *(f'`{method.name}`' for method in methods)), lines)


def method_table(methods: Sequence[Method], whole: Mapping[str, Score]) -> str:
    """Return each method's description, tuning, and reasons for no answer."""
    lines = []
    for each in methods:
        about = re.sub(r'\.$', '', each.about)
        reasons = sorted(set(whole[each.name].failures))
        words = (
            reasons[0].replace('|', '/')[:120] + (f' (and {len(reasons) - 1} more)' if reasons[1:] else '')
            if reasons
            else ''
        )
        lines.append((f'`{each.name}`', about, each.tuned, words or '-'))
    return table(('method', 'description', 'tuned', 'why no answer'), lines, words=True)


def draw(file: Path, whole: Mapping[str, Score]) -> None:
    """Draw accuracy against time; filled where the intervals hold."""
    low, high = (round(100 * share) for share in COVERED)
    with mpl.rc_context({'svg.hashsalt': 'mbaid_ros'}):
        drawing = Figure(figsize=(8.0, 4.6), layout='constrained', facecolor='white')
        axis = drawing.subplots()
        for name, own in whole.items():
            if not np.isfinite(own.median):
                continue
            colour = _COLOURS[name in OURS]
            face = colour if own.holds else 'white'
            axis.plot(own.processor, own.median, 'o', color=colour, markerfacecolor=face, markersize=9)
            place = (own.processor, own.median)
            axis.annotate(name.replace('_', ' '), place, (9, 3), textcoords='offset points', fontsize=8)
        axis.axhline(1.0, color='black', linewidth=0.9, linestyle=(0, (4, 3)))
        axis.annotate(
            'no unbiased method is better', (0.01, 1.0), (0, 3), ('axes fraction', 'data'), 'offset points', fontsize=8
        )
        axis.set_xscale('log')
        axis.set_yscale('log')
        axis.set_xlabel('processor time of a run [s]')
        axis.set_ylabel('error / bound, median')
        title = f'filled: {low} to {high} % of the 95 % intervals hold the truth'
        axis.set_title(title, fontsize=9, loc='left')
        axis.margins(x=0.25)
        axis.spines[['top', 'right']].set_visible(False)
        file.parent.mkdir(parents=True, exist_ok=True)
        drawing.savefig(file, metadata={'Date': None})
    text = re.sub(r' +\n', '\n', file.read_text(encoding='utf-8'))
    file.write_text(text, encoding='utf-8')
