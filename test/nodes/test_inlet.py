"""What arrives at the subscriptions of the estimator: packets, of messages that any publisher sends."""

from __future__ import annotations

from functools import partial
from typing import Any

from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState

from graph import Graph
from mbaid_ros.cdr import Packet
from mbaid_ros.messages import joint_state_shape
from mbaid_ros.nodes.subscriptions import Subscriptions


def test_messages_come_as_packets_where_their_layout_is_known(graph: Graph) -> None:
    sent: dict[str, list[Any]] = {
        'joint_states': [
            JointState(name=['a', 'bcd'], position=[0.5, 1.5]),
            JointState(name=['a', 'bcd'], position=[0.5, 1.5], velocity=[2.0, 3.0]),
            JointState(name=['a', 'bcd'], position=[0.5, 1.5], effort=[4.0, 5.0]),
            JointState(name=['e'], position=[0.5], velocity=[2.0], effort=[4.0]),
            JointState(),
        ],
        'odom': [Odometry(child_frame_id='base_link'), Odometry()],
        'thrust': [WrenchStamped()],
    }
    taken: dict[str, list[Any]] = {topic: [] for topic in sent}
    for topic, messages in sent.items():
        inlet = Subscriptions(graph.node, type(messages[0]), topic, taken[topic].append)
        publisher = graph.publisher(topic, type(messages[0]))
        for message in messages:
            publisher.publish(message)
        graph.wait(partial(_are_equally_many, taken[topic], messages), topic)
        assert inlet.received == len(messages)
        assert inlet.timed is not None
    assert all(isinstance(message, Packet) for topic in ('joint_states', 'odom') for message in taken[topic])
    assert taken['thrust'] == sent['thrust']
    for packet, message in zip(taken['joint_states'], sent['joint_states'], strict=True):
        found, expected = (joint_state_shape(x) for x in (packet, message))
        assert found.names == expected.names
        for column, other in zip(found.columns([packet]), expected.columns([message]), strict=True):
            assert column.tobytes() == other.tobytes()


def _are_equally_many(some: list[Any], others: list[Any]) -> bool:
    return len(some) == len(others)
