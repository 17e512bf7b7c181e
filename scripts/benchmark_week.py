"""A bag of a week through `replay`: processor time and memory day by day, and what is kept for the JSON.

usage: benchmark_week.py [--days N] [--rate HZ] [--method M] [--window S] [--bag FOLDER] [--output FOLDER]

The bag has a motion that repeats exactly every minute, with fresh noise. It is made where there is none, and stays
where --bag says so. It is read and identified by the very function that the executable calls, in this process.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.data import CONFIG, kernel
from benchmarks.driver import add_example_arguments, parser_of
from benchmarks.endurance import HEAD, ORDER, WEEK, resident, slope
from benchmarks.long_bag import make_long_bag
from benchmarks.methods import METHODS
from benchmarks.pages import provenance, put_section, table
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.parameters import build
from mbaid_ros.config.robot import read_robot_description
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.result_json import as_json
from mbaid_ros.replay.results import Run
from mbaid_ros.replay.run import replay_bag

_HOURS = 24.0  # a day
_EVERY = 0.25  # h, from one mark to the next
_WANTED_RATIO = 1.2
_SECTION = """\
## {heading}

{days:g} days of stamps of `{robot}`, {level} noise, joints and odometry at {rate:g} Hz: a bag of {messages} messages,
{size:.1f} GB, through what the executable `replay` calls; method `{method}`, windows of {window:g} s. {provenance}

It took {spent:.0f} s of the processor. The last day took {ratio:.2f} times as long as the first one. From the first
hour on resident memory grew by {growth:.2f} MB a day, from the third day on by {settled:.2f}, to {peak:.0f} MB at most;
the processor time of a day grew by {slower:.2f} % a day. Of {updates} updates {kept} estimates are kept for the JSON,
{json:.1f} MB. The status at the end is `{status}`, the largest error {worst:.1f} standard deviations.

{daily}
"""


@dataclass(frozen=True)
class Mark:
    """Where a replay was.

    Attributes
    ----------
    hours : of stamps that were read
    spent : s, of the processor
    memory : MB, resident
    """

    hours: float
    spent: float
    memory: float


def main() -> int:
    """Run the week and return the exit code: 1 if the last day took longer than the first one."""
    arguments = _parse()
    with tempfile.TemporaryDirectory() as folder:
        bag = arguments.bag or Path(folder) / 'week'
        if not bag.exists():
            given = (bag, arguments.robot, arguments.level, _HOURS * arguments.days, arguments.rate)
            making = multiprocessing.Process(target=make_long_bag, args=given)  # this process's memory is measured
            making.start()
            making.join()
        marks, run = _replayed(bag, arguments)
        size = sum(file.stat().st_size for file in bag.iterdir())
    text = json.dumps(as_json(run), allow_nan=False)
    section = _section(arguments, marks, run, size, len(text))
    print(section)
    if arguments.output:
        put_section(arguments.output / 'endurance.md', HEAD, section, ORDER)
    return 0 if _ratio(marks) <= _WANTED_RATIO else 1


def _replayed(bag: Path, arguments: argparse.Namespace) -> tuple[list[Mark], Run]:
    file = CONFIG / f'{arguments.robot}_estimator.yaml'
    config = build(EstimatorConfig, {**load_parameter_file(file, 'estimator'), 'method': arguments.method})
    config = replace(config, window=arguments.window)
    begin, marks = time.process_time(), [Mark(0.0, 0.0, resident())]

    def progress(done: int, total: int) -> None:
        hours = done / (2.0 * arguments.rate * 3600.0)
        if hours >= marks[-1].hours + _EVERY or (done == total and hours > marks[-1].hours):
            marks.append(Mark(hours, time.process_time() - begin, resident()))
            if int(hours) > int(marks[-2].hours):
                print(f'{marks[-1].hours:.2f} h: {marks[-1].spent:.1f} s, {marks[-1].memory:.1f} MB', flush=True)

    urdf = read_robot_description(CONFIG / f'{arguments.robot}.urdf')
    return marks, replay_bag(str(bag), config, urdf, Inputs(), progress=progress)


def _ratio(marks: list[Mark]) -> float:
    days = _days(marks)
    return days[-1] / days[0]


def _days(marks: list[Mark]) -> list[float]:
    """Return the processor time of each day, s."""
    hours, spent = [mark.hours for mark in marks], [mark.spent for mark in marks]
    ends = np.arange(0.0, hours[-1] + 0.5 * _EVERY, min(_HOURS, hours[-1]))
    return np.diff(np.interp(ends, hours, spent)).tolist()


def _section(arguments: argparse.Namespace, marks: list[Mark], run: Run, size: int, characters: int) -> str:
    days = _days(marks)
    truth = physical(kernel(arguments.robot).target.parameters)
    worst = np.max(np.abs((run.final.parameters - truth) / run.final.std))
    rows = []
    for day, spent in enumerate(days, start=1):
        memory = max(mark.memory for mark in marks if mark.hours <= _HOURS * day)
        rows.append(
            [str(day), f'{spent:.1f}', f'{1e3 * spent * arguments.window / (_HOURS * 3600.0):.2f}', f'{memory:.1f}']
        )
    return _SECTION.format(
        heading=WEEK,
        **vars(arguments),
        messages=sum(topic.messages for topic in run.topics),
        size=size / 1e9,
        provenance=provenance(),
        spent=marks[-1].spent,
        ratio=_ratio(marks),
        growth=_growth(marks, 1.0),
        settled=_growth(marks, 2.0 * _HOURS),
        peak=max(mark.memory for mark in marks),
        slower=100.0 * slope(range(len(days)), days) / np.mean(days) if len(days) > 1 else 0.0,
        updates=round(_HOURS * 3600.0 * arguments.days / arguments.window),
        kept=len(run.history),
        json=characters / 1e6,
        status=run.final.status,
        worst=worst,
        daily=table(['day', 'processor, s', 'update, ms', 'memory, MB'], rows),
    )


def _growth(marks: list[Mark], after: float) -> float:
    """Return by how much memory grows after some hours, MB a day; NaN where there are none."""
    later = [mark for mark in marks if mark.hours >= after]
    if len(later) < 2:
        return float('nan')
    return _HOURS * slope([mark.hours for mark in later], [mark.memory for mark in later])


def _parse() -> argparse.Namespace:
    parser = parser_of(__doc__)
    parser.add_argument('--days', type=float, metavar='N', default=7.0)
    parser.add_argument('--rate', type=float, metavar='HZ', default=10.0, help='of joints and odometry')
    add_example_arguments(parser, METHODS, 'trajectory')
    parser.add_argument('--window', type=float, metavar='S', default=1.0)
    parser.add_argument('--bag', type=Path, metavar='FOLDER', help='where the bag is, or is made and left')
    return parser.parse_args()


if __name__ == '__main__':
    sys.exit(main())
