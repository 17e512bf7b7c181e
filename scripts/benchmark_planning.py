"""Planned motions against random ones within the same limits, and what truly comes of them; writes planning.md.

usage: benchmark_planning.py [--seeds N] [--rows PATTERN] [--processes N] [--store FOLDER] [--output FOLDER]
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np

from benchmarks.driver import add_run_arguments, driving, parser_of
from benchmarks.pages import machine, number, table
from benchmarks.planned_runs import DRAWS, LONGER, LONGER_SEEDS, TURN, WANTED, Case, Outcomes, run
from benchmarks.random_sinusoids import LENGTHS, SINUSOIDS
from mbaid_ros.core.geometry import Array
from mbaid_ros.planning.planner import PlanSettings

ROBOTS, SPEEDS = ('servicer7', 'ets7', 'table1'), (1.0, 5.0)  # deg/s
HEADER = (
    'robot, joints, base',
    'states',
    'planned',
    f'best of {SINUSOIDS}',
    'planned / best',
    f'{LONGER} compared',
    'reached / promised',
    'of the true body',
    'in 95 %',
    'turned, most',
    'turned, drawn',
    'search',
)
PAGE = 'planning.md'
_CLOSE = 0.2  # by which what is reached may differ from what was promised
HEAD = """\
# Planned motions, measured

Written by `make benchmark-planning` (`scripts/benchmark_planning.py`{arguments}; {machine}).

Each state is that of a simulated robot, drawn: a pose of the arm, a slow tumble (2 mrad/s about each axis, one
standard deviation), six seconds of a drawn motion at 2 deg/s at most, half a second of rest, seen by sensors of 100
Hz (encoders 0.1 mrad, base 1 mm and 0.1 mrad, twist 1 mm/s and 0.1 mrad/s), identified by method `trajectory`. From
there a motion is planned that brings every parameter to {wanted:g} %, with the default {usual} motions compared.
**planned**: its length, median. **best of {sinusoids}**: the shortest time in which one of {sinusoids} random
sinusoids (two terms a joint, periods of 8 to 40 s, as large as the same limits of joints and base allow; they begin
at rest, and need not end there) is predicted to reach the same, a dash where in half of the states none does so in
{longest:g} s. **planned / best**: median of the ratios, and their range; 0 where no sinusoid reaches
it. **{longer} compared**: the median where a search compares so many motions, of the first {few} states of two
robots; in brackets that of the usual search for the same states. Then the planned motion is made by the simulated
robot, with noise, and the run goes on. **reached / promised**: standard deviations of the estimator over the
predicted ones, median and range over parameters and states, and the share of them within 0.8 to 1.2. **of the true
body**: the same over what would have been predicted for the same motion if the body had been known: what is left of the
difference where the present estimate is not to blame. **in 95 %**: errors within the estimator's intervals.
**turned, most**: the furthest that a base was truly turned from where it would have been with the joints at rest, and
how many were further than the limit. **turned, drawn**: the same of {draws} robots for each state, their body and
momentum drawn from what the run knows where the motion begins; bodies that cannot be are left out. **search**: median
time of one core.

"""


def main() -> int:
    """Run the benchmark and return the exit code."""
    parser = parser_of(__doc__)
    add_run_arguments(parser, 20, 20)
    parser.add_argument('--rows', metavar='PATTERN', default='', help="regular expression, as 'ets7|5 deg'")
    parser.add_argument('--output', type=Path, metavar='FOLDER', help=f'write {PAGE} there')
    arguments = parser.parse_args()
    cases = [(robot, speed, limited) for robot in ROBOTS for speed in SPEEDS for limited in (True, False)]
    named = [(_name(*case), case) for case in cases if re.search(arguments.rows, _name(*case))]
    rows = []
    with driving(len(named) * arguments.seeds, arguments.processes, arguments.store) as driver:
        for name, (robot, speed, limited) in named:
            work = [Case(robot, float(np.radians(speed)), limited, seed) for seed in range(arguments.seeds)]
            file = re.sub(r'\W+', '_', name)
            rows.append(_row(name, driver.completed(Outcomes, file, work, run), limited=limited))
            print(' | '.join(rows[-1]), flush=True)
    if arguments.output is not None:
        said = f' --seeds {arguments.seeds}' + (f" --rows '{arguments.rows}'" if arguments.rows else '')
        head = HEAD.format(
            arguments=said,
            machine=machine(),
            wanted=100.0 * WANTED,
            usual=PlanSettings.effort,
            sinusoids=SINUSOIDS,
            longest=LENGTHS[-1],
            longer=LONGER,
            few=LONGER_SEEDS,
            draws=DRAWS,
        )
        (arguments.output / PAGE).write_text(f'{head}{table(HEADER, rows)}\n', encoding='utf-8')
    return 0


def _name(robot: str, speed: float, limited: bool) -> str:  # noqa: FBT001 - as cases have it
    return f'{robot}, {speed:g} deg/s, {"2 deg" if limited else "free"}'


def _row(name: str, found: Outcomes, *, limited: bool) -> list[str]:
    ratio = found.planned / found.sinusoids
    known = ratio[np.isfinite(ratio)]
    beyond = f', {int(np.sum(found.turned > TURN))} beyond' if limited else ''
    return [
        name,
        str(len(found)),
        f'{number(float(np.nanmedian(found.planned)), 1)} s' + _missing(found),
        f'{number(float(np.median(found.sinusoids)), 1)} s',
        f'{np.median(known):.2f} ({known.min():.2f} to {known.max():.2f})' if len(known) else '-',
        _longer(found),
        _promised(found.reached),
        _promised(found.true_body),
        f'{int(found.inside.sum())} of {found.inside.size}',
        f'{np.degrees(found.turned.max()):.2f} deg{beyond}',
        _strayed(found, limited=limited),
        f'{np.median(found.searched):.1f} s',
    ]


def _promised(ratio: Array) -> str:
    """Return median and range of what was reached over what was promised, and the share that is close to 1."""
    known = ratio[np.isfinite(ratio)]
    within = 100.0 * np.mean(np.abs(known - 1.0) <= _CLOSE)
    return f'{np.median(known):.2f} ({known.min():.2f} to {known.max():.2f}), {within:.0f} %'


def _longer(found: Outcomes) -> str:
    """Return the median of what a longer search comes to, and of the usual one's for the same states."""
    made = np.isfinite(found.longer) & np.isfinite(found.planned) & np.isfinite(found.sinusoids)
    if not made.any():
        return '-'
    longer, usual = (float(np.median((each / found.sinusoids)[made])) for each in (found.longer, found.planned))
    return f'{longer:.2f} ({usual:.2f})'


def _strayed(found: Outcomes, *, limited: bool) -> str:
    strayed = found.strayed[np.isfinite(found.strayed)]
    beyond = f', {int(np.sum(strayed > TURN))} of {len(strayed)} beyond' if limited else ''
    return f'{np.degrees(strayed.max()):.2f} deg{beyond}'


def _missing(found: Outcomes) -> str:
    """Return how many plans reach nothing, if any."""
    count = int(np.isnan(found.planned).sum())
    return f' ({count} out of reach)' if count else ''


if __name__ == '__main__':
    sys.exit(main())
