"""Messages at the estimator's subscriptions: as packets, and in any interleaving."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import pytest
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState

from checked import same
from graph import Graph
from mbaid_ros.cdr import Packets
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.messages.fields import joint_state_shape
from mbaid_ros.nodes.subscriptions import Subscriptions
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_run import TimedMessage
from streams import offline, run, urdf


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
    assert all(isinstance(message, Packets) for topic in ('joint_states', 'odom') for message in taken[topic])
    assert taken['thrust'] == sent['thrust']
    for packet, message in zip(taken['joint_states'], sent['joint_states'], strict=True):
        found, expected = (joint_state_shape(x) for x in (packet, message))
        assert found.names == expected.names
        for column, other in zip(found.columns([packet]), expected.columns([message]), strict=True):
            assert column.tobytes() == other.tobytes()


def _are_equally_many(some: list[Any], others: list[Any]) -> bool:
    return len(some) == len(others)


# -- On a graph two topics arrive in any interleaving, and work is done at any time: the estimates are the same.


def interleaved(messages: Sequence[TimedMessage], seed: int, furthest: int) -> Iterator[TimedMessage]:
    """Yield the messages with each topic in order, one topic up to so many messages ahead of the other."""
    choose = random.Random(seed)
    queues = {topic: [m for m in messages if m.topic == topic] for topic in ('joint_states', 'odom')}
    done = dict.fromkeys(queues, 0)
    while any(done[topic] < len(queue) for topic, queue in queues.items()):
        open_topics = [topic for topic, queue in queues.items() if done[topic] < len(queue)]
        topic = choose.choice(open_topics)
        behind = min(open_topics, key=done.__getitem__)
        topic = behind if done[topic] - done[behind] >= furthest else topic
        for _ in range(choose.randint(1, furthest)):
            if done[topic] < len(queues[topic]):
                yield queues[topic][done[topic]]
                done[topic] += 1


def as_the_node_does(messages: Iterator[TimedMessage], seed: int) -> list[Estimate]:
    """Return the estimates of a session that works when it says so, and now and then besides."""
    session = Session(EstimatorConfig(), urdf('table1'))
    now_and_then = random.Random(seed)
    estimates = []
    for timed in messages:
        take = session.add_joint_state if timed.topic == 'joint_states' else session.add_odometry
        if take(timed.message) or now_and_then.random() < 0.02:
            estimates += session.process()
    return estimates + session.process()


@pytest.mark.parametrize('furthest', [1, 5, 60])
@pytest.mark.parametrize('seed', [1, 2])
def test_the_order_of_delivery_makes_no_difference(seed: int, furthest: int) -> None:
    messages = run('table1', 5.0)
    expected = offline(EstimatorConfig(), 'table1', messages)[0]
    delivered = as_the_node_does(interleaved(messages, seed, furthest), seed)
    assert same(delivered, expected)
