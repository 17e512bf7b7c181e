"""Write the tables of measured/speed.md: processor time over that of the work which no such program can avoid.

Measured pairs alternate on the same machine under the same load; medians are given.
"""

import gc
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from mbaid_msgs.msg import InertiaEstimate

from benchmarks.data import CONFIG, make_bag
from benchmarks.frame import Frame, number, provenance, table
from demo_graph import Graph, assigned, graph
from mbaid_ros.cli import EXIT_NOT_DETERMINED
from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.samples import stamp_of
from mbaid_ros.nodes.subscriptions import qos
from mbaid_ros.parameters import build, values_of

HERE = Path(__file__).parent / 'benchmarks'
ROBOT, METHODS = 'servicer7', ('difference', 'trajectory')
_RATE, _SHORT = 1000.0, 10.0  # Hz, of each topic of the live runs; s
# Parameters beside those of servicer7_estimator.yaml, which declares a robot that is exactly its URDF.
_DEFAULTS = values_of(build(EstimatorConfig, {}))
VARIANTS: dict[str, Mapping[str, object]] = {
    **{method: {'method': method} for method in METHODS},
    'trajectory, every model error among the unknowns': {name: _DEFAULTS[name] for name in ('method', *EXACT)},
}
# Wrongly declared noise contradicts the data: the filter searches for a start and for causes, again and again.
_CONTRADICTED = {'method': 'trajectory', 'noise.joint_position': 1e-5, 'noise.base_position': 3e-4}
# The executable that `ros2 run` starts is these two lines with a shebang.
_PROGRAM = [sys.executable, '-c', 'import sys; from mbaid_ros.replay.arguments import replay; sys.exit(replay())']


class Cost(NamedTuple):
    """Costs of a process."""

    wall: float  # s
    cpu: float  # s
    memory: float  # MB, its peak


_INPUTS = (': joint_states', ': odom')  # of the estimator's diagnostics


class Live(NamedTuple):
    """A live run."""

    cpu: float  # s, processor time of the node
    latencies: list[float]  # s, from the stamp of a window's last sample to the arrival of its estimate
    lost: int  # messages published and not received by the node


def _run(parameters: Mapping[str, object] | None, folder: Path, bag: Path, seconds: float) -> Live:
    """Return a run of the estimator, or of the bare node without parameters, with a published bag."""
    folder.mkdir()
    with graph(folder) as made, ExitStack() as stack:
        if parameters is None:
            pid = stack.enter_context(node_beside(made, 'bare')).pid
        else:
            options = assigned({'robot_description_file': f'{CONFIG / ROBOT}.urdf', **parameters})
            file = CONFIG / f'{ROBOT}_estimator.yaml'
            pid = made.start('estimator', '--ros-args', '--params-file', file, *options).pid
        latencies: list[float] = []

        def arrived(message: InertiaEstimate) -> None:
            if message.samples and message.status != 'waiting':
                latencies.append(1e-9 * (time.time_ns() - stamp_of(message)))

        made.node.create_subscription(InertiaEstimate, '/estimator/estimate', arrived, qos(1000))
        reports = made.collect('/diagnostics', DiagnosticArray, qos(1000))
        source = stack.enter_context(node_beside(made, str(bag), str(_RATE)))
        gc.freeze()  # as in the publisher
        before, end = processor_time(pid), time.monotonic() + seconds
        print(file=source.stdin, flush=True)
        made.wait(lambda: time.monotonic() > end, 'the end', seconds + 1.0)
        count = int(source.stdout.readline() if source.stdout else 0)
        if parameters is not None:
            made.wait(lambda: min(received(reports), default=0) >= count, 'all messages')
        cpu = processor_time(pid) - before
        print(file=source.stdin, flush=True)
        return Live(cpu, latencies, sum(count - each for each in received(reports)))


def processor_time(pid: int) -> float:
    """Return the processor time of a running process, s."""
    values = Path(f'/proc/{pid}/stat').read_text(encoding='ascii').rpartition(')')[2].split()
    return (int(values[11]) + int(values[12])) / os.sysconf('SC_CLK_TCK')


def received(reports: list[Any]) -> list[int]:
    """Return the numbers of received messages in the latest diagnostics."""
    inputs = [status for report in reports for status in report.status if status.name.endswith(_INPUTS)]
    counts = {status.name: int(item.value) for status in inputs for item in status.values if item.key == 'received'}
    return list(counts.values())


