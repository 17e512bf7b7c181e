"""The paper's claims beside measurements: its recursion on its own case, without noise.

usage: paper_table.py [--output FOLDER]

Exit code 1 if a settling time differs by more than 10 % from that of an independent implementation, or if a spatial
servicer's parameters are not found.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks import paper_page
from benchmarks.data import LEVELS, ROBOTS, kernel, momentum_of, motion, readings
from benchmarks.driver import parser_of
from benchmarks.methods import Identification
from benchmarks.pages import write
from benchmarks.recursion import FORMS, all_bodies_rank, recursion
from mbaid_ros.core.robot.momentum import physical

_RATES = (100.0, 50.0, 10.0)  # Hz
_PLANE = [0, 1, 2, 9]  # m, x_c, y_c, Izz
_SPATIAL = ('servicer7', 'ets7')
_DIFFERENCE_LIMIT = 1e-8  # relative error of method difference without noise


def main() -> int:
    """Run the table and return the exit code."""
    parser = parser_of(__doc__)
    parser.add_argument('--output', type=Path, metavar='FOLDER', help='write paper-claims.md there')
    arguments = parser.parse_args()
    measured = _measure()
    problems = list(_problems(measured))
    print(paper_page.text(measured))
    for problem in problems:
        print(f'paper_table.py: {problem}', file=sys.stderr)
    if arguments.output and not problems:
        write(arguments.output, 'paper-claims.md', paper_page.page(measured))
    return 1 if problems else 0


def _measure() -> paper_page.Measured:
    settling, scaled, begin = {}, {}, {}
    for form in FORMS:
        for rate in _RATES:
            history = recursion('table1', form, rate)
            settling[form, rate] = tuple(float(value) for value in history.settled(0.01)[_PLANE])
            begin[form, rate] = float(history.settled(0.5)[9])
            scaled[form, rate] = float(max(recursion('table1', form, rate, scaled=True).settled(0.01)[_PLANE]))
    return paper_page.Measured(
        settling=settling,
        inertia_begins=begin,
        scaled=scaled,
        spatial={
            robot: {form: float(abs(recursion(robot, form, 100.0).error[-1]).max()) for form in FORMS}
            for robot in _SPATIAL
        },
        difference={robot: _exact_error(robot) for robot in ROBOTS},
        ranks={robot: all_bodies_rank(robot) for robot in ROBOTS},
    )


def _exact_error(robot: str) -> float:
    """Return the largest relative error of method difference at the end of a noise-free run."""
    truth = motion(robot)
    noise = LEVELS['mid']
    task = Identification(kernel(robot), noise, momentum_of(robot, truth))
    last = task.estimates('difference', *readings(truth, noise, None))[-1]
    target = physical(kernel(robot).target.parameters)
    chosen = _PLANE if robot == 'table1' else list(range(10))
    return float(abs(last.parameters[chosen] / target[chosen] - 1.0).max())


def _problems(measured: paper_page.Measured) -> Iterator[str]:
    for (form, rate), independent in paper_page.INDEPENDENT.items():
        for name, value, wanted in zip(paper_page.NAMES, measured.settling[form, rate], independent, strict=True):
            if not abs(value / wanted - 1.0) <= paper_page.AGREEMENT:
                yield f'{form} at {rate:g} Hz: {name} settles after {value:g} s; {wanted:g} s expected'
    for robot, by_form in measured.spatial.items():
        for form, error in by_form.items():
            if not error <= paper_page.SPATIAL_LIMIT:
                yield f'{robot}, {form}: relative error {error:.1e}; at most {paper_page.SPATIAL_LIMIT:.0e} expected'
    for robot, error in measured.difference.items():
        if not error <= _DIFFERENCE_LIMIT:
            yield f'{robot}, method difference: relative error {error:.1e}; at most {_DIFFERENCE_LIMIT:.0e} expected'


if __name__ == '__main__':
    sys.exit(main())
