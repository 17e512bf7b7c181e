"""The estimator that is attacked: what is sent to it, what it says, and its estimates of a clean recording."""

from __future__ import annotations

import itertools
import resource
import time
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from mbaid_msgs.msg import InertiaEstimate
from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from benchmarks.data import CONFIG
from benchmarks.endurance import resident
from benchmarks.speed_bag import ROBOT
from graph import Graph
from mbaid_ros.bags import BagReader
from mbaid_ros.messages import stamp_of
from mbaid_ros.nodes.subscriptions import qos
from streams import every_bit, urdf

BAG = CONFIG.parent / 'bags' / 'servicer7_mid'
KINDS: dict[str, Any] = {'joint_states': JointState, 'odom': Odometry}
_PARTS = ('samples', 'robot description')  # of /diagnostics, that say what is wrong with inputs
_BEFORE = 1_000_000_000  # ns, from the end of the recording: its last window may stay open
_ACKNOWLEDGED = Duration(seconds=60.0)


def recorded() -> list[tuple[str, bytes]]:
    """Return the messages of the clean recording, as topics without the slash and bytes."""
    with BagReader(BAG) as bag:
        return [(topic.lstrip('/'), data) for topic, data, _ in bag.raw([f'/{topic}' for topic in KINDS])]


class Victim:
    """A node `estimator` that gets its robot description on a topic.

    Parameters
    ----------
    graph : Graph
    parameters : ``name:=value``, beside those of the robot's file
    """

    def __init__(self, graph: Graph, *parameters: str) -> None:
        self.graph = graph
        given = [word for parameter in parameters for word in ('-p', parameter)]
        file = CONFIG / f'{ROBOT}_estimator.yaml'
        self.process = graph.start('estimator', '--ros-args', '--params-file', file, *given)
        self._estimates = graph.collect('/estimator/estimate', InertiaEstimate)
        self._diagnostics = graph.collect('/diagnostics', DiagnosticArray, qos(10_000))
        self._publishers = {topic: graph.publisher(topic, kind) for topic, kind in KINDS.items()}
        self._publishers['robot_description'] = graph.publisher('robot_description', String, qos(100, latched=True))
        self.recording = recorded()

    def send(self, topic: str, message: Any) -> None:
        """Publish a message, or the bytes of one."""
        self._publishers[topic].publish(message)

    def describe(self, text: str) -> None:
        """Publish a robot description."""
        self.send('robot_description', String(data=text))

    def drained(self) -> None:
        """Wait until nothing is left to be taken: two reports in which as much has been received."""
        for topic, publisher in self._publishers.items():
            if not publisher.wait_for_all_acked(_ACKNOWLEDGED):
                raise AssertionError(f'not everything on {topic} was received')
        begin = len(self._diagnostics)

        def quiet() -> bool:
            last = self._diagnostics[begin:][-2:]
            return len(last) == 2 and _received(last[0]) == _received(last[1])

        self.graph.wait(quiet, 'the end of what has been sent')

    def received(self) -> int:
        """Return how many messages it says that it has received, on both topics."""
        return sum(_received(self._diagnostics[-1]).values())

    def of_clean(self) -> list[bytes]:
        """Return the bits of its estimates of the clean recording, from ~/reset on."""
        self.graph.call('/estimator/pause', SetBool, SetBool.Request(data=False))
        self.describe(urdf(ROBOT))
        self.drained()
        self.reset()
        for topic, data in self.recording:
            self.send(topic, data)
        topic, data = self.recording[-1]
        end = stamp_of(deserialize_message(data, KINDS[topic])) - _BEFORE
        self.graph.wait(lambda: self._new() and stamp_of(self._new()[-1]) >= end, 'the estimates of a clean recording')
        return [every_bit(each, 'mbaid_msgs/msg/InertiaEstimate') for each in self._new() if stamp_of(each) <= end]

    def reset(self) -> None:
        """Call ~/reset, and wait until what was estimated before has been withdrawn."""
        self._estimates.clear()
        self.graph.call('/estimator/reset', Trigger, Trigger.Request())
        self.graph.wait(lambda: any(not each.samples for each in self._estimates), 'an estimate that waits')

    def _new(self) -> list[Any]:
        """Return the estimates since the last one that waits, without those that are told again."""
        begin = max(number for number, each in enumerate(self._estimates) if not each.samples)
        return [each for each in self._estimates[begin + 1 :] if not each.stale]

    def forget(self) -> None:
        """Forget what it has said in /diagnostics, but for the last."""
        del self._diagnostics[:-1]

    def reports(self) -> int:
        """Return how many there were in /diagnostics since what it has said was forgotten."""
        return len(self._diagnostics) - 1

    def rest(self, seconds: float) -> None:
        """Let some time pass."""
        end = time.monotonic() + seconds
        self.graph.wait(lambda: time.monotonic() > end, 'time to pass')

    def complaints(self, parts: tuple[str, ...] = _PARTS) -> list[str]:
        """Return what it has said in parts of /diagnostics to be wrong, each text once."""
        names = [f'estimator: {part}' for part in parts]
        statuses = [status for array in self._diagnostics for status in array.status if status.name in names]
        wrong = [
            status.message for status in statuses if status.level in {DiagnosticStatus.WARN, DiagnosticStatus.ERROR}
        ]
        return list(dict.fromkeys(wrong))

    def silence(self) -> float:
        """Return the longest time between two reports in /diagnostics, s by the node's clock."""
        stamps = [stamp_of(array) for array in self._diagnostics]
        return 1e-9 * max(after - before for before, after in itertools.pairwise(stamps))

    def fill_disk(self) -> None:
        """Let no file of it grow, once messages flow: the middleware's shared memory is made of files, too."""
        self.describe(urdf(ROBOT))
        self.drained()
        self.reset()
        resource.prlimit(self.process.pid, resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))

    def memory(self) -> float:
        """Return its resident memory, MB."""
        return resident(self.process.pid)

    def most_memory(self) -> float:
        """Return the most resident memory that it ever had, MB."""
        lines = Path(f'/proc/{self.process.pid}/status').read_text(encoding='ascii').splitlines()
        return 1.024e-3 * next(int(line.split()[1]) for line in lines if line.startswith('VmHWM'))


def _received(array: Any) -> dict[str, int]:
    inputs = {f'estimator: {topic}' for topic in KINDS}
    values = [(status.name, pair) for status in array.status if status.name in inputs for pair in status.values]
    return {name: int(pair.value) for name, pair in values if pair.key == 'received'}
