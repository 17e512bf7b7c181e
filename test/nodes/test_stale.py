"""An estimate that nothing follows is told as stale whatever the reason, and only then."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from mbaid_msgs.msg import InertiaEstimate
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState

from graph import Graph
from mbaid_ros.nodes.subscriptions import qos
from simulated import CONFIG
from streams import run

RATE = 50.0  # Hz, of the messages, in the time of their stamps and in that of the clock
MOTION = 6.0  # s, that are sent at once


class Stream:
    """An estimator and the sensors of its robot, which go on sending while the test waits."""

    def __init__(self, graph: Graph, *parameters: str) -> None:
        given = (f'robot_description_file:={CONFIG}/table1.urdf', *parameters)
        self.node = graph.start('estimator', '--ros-args', *(word for text in given for word in ('-p', text)))
        self.estimates: list[Any] = graph.collect('/estimator/estimate', InertiaEstimate)
        self.change: Callable[[Any], None] = lambda _message: None
        self._messages = iter(run('table1', 60.0, RATE))
        self._publishers = {
            'joint_states': graph.publisher('joint_states', JointState),
            'odom': graph.publisher('odom', Odometry),
        }
        self._send(MOTION)
        graph.wait(lambda: self.estimates and self.estimates[-1].samples, 'an estimate')
        graph.node.create_timer(0.1, lambda: self._send(0.1))

    def _send(self, seconds: float) -> None:
        for _ in range(2 * round(seconds * RATE)):
            timed = next(self._messages)
            message = deepcopy(timed.message)
            self.change(message)
            self._publishers[timed.topic].publish(message)


def lose_track(message: Any) -> None:
    if isinstance(message, Odometry):
        message.pose.pose.position.x = float('nan')


def jump_back(message: Any) -> None:
    message.header.stamp.sec -= 100


@pytest.mark.parametrize(
    ('change', 'parameters', 'reason'),
    [
        (lose_track, (), 'messages arrive, and none could be used for more than 2 s: NaN or infinite value'),
        (jump_back, ('time_jump:=error',), 'jumped back'),
    ],
    ids=['lost', 'stopped'],
)
def test_data_that_cannot_be_used_leave_a_stale_estimate(
    graph: Graph, change: Callable[[Any], None], parameters: tuple[str, ...], reason: str
) -> None:
    stream = Stream(graph, *parameters)
    stream.change = change
    graph.wait(lambda: stream.estimates[-1].stale, 'the stale estimate')
    assert reason in stream.estimates[-1].warnings[-1]
    assert stream.estimates[-1].samples > 0
    if change is lose_track:
        stream.change = lambda _message: None
        graph.wait(lambda: not stream.estimates[-1].stale, 'an estimate once it can be used again')


def test_a_message_from_another_source_of_poses_makes_nothing_stale(graph: Graph) -> None:
    stream = Stream(graph)
    diagnostics = graph.collect('/diagnostics', DiagnosticArray, qos(100))
    graph.publisher('pose', PoseStamped).publish(PoseStamped())
    dropped = 'dropped, the pose of the base comes from another source'
    graph.wait(lambda: f"key='{dropped}', value='1'" in str(diagnostics), 'the message that is not used')
    diagnostics.clear()
    stream.estimates.clear()
    graph.wait(lambda: len(diagnostics) >= 4 and stream.estimates, 'more than two seconds of reports')
    assert not any(estimate.stale for estimate in stream.estimates)
    names = {status.name for array in diagnostics for status in array.status}
    assert 'estimator: odom' in names
    assert 'estimator: pose' not in names
    assert DiagnosticStatus.STALE not in {status.level for array in diagnostics for status in array.status}
