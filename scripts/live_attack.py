"""Attack the nodes on a graph: kill them, call services in a loop; writes into measured/robustness.md.

Exit code 1: a traceback, another exit code than a signal's, a hang, lost messages, or 1 GB.
"""

from __future__ import annotations

import itertools
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from mbaid_msgs.msg import InertiaEstimate
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from std_srvs.srv import SetBool, Trigger

from benchmarks.bags import ROBOT, make_bag
from benchmarks.frame import Frame, provenance, resident, table
from benchmarks.speed_live import node_beside, received
from demo_graph import CONFIG, Graph, executable, graph
from mbaid_ros.nodes.subscriptions import qos

MEMORY = 1000.0  # MB
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
NODES = ('estimator', 'recorder', 'watch', 'simulator')
EARLY, LATEST, HANG = 1.0, 4.0, 10.0  # s: half of the kills before the first, the others until the second; to the end
RATE, SECONDS, SPREAD = 1000.0, 120.0, 0.9  # Hz of each topic and s of the flow; part of it with calls
_PACKAGE = re.compile(r'/mbaid_ros/\w+(/\w+)*\.py"')  # in a traceback
_FILES = CONFIG / 'table1'


@contextmanager
def _alone() -> Iterator[tuple[Graph, Path]]:
    """Give a graph of its own, and a folder."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / 'processes').mkdir()
        with graph(Path(folder) / 'processes') as made:
            yield made, Path(folder)


def kills(count: int, seed: int, wrong: list[str]) -> str:
    """Return tables of kills of nodes beside a simulator and an estimator; faults are added to a list."""
    codes: dict[tuple[str, signal.Signals], Counter[int]] = {}
    left: dict[signal.Signals, Counter[str]] = {}
    generator = np.random.default_rng([seed, 0])
    # Each node with each signal, early and late, as often as any other if the count is a multiple of their number.
    ways = itertools.islice(itertools.cycle(itertools.product(NODES, SIGNALS, (True, False))), count)
    with _alone() as (made, folder):
        estimates = made.collect('/estimator/estimate', InertiaEstimate)
        for name in ('estimator', 'simulator'):
            made.start(name, *_arguments(name, folder))
        made.wait(lambda: estimates and estimates[-1].samples, 'an estimate')
        for number, way in enumerate(generator.permutation(np.array(list(ways), dtype=object))):
            name, sent, early = way
            bag = folder / f'bag{number}'
            process = made.start(name, *_arguments(name, bag))
            time.sleep(float(generator.uniform(0.0, EARLY) if early else generator.uniform(EARLY, LATEST)))
            try:
                code = process.stop(sent, HANG)
            except subprocess.TimeoutExpired:
                wrong.append(f'{name} continues after {sent.name}')
                process.close()
                continue
            codes.setdefault((name, sent), Counter())[code] += 1
            early_end = process.stderr.endswith('KeyboardInterrupt\n') and not _PACKAGE.search(process.stderr)
            starting = sent == signal.SIGINT and early_end  # Python itself, before any code of the package
            if not starting and (code not in {0, 128 + sent, -sent} or 'Traceback' in process.stderr):
                wrong.append(f'{name}, {sent.name}: exit code {code}, {process.stderr[-1000:]!r}')
            if name == 'recorder':
                left.setdefault(sent, Counter())[_left_for_replay(bag, wrong)] += 1
    rows = [[name, *(_counted(codes.get((name, sent), Counter())) for sent in SIGNALS)] for name in NODES]
    bags = '; '.join(f'{sent.name}: {_counted(each)}' for sent, each in left.items())
    header = ['killed', *(f'exit codes after {sent.name}' for sent in SIGNALS)]
    return f'{table(header, rows, words=True)}\n\nThe bags of the recorders for `replay`: {bags}.'


def _counted(counter: Counter[Any]) -> str:
    return ', '.join(f'{count} of {value}' for value, count in sorted(counter.items())) or '-'


def _arguments(name: str, bag: Path) -> Sequence[object]:
    described = ['-p', f'robot_description_file:={_FILES}.urdf', '--params-file', f'{_FILES}_{name}.yaml']
    every: dict[str, Sequence[object]] = {
        'estimator': ['--ros-args', *described],
        'simulator': ['--ros-args', *described, '-p', 'duration:=0.0'],
        'recorder': ['--ros-args', '-p', f'output:={bag}'],
        'watch': [],
    }
    return every[name]


def _left_for_replay(bag: Path, wrong: list[str]) -> str:
    """Return the state of a recorder's bag; a fault is added to a list."""
    if not any(bag.glob('*.mcap')):
        return 'no bag'
    command = [executable('replay'), bag, '--model', f'{_FILES}.urdf', '--params', f'{_FILES}_estimator.yaml']
    ended = subprocess.run([*map(str, command)], capture_output=True, text=True, timeout=60.0, check=False)
    empty = 'has no topic' in ended.stderr or 'no messages' in ended.stderr
    if ended.returncode not in {0, 2, 3, 4} or (ended.returncode == 2 and not empty) or 'Traceback' in ended.stderr:
        wrong.append(f'replay of {bag.name}: exit code {ended.returncode}, {ended.stderr[-1000:]!r}')
    return f'exit code {ended.returncode}'


