"""Write docs/measured/benchmark.md: the same recordings identified by every method, side by side.

Recordings and finished runs stay in --store (default: build/peers), from which a second call goes on;
--processes 0 scores finished runs, and runs nothing.
"""

import re
import sys
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from benchmarks.frame import Frame, number, percent, provenance, table
from benchmarks.peers import dataset, registry
from benchmarks.peers.conditions import CONDITIONS, NOT_URDF, PANEL, of_redysim
from benchmarks.peers.dataset import Run
from benchmarks.peers.registry import BEST, OURS, Method
from benchmarks.peers.runs import COVERED, Outcome, Score, Truth, median, outcomes, score

ROOT = Path(__file__).resolve().parents[1]
PICTURE = 'benchmark.svg'
_QUICK = re.compile(rf'(ets7|table1) mid$|{NOT_URDF}|{PANEL}')
_QUICK_SECONDS = 20.0


Scores = Mapping[str, Mapping[str, Score]]  # by method and row
_COLOURS = {True: '#0072b2', False: '#d55e00'}  # of this package, of others: blue and vermilion of Okabe and Ito


def main_table(methods: Sequence[Method], whole: Mapping[str, Score], rows: Scores, same: Mapping[str, float]) -> str:
    """Return the table of all methods over all their runs, the most accurate first."""
    header = [
        *('method', 'error / bound', f'`{BEST}` there', 'worst row', 'coverage', 'rows covered', 'silently wrong'),
        *('no answer', 'time, s', 'memory, MB', 'needs'),
    ]
    lines = []
    for method in sorted(methods, key=lambda each: (np.isnan(whole[each.name].median), whole[each.name].median)):
        own, answered = whole[method.name], [each for each in rows[method.name].values() if each.answers]
        held = f'{sum(each.holds for each in answered)} of {len(answered)}'
        lines.append(
            (
                f'**`{method.name}`**' if method.name in OURS else f'`{method.name}`',
                number(own.median),
                number(same[method.name]),
                number(max((each.median for each in answered), default=np.nan)),
                percent(own.covered),
                held if np.isfinite(own.covered) else '-',
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
    held = {method: [each.holds for each in by_row.values() if each.answers] for method, by_row in rows.items()}
    hold = [f'`{method}`' for method, by_row in held.items() if all(by_row)]
    facts = {
        f'Rows in which another method is more accurate than `{BEST}`, the best of them': '; '.join(better),
        f'Rows in which the coverage of `{BEST}` does not hold': '; '.join(uncovered),
        f'Rows without an answer of `{BEST}`': '; '.join(silent),
        'Methods with the right coverage in every row with an answer': ', '.join(hold),
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
        first, *more = sorted(set(whole[each.name].failures)) or ['-']
        words = first.replace('|', '/')[:120] + (f' (and {len(more)} more)' if more else '')
        lines.append((f'`{each.name}`', about, each.tuned, words))
    return table(('method', 'description', 'tuned', 'why no answer'), lines, words=True)


def draw(file: Path, whole: Mapping[str, Score]) -> None:
    """Draw accuracy against time; filled where the intervals contain the truth as often as they should."""
    low, high = (round(100 * share) for share in COVERED)
    with mpl.rc_context({'svg.hashsalt': 'mbaid_ros'}):
        drawing = Figure(figsize=(8.0, 4.6), layout='constrained', facecolor='white')
        axis = drawing.subplots()
        named: list[tuple[float, float]] = []
        for name, own in whole.items():
            if not np.isfinite(own.median):
                continue
            colour, place = _COLOURS[name in OURS], (own.processor, own.median)
            axis.plot(*place, 'o', color=colour, markerfacecolor=colour if own.holds else 'white', markersize=9)
            apart = [np.abs(np.log10(np.divide(place, other))) for other in named]
            lower = any(across < 0.3 and up < 0.05 for across, up in apart)  # below, beside another name
            named.append(place)
            axis.annotate(
                name.replace('_', ' '), place, (9, -11 if lower else 3), textcoords='offset points', fontsize=8
            )
        axis.axhline(1.0, color='black', linewidth=0.9, linestyle=(0, (4, 3)))
        axis.annotate(
            'no unbiased method is better', (0.01, 1.0), (0, 3), ('axes fraction', 'data'), 'offset points', fontsize=8
        )
        labels = {'xlabel': 'processor time of a run [s]', 'ylabel': 'error / bound, median'}
        axis.set(xscale='log', yscale='log', **labels)
        axis.set_title(f'filled: {low} to {high} % of the 95 % intervals contain the truth', fontsize=9, loc='left')
        axis.margins(x=0.25)
        axis.spines[['top', 'right']].set_visible(False)
        file.parent.mkdir(parents=True, exist_ok=True)
        drawing.savefig(file, metadata={'Date': None})
    text = re.sub(r' +\n', '\n', file.read_text(encoding='utf-8'))
    file.write_text(text, encoding='utf-8')


def main() -> None:
    """Run the benchmark."""
    frame = Frame(__doc__, 'measured/benchmark.md', seeds=4, seconds=60.0, methods='', redysim='', quick=False)
    given = frame.arguments
    folder = given.store or ROOT / 'build' / 'peers'
    folder.mkdir(parents=True, exist_ok=True)
    public = of_redysim(Path(given.redysim), folder) if given.redysim else ()
    conditions = frame.chosen((*CONDITIONS, *public), lambda each: each.name)
    seeds, seconds = given.seeds, given.seconds
    if given.quick:
        conditions, seeds, seconds = [each for each in conditions if _QUICK.search(each.name)], 1, _QUICK_SECONDS
    methods = _methods(given.methods)
    runs = [Run(condition, seed, seconds) for condition in conditions for seed in range(seeds)]
    manifest = dataset.make(runs, folder)
    work = [(each.name, folder / run.name) for run in runs for each in methods if run.seed < each.seeds]
    found: dict[str, dict[str, Outcome]] = defaultdict(dict)
    for method, run, outcome in outcomes(work, manifest, given.processes):
        found[method][run] = outcome
    methods = [each for each in methods if each.name in found]
    whole, rows, same = _scores(found, runs, folder)
    digest = dataset.manifest_digest(manifest)
    done = sum(len(each) for each in found.values())
    note = f'{len(runs)} runs of {seconds:g} s in {len(conditions)} rows, {done} answers; manifest {digest[:16]}'
    texts = {
        'table': f'{main_table(methods, whole, rows, same)}\n\n{provenance(note)}',
        'verdict': verdict(rows),
        'rows': row_table(methods, rows),
        'methods': method_table(methods, whole),
    }
    print(*texts.values(), sep='\n\n')
    if given.quick or given.rows or given.methods:
        print('a part of the benchmark: docs/measured/benchmark.md stays as it is', file=sys.stderr)
    elif given.output is not None:
        frame.write(**texts)
        draw(given.output / 'measured' / PICTURE, whole)


def _methods(pattern: str) -> list[registry.Method]:
    """Return the methods that match a pattern; one that lacks a package is left out, and named."""
    methods = []
    for name in registry.names():
        if re.search(pattern, name):
            try:
                methods.append(registry.load(name))
            except ModuleNotFoundError as error:
                print(f'{name} is left out: {error}', file=sys.stderr)
    return methods


def _scores(
    found: dict[str, dict[str, Outcome]], runs: list[Run], folder: Path
) -> tuple[dict[str, Score], dict[str, dict[str, Score]], dict[str, float]]:
    """Return the scores by method, by method and row, and the default method's error on the runs that each answers."""
    truths = {run.name: Truth.read(folder / run.name) for run in runs}
    whole: dict[str, Score] = {}
    rows: dict[str, dict[str, Score]] = {}
    for method, by_run in found.items():
        whole[method] = score(list(by_run.values()), [truths[name] for name in by_run])
        rows[method] = {}
        for condition in dict.fromkeys(run.condition for run in runs):
            own = [run.name for run in runs if run.condition == condition and run.name in by_run]
            if own:  # none of a row whose seeds a slow method has not run
                rows[method][condition.name] = score([by_run[name] for name in own], [truths[name] for name in own])
    ours = dict(zip(found.get(BEST, ()), whole[BEST].ratio, strict=True)) if BEST in found else {}
    same = {}
    for method, by_run in found.items():
        answered = [ours.get(name, np.nan) for name, own in zip(by_run, whole[method].ratio, strict=True) if own >= 0.0]
        same[method] = median(answered)
    return whole, rows, same


if __name__ == '__main__':
    main()
