"""Conditions that nobody has tuned the estimator for: whether it is ever silently wrong, and what it names.

usage: benchmark_honesty.py [--seeds N] [--rows PATTERN] [--method M] [--processes N] [--store FOLDER]
       [--output FOLDER]
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.honesty.catalogue import CONDITIONS
from benchmarks.honesty.command import command, outcomes, parsed, write
from benchmarks.honesty.condition import Condition
from benchmarks.honesty.runs import REFUSED
from benchmarks.honesty.verdicts import FAR, Verdict, judged
from benchmarks.honesty.wrong_models import WRONG_FILES
from benchmarks.pages import number, percent, provenance, table

_PAGE = 'honesty.md'
_SEEDS = 6
_HEADER = (
    'condition',
    'seeds',
    'last status',
    'covered',
    'largest error',
    'jointly',
    'at first',
    'later',
    'named first',
    'true cause',
    'silently wrong',
)
_SHOWN = 3  # causes that a reader looks at


def main() -> int:
    """Run the benchmark and return the exit code."""
    arguments = parsed(__doc__.partition('\n')[0], CONDITIONS, _SEEDS, _PAGE)
    verdicts: dict[str, Verdict] = {}
    for condition, outcome in outcomes(arguments):
        verdicts[condition.name] = judged(outcome, condition.name)
        print(' | '.join(_line(condition, verdicts[condition.name])), flush=True)
    print(_summary(verdicts))
    print(_found(verdicts))
    print(_early(verdicts))
    print(_alarms(arguments.conditions, verdicts))
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
        number(verdict.jointly, 1),
        number(verdict.young, 1) if verdict.young > 0.0 else '-',
        f'{number(verdict.ever, 1)} at {verdict.ever_at:.1f} s' if verdict.ever > 0.0 else '-',
        verdict.named.replace('|', '/') or '-',
        ', '.join(str(place or '-') for place in verdict.places),
        '**yes**' if verdict.silently_wrong else 'no',
    ]


def _summary(verdicts: Mapping[str, Verdict]) -> str:
    wrong = sum(verdict.silently_wrong for verdict in verdicts.values())
    return f'silently wrong in {wrong} of {len(verdicts)} conditions'


def _early(verdicts: Mapping[str, Verdict]) -> str:
    first = sum(verdict.young > FAR for verdict in verdicts.values())
    later = sum(verdict.ever > FAR for verdict in verdicts.values())
    return (
        f'On its way, some run published an estimate beyond {FAR:g} standard deviations in {later} of {len(verdicts)} '
        f'conditions, and in {first} within the first seconds, with a warning that says so.'
    )


def _alarms(conditions: Sequence[Condition], verdicts: Mapping[str, Verdict]) -> str:
    undisturbed = [verdicts[one.name] for one in conditions if one.group == 'undisturbed']
    windows, alarms = sum(one.windows for one in undisturbed), sum(one.alarms for one in undisturbed)
    return f'Where nothing is wrong, {alarms} of {windows} estimates are `inconsistent`.'


def _found(verdicts: Mapping[str, Verdict]) -> str:
    places = [place for verdict in verdicts.values() for place in verdict.places]
    first, among = (sum(0 < place <= most for place in places) for most in (1, _SHOWN))
    whole = max(len(places), 1)
    return (
        f'The true cause stands first in {first} of {len(places)} runs in which something is wrong '
        f'({percent(first / whole)}), among the first {_SHOWN} in {among} ({percent(among / whole)}).'
    )


def _wrong_files(verdicts: Mapping[str, Verdict]) -> str:
    """Return the section on wrong descriptions of one robot; empty where not all of them were run."""
    if not set(WRONG_FILES) <= set(verdicts):
        return ''
    rows = []
    for name in WRONG_FILES:
        verdict = verdicts[name]
        told = 'refused' if set(verdict.statuses) == {REFUSED} else 'told' if np.isnan(verdict.largest) else 'inside'
        rows.append([name, told, ', '.join(verdict.statuses).replace('_', ' '), verdict.named.replace('|', '/') or '-'])
        rows[-1][1] = '**silently wrong**' if verdict.silently_wrong else told
    header = ('what is wrong in the URDF', 'outcome', 'last status', 'named first')
    return f'{_WRONG_FILES}{table(header, rows, words=True)}'


def _page(chosen: Sequence[Condition], verdicts: Mapping[str, Verdict], method: str, made_by: str) -> str:
    groups = dict.fromkeys(condition.group for condition in chosen)
    sections = [
        f'## {group.capitalize()}\n\n'
        + table(_HEADER, [_line(one, verdicts[one.name]) for one in chosen if one.group == group], words=True)
        for group in groups
    ]
    sections.append(_wrong_files(verdicts))
    return _INTRODUCTION.format(
        summary=_summary(verdicts),
        found=_found(verdicts),
        early=_early(verdicts),
        alarms=_alarms(chosen, verdicts),
        method=method,
        sections='\n\n'.join(section for section in sections if section),
        origin=provenance(command=made_by),
    )


_INTRODUCTION = """\
# Never silently wrong

**Method `{method}` is {summary}.**

**{found}**

{early} A model that is far from the robot agrees with the first seconds of motion: what it takes for the body is
contradicted by what follows. Estimates of the first 6 s of numbers therefore carry a warning.
{alarms}

Conditions that nobody has tuned the estimator for: `servicer7` with *mid* noise, 60 s at 100 Hz where nothing else is
said, simulated in memory and sent through the same session as in `replay` and the node, with default parameters. Only
the standard deviations of the noise are given, as they are where the condition says nothing else.

- *last status*: of how many runs; `refused` is a robot or parameter that is not accepted.
- *covered*: the share of the 95 % intervals that hold the truth, and *largest error*: of any parameter, in reported
  standard deviations; *jointly*: of all parameters of a run together, in the metric of their covariance, what a single
  one would be off by to be as unlikely. All of the runs that end `converged` or `estimating`; a dash where none does.
- *at first*, *later*: the largest error of any parameter in any estimate that any run published on its way: of those
  with the warning that they are first ones, and of all others, and when that was.
- *named first*: the first cause or, without any, the first event or warning of the last estimate, as most of the runs
  have it. [trajectory.md](trajectory.md#verdict-coreverdict) tells how causes are found.
- *true cause*: at which place each run names what is wrong, a dash where it does not. Runs that are right and name
  nothing are left out, and conditions with nothing to be named.
- *silently wrong*: some parameter of a run that ends `converged` or `estimating`, or all of them jointly, is beyond 5
  standard deviations, or fewer than 60 % are covered.

{sections}

{origin}
"""

_WRONG_FILES = """\
## Twelve wrong URDFs of one robot

Of these conditions, those in which the file is wrong. *told*: every run ends `inconsistent` or `not_identifiable`;
*inside*: runs that publish hold the truth as above; *refused*: the file is not accepted. What no motion tells is a file
whose masses are all wrong by one factor: they grow together with the momentum. The total mass is among what
`replay` and the node say of the robot first.

"""


if __name__ == '__main__':
    sys.exit(main())