def _set(number: int) -> Any:
    value = ParameterValue(type=ParameterType.PARAMETER_BOOL, bool_value=number % 2 == 0)
    return SetParameters.Request(parameters=[Parameter(name='publish_tf', value=value)])


# By service: type, request by the number of the call, share. Reset and capture are rare, so that plans are possible.
_CALLS: dict[str, tuple[Any, Callable[[int], Any], float]] = {
    'reset': (Trigger, lambda _: Trigger.Request(), 0.007),
    'capture': (Trigger, lambda _: Trigger.Request(), 0.023),
    'pause': (SetBool, lambda number: SetBool.Request(data=number % 2 == 0), 0.4),
    'plan': (Trigger, lambda _: Trigger.Request(), 0.17),
    'set_parameters': (SetParameters, _set, 0.2),
    'get_parameters': (GetParameters, lambda _: GetParameters.Request(names=['method']), 0.2),
}


def calls(count: int, seed: int, wrong: list[str]) -> str:
    """Return the table of calls of services while messages come at 1 kHz; faults are added to a list."""
    shares = [share for _, _, share in _CALLS.values()]
    names = np.random.default_rng([seed, 2]).choice(list(_CALLS), count, p=shares).tolist()
    taken: dict[str, list[float]] = {name: [] for name in _CALLS}
    granted: Counter[str] = Counter()
    with _alone() as (made, folder), ExitStack() as stack:
        make_bag(folder / 'flow', SECONDS / 60.0, RATE)
        described = ['-p', f'robot_description_file:={CONFIG / ROBOT}.urdf', '-p', 'capture.time:=5.0']
        estimator = made.start('estimator', '--ros-args', *described)
        for name in _CALLS:
            _ask(made, name, 1)  # finds the service
        source = stack.enter_context(node_beside(made, str(folder / 'flow'), f'{RATE:g}'))
        reports = made.collect('/diagnostics', DiagnosticArray, qos(1000))
        before, begin = resident(estimator.pid), time.monotonic()
        print(file=source.stdin, flush=True)
        for number, name in enumerate(names):
            time.sleep(max(0.0, begin + number * SPREAD * SECONDS / count - time.monotonic()))
            at = time.monotonic()
            granted[name] += _ask(made, name, number)
            taken[name].append(time.monotonic() - at)
        assert source.stdout is not None, 'it is a pipe'
        messages = int(source.stdout.readline())
        made.wait(lambda: min(received(reports), default=0) >= messages, 'all messages')
        memory, code, log = resident(estimator.pid), estimator.stop(), estimator.stderr
    if memory > MEMORY or code or 'Traceback' in log:
        wrong.append(f'calls: {memory:.0f} MB, exit code {code}, {log[-1000:]!r}')
    rows = []
    for name, each in taken.items():
        times = (np.median(each), np.quantile(each, 0.99), np.max(each)) if each else (np.nan,) * 3
        rows.append([f'`~/{name}`', str(len(each)), str(granted[name]), *(f'{1e3 * time:.1f}' for time in times)])
    return (
        f'{count} calls while both topics come at {RATE:g} Hz for {SECONDS:g} s:\n\n'
        + table(['service', 'calls', 'granted', 'median, ms', 'p99, ms', 'slowest, ms'], rows)
        + f'\n\nNone of {2 * messages} messages was lost; resident memory was {before:.0f}, then {memory:.0f} MB.'
    )


def _ask(made: Graph, name: str, number: int) -> bool:
    """Make a call, and return whether it was granted."""
    kind, request, _ = _CALLS[name]
    answer = made.call(f'/estimator/{name}', kind, request(number))
    if kind is GetParameters:
        return len(answer.values) == 1
    return bool(answer.results[0].successful if kind is SetParameters else answer.success)


def main() -> int:
    """Attack, report, and return the exit code."""
    frame = Frame(__doc__, 'measured/robustness.md', kills=48, calls=1000, seed=0)
    arguments, wrong, parts = frame.arguments, list[str](), list[str]()
    stages: list[Callable[[], str]] = [
        lambda: kills(arguments.kills, arguments.seed, wrong),
        lambda: calls(arguments.calls, arguments.seed, wrong),
    ]
    for stage in stages:
        try:
            parts.append(stage())
            print(f'{parts[-1]}\n', flush=True)
        except AssertionError as reason:  # noqa: PERF203 - waited in vain: a hang, or an end
            wrong.append(str(reason))
    faults = f'{len(wrong)} faults.' + ''.join(f'\n- {text[:300]}' for text in wrong)
    print('\n'.join([faults, *wrong]))
    load = f'the load of the machine {os.getloadavg()[2]:.1f}'
    frame.write(attacks='\n\n'.join([provenance(load), *parts, faults]))
    return int(bool(wrong))


if __name__ == '__main__':
    sys.exit(main())
