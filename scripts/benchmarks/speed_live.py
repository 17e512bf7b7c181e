"""Live runs of the estimator, each after one of a bare node with the same subscriptions."""

from __future__ import annotations

import gc
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from mbaid_msgs.msg import InertiaEstimate

from benchmarks.bags import ROBOT, make_bag
from benchmarks.data import CONFIG
from benchmarks.frame import processor_time
from demo_graph import Graph, assigned, graph
from mbaid_ros.nodes.subscriptions import qos

NODES = Path(__file__).with_name('speed_nodes.py')
_INPUTS = (': joint_states', ': odom')  # of the estimator's diagnostics


@dataclass(frozen=True)
class Live:
    """A live run."""

    cpu: float  # s, processor time of the node
    latencies: list[float]  # s, from the stamp of a window's last sample to the arrival of its estimate
    lost: int  # messages published and not received by the node


def live_runs(
    variants: Mapping[str, Mapping[str, object]], folder: Path, rate: float, seconds: float, repeats: int
) -> dict[str, list[tuple[Live, Live]]]:
    """Return runs by variant, whose parameters are given, each with that of the bare node; rate in Hz, of a topic."""
    bag = folder / 'live'
    make_bag(bag, seconds / 60.0, rate)
    found: dict[str, list[tuple[Live, Live]]] = {name: [] for name in variants}
    for number in range(repeats):
        bare = _run(None, folder / f'bare{number}', (str(bag), str(rate)), seconds)
        for place, (name, parameters) in enumerate(variants.items()):
            live = _run(parameters, folder / f'{number}-{place}', (str(bag), str(rate)), seconds)
            found[name].append((live, bare))
    return found


def _run(parameters: Mapping[str, object] | None, folder: Path, published: tuple[str, str], seconds: float) -> Live:
    """Return a run of the estimator, or of the bare node without parameters, with a bag published at a rate."""
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
                stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
                latencies.append(1e-9 * (time.time_ns() - stamp))

        made.node.create_subscription(InertiaEstimate, '/estimator/estimate', arrived, qos(1000))
        reports = made.collect('/diagnostics', DiagnosticArray, qos(1000))
        source = stack.enter_context(node_beside(made, *published))
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


def received(reports: list[Any]) -> list[int]:
    """Return the numbers of received messages in the latest diagnostics."""
    counts = {
        status.name: int(item.value)
        for report in reports
        for status in report.status
        if status.name.endswith(_INPUTS)
        for item in status.values
        if item.key == 'received'
    }
    return list(counts.values())


@contextmanager
def node_beside(made: Graph, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run one of the nodes beside the estimator, the publisher until it is ready; it ends with the block."""
    command, pipe = [sys.executable, str(NODES), *arguments], subprocess.PIPE
    with subprocess.Popen(command, env=made.environment, stdin=pipe, stdout=pipe, text=True) as process:
        try:
            assert process.stdout is not None, 'it is a pipe'
            assert arguments == ('bare',) or process.stdout.readline() == 'ready\n', 'the publisher has ended'
            yield process
        finally:
            process.terminate()
