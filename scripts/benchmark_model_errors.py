"""Monte Carlo over robots that are not their URDF: whether intervals hold, over what is attainable; an error budget.

usage: benchmark_model_errors.py [--seeds N] [--others N] [--steps N] [--robots R ...] [--sections S ...]
       [--processes N] [--store FOLDER] [--output FOLDER]
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from benchmarks.data import ROBOTS
from benchmarks.model_errors import flywheel
from benchmarks.model_errors.page import Outcomes, page, row
from benchmarks.model_errors.plan import EXAMPLE, SECTIONS, outcomes, plan
from benchmarks.model_errors.runs import budget
from benchmarks.model_errors.variant import monte_carlo
from benchmarks.pages import provenance

_SEEDS, _OTHERS, _STEPS = 50, 20, 20
_WHEELS = 4
_MASS_STD = 0.01 * flywheel.MASS


def main() -> int:
    """Run the benchmark and return the exit code."""
    arguments = _parse()
    found: Outcomes = {}
    for variant, outcome in outcomes(
        plan(arguments.sections, arguments.robots, (arguments.seeds, arguments.others, arguments.steps)),
        arguments.processes,
        arguments.store,
    ):
        found = {**found, variant: outcome}
        print(' | '.join(row(variant, outcome)), flush=True)
    if arguments.output:
        wheel = {std: flywheel.rows(range(_WHEELS), std) for std in (0.0, _MASS_STD)}
        example = budget(next(monte_carlo(EXAMPLE)), 0)
        # Where finished runs are kept is nobody's business.
        counts = f'--seeds {arguments.seeds} --others {arguments.others} --steps {arguments.steps}'
        command = f'scripts/{Path(__file__).name} {counts} --output docs'
        arguments.output.mkdir(parents=True, exist_ok=True)
        text = page(found, wheel, example, provenance(command=command))
        (arguments.output / 'model-errors.md').write_text(text, encoding='utf-8')
    return 0


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument(
        '--seeds', type=int, metavar='N', default=_SEEDS, help=f'robots with all blocks on (default: {_SEEDS})'
    )
    parser.add_argument(
        '--others', type=int, metavar='N', default=_OTHERS, help=f'robots of every other row (default: {_OTHERS})'
    )
    parser.add_argument(
        '--steps', type=int, metavar='N', default=_STEPS, help=f'robots of each step of the ladder (default: {_STEPS})'
    )
    parser.add_argument('--robots', nargs='+', choices=list(ROBOTS), default=[EXAMPLE, 'ets7', 'table1'])
    parser.add_argument('--sections', nargs='+', choices=SECTIONS, default=SECTIONS)
    parser.add_argument('--processes', type=int, metavar='N', default=os.cpu_count(), help='default: one a core')
    parser.add_argument('--store', type=Path, metavar='FOLDER', help='keep finished runs there, and go on from them')
    parser.add_argument('--output', type=Path, metavar='FOLDER', help='write model-errors.md there')
    return parser.parse_args()


if __name__ == '__main__':
    sys.exit(main())
