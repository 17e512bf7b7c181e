"""A ROS 2 graph of one's own: the package's executables as processes, and a node that sees what they say."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any

# A graph of its own: no other ROS 2 system on this machine or network takes part. Of the domains whose ports Linux does
# not hand out, those that hardly anyone uses.
os.environ['ROS_DOMAIN_ID'] = str(215 + os.getpid() % 18)
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(Path(__file__).with_name('quick_discovery.xml'))

from ament_index_python.packages import get_package_prefix
from geometry_msgs.msg import InertiaStamped
from mbaid_msgs.msg import InertiaEstimate
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from mbaid_ros.cli import EXIT_NOT_DETERMINED
from mbaid_ros.core.errors import DataError
from mbaid_ros.nodes.subscriptions import qos

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / 'config'
PATIENCE = 20.0  # s, for a process to appear on the graph or to end


class Processes:
    """The executables of the package as processes, each with its output in a file.

    Parameters
    ----------
    folder : where the outputs go
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str, *arguments: object) -> subprocess.Popen[bytes]:
        """Start an executable, found where `ros2 run mbaid_ros` finds it."""
        path = Path(get_package_prefix('mbaid_ros')) / 'lib' / 'mbaid_ros' / name
        with self._log(name).open('wb') as log:
            process = subprocess.Popen([path, *map(str, arguments)], stdout=log, stderr=subprocess.STDOUT)
        self._running[name] = process
        return process

    def check(self) -> None:
        """Raise a DataError if one has failed."""
        for name, process in self._running.items():
            if process.poll() not in (None, 0, EXIT_NOT_DETERMINED):
                lines = self._log(name).read_text(errors='replace').splitlines()
                raise DataError(f'{name} ended with exit code {process.returncode}: {" | ".join(lines[-3:])}')

    def stop(self, name: str) -> None:
        """Ask one to end, as Ctrl-C does, and wait for it."""
        if self._running[name].poll() is None:
            self._running[name].send_signal(signal.SIGINT)
        self.wait(name, PATIENCE)

    def wait(self, name: str, patience: float) -> None:
        """Wait for the end of one; a DataError if it takes too long or has failed."""
        try:
            self._running[name].wait(patience)
        except subprocess.TimeoutExpired as error:
            raise DataError(f'{name} has not ended after {patience:g} s') from error
        self.check()

    def close(self) -> None:
        """End whatever still runs."""
        for process in self._running.values():
            if process.poll() is None:
                process.terminate()
        for process in self._running.values():
            with suppress(subprocess.TimeoutExpired):
                process.wait(3.0)
            process.kill()  # nothing to one that has ended
            process.wait()

    def _log(self, name: str) -> Path:
        return self._folder / f'{name}.log'


class Spectator:
    """A node of the demo itself: it sees the estimates and the truth.

    Parameters
    ----------
    processes : whose failure ends any waiting
    """

    def __init__(self, processes: Processes) -> None:
        self._processes = processes
        self._node = Node('demo', start_parameter_services=False)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self.estimates: list[Any] = []
        self.truths: list[Any] = []
        everything = qos(1000, latched=True)
        self._node.create_subscription(InertiaEstimate, '/estimator/estimate', self.estimates.append, everything)
        self._node.create_subscription(InertiaStamped, '/simulator/truth', self.truths.append, everything)

    def wait(self, condition: Callable[[], object], what: str, patience: float = PATIENCE) -> None:
        """Take messages until a condition holds; a DataError if that takes too long or a process fails."""
        end = time.monotonic() + patience
        while not condition():
            self._processes.check()
            if time.monotonic() > end:
                raise DataError(f'waited {patience:g} s in vain for {what}')
            self._executor.spin_once(timeout_sec=0.1)

    def recorded(self, topic: str) -> bool:
        """Tell whether the recorder listens to a topic."""
        return any(info.node_name == 'recorder' for info in self._node.get_subscriptions_info_by_topic(topic))


@contextmanager
def running(folder: Path) -> Iterator[Processes]:
    """Give processes that end with the block, however it is left."""

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, interrupt)
    processes = Processes(folder)
    try:
        yield processes
    finally:
        processes.close()
