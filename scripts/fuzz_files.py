"""Send damaged files through the executables that read them: bags, robots, parameters, truths, results, logs.

Each has to end with 0, 2, 3 or 4, with one line of error at most, within 10 s of the processor and 30 s of the clock,
in less than 1 GB. All run in this process; each thousandth runs again in one of its own, with the same outcome.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tqdm import tqdm

from fuzzing.formats import Format, formats
from fuzzing.trial import Found, TooLongError, alone, tried

EVERY = 1000  # inputs, of which one is tried in a process of its own, too


def fuzz(count: int, seed: int, wanted: Sequence[str] | None = None, every: int = EVERY) -> dict[str, Found]:
    """Return the outcomes of so many inputs of each format, or of the wanted ones."""
    outcome: dict[str, Found] = {}
    with tempfile.TemporaryDirectory() as name:
        there = formats(Path(name))
        for kind in wanted or there:
            outcome[kind] = Found()
            for number in tqdm(range(count), unit=f' {kind}', disable=None, leave=False):
                wrong = _one(there[kind], number, seed, outcome[kind], apart=number % every == every // 2)
                if wrong:
                    outcome[kind].wrong.append(f'{kind} {number}: {wrong}')
            there[kind].path.write_bytes(there[kind].content)
    return outcome


def _one(kind: Format, number: int, seed: int, found: Found, *, apart: bool) -> str:
    """Try one input; return the faults of its outcome."""
    kind.path.write_bytes(kind.damaged(kind.content, np.random.default_rng([seed, number])))
    arguments = kind.arguments(number)
    kind.clear()
    with tempfile.TemporaryFile() as words:
        try:
            trial = tried(kind.main, arguments, words)
        except (Exception, TooLongError) as reason:  # noqa: BLE001 - that none comes out is what is tested
            return f'{type(reason).__name__}: {reason}'
    found.measured(trial.taken, trial.memory)
    found.codes[trial.code] += 1
    wrong = trial.wrong(kind.reported)
    if apart and not wrong:
        kind.clear()
        other = alone(kind.main, arguments)
        wrong = '' if other == (trial.code, trial.error) else f'{trial} and in a process of its own {other}'
    return wrong


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--inputs', type=int, default=400, metavar='N', help='of each format (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=0, metavar='N')
    parser.add_argument('--formats', nargs='+', metavar='F', help="such as URDF or 'MCAP bytes' (default: all)")
    asked = parser.parse_args()
    results = fuzz(asked.inputs, asked.seed, asked.formats)
    for each, of_it in results.items():
        print(f'{each}: {of_it}')
    sys.exit(any(of_it.wrong for of_it in results.values()))
