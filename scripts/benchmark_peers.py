"""Write docs/measured/benchmark.md: the same recordings identified by every method, side by side.

Recordings and finished runs stay in --store (default: build/peers), from which a second call goes on;
--processes 0 scores finished runs, and runs nothing.
"""

from __future__ import annotations

import re
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np

from benchmarks.frame import Frame, provenance
from benchmarks.peers import dataset, page, registry
from benchmarks.peers.conditions import CONDITIONS, NOT_URDF, PANEL, of_redysim
from benchmarks.peers.dataset import Run
from benchmarks.peers.registry import BEST
from benchmarks.peers.runs import Outcome, Score, Truth, median, outcomes, score

ROOT = Path(__file__).resolve().parents[1]
PICTURE = 'benchmark.svg'
_QUICK = re.compile(rf'(ets7|table1) mid$|{NOT_URDF}|{PANEL}')
_QUICK_SECONDS = 20.0


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
        'table': f'{page.main_table(methods, whole, rows, same)}\n\n{provenance(note)}',
        'verdict': page.verdict(rows),
        'rows': page.row_table(methods, rows),
        'methods': page.method_table(methods, whole),
    }
    print(*texts.values(), sep='\n\n')
    if given.quick or given.rows or given.methods:
        print('a part of the benchmark: docs/measured/benchmark.md stays as it is', file=sys.stderr)
    elif given.output is not None:
        frame.write(**texts)
        page.draw(given.output / 'measured' / PICTURE, whole)


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
