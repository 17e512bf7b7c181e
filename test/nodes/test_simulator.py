"""The node `simulator` on a live graph, and its pace."""

from __future__ import annotations

import itertools
import signal

import pytest
from geometry_msgs.msg import InertiaStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from graph import Graph, Process
from mbaid_ros.nodes.simulator import Pace
from mbaid_ros.nodes.subscriptions import qos
from simulated import CONFIG, options
from streams import run

DEEP = qos(10_000)


def start(graph: Graph, *parameters: str, ns: str = '/') -> Process:
    """Start a simulator of the paper's case."""
    words = options(f'robot_description_file:={CONFIG}/table1.urdf', *parameters)
    file = CONFIG / 'table1_simulator.yaml'
    return graph.start('simulator', '--ros-args', '--params-file', file, '-r', f'__ns:={ns}', *words)


def test_what_it_publishes(graph: Graph) -> None:
    joints = graph.collect('joint_states', JointState, DEEP)
    odometry = graph.collect('odom', Odometry, DEEP)
    descriptions = graph.collect('robot_description', String)
    truths = graph.collect('simulator/truth', InertiaStamped)
    node = start(graph, 'duration:=0')
    graph.wait(lambda: len(joints) > 20 and len(odometry) > 20 and descriptions and truths, 'every topic')
    assert node.stop(signal.SIGTERM) == 0
    assert 'Traceback' not in node.stderr

    assert descriptions[0].data == (CONFIG / 'table1.urdf').read_text()
    assert (truths[0].header.frame_id, truths[0].inertia.m) == ('link4', 934.45)
    assert (odometry[0].header.frame_id, odometry[0].child_frame_id) == ('odom', 'base_link')
    stamps = [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in joints]
    assert {later - earlier for earlier, later in itertools.pairwise(stamps)} == {10_000_000}


def test_it_is_the_run_of_the_core_and_ends_after_its_duration(graph: Graph) -> None:
    clock = graph.collect('/clock', Clock, DEEP)
    joints = graph.collect('joint_states', JointState, DEEP)
    odometry = graph.collect('odom', Odometry, DEEP)
    node = start(graph, 'publish_clock:=true', 'real_time_factor:=8', 'duration:=4', 'wait_for_subscribers:=1')
    graph.wait(lambda: len(joints) == len(odometry) == 401 and clock[-1].clock.sec == 4, 'every message')
    assert node.wait() == 0
    expected = run('table1', 4.01, start=0)
    assert joints == [timed.message for timed in expected if timed.topic == 'joint_states']
    assert odometry == [timed.message for timed in expected if timed.topic == 'odom']
    seconds = [message.clock.sec + 1e-9 * message.clock.nanosec for message in clock]
    assert seconds == sorted(seconds)


# --


def test_a_run_goes_by_the_clock_and_is_late_after_a_standstill() -> None:
    clock = [100.0]
    pace = Pace(10.0, 2.0, lambda: clock[0])
    pace.begin()
    assert pace.now() == 0.0
    for seconds in (0.125, 0.1875):  # less than may be told at once
        clock[0] += seconds
        assert pace.now() == pytest.approx(10.0 * (clock[0] - 100.0))
        assert pace.late == 0.0
    clock[0] += 5.0  # 50 s of the run, of which 2 s are told
    assert pace.now() == pytest.approx(5.125)
    assert pace.late == pytest.approx(4.8)
    assert pace.now() == pytest.approx(5.125)
    clock[0] += 0.1
    assert pace.now() == pytest.approx(6.125)
    assert pace.late == pytest.approx(4.8)
