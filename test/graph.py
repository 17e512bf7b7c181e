"""A ROS 2 graph for a test: the package's executables as processes, and a node that waits for what they do.

Every test has a domain of its own, on this machine alone. Nothing here sleeps: whatever is waited for is an event on
the graph or the end of a process, with an allowance far above what it takes.
"""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import rclpy
from ament_index_python.packages import get_package_prefix
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from mbaid_ros.nodes.subscriptions import qos

ROOT = Path(__file__).resolve().parents[1]
LOCAL = {
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    'FASTRTPS_DEFAULT_PROFILES_FILE': str(ROOT / 'scripts' / 'quick_discovery.xml'),
}
EVERYTHING = qos(10_000, latched=True)  # what was published last, and all from then on
PATIENCE = 180.0  # s, for anything: a machine with other work may stand still for a while, and several times
RESPONSE = 10.0  # s, for the first response of a service, before it is asked again
DOMAINS = range(1, 102)  # those whose ports Linux does not hand out to others


def executable(name: str) -> Path:
    """Return an executable of the package where `ros2 run` looks for it."""
    return Path(get_package_prefix('mbaid_ros')) / 'lib' / 'mbaid_ros' / name


@contextmanager
def reserved_domain() -> Iterator[tuple[int, int]]:
    """Reserve a ROS domain that no other test on this machine uses, whoever runs it; give it and the lock's descriptor.

    A process that inherits the descriptor keeps the domain reserved, should it outlive the test.
    """
    folder = Path(tempfile.gettempdir()) / f'mbaid_ros_domains.{os.getuid()}'
    folder.mkdir(exist_ok=True)
    for domain in DOMAINS:
        with (folder / str(domain)).open('w') as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain, lock.fileno()
            return
    raise RuntimeError('every ROS domain is in use')


class Process:
    """An executable of the package, running.

    Parameters
    ----------
    command : its name and arguments
    environment : of the process
    folder : where its output is kept
    lock : descriptor that it inherits
    """

    def __init__(self, command: list[str], environment: dict[str, str], folder: Path, lock: int) -> None:
        self.name = command[0]
        self._out: IO[str] = (folder / f'{self.name}.out').open('w+')
        self._err: IO[str] = (folder / f'{self.name}.err').open('w+')
        arguments = [str(executable(self.name)), *command[1:]]
        self._process = subprocess.Popen(
            arguments, env=environment, stdout=self._out, stderr=self._err, pass_fds=[lock]
        )

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    @property
    def stdout(self) -> str:
        """What it has written so far."""
        return self._read(self._out)

    @property
    def stderr(self) -> str:
        """What it has complained of or logged so far."""
        return self._read(self._err)

    def wait(self, timeout: float = PATIENCE) -> int:
        """Wait for its end and return the exit code."""
        return self._process.wait(timeout)

    def stop(self, number: signal.Signals = signal.SIGINT, timeout: float = PATIENCE) -> int:
        """Send a signal, wait for the end and return the exit code."""
        self._process.send_signal(number)
        return self.wait(timeout)

    def close(self) -> None:
        """End it in any case."""
        if self.running:
            self._process.kill()
            self._process.wait()
        self._out.close()
        self._err.close()

    @staticmethod
    def _read(stream: IO[str]) -> str:
        return Path(stream.name).read_text()


class Graph:
    """A ROS domain with processes in it and this test's own node.

    Parameters
    ----------
    domain : int
    lock : descriptor that keeps the domain reserved
    folder : where the output of processes is kept
    """

    def __init__(self, domain: int, lock: int, folder: Path) -> None:
        self._lock = lock
        self.environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain), **LOCAL, 'PYTHONUNBUFFERED': '1'}
        self._folder = folder
        self.processes: list[Process] = []
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = Node('test', context=self._context, start_parameter_services=False)
        self._clients: dict[str, Client] = {}
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._nodes = [self.node]

    def start(self, name: str, *arguments: object) -> Process:
        """Start an executable of the package."""
        folder = self._folder / str(len(self.processes))
        folder.mkdir()
        process = Process([name, *map(str, arguments)], self.environment, folder, self._lock)
        self.processes.append(process)
        return process

    def add(self, node: Node) -> None:
        """Run a node of this process, made in the context of the test's own, until the end."""
        self._nodes.append(node)  # the executor does not keep it alive
        self._executor.add_node(node)

    @contextmanager
    def stranger(self, name: str) -> Iterator[Node]:
        """Give a node that shares no more with the test's own than one of another process does."""
        context = Context()
        rclpy.init(context=context, domain_id=self._context.get_domain_id())
        node = Node(name, context=context, start_parameter_services=False)
        try:
            yield node
        finally:
            node.destroy_node()  # type: ignore[no-untyped-call]
            rclpy.shutdown(context=context)

    def collect(self, topic: str, message_type: type, profile: QoSProfile = EVERYTHING) -> list[Any]:
        """Return a list that the messages of a topic are appended to from now on."""
        messages: list[Any] = []
        self.node.create_subscription(message_type, topic, messages.append, profile)
        return messages

    def publisher(self, topic: str, message_type: type, profile: QoSProfile | None = None) -> Publisher:
        """Return a publisher that has a subscriber; its queue is deep and reliable unless a profile is given."""
        publisher = self.node.create_publisher(message_type, topic, profile or qos(10_000))
        self.wait(lambda: publisher.get_subscription_count() > 0, f'a subscriber of {topic}')
        return publisher

    def call(self, service: str, service_type: Any, request: Any) -> Any:
        """Call a service and return its response.

        The first call of one may come twice: a service can be ready before it has found who is to get its response,
        which then is lost.
        """
        client = self._clients.get(service)
        if client is None:
            client = self._clients[service] = self.node.create_client(service_type, service)
            self.wait(client.service_is_ready, f'service {service}')
            future = client.call_async(request)
            if self._spin_until(future.done, RESPONSE):
                return future.result()  # type: ignore[no-untyped-call]
        future = client.call_async(request)
        self.wait(future.done, f'an answer of {service}')
        return future.result()  # type: ignore[no-untyped-call]

    def wait(self, condition: Callable[[], object], what: str, timeout: float = PATIENCE) -> None:
        """Take messages until a condition holds.

        Raises
        ------
        AssertionError
            It does not come to hold in time; the text has what the processes wrote.
        """
        if not self._spin_until(condition, timeout):
            outputs = [f'-- {p.name} (running: {p.running})\n{p.stdout}{p.stderr}' for p in self.processes]
            raise AssertionError('\n'.join([f'waited {timeout:g} s in vain for {what}', *outputs]))

    def _spin_until(self, condition: Callable[[], object], timeout: float) -> bool:
        """Take messages until a condition holds or the time (s) is over; return whether it holds."""
        end = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > end:
                return False
            self._executor.spin_once(timeout_sec=0.1)
        return True

    def close(self) -> None:
        """End every process and leave the domain."""
        for process in self.processes:
            process.close()
        self._executor.shutdown()
        for node in self._nodes:
            node.destroy_node()  # type: ignore[no-untyped-call]
        rclpy.shutdown(context=self._context)


@contextmanager
def graph(folder: Path) -> Iterator[Graph]:
    """Return an empty graph on a domain of its own."""
    os.environ.update(LOCAL)  # read by the middleware of this process, too
    with reserved_domain() as (domain, lock):
        made = Graph(domain, lock, folder)
        try:
            yield made
        finally:
            made.close()
