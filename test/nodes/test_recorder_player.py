"""The recorder and the player on a graph: what is published is in the bag, what is in the bag is published."""

from __future__ import annotations

import resource
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.duration import Duration
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

import recorded
from graph import Graph, graph
from made_runs import estimate
from mbaid_ros.bags import BagReader, BagWriter, message_class
from mbaid_ros.nodes.subscriptions import LATCHED, qos
from older_bags import TOPIC, older_estimates

COUNT = 300
DEEP = qos(10_000)
SECONDS = Duration(seconds=20)


@pytest.fixture
def live(tmp_path: Path) -> Iterator[Graph]:
    folder = tmp_path / 'processes'
    folder.mkdir()
    with graph(folder) as made:
        yield made


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds of joint states and odometry at 20 Hz, and a latched robot description."""
    folder = tmp_path_factory.mktemp('bags')
    moving = recorded.papers_case(folder / 'moving', duration=2.0)
    path = folder / 'bag'
    with BagReader(moving) as source, BagWriter(path) as target:
        target.add_topic('/robot_description', 'std_msgs/msg/String', latched=True)
        for topic in source.topics.values():
            target.add_topic(topic.name, topic.type)
        start = recorded.EPOCH * 1_000_000_000
        target.write('/robot_description', message_class('std_msgs/msg/String')(data='<robot/>'), start)
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


def record(live: Graph, path: Path, *parameters: str) -> Any:
    arguments = [part for parameter in parameters for part in ('-p', parameter)]
    return live.start('recorder', '--ros-args', '-p', f'output:={path}', *arguments)


def joint_state(index: int) -> JointState:
    message = JointState(name=['a', 'b'], position=[float(index), 0.5], velocity=[])
    message.header.stamp.sec = index
    return message


def test_everything_a_reliable_publisher_sends_is_in_the_bag(live: Graph, tmp_path: Path) -> None:
    recorder = record(live, tmp_path / 'run')
    states = live.publisher('/joint_states', JointState, DEEP)
    description = live.publisher('/robot_description', String, LATCHED)
    description.publish(String(data='<robot/>'))
    for index in range(COUNT):
        states.publish(joint_state(index))
    begin = time.time_ns()
    assert states.wait_for_all_acked(SECONDS)
    assert description.wait_for_all_acked(SECONDS)
    assert recorder.stop() == 0
    assert f'{COUNT + 1} messages on 2 topics' in recorder.stdout
    with BagReader(tmp_path / 'run') as reader:
        assert reader.warnings == []
        assert reader.topics['/robot_description'].latched
        assert not reader.topics['/joint_states'].latched
        read = [(message, when) for _, message, when in reader.read(['/joint_states'])]
    assert [message.header.stamp.sec for message, _ in read] == list(range(COUNT))
    assert [message.position[0] for message, _ in read] == list(range(COUNT))
    assert len(read[0][0].velocity) == 0
    assert all(abs(when - begin) < 60_000_000_000 for _, when in read)


def test_what_is_not_the_estimators_is_left_out_unless_asked_for(live: Graph, tmp_path: Path) -> None:
    default = record(live, tmp_path / 'default')
    chosen = record(live, tmp_path / 'chosen', 'topics:=[/other]')
    live.node.create_publisher(JointState, '/other', DEEP)
    diagnostics = live.publisher('/diagnostics', DiagnosticArray)
    diagnostics.publish(DiagnosticArray())
    other = live.publisher('/other', JointState)
    other.publish(joint_state(1))
    assert diagnostics.wait_for_all_acked(SECONDS)
    assert other.wait_for_all_acked(SECONDS)
    assert (default.stop(), chosen.stop()) == (0, 0)
    assert set(by_topic(tmp_path / 'default')) == {'/diagnostics'}
    assert set(by_topic(tmp_path / 'chosen')) == {'/other'}


def test_a_best_effort_publisher_that_comes_later_is_recorded_too(live: Graph, tmp_path: Path) -> None:
    recorder = record(live, tmp_path / 'run')
    reliable = live.publisher('/joint_states', JointState)
    reliable.publish(joint_state(0))
    assert reliable.wait_for_all_acked(SECONDS)
    # It matches as soon as the recorder asks for no more than it offers.
    best_effort = live.publisher('/joint_states', JointState, qos(100, best_effort=True))
    live.wait(lambda: reliable.get_subscription_count() == 1, 'the recorder on both')
    for _ in range(50):  # best effort may lose some
        best_effort.publish(joint_state(2))
    reliable.publish(joint_state(1))
    assert reliable.wait_for_all_acked(SECONDS)
    assert recorder.stop() == 0
    with BagReader(tmp_path / 'run') as reader:
        seconds = {message.header.stamp.sec for _, message, _ in reader.read(['/joint_states'])}
    assert seconds == {0, 1, 2}


def test_the_recording_ends_by_itself_after_its_duration(live: Graph, tmp_path: Path) -> None:
    recorder = record(live, tmp_path / 'run', 'duration:=0.3')
    states = live.publisher('/joint_states', JointState)
    states.publish(joint_state(0))
    assert recorder.wait() == 0
    assert len(by_topic(tmp_path / 'run')['/joint_states']) == 1


def test_sigterm_completes_the_bag(live: Graph, tmp_path: Path) -> None:
    recorder = record(live, tmp_path / 'run')
    states = live.publisher('/joint_states', JointState)
    states.publish(joint_state(0))
    assert states.wait_for_all_acked(SECONDS)
    assert recorder.stop(signal.SIGTERM) == 0
    assert len(by_topic(tmp_path / 'run')['/joint_states']) == 1


def test_a_recorder_that_is_killed_leaves_what_it_had_a_second_before(live: Graph, tmp_path: Path) -> None:
    recorder = record(live, tmp_path / 'run')
    states = live.publisher('/joint_states', JointState)
    states.publish(joint_state(0))
    file = tmp_path / 'run' / 'run.mcap'
    live.wait(lambda: file.stat().st_size > 500, 'the message on the disk')
    recorder.stop(signal.SIGKILL)
    with BagReader(tmp_path / 'run') as reader:
        assert reader.messages == 1
        assert 'cut off' in reader.warnings[0]


def test_a_full_disk_ends_the_recorder_with_one_line_and_a_bag_that_can_be_read(live: Graph, tmp_path: Path) -> None:
    recorder = record(live, tmp_path / 'run')
    states = live.publisher('/joint_states', JointState)
    states.publish(joint_state(0))
    file = tmp_path / 'run' / 'run.mcap'
    live.wait(lambda: file.stat().st_size > 500, 'the message on the disk')
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (file.stat().st_size + 50, resource.RLIM_INFINITY))
    states.publish(joint_state(1))
    assert recorder.wait() == 2
    lines = [line for line in recorder.stderr.splitlines() if not line.startswith('[')]
    assert len(lines) == 1
    assert "run' cannot be written: File too large; it holds 1 of 2 messages" in lines[0]
    assert recorder.stdout == ''
    with BagReader(tmp_path / 'run') as reader:
        assert reader.messages == 1


def test_the_player_publishes_the_bag_and_the_recorder_records_the_same_bytes(
    live: Graph, bag: Path, tmp_path: Path
) -> None:
    recorder = record(live, tmp_path / 'copy')
    begin = time.monotonic()
    player = live.start('player', bag, '--rate', 4, '--wait-for-subscribers', 30)
    assert player.wait() == 0, player.stderr
    assert time.monotonic() - begin > 2.0 / 4
    assert recorder.stop() == 0
    assert by_topic(tmp_path / 'copy') == by_topic(bag)
    with BagReader(tmp_path / 'copy') as copy:
        assert copy.topics['/robot_description'].latched
        times = [when for _, _, when in copy.raw(['/odom'])]
    assert (times[-1] - times[0]) * 1e-9 == pytest.approx(2.0 / 4, rel=0.3)


def test_latched_topics_of_a_bag_reach_who_comes_later(live: Graph, bag: Path) -> None:
    player = live.start('player', bag, '--loop', '--rate', 10)
    states = live.collect('/joint_states', JointState, DEEP)
    live.wait(lambda: len(states) > 0, 'joint states')
    descriptions = live.collect('/robot_description', String, LATCHED)
    live.wait(lambda: len(descriptions) > 0, 'the robot description')
    assert descriptions[0].data == '<robot/>'
    # A loop: more messages than there are in the bag.
    live.wait(lambda: len(states) > 60, 'a second turn')
    assert player.stop() == 0
    assert player.stderr == ''


def test_estimates_older_than_the_installed_message_are_not_played(live: Graph, tmp_path: Path) -> None:
    older = older_estimates(tmp_path / 'older.mcap', estimate())
    refused = live.start('player', older, '--topics', TOPIC)
    assert refused.wait() == 2
    assert refused.stderr.count('\n') == 1
    assert 'are older than the installed' in refused.stderr
    left_out = live.start('player', older)
    assert left_out.wait() == 0
    assert (
        'without budget_causes, budget_shares, events, phase, stage, stale, standard_deviation'
        in left_out.stdout + left_out.stderr
    )


@pytest.mark.parametrize('name', ['joint states', '/arm/1st'])
def test_a_topic_whose_name_is_none_to_ros_is_not_played(live: Graph, tmp_path: Path, name: str) -> None:
    with BagWriter(tmp_path / 'odd') as bag:
        for topic in ('/robot_description', name):
            bag.add_topic(topic, 'std_msgs/msg/String', latched=True)
            bag.write(topic, message_class('std_msgs/msg/String')(data='<robot/>'), 0)
    refused = live.start('player', tmp_path / 'odd', '--topics', name)
    assert refused.wait() == 2
    assert refused.stderr.count('\n') == 1
    assert f"topic '{name}' cannot be played: topic name " in refused.stderr
    descriptions = live.collect('/robot_description', String, LATCHED)
    rest = live.start('player', tmp_path / 'odd', '--wait-for-subscribers', 30)
    live.wait(lambda: descriptions, 'the other topic')
    assert rest.wait() == 0
    assert f"topic '{name}' cannot be played: topic name " in rest.stdout + rest.stderr


def test_only_the_topics_asked_for_are_played_with_a_clock(live: Graph, bag: Path) -> None:
    states = live.collect('/joint_states', JointState, DEEP)
    clocks = live.collect('/clock', Clock, DEEP)
    player = live.start('player', bag, '--topics', '/joint_states', '--clock', '--wait-for-subscribers', 30)
    live.wait(lambda: not player.running, 'the end of the bag')
    live.wait(lambda: len(states) == 41, 'all joint states')
    assert '/odom' not in dict(live.node.get_topic_names_and_types())
    times = [clock.clock.sec + clock.clock.nanosec * 1e-9 for clock in clocks]
    assert times == sorted(times)
    assert times[0] >= recorded.EPOCH
    assert times[-1] <= recorded.EPOCH + 2.0
    assert len(times) > 50


@pytest.mark.parametrize(
    ('name', 'arguments', 'text'),
    [
        ('player', ['/absent'], "bag '/absent' does not exist"),
        ('player', ['{bag}', '--rate', '0'], "--rate: '0' is not accepted; accepted: a number > 0"),
        ('player', ['{bag}', '--topics', '/pose'], "no topic '/pose'; topics: /robot_description, /joint_states"),
        ('player', ['{bag}', '--ros-args', '-p', 'rate:=2.0'], "unknown parameter 'rate'; known: none"),
        ('player', ['{bag}', '--speed', '2'], "unknown argument '--speed'"),
        ('recorder', ['run1'], 'run1'),
        ('recorder', ['--ros-args', '-p', 'outputs:=x'], "unknown parameter 'outputs'; known: output, "),
        ('recorder', ['--ros-args', '-p', 'output:={bag}'], 'exists already'),
        (
            'recorder',
            ['--ros-args', '-p', 'duration:=-1.0'],
            "'duration' is -1.0 s; accepted: a number >= 0 and <= 1e+06 s",
        ),
        ('recorder', ['--ros-args', '-p', 'output'], 'output'),
        (
            'recorder',
            ['--ros-args', '-p', "topics:=['/odom', 'joint states']"],
            "parameter 'topics' names 'joint states': topic name must not contain characters other than",
        ),
        ('recorder', ['--ros-args', '-p', "topics:=['/arm/1st']"], 'topic name token must not start with a number'),
    ],
)
def test_a_users_error_is_one_line(live: Graph, bag: Path, name: str, arguments: list[str], text: str) -> None:
    process = live.start(name, *(argument.replace('{bag}', str(bag)) for argument in arguments))
    assert process.wait() == 2
    assert text in process.stderr
    assert process.stderr.startswith(f'mbaid_ros {name}: ')
    assert process.stderr.count('\n') == 1
    assert process.stdout == ''


@pytest.mark.parametrize('name', ['player', 'recorder'])
def test_help_has_an_example(live: Graph, name: str) -> None:
    process = live.start(name, '--help')
    assert process.wait() == 0
    assert f'ros2 run mbaid_ros {name}' in process.stdout
