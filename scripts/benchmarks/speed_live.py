"""The live node beside a bare one with the same subscriptions: processor time, latency, messages lost."""

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
from typing import Any

import rclpy
from ament_index_python.packages import get_package_prefix
from diagnostic_msgs.msg import DiagnosticArray
from mbaid_msgs.msg import InertiaEstimate
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from benchmarks.data import CONFIG
from benchmarks.endurance import processor_time
from benchmarks.speed_bag import ROBOT, make_bag
from benchmarks.speed_replay import VARIANTS, assigned
from mbaid_ros.nodes.subscriptions import qos

HERE = Path(__file__).parent
# A graph of its own: of the domains whose ports Linux does not hand out, those that hardly anyone uses.
DOMAIN = 215 + os.getpid() % 18
ENVIRONMENT = {
    **os.environ,
    'ROS_DOMAIN_ID': str(DOMAIN),
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    'FASTRTPS_DEFAULT_PROFILES_FILE': str(HERE.parent / 'quick_discovery.xml'),
}
# A run that contradicts its model: it is searched again, and asked what may be wrong, again and again.
_CONTRADICTED = {'noise.joint_position': 1e-5, 'noise.base_position': 3e-4}
_LIVE: dict[str, tuple[str, Mapping[str, object]]] = {
    **VARIANTS,
    'trajectory, contradicted: searches and inquiries': ('trajectory', _CONTRADICTED),
}
_PATIENCE = 20.0  # s
_PUBLISHED = (': joint_states', ': odom')  # what the node tells of its inputs; on the others nothing comes


@dataclass(frozen=True)
class Live:
    """What a live run showed.

    Attributes
    ----------
    cpu : s, processor time of the node
    floor : s, that of the bare node right before
    latencies : s, from the stamp of the last sample of each window to the arrival of its estimate
    lost : messages that were published and not received by the node
    """

    cpu: float
    floor: float
    latencies: tuple[float, ...]
    lost: int


def runs(folder: Path, rate: float, seconds: float, repeats: int) -> dict[str, list[Live]]:
    """Return, by variant, what runs showed, each after one of the bare node.

    Parameters
    ----------
    folder : where the bag is made
    rate : Hz, of each of the two topics
    seconds : length of a run
    repeats : number of pairs
    """
    bag = folder / 'live'
    make_bag(bag, seconds / 60.0, rate)
    publisher = [sys.executable, str(HERE / 'speed_publisher.py'), str(bag), str(rate)]
    found: dict[str, list[Live]] = {name: [] for name in _LIVE}
    for _ in range(repeats):
        floor = _run([sys.executable, str(HERE / 'speed_bare_node.py')], publisher, seconds).cpu
        for name, variant in _LIVE.items():
            live = _run(_estimator(*variant), publisher, seconds)
            found[name].append(Live(live.cpu, floor, live.latencies, live.lost))
    return found


def executable(name: str) -> str:
    """Return the path of an executable, where `ros2 run mbaid_ros` finds it."""
    return str(Path(get_package_prefix('mbaid_ros')) / 'lib' / 'mbaid_ros' / name)


def _estimator(method: str, others: Mapping[str, object]) -> list[str]:
    options = assigned({'robot_description_file': f'{CONFIG / ROBOT}.urdf', 'method': method, **others})
    return [executable('estimator'), '--ros-args', '--params-file', str(CONFIG / f'{ROBOT}_estimator.yaml'), *options]


def _run(command: Sequence[str], publisher: Sequence[str], seconds: float) -> Live:
    """Return what one run of a node showed; a node that tells nothing counts as one that has lost nothing."""
    with _process(command) as node, _process(publisher) as source, _listener() as listener:
        _line(source)
        gc.freeze()  # as in the publisher
        before = processor_time(node.pid)
        _say(source)
        listener.spin(seconds)
        published = int(_line(source))
        if listener.received:
            listener.until(lambda: min(listener.received.values()) >= published)
        cpu = processor_time(node.pid) - before
        _say(source)
        lost = sum(published - count for count in listener.received.values())
        return Live(cpu, 0.0, tuple(listener.latencies), lost)


class _Listener:
    """Notes when estimates arrive, and how many messages the node says it has received."""

    def __init__(self, context: Context) -> None:
        self._node = Node('listener', context=context, start_parameter_services=False)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self._node)
        self.latencies: list[float] = []
        self.received: dict[str, int] = {}
        self._node.create_subscription(InertiaEstimate, '/estimator/estimate', self._on_estimate, qos(1000))
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, qos(1000))

    def spin(self, seconds: float) -> None:
        """Listen for a time."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.1)

    def until(self, condition: Callable[[], bool]) -> None:
        """Listen until a condition holds, but not for ever."""
        end = time.monotonic() + _PATIENCE
        while not condition() and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.1)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._node.destroy_node()  # type: ignore[no-untyped-call]

    def _on_estimate(self, message: InertiaEstimate) -> None:
        if message.samples and message.status != 'waiting':
            stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
            self.latencies.append(1e-9 * (time.time_ns() - stamp))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if not status.name.endswith(_PUBLISHED):
                continue
            for item in status.values:
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
        listener.close()
        rclpy.shutdown(context=context)


@contextmanager
def _process(command: Sequence[str]) -> Iterator[subprocess.Popen[str]]:
    """Run a process on the graph; interrupt it in the end."""
    process = subprocess.Popen(
        command, env=ENVIRONMENT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    try:
        yield process
    finally:
        interrupted(process)


def interrupted(process: subprocess.Popen[Any]) -> None:
    """Ask a process to end, as Ctrl-C does, and wait for it."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    process.communicate(timeout=_PATIENCE)


def _line(process: subprocess.Popen[str]) -> str:
    """Return the next line that a process writes."""
    line = process.stdout.readline() if process.stdout else ''
    if not line:
        raise RuntimeError(f'{process.args!r} has ended')
    return line


def _say(process: subprocess.Popen[str]) -> None:
    """Give a process the line that it waits for."""
    if process.stdin:
        process.stdin.write('\n')
        process.stdin.flush()