@contextmanager
def node_beside(made: Graph, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run one of the nodes beside the estimator, the publisher until it is ready; it ends with the block."""
    command, pipe = [sys.executable, str(HERE / 'speed_nodes.py'), *arguments], subprocess.PIPE
    with subprocess.Popen(command, env=made.environment, stdin=pipe, stdout=pipe, text=True) as process:
        try:
            assert process.stdout is not None, 'it is a pipe'
            assert arguments == ('bare',) or process.stdout.readline() == 'ready\n', 'the publisher has ended'
            yield process
        finally:
            process.terminate()


def main() -> None:
    """Measure the chosen parts."""
    frame = Frame(__doc__, 'measured/speed.md', minutes=60.0, seconds=30.0, repeats=5, parts='replay, live, start')
    arguments = frame.arguments
    parts = {'replay': (_replays, arguments.minutes), 'live': (_live, arguments.seconds), 'start': (_starts, _SHORT)}
    for name, (part, length) in parts.items():
        if name in arguments.parts:
            with TemporaryDirectory() as folder:
                text = part(Path(folder), length, arguments.repeats)
            note = f'medians of {arguments.repeats}, load average {os.getloadavg()[2]:.0f} at the end'
            print(text, flush=True)
            frame.write(**{name: f'{text}\n\n{provenance(note)}'})


def _replays(folder: Path, minutes: float, repeats: int) -> str:
    bag = folder / 'long'
    make_bag(bag, ROBOT, minutes)
    floor, costs = [], {name: list[Cost]() for name in VARIANTS}
    for _ in range(repeats):
        floor.append(_measured([sys.executable, str(HERE / 'speed_floor.py'), str(bag)]))
        for name, parameters in VARIANTS.items():
            costs[name].append(_measured(_replay(bag, parameters)))
    rows, least = [], _median(floor)
    for name, each in costs.items():
        ratio = _middle([cost.cpu / bare.cpu for cost, bare in zip(each, floor, strict=True)])
        cost = _median(each)
        numbers = (number(cost.cpu, 1), number(least.cpu, 1), number(cost.memory), number(least.memory))
        rows.append([name, ratio, *numbers])
    header = ['method', 'ratio', 'replay, s', 'floor, s', 'peak, MB', 'floor, MB']
    return f'A bag of {minutes:g} min at 100 Hz:\n\n{table(header, rows)}'


def _live(folder: Path, seconds: float, repeats: int) -> str:
    variants = {**VARIANTS, 'trajectory, contradicted: searches for start and causes': _CONTRADICTED}
    bag = folder / 'live'
    make_bag(bag, ROBOT, seconds / 60.0, _RATE)
    found: dict[str, list[tuple[Live, Live]]] = {name: [] for name in variants}
    for turn in range(repeats):
        bare = _run(None, folder / f'bare{turn}', bag, seconds)
        for place, (name, parameters) in enumerate(variants.items()):
            found[name].append((_run(parameters, folder / f'{turn}-{place}', bag, seconds), bare))
    rows = []
    for name, pairs in found.items():
        shares = [
            [1e3 * float(np.percentile(run.latencies, share)) for run, _ in pairs] for share in (50.0, 99.0, 100.0)
        ]
        ratio = _middle([run.cpu / bare.cpu for run, bare in pairs])
        rows.append([name, ratio, *(_middle(each, '.1f') for each in shares), str(sum(run.lost for run, _ in pairs))])
    header = ['method', 'ratio', 'p50, ms', 'p99, ms', 'longest, ms', 'lost']
    return f'Two topics at {_RATE:g} Hz each for {seconds:g} s:\n\n{table(header, rows)}'


def _starts(folder: Path, seconds: float, repeats: int) -> str:
    bag = folder / 'short'
    make_bag(bag, ROBOT, seconds / 60.0)
    commands = {'`replay --help`': [*_PROGRAM, '--help']}
    commands |= {f'replay of {seconds:g} s, {method}': _replay(bag, VARIANTS[method]) for method in METHODS}
    rows = []
    for name, command in commands.items():
        cost = _median([_measured(command) for _ in range(repeats)])
        rows.append([name, number(cost.wall), number(cost.cpu), number(cost.memory)])
    return table(['', 'wall, s', 'processor, s', 'peak, MB'], rows)


def _replay(bag: Path, parameters: Mapping[str, object]) -> list[str]:
    files = ['--model', str(CONFIG / f'{ROBOT}.urdf'), '--params', str(CONFIG / f'{ROBOT}_estimator.yaml')]
    return [*_PROGRAM, str(bag), *files, *assigned(parameters)]


def _measured(command: Sequence[str]) -> Cost:
    program = [sys.executable, str(HERE / 'speed_measured.py'), *command]
    run = subprocess.run(program, stdout=subprocess.PIPE, text=True, check=False)
    if run.returncode not in {0, EXIT_NOT_DETERMINED}:
        raise RuntimeError(f'exit code {run.returncode} of {" ".join(command)}')
    return Cost(**json.loads(run.stdout))


def _median(costs: Sequence[Cost]) -> Cost:
    return Cost(*(float(np.median([getattr(cost, name) for cost in costs])) for name in ('wall', 'cpu', 'memory')))


def _middle(values: Sequence[float], form: str = '.2f') -> str:
    """Return median and range of values, one a pair."""
    return f'{np.median(values):{form}} ({min(values):{form}} to {max(values):{form}})'


if __name__ == '__main__':
    main()
