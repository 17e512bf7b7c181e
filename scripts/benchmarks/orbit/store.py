"""A file of runs, a line each: parts of the benchmark put theirs there."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.orbit.runs import DURATIONS, Kept, circle, grid, undeclared
from benchmarks.orbit.simulated import thruster, wheels

Part = Callable[[int, Kept], Iterator[dict[str, Any]]]
PARTS: dict[str, Part] = {
    'grid': grid,
    'minute': partial(grid, durations=DURATIONS[:1]),
    'undeclared': undeclared,
    'undeclared-minute': partial(undeclared, durations=DURATIONS[:1]),
    'circle': circle,
    'wheels': wheels,
    'thruster': thruster,
}


def run_part(part: str, seeds: Sequence[int], store: Path) -> None:
    """Run a part for some seeds, but for what a file holds already, and put it there.

    `minute` is the first minute of `grid`, `undeclared-minute` that of `undeclared`.
    """
    kept = {(each['part'], each['pace'], each['frame'], each['place'], each['seed']) for each in stored(store)}
    for seed in seeds:
        begin = time.monotonic()
        for line in PARTS[part](seed, kept):
            own = {
                'part': 'grid' if part == 'minute' else part.removesuffix('-minute'),
                'seed': seed,
                **line,
                'wall': round(time.monotonic() - begin, 1),
            }
            with store.open('a', encoding='utf-8') as file:
                file.write(json.dumps(own) + '\n')
            begin = time.monotonic()


def stored(store: Path) -> list[dict[str, Any]]:
    """Return the runs that a file holds."""
    if not store.exists():
        return []
    return [json.loads(line) for line in store.read_text(encoding='utf-8').splitlines()]
