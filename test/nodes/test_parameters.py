"""ROS parameters from the dataclasses, and messages at the subscriptions: packets, lost ones, any interleaving."""

from __future__ import annotations

import os
import random
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import rclpy
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import HistoryPolicy
from sensor_msgs.msg import JointState

from checked import same
from graph import PATIENCE, Graph, reserved_domain
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.config.simulator_parameters import SimulatorConfig
from mbaid_ros.core.joints.stream import joint_state_shape
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.samples import Packets
from mbaid_ros.errors import ParameterError
from mbaid_ros.nodes import runner, subscriptions
from mbaid_ros.nodes.runner import declare_parameters
from mbaid_ros.nodes.subscriptions import Subscriptions
from mbaid_ros.parameters import parameter, specifications, values_of
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_run import TimedMessage
from simulated import options
from streams import offline, run, urdf


@dataclass(frozen=True)
class Inner:
    """A group."""

    gain: float = parameter(0.5, minimum=0.0, maximum=2.0)
    """A gain."""


@dataclass(frozen=True)
class Example:
    """Parameters of every kind."""

    rate: float = parameter(10.0, unit='Hz', minimum=0.0, exclusive_minimum=True)
    """A rate."""
    count: int = parameter(3, minimum=1)
    """A number of things."""
    shape: str = parameter('round', choices=('round', 'square'))
    """A shape."""
    active: bool = parameter(False)
    """Whether it is on."""
    places: tuple[float, ...] = parameter((), unit='m')
    """Some places."""
    start: tuple[float, ...] = parameter((1.0, 2.0), 'A start.', lengths=(2,))
    inner: Inner = field(default_factory=Inner)


@contextmanager
def node(*arguments: str) -> Iterator[Node]:
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    with reserved_domain() as (domain, _):
        context = Context()
        words = options(*arguments)
        rclpy.init(args=['', '--ros-args', *words], context=context, domain_id=domain)
        made = Node('example', context=context)
        try:
            yield made
        finally:
            made.destroy_node()  # type: ignore[no-untyped-call]
            rclpy.shutdown(context=context)


def test_defaults_and_descriptors() -> None:
    with node() as made:
        config = declare_parameters(made, Example)
        assert config == Example()
        rate = made.describe_parameter('rate')
        assert (rate.description, rate.additional_constraints) == (
            'A rate.',
            'a number > 0 Hz; read when the node starts',
        )
        assert rate.read_only
        assert rate.floating_point_range[0].from_value == 0.0
        assert made.describe_parameter('inner.gain').floating_point_range[0].to_value == 2.0
        assert made.describe_parameter('count').integer_range[0].from_value == 1
        assert made.describe_parameter('shape').additional_constraints == 'round, square; read when the node starts'
        kinds = {name: made.get_parameter(name).type_ for name in specifications(Example)}
        assert kinds['places'] == kinds['start'] == Parameter.Type.DOUBLE_ARRAY
        assert made.describe_parameter('places').type == Parameter.Type.DOUBLE_ARRAY.value
        assert list(made.get_parameter('places').value) == []


def test_values_given_are_those_declared() -> None:
    given = [
        'rate:=4',
        'count:=7',
        'shape:=square',
        'active:=true',
        'places:=[1, 2]',
        'start:=[0.5, 1.5]',
        'inner.gain:=1',
    ]
    with node(*given) as made:
        config = declare_parameters(made, Example)
        assert config == Example(4.0, 7, 'square', True, (1.0, 2.0), (0.5, 1.5), Inner(1.0))
        for name, value in values_of(config).items():
            declared = made.get_parameter(name).value
            assert (tuple(declared) if isinstance(value, tuple) else declared) == value
            assert not isinstance(value, float) or isinstance(declared, float)


@pytest.mark.parametrize(
    ('given', 'words'),
    [
        ('rat:=4.0', r"unknown parameter 'rat'; known: rate, "),
        ('rate:=0.0', "'rate' is 0.0 Hz; accepted: a number > 0 Hz"),
        ('rate:=fast', "'rate' is 'fast'"),
        ('rate:=[]', "'rate' is None"),
        ('count:=1.5', "'count' is 1.5; accepted: a whole number >= 1"),
        ('shape:=oval', "'shape' is 'oval'; accepted: round, square"),
        ('start:=[1.0]', "'start' is"),
    ],
)
def test_what_is_not_accepted(given: str, words: str) -> None:
    with node(given) as made, pytest.raises(ParameterError, match=words):
        declare_parameters(made, Example)


def test_files_count_by_wildcards_and_assignments_count_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rclpy alone knows no wildcards but /**, and takes the section of the node before -p."""
    files = {'/example': 'rate: 1.0, count: 2', '/*': 'shape: square, use_sim_time: true', '/**': 'count: 4'}
    words = []
    for place, (section, values) in enumerate(files.items()):
        path = tmp_path / f'{place}.yaml'
        path.write_text(f'{section}: {{ros__parameters: {{{values}}}}}\n')
        words += [('--params-file', str(path))]
    monkeypatch.setattr(runner, '_words', [*words, ('-p', 'rate:=5'), ('-p', 'other:rate:=6.0')])
    with node() as made:
        assert declare_parameters(made, Example) == Example(5.0, 4, 'square')
        assert made.get_parameter('use_sim_time').value is True


@pytest.mark.parametrize('cls', [EstimatorConfig, SimulatorConfig])
def test_the_nodes_parameters_can_all_be_declared(cls: type) -> None:
    with node() as made:
        declare_parameters(made, cls)
        for name, spec in specifications(cls).items():
            assert made.get_parameter(name).type_.name == spec.type.upper(), name
            assert made.describe_parameter(name).description == spec.description


def test_messages_that_are_lost_between_others_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subscriptions, 'DEPTH', 10)
    monkeypatch.setattr(subscriptions, 'HistoryPolicy', SimpleNamespace(KEEP_ALL=HistoryPolicy.KEEP_LAST))
    with node() as made:
        publisher = made.create_publisher(JointState, 'joint_states', subscriptions.qos(1000))
        subscription = subscriptions.Subscriptions(made, JointState, 'joint_states', lambda _: None)
        executor = SingleThreadedExecutor(context=made.context)
        executor.add_node(made)
        while not subscription.received:
            publisher.publish(JointState())
            executor.spin_once(timeout_sec=0.1)
        subscription.lost, first = 0, subscription.received
        for _ in range(100):
            publisher.publish(JointState())
        assert publisher.wait_for_all_acked(Duration(seconds=PATIENCE))
        while subscription.received < first + 10:
            executor.spin_once(timeout_sec=0.1)
        executor.shutdown()
    assert subscription.lost == 90


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
    expected = offline(EstimatorConfig(), 'table1', messages)
    delivered = as_the_node_does(interleaved(messages, seed, furthest), seed)
    assert same(delivered, expected)
