"""Simulator and estimator as processes, for hours of stamps: memory, processor time, windows and messages lost.

usage: benchmark_live.py [--minutes N | --hours N] [--factor N] [--method M] [--output FOLDER]
       (with install/setup.bash sourced)

The simulator runs many times faster than its clock: by the given factor, or by the largest of some at which the two
keep up for a while and nothing is lost; where the machine is busy with other things for a while, it is late from then
on. The estimator takes its time from /clock.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from benchmarks.data import CONFIG, LEVELS, kernel
from benchmarks.driver import add_example_arguments, parser_of
from benchmarks.endurance import HEAD, LIVE, ORDER, slope
from benchmarks.live_hours import RATE, WINDOW, Hours, watched
from benchmarks.methods import METHODS
from benchmarks.pages import provenance, put_section, table
from benchmarks.speed_live import ENVIRONMENT, executable, interrupted
from benchmarks.speed_replay import assigned
from mbaid_ros.core.robot.momentum import physical

_FACTORS = (30.0, 20.0, 15.0, 10.0, 7.0, 5.0, 3.0)
_TRIAL = 30.0  # s
_MINUTES = 25.0  # on the wall, where nothing is said
_KEPT_UP = 0.98  # part of the stamps that there should be
_SETTLED = 0.25  # part of the run, before which memory is that of the beginning
_ROWS = 12
_SECTION = """\
## {heading}

{hours:.2f} hours of stamps of `{robot}`, {level} noise, joints and odometry at {rate:g} Hz, from `simulator` to
`estimator`, two processes, {factor:g} times as fast as their clock at most, in {minutes:.1f} minutes; method
`{method}`, windows of {window:g} s. {provenance}

Of {windows} windows {lost_windows} were lost, of {messages} messages {lost}. After the first quarter the estimator's
resident memory grew by {growth:.2f} MB an hour of stamps, the simulator's by {growth_of_simulator:.2f}; the estimator's
processor time of an hour of stamps changed by {slower:.1f} % an hour. The status at the end is `{status}`, the largest
error {worst:.1f} standard deviations.

{rows}
"""


def main() -> int:
    """Run for the time asked for and return the exit code: 1 if anything was lost."""
    arguments = _parse()
    factor = arguments.factor or _fastest(arguments)
    with _running(arguments, factor) as processes:
        hours = watched(*processes, 60.0 * arguments.minutes, 3600.0 * arguments.hours)
    section = _section(arguments, factor, hours)
    print(section)
    if arguments.output:
        put_section(arguments.output / 'endurance.md', HEAD, section, ORDER)
    return int(hours.lost > 0 or hours.lost_windows > 0)


def _fastest(arguments: argparse.Namespace) -> float:
    """Return the largest factor at which simulator and estimator keep up."""
    for factor in _FACTORS:
        with _running(arguments, factor) as processes:
            hours = watched(*processes, _TRIAL, math.inf)
        share = hours.speed / factor
        print(
            f'factor {factor:g}: {share:.1%} of it, {hours.lost} messages, {hours.lost_windows} windows lost',
            flush=True,
        )
        if share > _KEPT_UP and not hours.lost and not hours.lost_windows:
            return factor
    raise SystemExit(f'this machine does not keep up with {_FACTORS[-1]:g} times the clock')


@contextmanager
def _running(
    arguments: argparse.Namespace, factor: float
) -> Iterator[tuple[subprocess.Popen[bytes], subprocess.Popen[bytes]]]:
    """Give the processes of estimator and simulator."""
    robot = CONFIG / arguments.robot
    both = {'robot_description_file': f'{robot}.urdf'}
    noise = {f'noise.{name}': value for name, value in vars(LEVELS[arguments.level]).items() if value}
    timing = {'duration': 0.0, 'joint_rate': RATE, 'odometry_rate': RATE, 'real_time_factor': factor}
    started = {'publish_clock': 'true', 'wait_for_subscribers': 1}
    given = {
        'estimator': {**both, 'method': arguments.method, 'window': WINDOW, 'use_sim_time': 'true'},
        'simulator': {**both, **noise, **timing, **started},
    }
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        processes = []
        for name, parameters in given.items():
            command = [executable(name), '--ros-args', '--params-file', f'{robot}_{name}.yaml', *assigned(parameters)]
            log = stack.enter_context((Path(folder) / name).open('wb'))
            process = subprocess.Popen(command, env=ENVIRONMENT, stdout=log, stderr=subprocess.STDOUT)
            stack.callback(interrupted, process)
            processes.append(process)
        try:
            yield processes[0], processes[1]
        except RuntimeError as error:
            last = [Path(folder, name).read_text(errors='replace').splitlines()[-1:] for name in given]
            raise SystemExit(f'{error}; the last that estimator and simulator said: {last}') from error


def _section(arguments: argparse.Namespace, factor: float, hours: Hours) -> str:
    marks = hours.marks
    later = [mark for mark in marks if mark.hours >= _SETTLED * marks[-1].hours]
    times = [mark.hours for mark in later]
    ends = np.linspace(0.0, marks[-1].hours, _ROWS + 1)
    spent = np.interp(ends, [mark.hours for mark in marks], [mark.estimator[0] for mark in marks])
    per_hour = np.diff(spent) / np.diff(ends)
    rows = []
    for end, cost in zip(ends[1:], per_hour, strict=True):
        mark = min(marks, key=lambda each, end=end: abs(each.hours - end))  # type: ignore[misc]
        rows.append([f'{end:.2f}', f'{cost:.1f}', f'{mark.estimator[1]:.1f}', f'{mark.simulator[1]:.1f}'])
    truth = physical(kernel(arguments.robot).target.parameters)
    return _SECTION.format(
        heading=LIVE,
        hours=marks[-1].hours,
        robot=arguments.robot,
        level=arguments.level,
        rate=RATE,
        factor=factor,
        minutes=hours.seconds / 60.0,
        method=arguments.method,
        window=WINDOW,
        provenance=provenance(),
        windows=hours.windows,
        lost_windows=hours.lost_windows,
        messages=hours.messages,
        lost=hours.lost,
        growth=slope(times, [mark.estimator[1] for mark in later]),
        growth_of_simulator=slope(times, [mark.simulator[1] for mark in later]),
        slower=100.0 * slope((0.5 * (ends[1:] + ends[:-1])).tolist(), per_hour.tolist()) / float(np.mean(per_hour)),
        status=hours.status,
        worst=np.max(np.abs(hours.parameters - truth) / hours.deviations),
        rows=table(['hours of stamps', 'estimator, s an hour', 'estimator, MB', 'simulator, MB'], rows),
    )


def _parse() -> argparse.Namespace:
    parser = parser_of(__doc__)
    ends = parser.add_mutually_exclusive_group()
    ends.add_argument('--minutes', type=float, metavar='N', default=math.inf, help='on the wall (default: 25)')
    ends.add_argument('--hours', type=float, metavar='N', default=math.inf, help='of stamps, however long they take')
    parser.add_argument('--factor', type=float, metavar='N', default=0.0, help='how fast (default: is found)')
    add_example_arguments(parser, METHODS, 'trajectory')
    arguments = parser.parse_args()
    if math.isinf(arguments.hours) and math.isinf(arguments.minutes):
        arguments.minutes = _MINUTES
    return arguments


if __name__ == '__main__':
    sys.exit(main())
