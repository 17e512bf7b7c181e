"""Conditions that nobody has tuned the estimator for: whether it is ever silently wrong, and what it names.

usage: benchmark_honesty.py [--seeds N] [--rows PATTERN] [--method M] [--processes N] [--store FOLDER]
       [--output FOLDER]
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from tqdm import tqdm

from benchmarks.honesty.catalogue import CONDITIONS
from benchmarks.honesty.condition import Condition
from benchmarks.honesty.runs import Outcome, run, run_file
from benchmarks.honesty.verdicts import Verdict, judged
from benchmarks.pages import number, percent, provenance, table
from benchmarks.store import completed
from mbaid_ros.config.estimator import METHODS

_SEEDS = 6
_HEADER = ('condition', 'seeds', 'last status', 'covered', 'largest error', 'named first', 'silently wrong')


def main() -> int:
    """Run the benchmark and return the exit code."""
    arguments = _parse()
    chosen = [one for one in CONDITIONS if re.search(arguments.rows, f'{one.group}: {one.name}')]
    if not chosen:
        print(
            f"--rows is '{arguments.rows}'; accepted: what is found in one of {len(CONDITIONS)} names", file=sys.stderr
        )
        return 2
    verdicts: dict[str, Verdict] = {}
    with (
        tqdm(total=len(chosen) * arguments.seeds, unit=' runs', disable=None, leave=False) as bar,
        ProcessPoolExecutor(arguments.processes) as pool,
    ):
        for condition in chosen:
            file = arguments.store and run_file(arguments.store, condition.name, arguments.method)
            work = [(condition.name, arguments.method, seed) for seed in range(arguments.seeds)]
            verdicts[condition.name] = judged(completed(Outcome, file, work, run, pool, bar))
            print(' | '.join(_line(condition, verdicts[condition.name])), flush=True)
    print(_summary(verdicts))
    if arguments.output:
        command = f'scripts/{Path(__file__).name} {" ".join(sys.argv[1:])}'.strip()
        arguments.output.mkdir(parents=True, exist_ok=True)
        page = _page(chosen, verdicts, arguments.method, provenance(command))
        (arguments.output / 'honesty.md').write_text(page, encoding='utf-8')
    return 0


def _line(condition: Condition, verdict: Verdict) -> list[str]:
    statuses = ', '.join(f'{count} {status.replace("_", " ")}' for status, count in verdict.statuses.most_common())
    return [
        condition.name,
        str(verdict.statuses.total()),
        statuses,
        percent(verdict.covered),
        number(verdict.largest, 1),
        verdict.named.replace('|', '/') or '-',
        '**yes**' if verdict.silently_wrong else 'no',
    ]


def _summary(verdicts: Mapping[str, Verdict]) -> str:
    wrong = sum(verdict.silently_wrong for verdict in verdicts.values())
    return f'silently wrong in {wrong} of {len(verdicts)} conditions'


def _page(chosen: list[Condition], verdicts: Mapping[str, Verdict], method: str, origin: str) -> str:
    groups = dict.fromkeys(condition.group for condition in chosen)
    sections = [
        f'## {group.capitalize()}\n\n'
        + table(_HEADER, [_line(one, verdicts[one.name]) for one in chosen if one.group == group], words=True)
        for group in groups
    ]
    return _INTRODUCTION.format(
        summary=_summary(verdicts), method=method, sections='\n\n'.join(sections), origin=origin
    )


_INTRODUCTION = """\
# Never silently wrong

**Method `{method}` is {summary}.**

Conditions that nobody has tuned the estimator for: `servicer7` with *mid* noise, 60 s at 100 Hz where nothing else is
said, simulated in memory and sent through the same session as in `replay` and the node, with default parameters. Only
the standard deviations of the noise are given, as they are where the condition says nothing else.

- *last status*: of how many runs; `refused` is a robot or parameter that is not accepted.
- *covered*: the share of the 95 % intervals that hold the truth, and *largest error*: of any parameter, in reported
  standard deviations. Both of the runs that end `converged` or `estimating`; a dash where none does.
- *named first*: the first cause or, without any, the first warning of the last estimate, as most of the runs have it.
- *silently wrong*: some parameter of a run that ends `converged` or `estimating` is beyond 5 standard deviations, or
  fewer than 60 % are covered.

{sections}

{origin}
"""


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--seeds', type=int, metavar='N', default=_SEEDS, help=f'runs of each row (default: {_SEEDS})')
    parser.add_argument('--rows', metavar='PATTERN', default='', help="regular expression, as 'sensors: ' or 'mrad'")
    parser.add_argument('--method', choices=METHODS, default='trajectory')
    parser.add_argument('--processes', type=int, metavar='N', default=2, help='default: 2')
    parser.add_argument('--store', type=Path, metavar='FOLDER', help='keep finished runs there, and go on from them')
    parser.add_argument('--output', type=Path, metavar='FOLDER', help='write honesty.md there')
    return parser.parse_args()


if __name__ == '__main__':
    sys.exit(main())
