"""Conditions that nobody has tuned the estimator for: whether it is ever silently wrong, and what it names.

usage: benchmark_honesty.py [--seeds N] [--rows PATTERN] [--method M] [--processes N] [--store FOLDER]
       [--output FOLDER]
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence

from benchmarks.honesty.catalogue import CONDITIONS
from benchmarks.honesty.command import command, outcomes, parsed, write
from benchmarks.honesty.condition import Condition
from benchmarks.honesty.verdicts import Verdict, judged
from benchmarks.pages import number, percent, provenance, table

_PAGE = 'honesty.md'
_SEEDS = 6
_HEADER = ('condition', 'seeds', 'last status', 'covered', 'largest error', 'named first', 'silently wrong')


def main() -> int:
    """Run the benchmark and return the exit code."""
    arguments = parsed(__doc__.partition('\n')[0], CONDITIONS, _SEEDS, _PAGE)
    verdicts: dict[str, Verdict] = {}
    for condition, outcome in outcomes(arguments):
        verdicts[condition.name] = judged(outcome)
        print(' | '.join(_line(condition, verdicts[condition.name])), flush=True)
    print(_summary(verdicts))
    write(arguments, _PAGE, _page(arguments.conditions, verdicts, arguments.method, command(arguments)))
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


def _page(chosen: Sequence[Condition], verdicts: Mapping[str, Verdict], method: str, made_by: str) -> str:
    groups = dict.fromkeys(condition.group for condition in chosen)
    sections = [
        f'## {group.capitalize()}\n\n'
        + table(_HEADER, [_line(one, verdicts[one.name]) for one in chosen if one.group == group], words=True)
        for group in groups
    ]
    return _INTRODUCTION.format(
        summary=_summary(verdicts), method=method, sections='\n\n'.join(sections), origin=provenance(made_by)
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
- *named first*: the first cause or, without any, the first event or warning of the last estimate, as most of the runs
  have it. `scripts/benchmark_causes.py` tells at which place the true cause stands, and
  [trajectory.md](trajectory.md#verdict-coreverdict) how causes are found.
- *silently wrong*: some parameter of a run that ends `converged` or `estimating` is beyond 5 standard deviations, or
  fewer than 60 % are covered.

{sections}

{origin}
"""


if __name__ == '__main__':
    sys.exit(main())
