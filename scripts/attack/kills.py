"""Nodes that are killed at any time of their lives, the first moment included, while messages flow."""

from __future__ import annotations

import itertools
import re
import signal
import subprocess
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mbaid_msgs.msg import InertiaEstimate
from tqdm import tqdm

from benchmarks.data import CONFIG
from benchmarks.pages import table
from graph import Graph, Process, executable

ROBOT = 'table1'
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
NODES = ('estimator', 'recorder', 'watch', 'simulator')
EARLY, LATEST = 1.0, 4.0  # s: half of the kills come before the one, the others from then to the other
HANG = 10.0  # s, from the signal to the end
_READ = 60.0  # s, for `replay`
_PACKAGE = re.compile(r'/mbaid_ros/\w+(/\w+)*\.py"')  # in a traceback


@dataclass
class Kills:
    """What came of nodes that were killed.

    Attributes
    ----------
    codes : by node and signal, how often each exit code came; negative: by the signal itself, before Python was up
    before : how many SIGINT ended while Python itself started, with its own traceback, before any code of the package
    slowest : s, from a signal to the end
    bags : what recorders left, and how often, by signal
    wrong : what should not have been
    """

    codes: dict[tuple[str, signal.Signals], Counter[int]] = field(default_factory=dict)
    before: int = 0
    slowest: float = 0.0
    bags: dict[signal.Signals, Counter[str]] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        """Return the tables of the page."""
        rows = []
        for name in NODES:
            counts = (self.codes.get((name, number), Counter()) for number in SIGNALS)
            rows.append([name, *(', '.join(f'{n} of {code}' for code, n in sorted(c.items())) or '-' for c in counts)])
        left = [
            f'{number.name}: {", ".join(f"{n} {what}" for what, n in sorted(counted.items()))}'
            for number, counted in self.bags.items()
        ]
        header = ['killed', *(f'exit codes after {number.name}' for number in SIGNALS)]
        took = (
            f'{self.before} were ended by SIGINT while Python itself started, with its own traceback, before any code '
            f'of the package ran. The slowest took {self.slowest:.1f} s to end.'
        )
        return f'{table(header, rows, words=True)}\n\n{took} What the recorders left for `replay`: {"; ".join(left)}.'


def arguments_of(name: str, bag: Path) -> Sequence[object]:
    """Return the arguments of a node, the bag being a recorder's."""
    described = [
        '-p',
        f'robot_description_file:={CONFIG / ROBOT}.urdf',
        '--params-file',
        f'{CONFIG / ROBOT}_{name}.yaml',
    ]
    every: dict[str, Sequence[object]] = {
        'estimator': ['--ros-args', *described],
        'simulator': ['--ros-args', *described, '-p', 'duration:=0.0'],
        'recorder': ['--ros-args', '-p', f'output:={bag}'],
        'watch': [],
    }
    return every[name]


def kills(graph: Graph, folder: Path, count: int, generator: np.random.Generator) -> Kills:
    """Return what came of so many kills, beside a simulator and an estimator that go on."""
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    for name in ('estimator', 'simulator'):
        graph.start(name, *arguments_of(name, folder))
    graph.wait(lambda: estimates and estimates[-1].samples, 'an estimate')
    found = Kills()
    # Each node with each signal, early and late, as often as any other if the count is a multiple of their number.
    ways = list(itertools.product(NODES, SIGNALS, (True, False)))
    turns = [ways[turn % len(ways)] for turn in range(count)]
    for number, turn in enumerate(tqdm(generator.permutation(count), unit=' kills', disable=None, leave=False)):
        name, sent, early = turns[turn]
        bag = folder / f'bag{number}'
        process = graph.start(name, *arguments_of(name, bag))
        time.sleep(float(generator.uniform(0.0, EARLY) if early else generator.uniform(EARLY, LATEST)))
        _kill(process, sent, found)
        if name == 'recorder':
            found.bags.setdefault(sent, Counter())[left_for_replay(bag, found.wrong)] += 1
    return found


def _kill(process: Process, sent: signal.Signals, found: Kills) -> None:
    begin = time.monotonic()
    try:
        code = process.stop(sent, HANG)
    except subprocess.TimeoutExpired:
        found.wrong.append(f'{process.name} goes on after {sent.name}')
        process.close()
        return
    found.slowest = max(found.slowest, time.monotonic() - begin)
    found.codes.setdefault((process.name, sent), Counter())[code] += 1
    said = process.stderr
    if sent == signal.SIGINT and said.endswith('KeyboardInterrupt\n') and not _PACKAGE.search(said):
        found.before += 1
    elif code not in {0, 128 + sent, -sent} or 'Traceback' in said:
        found.wrong.append(f'{process.name}, {sent.name}: exit code {code}, {said[-1000:]!r}')


def left_for_replay(bag: Path, wrong: list[str]) -> str:
    """Return what a recorder left; what should not be is added to a list."""
    if not any(bag.glob('*.mcap')):
        return 'nothing'
    options = ['--model', f'{CONFIG / ROBOT}.urdf', '--params', f'{CONFIG / ROBOT}_estimator.yaml']
    try:
        ended = subprocess.run(
            [str(executable('replay')), str(bag), *options], capture_output=True, text=True, timeout=_READ, check=False
        )
    except subprocess.TimeoutExpired:
        wrong.append(f'replay does not end with {bag.name}')
        return 'a bag that hangs `replay`'
    refused = ended.returncode == 2 and not ('has no topic' in ended.stderr or 'no messages' in ended.stderr)
    if ended.returncode not in {0, 2, 3, 4} or refused or 'Traceback' in ended.stderr:
        wrong.append(f'replay of {bag.name}: exit code {ended.returncode}, {ended.stderr[-1000:]!r}')
    if ended.returncode == 2:
        return 'without joint states yet' if 'has no topic' in ended.stderr else 'empty, which a line says'
    return 'with an estimate' if ended.returncode == 0 else f'with exit code {ended.returncode}'
