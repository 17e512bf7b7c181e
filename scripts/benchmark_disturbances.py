"""Monte Carlo over disturbances: thrust, forces, wrong known links, wheels, late joints, a capture.

usage: benchmark_disturbances.py [--seeds N] [--cases C ...] [--methods M ...] [--processes N] [--store FOLDER]
       [--output FOLDER]
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.disturbed import CASES, LEVEL, ROBOT, SECONDS, Row, Said, motion, run
from benchmarks.driver import add_run_arguments, driving, parser_of
from benchmarks.pages import number, percent, provenance, table, write
from mbaid_ros.replay.campaigns.monte_carlo import coverage

_SEEDS = 50
_METHODS = ('difference', 'trajectory')


def _links(std: float) -> dict[str, object]:
    # Published however wide they are, so that the intervals can be judged.
    return {'known_links.relative_std': std, 'convergence.identifiable_std': 100.0}


ROWS = (
    Row('none', 'nothing'),
    Row('none', 'a force, odometry axes', {'disturbance.constant': 'inertial'}, ('trajectory',)),
    Row('none', 'a force, base axes', {'disturbance.constant': 'body'}, ('trajectory',)),
    Row('pulse', 'found'),
    Row('pulse', 'told', told=True),
    *(
        row
        for axes in ('inertial', 'body')
        for row in (
            Row(axes, 'found'),
            Row(axes, 'given', {'disturbance.constant': axes}, ('trajectory',)),
        )
    ),
    *(
        row
        for share in (0.01, 0.05)
        for row in (
            Row(f'links {100.0 * share:.0f} %', 'taken for exact'),
            Row(f'links {100.0 * share:.0f} %', 'considered', _links(share), ('difference',)),
            Row(f'links {100.0 * share:.0f} %', 'estimated', _links(share), ('trajectory',)),
        )
    ),
    Row('wheels', 'their speeds are read'),
    Row('wheels untold', 'found'),
    Row('late', 'taken as stamped', {'time_offset.estimate': False}),
    Row('late', 'found'),
    Row('capture', 'its time is told', {'capture.time': 20.0, 'debris.report': True}),
)


def main() -> int:
    """Run the benchmark and return the exit code."""
    arguments = _parse()
    plain = ROWS[0]
    rows = [row for row in ROWS if row.case in arguments.cases or row is plain]
    # Simulated here, once; the workers inherit it.
    for case in {row.case for row in rows}:
        motion(case)
    wanted = [(row, method) for method in arguments.methods for row in rows if method in row.methods]
    results: dict[tuple[str, str], Said] = {}
    with driving(len(wanted) * arguments.seeds, arguments.processes, arguments.store) as driver:
        for row, method in wanted:
            work = [(row, method, seed) for seed in range(arguments.seeds)]
            results[method, row.name] = driver.completed(Said, f'{method}-{row.name}', work, run)
            print(' | '.join(_line(row, method, results)), flush=True)
    if arguments.output:
        order = list(CASES)
        lines = [
            _line(row, method, results) for row, method in sorted(wanted, key=lambda item: order.index(item[0].case))
        ]
        write(arguments.output, 'disturbances.md', _page(table(_HEADER, lines)))
    return 0


_HEADER = (
    'case',
    'method',
    'allowed for',
    'RMSE over undisturbed',
    'worst',
    'std',
    'covered',
    'least',
    'largest error',
    'events',
    'inconsistent',
    'by',
)


def _line(row: Row, method: str, results: Mapping[tuple[str, str], Said]) -> list[str]:
    outcome, plain = results[method, row.name], results[method, ROWS[0].name]
    known = np.isfinite(outcome.std) & np.isfinite(outcome.error)
    # What some runs leave open is judged by the others.
    deviation = np.abs(np.divide(outcome.error, outcome.std, where=known, out=np.full(known.shape, np.nan)))
    share = coverage(outcome.error, outcome.std)
    ratio = widened = np.full(1, np.nan)
    if outcome.error.shape[1] == plain.error.shape[1]:
        ratio, widened = (
            np.sqrt(np.mean(now**2, axis=0, where=known) / np.mean(before**2, axis=0))
            for now, before in ((outcome.error, plain.error), (outcome.std, plain.std))
        )
    noticed = outcome.noticed[np.isfinite(outcome.noticed)]
    return [
        CASES[row.case].title,
        method,
        row.option,
        number(float(np.median(ratio))),
        number(float(np.max(ratio))),
        number(float(np.median(widened))),
        percent(float(np.mean(share))),
        percent(float(np.min(share))),
        number(float(np.nanmax(deviation)), 1),
        f'{np.mean(outcome.events):.1f} in {percent(len(noticed) / len(outcome.noticed))}',
        percent(float(np.mean(outcome.wrong))),
        f'{np.max(noticed):.1f} s' if len(noticed) else '-',
    ]


def _page(lines: str) -> str:
    return f"""# When something disturbs

What a disturbance costs, and whether it is noticed: `{ROBOT}`, {LEVEL} noise, {SECONDS:g} s at 100 Hz, simulated as
`simulate` does and sent through the same session as in `replay` and the node. [How it works](method.md).

- *RMSE over undisturbed*: of the ten parameters, over those of the same method undisturbed: median and worst.
- *std*: the median widening of the reported standard deviations, which is what more unknowns cost by themselves.
- *covered*: the share of the 95 % intervals that hold the truth; *least*: that of the worst parameter.
- *largest error* of any parameter in any run, in reported standard deviations; of runs that end as
  `inconsistent`, whose numbers are not to be trusted, as well.
- *events*: their mean number, and the share of the runs with any; *inconsistent*: the share of the runs with that
  status at the end; *by*: when the last run reported its first event.

The robot is told to be exactly its URDF, but where another option is named. Known links are wrong by another draw in
each run, each of them as a whole and each of its numbers beside that, as `known_links.relative_std` has it. Where that
is allowed for, everything is published, however wide its interval. After the capture, errors are those of the captured
body alone (ten parameters) and of the momentum that it had before (six).

{lines}

{provenance()}
"""


def _parse() -> argparse.Namespace:
    parser = parser_of(__doc__)
    add_run_arguments(parser, _SEEDS, _SEEDS)
    parser.add_argument('--cases', nargs='+', choices=list(CASES), default=list(CASES))
    parser.add_argument('--methods', nargs='+', choices=_METHODS, default=list(_METHODS))
    parser.add_argument('--output', type=Path, metavar='FOLDER', help='write disturbances.md there')
    return parser.parse_args()


if __name__ == '__main__':
    sys.exit(main())
