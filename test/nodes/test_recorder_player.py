"""The recorder and the player: what is published is in the bag, what is in the bag is published and replayed alike."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from mbaid_msgs.msg import InertiaEstimate
from rclpy.duration import Duration
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

import recorded
from graph import PATIENCE, Graph
from mbaid_ros.bags import BagReader, BagWriter, deserialize, message_class, serialize
from mbaid_ros.nodes import player
from mbaid_ros.nodes.subscriptions import LATCHED, qos
from mbaid_ros.parameters import METHODS
from mbaid_ros.replay.arguments import replay
from recorded import papers_case
from simulated import CONFIG
from streams import TABLE1_MOMENTUM

COUNT = 300
DEEP = qos(10_000)
ALL_ACKED = Duration(seconds=PATIENCE)
STRING = 'std_msgs/msg/String'


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds of joint states and odometry at 20 Hz, and a latched robot description."""
    folder = tmp_path_factory.mktemp('bags')
    moving = papers_case(folder / 'moving', duration=2.0)
    path = folder / 'bag'
    with BagReader(moving) as source, BagWriter(path) as target:
        target.add_topic('/robot_description', STRING, latched=True)
        for topic in source.topics.values():
            target.add_topic(topic.name, topic.type)
        start = recorded.EPOCH * 1_000_000_000
        target.write('/robot_description', message_class(STRING)(data='<robot/>'), start)
        for name, data, when in source.raw():
            target.write_raw(name, data, when)
    return path


def by_topic(path: Path) -> dict[str, list[bytes]]:
    with BagReader(path) as reader:
        assert reader.warnings == []
        found: dict[str, list[bytes]] = {name: [] for name in reader.topics}
        for name, data, _ in reader.raw():
            found[name].append(data.rstrip(b'\0'))  # the wire pads to whole words
    return found


def start_recorder(graph: Graph, path: Path, *parameters: str) -> Any:
    arguments = [part for parameter in parameters for part in ('-p', parameter)]
    return graph.start('recorder', '--ros-args', '-p', f'output:={path}', *arguments)


def joint_state(index: int) -> JointState:
    message = JointState(name=['a', 'b'], position=[float(index), 0.5], velocity=[])
    message.header.stamp.sec = index
    return message


def test_everything_a_reliable_publisher_sends_is_in_the_bag_whatever_ends_it(graph: Graph, tmp_path: Path) -> None:
    names = {'all': (), 'chosen': ('topics:=[/other]',), 'brief': ('topics:=[/odom]', 'duration:=0.3')}
    recorders = {name: start_recorder(graph, tmp_path / name, *given) for name, given in names.items()}
    kinds = {'/joint_states': JointState, '/thrust': WrenchStamped, '/diagnostics': DiagnosticArray}
    # The types of /other and of /odom are taken as they are.
    published = {topic: graph.publisher(topic, kind, DEEP) for topic, kind in kinds.items()}
    published |= {topic: graph.publisher(topic, JointState, DEEP) for topic in ('/other', '/odom')}
    published['/robot_description'] = graph.publisher('/robot_description', String, LATCHED)
    begin = time.time_ns()
    published['/robot_description'].publish(String(data='<robot/>'))
    for topic, kind in kinds.items():
        if topic != '/joint_states':
            published[topic].publish(kind())
    for index in range(COUNT):
        published['/joint_states'].publish(joint_state(index))
    published['/other'].publish(joint_state(1))
    graph.wait(lambda: published['/odom'].get_subscription_count() == 2, 'two recorders of one topic')
    published['/odom'].publish(joint_state(2))
    assert all(publisher.wait_for_all_acked(ALL_ACKED) for publisher in published.values())
    assert recorders['brief'].wait() == 0
    # A best effort publisher matches as soon as the recorder asks for no more than it offers.
    states = published['/joint_states']
    best_effort = graph.publisher('/joint_states', JointState, qos(100, best_effort=True))
    graph.wait(lambda: states.get_subscription_count() == 1, 'the recorder on both')
    for _ in range(50):  # best effort may lose some
        best_effort.publish(joint_state(COUNT + 1))
    states.publish(joint_state(COUNT))
    assert states.wait_for_all_acked(ALL_ACKED)
    assert recorders['chosen'].stop(signal.SIGTERM) == 0
    assert recorders['all'].stop() == 0
    assert 'messages on 5 topics' in recorders['all'].stdout
    assert {name: set(by_topic(tmp_path / name)) for name in names} == {
        'all': {'/robot_description', '/joint_states', '/thrust', '/diagnostics', '/odom'},
        'chosen': {'/other'},
        'brief': {'/odom'},
    }
    with BagReader(tmp_path / 'all') as reader:
        assert reader.topics['/robot_description'].latched
        assert not reader.topics['/joint_states'].latched
        read = [(message, when) for _, message, when in reader.read(['/joint_states'])]
    assert [message.header.stamp.sec for message, _ in read[:COUNT]] == list(range(COUNT))
    assert [message.position[0] for message, _ in read[:COUNT]] == list(range(COUNT))
    assert {message.header.stamp.sec for message, _ in read[COUNT:]} == {COUNT, COUNT + 1}
    assert len(read[0][0].velocity) == 0
    assert all(begin <= when <= time.time_ns() for _, when in read)


