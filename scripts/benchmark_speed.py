"""Speed, as ratios to what the work cannot do without: replay, live node, core and start-up, side by side in one run.

usage: benchmark_speed.py [--minutes M] [--seconds S] [--lengths MINUTES ...] [--repeats N]
                          [--parts a b c d] [--output docs]

What is compared is measured in turn, pair by pair, on the same machine under the same load; medians are given.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks import speed_core, speed_live, speed_replay
from benchmarks.driver import parser_of
from benchmarks.pages import number, provenance, put_section, table
from benchmarks.speed_replay import METHODS

RATE = 1000.0  # Hz, of each topic of the live run
_ROWS = 3_000  # samples whose rows are made at a time
_SHORT = 10.0  # s, of the runs that say how the work grows

_LAST_MINUTES = (
    'and in the last minutes (at most five) of runs of some length; the first minute, alone in the first column, holds '
    'the search for a start:'
)

_SECTIONS = ('Replay', 'Live node', 'Core', 'Start')
_HEAD = """\
# Speed

How far the project is above what no program of its kind can do without: reading a bag, receiving a message. Ratios of
times taken in turn in one run, with the median first and the range behind it; robot `servicer7` with seven joints,
`mid` noise. `make benchmark-speed` measures all of it anew, a part with `ARGS="--parts a"`.
"""


def main() -> None:
    """Measure, print and write the page: the parts that were measured anew, the others as they were."""
    arguments = _parse()
    parts = {'a': _replays, 'b': _live, 'c': _core, 'd': _starts}
    with TemporaryDirectory() as folder:
        for part in arguments.parts:
            text = f'{parts[part](arguments, Path(folder))}\n\n{_provenance(part, arguments)}\n'
            print(text, flush=True)
            if arguments.output:
                put_section(arguments.output / 'speed.md', _HEAD, text, _SECTIONS)


def _provenance(part: str, arguments: argparse.Namespace) -> str:
    own = {
        'a': f'--minutes {arguments.minutes:g} ',
        'b': f'--seconds {arguments.seconds:g} ',
        'c': f'--lengths {" ".join(map(str, arguments.lengths))} ',
        'd': '',
    }
    command = f'scripts/{Path(__file__).name} --parts {part} {own[part]}--repeats {arguments.repeats} --output docs'
    return provenance(f'medians of {arguments.repeats}, load average {os.getloadavg()[2]:.0f} by then', command)


def _replays(arguments: argparse.Namespace, folder: Path) -> str:
    found = speed_replay.replays(folder, arguments.minutes, arguments.repeats)
    rows = [
        [
            method,
            _middle(pairs.ratios),
            number(pairs.cost.cpu, 1),
            number(pairs.floor.cpu, 1),
            number(pairs.cost.memory),
            number(pairs.floor.memory),
        ]
        for method, pairs in found.items()
    ]
    header = ['method', 'ratio', 'replay, s', 'floor, s', 'peak, MB', 'floor, MB']
    return (
        f'## Replay\n\nProcessor time of `replay` on a bag of {arguments.minutes:g} min at 100 Hz, as many JointState '
        'as Odometry, over that of a process which reads and deserialises the same bag with rosbags and does nothing '
        'else. '
        f'Wanted: at most 1.3 of a robot that is its URDF, 3 of another, and below 400 MB.\n\n{table(header, rows)}'
    )


def _live(arguments: argparse.Namespace, folder: Path) -> str:
    found = speed_live.runs(folder, RATE, arguments.seconds, arguments.repeats)
    rows = []
    for method, runs in found.items():
        ratio = _middle([run.cpu / run.floor for run in runs])
        latencies = [
            _middle([1e3 * float(np.percentile(run.latencies, share)) for run in runs], '.1f')
            for share in (50.0, 99.0, 100.0)
        ]
        rows.append([method, ratio, *latencies, str(sum(run.lost for run in runs))])
    return (
        f'## Live node\n\nProcessor time of `estimator` while two topics come at 1 kHz each for '
        f'{arguments.seconds:g} s, over that of a bare node with the same two subscriptions; time from the last sample '
        'of a window to the arrival of its estimate, percentiles of each run; messages that did not '
        'arrive. Wanted: at most 1, p99 below 15 ms, none lost.\n\n'
        f'{table(["method", "ratio", "p50, ms", "p99, ms", "longest, ms", "lost"], rows)}'
    )


def _core(arguments: argparse.Namespace, _folder: Path) -> str:
    rates = speed_core.rows(_ROWS, arguments.repeats)
    ratio = _middle([ours / peer for ours, peer in zip(rates.rows, rates.peer, strict=True)])
    kilo = [number(1e-3 * float(np.median(values)), 1) for values in (rates.rows, rates.peer)]
    made = (
        f'Regressor and known momentum of a sample, by the kernel for {_ROWS} samples at once, and one by one '
        f'in a loop over pinocchio, which gives the same numbers: {kilo[0]} and {kilo[1]} thousand samples a second, a '
        f'ratio of {ratio}. Wanted: 400 thousand, and 10.'
    )
    joints: dict[str, Mapping[int, float]] = {'rows': speed_core.rows_by_joints(_ROWS, arguments.repeats)}
    joints |= {name: speed_core.identification_by_joints(name, _SHORT, arguments.repeats) for name in METHODS[:1]}
    windows = {name: speed_core.identification_by_window(name, _SHORT, arguments.repeats) for name in METHODS[:1]}
    lengths = {name: speed_core.identification_by_length(name, arguments.lengths) for name in METHODS}
    return '\n\n'.join(
        [
            '## Core',
            made,
            'Thousand samples a second of one core, by number of joints:',
            _growth(joints, 'joints'),
            f'by length of the windows (runs of {_SHORT:g} s):',
            _growth(windows, 'window, s'),
            _LAST_MINUTES,
            _growth(lengths, 'run, min'),
        ]
    )


def _starts(arguments: argparse.Namespace, folder: Path) -> str:
    found = speed_replay.starts(folder, arguments.repeats)
    rows = [
        [f'`{name}`' if '--' in name else name, *(number(value) for value in (cost.wall, cost.cpu, cost.memory))]
        for name, cost in found.items()
    ]
    return (
        '## Start\n\nThe whole process, from its start to its end. Wanted: the help within 0.3 s.\n\n'
        f'{table(["", "wall, s", "processor, s", "peak, MB"], rows)}'
    )


def _growth(rates: Mapping[str, Mapping[int, float] | Mapping[float, float]], name: str) -> str:
    """Return a table of thousand samples a second, a column for each size."""
    sizes = list(next(iter(rates.values())))
    rows = [[f'{what}', *(number(1e-3 * rate) for rate in found.values())] for what, found in rates.items()]
    return table([name, *(f'{size:g}' for size in sizes)], rows)


def _middle(values: Sequence[float], form: str = '.2f') -> str:
    """Return the median of values, one a pair, and their range."""
    return f'{np.median(values):{form}} ({min(values):{form}} to {max(values):{form}})'


def _parse() -> argparse.Namespace:
    parser = parser_of(__doc__)
    parser.add_argument('--minutes', type=float, metavar='M', default=60.0, help='length of the bag that is replayed')
    parser.add_argument('--seconds', type=float, metavar='S', default=30.0, help='length of the live runs')
    parser.add_argument(
        '--lengths',
        type=int,
        nargs='+',
        metavar='MINUTES',
        default=[1, 2, 10, 60],
        help='runs that the cost is told at',
    )
    parser.add_argument('--repeats', type=int, metavar='N', default=5, help='pairs, of which medians are given')
    parser.add_argument('--parts', nargs='+', choices=list('abcd'), default=list('abcd'), help='what is measured')
    parser.add_argument('--output', type=Path, metavar='FOLDER', help='write speed.md there')
    return parser.parse_args()


if __name__ == '__main__':
    main()
