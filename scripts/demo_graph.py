"""The graph of the demos: simulator, estimator and recorder as processes, and a node that listens."""

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Any

from geometry_msgs.msg import InertiaStamped
from mbaid_msgs.msg import InertiaEstimate

from mbaid_ros.cli import EXIT_NOT_DETERMINED
from mbaid_ros.errors import DataError

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / 'config'
sys.path.insert(0, str(ROOT / 'test'))

from graph import PATIENCE, Graph, Process, graph  # noqa: E402 - from the tests, which are no package
from simulated import assigned  # noqa: E402

__all__ = ['CONFIG', 'PATIENCE', 'ROOT', 'Demo', 'Graph', 'assigned', 'graph', 'running']


class Demo:
    """A graph whose node collects estimates and truths; a failure of a process ends its waiting."""

    def __init__(self, made: Graph) -> None:
        self.graph = made
        self.estimates: list[Any] = made.collect('/estimator/estimate', InertiaEstimate)
        self.truths: list[Any] = made.collect('/simulator/truth', InertiaStamped)

    def start(self, name: str, *arguments: object) -> Process:
        """Start a node of the package with ROS arguments."""
        return self.graph.start(name, '--ros-args', *arguments)

    def wait(self, condition: Callable[[], object], what: str, patience: float = PATIENCE) -> None:
        """Take messages until a condition holds; a DataError if that takes too long or a process fails."""

        def holds() -> object:
            self._check()
            return condition()

        try:
            self.graph.wait(holds, what, patience)
        except AssertionError as error:
            raise DataError(f'waited {patience:g} s in vain for {what}') from error

    def ended(self, process: Process, patience: float) -> None:
        """Wait for the end of a process."""
        self.wait(lambda: not process.running, f'the end of {process.name}', patience)
        self._check()

    def stop(self, *processes: Process) -> None:
        """Interrupt processes, as Ctrl-C does."""
        for process in processes:
            if process.running:
                process.stop(timeout=PATIENCE)
        self._check()

    def recorded(self, topic: str) -> bool:
        """Return whether the recorder listens to a topic."""
        return any(info.node_name == 'recorder' for info in self.graph.node.get_subscriptions_info_by_topic(topic))

    def _check(self) -> None:
        for process in self.graph.processes:
            if not process.running and process.wait() not in (0, EXIT_NOT_DETERMINED):
                lines = process.stderr.splitlines()[-3:]
                raise DataError(f'{process.name} ended with exit code {process.wait()}: {" | ".join(lines)}')


@contextmanager
def running() -> Iterator[Graph]:
    """Give a graph; it ends with the block, also on SIGTERM."""

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, interrupt)
    with TemporaryDirectory() as folder, graph(Path(folder)) as made:
        yield made