def test_the_player_publishes_the_bag_and_the_recorder_records_the_same_bytes(
    graph: Graph, bag: Path, tmp_path: Path
) -> None:
    copying = start_recorder(graph, tmp_path / 'copy')
    begin = time.monotonic()
    playing = graph.start('player', bag, '--rate', 4, '--wait-for-subscribers', PATIENCE)
    assert playing.wait() == 0, playing.stderr
    assert time.monotonic() - begin > 2.0 / 4
    assert copying.stop() == 0
    assert by_topic(tmp_path / 'copy') == by_topic(bag)
    with BagReader(tmp_path / 'copy') as copy:
        assert copy.topics['/robot_description'].latched


def test_a_message_is_due_at_its_time_over_the_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]

    def sleep(seconds: float) -> None:
        now[0] += seconds

    monkeypatch.setattr(player, 'time', SimpleNamespace(monotonic=lambda: now[0], sleep=sleep))
    playing: Any = SimpleNamespace(
        _origin=(now[0], 5_000_000_000), _rate=4.0, _clock_topic=None, _interrupt=SimpleNamespace(requested=False)
    )
    for due, time_of_it in ((7_000_000_000, 100.5), (6_000_000_000, 100.5), (15_000_000_000, 102.5)):
        player.PlayerNode._wait_until(playing, due)
        assert now[0] == pytest.approx(time_of_it, abs=1e-6)


@pytest.mark.long
def test_a_choice_of_topics_with_a_clock_and_latched_topics_in_a_loop(graph: Graph, bag: Path) -> None:
    states = graph.collect('/joint_states', JointState, DEEP)
    clocks = graph.collect('/clock', Clock, DEEP)
    chosen = graph.start('player', bag, '--topics', '/joint_states', '--clock', '--wait-for-subscribers', PATIENCE)
    graph.wait(lambda: not chosen.running, 'the end of the bag')
    graph.wait(lambda: len(states) == 41, 'all joint states')
    assert '/odom' not in dict(graph.node.get_topic_names_and_types())
    times = [clock.clock.sec + clock.clock.nanosec * 1e-9 for clock in clocks]
    assert times == sorted(times)
    assert times[0] >= recorded.EPOCH
    assert times[-1] <= recorded.EPOCH + 2.0
    assert len(times) > 50
    states.clear()
    looping = graph.start('player', bag, '--loop', '--rate', 10)
    graph.wait(lambda: len(states) > 0, 'joint states')
    descriptions = graph.collect('/robot_description', String, LATCHED)
    graph.wait(lambda: len(descriptions) > 0, 'the robot description')
    assert descriptions[0].data == '<robot/>'
    # A loop: more messages than there are in the bag.
    graph.wait(lambda: len(states) > 60, 'a second turn')
    assert looping.stop() == 0
    assert looping.stderr == ''


# -- a bag played into the live estimator

WINDOW = 500_000_000  # ns
TYPE = 'mbaid_msgs/msg/InertiaEstimate'


def comparable(data: bytes) -> bytes:
    """Return a serialised estimate free of what serialisers pad with, and of the run's own warnings."""
    made = deserialize(data, TYPE)
    made.warnings.clear()
    return serialize(made, TYPE)


def by_window(data: Iterable[bytes]) -> dict[int, bytes]:
    """Return the last estimate of each window: of several a window, as the paper's methods give, that one is graph."""
    spans = [(deserialize(each, TYPE).span, each) for each in data]
    return {(span.sec * 1_000_000_000 + span.nanosec + 1) // WINDOW: each for span, each in spans}


@pytest.mark.long
@pytest.mark.parametrize('method', METHODS)
def test_a_played_bag_gives_the_estimates_of_its_replay(graph: Graph, tmp_path: Path, method: str) -> None:
    moving = papers_case(tmp_path / 'moving', duration=20.0, rate=100.0)
    parameters, model = tmp_path / 'estimator.yaml', CONFIG / 'table1.urdf'
    given = f'method: {method}, paper.total_angular_momentum: {list(TABLE1_MOMENTUM)}'
    parameters.write_text(f'/**: {{ros__parameters: {{{given}}}}}\n')
    arguments = ['--params-file', parameters, '-p', f'robot_description_file:={model}']
    graph.start('estimator', '--ros-args', *arguments)
    published: list[Any] = graph.collect('/estimator/estimate', InertiaEstimate)
    graph.wait(lambda: published, 'what the estimator waits for')
    playing = graph.start('player', moving, '--rate', '20', '--wait-for-subscribers', PATIENCE)

    output = tmp_path / 'estimates'
    assert replay([str(moving), '--model', str(model), '--params', str(parameters), '--output', str(output)]) == 0
    with BagReader(output) as estimates:
        replayed = by_window(comparable(data) for _, data, _ in estimates.raw(['/estimator/estimate']))
    assert len(replayed) >= 39

    def fresh() -> list[Any]:  # on a busy machine one may go stale, and be published again, before the next
        return [each for each in published if each.samples and not each.stale]

    graph.wait(lambda: len(fresh()) >= len(replayed), 'every estimate')
    assert playing.wait() == 0
    assert [comparable(serialize_message(each)) for each in fresh()] == list(replayed.values())
