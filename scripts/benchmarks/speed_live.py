"""Live runs of the estimator, each after one of a bare node with the same subscriptions."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import rclpy
from ament_index_python.packages import get_package_prefix
from diagnostic_msgs.msg import DiagnosticArray
from mbaid_msgs.msg import InertiaEstimate
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from benchmarks.bags import ROBOT, make_bag
from benchmarks.data import CONFIG
from benchmarks.frame import processor_time
from mbaid_ros.nodes.qos import qos

NODES = Path(__file__).with_name('speed_nodes.py')
# A graph of its own, on a domain that hardly anyone uses and whose ports Linux does not assign.
DOMAIN = 215 + os.getpid() % 18
ENVIRONMENT = {
    **os.environ,
    'ROS_DOMAIN_ID': str(DOMAIN),
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    'FASTRTPS_DEFAULT_PROFILES_FILE': str(NODES.parents[1] / 'quick_discovery.xml'),
}
_PATIENCE = 20.0  # s
_INPUTS = (': joint_states', ': odom')  # of the estimator's diagnostics


@dataclass(frozen=True)
class Live:
    """A live run."""

    cpu: float  # s, processor time of the node
    floor: float  # s, that of the bare node before
    latencies: tuple[float, ...]  # s, from the stamp of a window's last sample to the arrival of its estimate
    lost: int  # messages published and not received by the node


def live_runs(
    variants: Mapping[str, Mapping[str, object]], folder: Path, rate: float, seconds: float, repeats: int
) -> dict[str, list[Live]]:
    """Return runs by variant, whose parameters are given; rate in Hz, of each topic."""
    bag = folder / 'live'
    make_bag(bag, seconds / 60.0, rate)
    publisher = [sys.executable, str(NODES), str(bag), str(rate)]
    found: dict[str, list[Live]] = {name: [] for name in variants}
    for _ in range(repeats):
        floor = _run([sys.executable, str(NODES), 'bare'], publisher, seconds).cpu
        for name, parameters in variants.items():
            live = _run(_estimator(parameters), publisher, seconds)
            found[name].append(Live(live.cpu, floor, live.latencies, live.lost))
    return found


def assigned(values: Mapping[str, object]) -> list[str]:
    """Return the words of a command line that set parameters."""
    return [word for name, value in values.items() for word in ('-p', f'{name}:={value}')]


def _estimator(parameters: Mapping[str, object]) -> list[str]:
    path = Path(get_package_prefix('mbaid_ros')) / 'lib' / 'mbaid_ros' / 'estimator'
    options = assigned({'robot_description_file': f'{CONFIG / ROBOT}.urdf', **parameters})
    return [str(path), '--ros-args', '--params-file', str(CONFIG / f'{ROBOT}_estimator.yaml'), *options]


def _run(command: Sequence[str], publisher: Sequence[str], seconds: float) -> Live:
    """Return one run of a node; a node without diagnostics counts as one that has lost nothing."""
    with _process(command) as node, _process(publisher) as source, _listener() as listener:
        _line(source)
        gc.freeze()  # as in the publisher
        before = processor_time(node.pid)
        _continue(source)
        listener.spin(seconds)
        published = int(_line(source))
        if listener.received:
            listener.spin(_PATIENCE, lambda: min(listener.received.values()) >= published)
        cpu = processor_time(node.pid) - before
        _continue(source)
        lost = sum(published - count for count in listener.received.values())
        return Live(cpu, 0.0, tuple(listener.latencies), lost)


class _Listener:
    """A node that records arrivals of estimates, and the number of messages that the estimator has received."""

    def __init__(self, context: Context) -> None:
        self.node = Node('listener', context=context, start_parameter_services=False)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.latencies: list[float] = []
        self.received: dict[str, int] = {}
        self.node.create_subscription(InertiaEstimate, '/estimator/estimate', self._on_estimate, qos(1000))
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, qos(1000))

    def spin(self, seconds: float, done: Callable[[], bool] = lambda: False) -> None:
        """Listen for a time, or until a condition holds."""
        end = time.monotonic() + seconds
        while not done() and time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.1)

    def _on_estimate(self, message: InertiaEstimate) -> None:
        if message.samples and message.status != 'waiting':
            stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
            self.latencies.append(1e-9 * (time.time_ns() - stamp))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            for item in status.values if status.name.endswith(_INPUTS) else ():
                if item.key == 'received':
                    self.received[status.name] = int(item.value)


@contextmanager
def _listener() -> Iterator[_Listener]:
    os.environ.update(ENVIRONMENT)  # read by the middleware of this process, too
    context = Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    listener = _Listener(context)
    try:
        yield listener
    finally:
        listener.executor.shutdown()
        listener.node.destroy_node()  # type: ignore[no-untyped-call]
        rclpy.shutdown(context=context)


@contextmanager
def _process(command: Sequence[str]) -> Iterator[subprocess.Popen[str]]:
    """Run a process on the graph; interrupt it at the end, as Ctrl-C does."""
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, env=ENVIRONMENT, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.communicate(timeout=_PATIENCE)


def _line(process: subprocess.Popen[str]) -> str:
    """Return the next line of a process."""
    line = process.stdout.readline() if process.stdout else ''
    if not line:
        raise RuntimeError(f'{process.args!r} has ended')
    return line


def _continue(process: subprocess.Popen[str]) -> None:
    """Give a process the line that it waits for."""
    if process.stdin:
        process.stdin.write('\n')
        process.stdin.flush()
