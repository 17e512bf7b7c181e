"""Motions that are hard to start with: whether there is an estimate by the end, and whether one is ever wrong.

usage: starts.py [--seeds N] [--rows PATTERN] [--method M] [--processes N] [--store FOLDER] [--output FOLDER]
"""

from __future__ import annotations

import sys
from collections import Counter

import numpy as np

from benchmarks.honesty.command import command, outcomes, parsed, write
from benchmarks.honesty.condition import Condition
from benchmarks.honesty.runs import PUBLISHED, Outcome
from benchmarks.honesty.starts import STARTS
from benchmarks.honesty.verdicts import FAR
from benchmarks.pages import number, percent, provenance, table

_SEEDS = 100
_PAGE = 'starts.md'
_HEADER = (
    'motion',
    'runs',
    'estimate by the end',
    'last status',
    'first, s: median, latest',
    'largest error ever',
    'beyond 5 ever',
    'at the end',
    'seeds beyond 5',
)


def main() -> int:
    """Run the starts and return the exit code."""
    arguments = parsed(__doc__.partition('\n')[0], STARTS, _SEEDS, _PAGE)
    rows = []
    for condition, outcome in outcomes(arguments):
        rows.append(_line(condition, outcome))
        print(' | '.join(rows[-1]), flush=True)
    text = _PAGE_TEXT.format(
        method=arguments.method, table=table(_HEADER, rows), origin=provenance(command=command(arguments))
    )
    write(arguments, _PAGE, text)
    return 0


def _line(condition: Condition, outcome: Outcome) -> list[str]:
    ended = np.isin(outcome.status, PUBLISHED) & np.any(np.isfinite(outcome.error), axis=1)
    given = ended[:, None] & np.isfinite(outcome.error) & (outcome.std > 0.0)
    last = np.abs(np.divide(outcome.error, outcome.std, out=np.zeros(outcome.error.shape), where=given))
    worst = np.maximum(outcome.worst, outcome.young)
    wrong = np.flatnonzero(worst > FAR)
    started = outcome.first[np.isfinite(outcome.first)]
    median, latest = (np.median(started), np.max(started)) if len(started) else (np.nan, np.nan)
    return [
        condition.name.removeprefix('start: '),
        str(len(outcome)),
        percent(float(np.mean(ended))),
        ', '.join(
            f'{count} {name.replace("_", " ")}' for name, count in Counter(outcome.status.tolist()).most_common()
        ),
        f'{number(float(median), 1)}, {number(float(latest), 1)}',
        number(float(np.max(worst)), 1),
        str(len(wrong)),
        str(int(np.sum(np.max(last, axis=1) > FAR))),
        ', '.join(str(seed) for seed in wrong[:5]) or '-',
    ]


_PAGE_TEXT = """\
# Starts

Motions that are hard to start with, method `{method}` with default parameters, `servicer7` with *mid* noise at 100 Hz
where no other robot is named; every run has a motion of its own. The base tumbles slowly, or has no momentum (*from
rest*). Errors are in reported standard deviations, of any parameter in any estimate that is published as `estimating`
or `converged`: *ever* during a run, or *at the end* of it.

{table}

{origin}
"""


if __name__ == '__main__':
    sys.exit(main())
