"""Clocks that do not fit, a stream that starts again, and publishers of other qualities, on a live graph."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from mbaid_msgs.msg import InertiaEstimate
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from graph import Graph
from mbaid_ros.nodes.diagnostics import clock_problems
from mbaid_ros.nodes.subscriptions import qos
from simulated import CONFIG
from streams import run

SECOND = 1_000_000_000
NOW = 1_700_000_000 * SECOND


@pytest.mark.parametrize(
    ('now', 'stamp', 'arrival', 'simulated', 'text'),
    [
        (NOW, NOW - SECOND // 100, NOW, False, ''),
        (NOW, NOW - 3600 * SECOND, NOW, False, ''),  # a recorded bag
        (NOW, NOW + 3 * SECOND, NOW, False, 'stamps on /odom are 3.0 s in the future'),
        (NOW, 12 * SECOND, NOW, False, 'simulated time (12 s), but use_sim_time is false'),
        (12 * SECOND, 12 * SECOND, 12 * SECOND, True, ''),
        (12 * SECOND, NOW, 12 * SECOND, True, 'use_sim_time is true, but stamps on /odom are not simulated time'),
        (0, NOW, 0, True, 'use_sim_time is true, but nothing has come on /clock'),
    ],
)
def test_what_is_told_of_clocks(now: int, stamp: int, arrival: int, simulated: bool, text: str) -> None:
    problems = clock_problems(now, {'/odom': (stamp, arrival)}, use_sim_time=simulated)
    assert bool(problems) == bool(text)
    assert all(text in problem for problem in problems)


def test_a_stream_that_starts_again(graph: Graph) -> None:
    node = graph.start('estimator', '--ros-args', '-p', f'robot_description_file:={CONFIG}/table1.urdf')
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    profile = qos(10_000)
    publishers = {
        'joint_states': graph.publisher('joint_states', JointState, profile),
        'odom': graph.publisher('odom', Odometry, profile),
    }
    messages = run('table1', 5.0)
    reason = 'on joint_states jumped back by 4.99 s (a bag or simulation started again, a clock set); started again'

    def made() -> list[InertiaEstimate]:
        return [estimate for estimate in estimates if estimate.samples]

    for timed in messages:
        publishers[timed.topic].publish(timed.message)
    graph.wait(lambda: len(made()) >= 9, 'the estimates of the first round')
    # Which topic is read first is not fixed by a graph: here the joints are, by waiting for what two of them lead to.
    ahead = [timed for timed in messages if timed.topic == 'joint_states'][:2]
    for timed in ahead:
        publishers['joint_states'].publish(timed.message)
    graph.wait(lambda: reason in node.stderr, 'the restart')
    for timed in messages:
        if timed not in ahead:
            publishers[timed.topic].publish(timed.message)
    graph.wait(lambda: len(made()) >= 18, 'the estimates of both rounds')
    first, second = made()[:9], made()[9:18]
    assert [e.samples for e in first] == [e.samples for e in second]
    assert [e.inertia.m for e in first if e.inertia.m > 0] == [e.inertia.m for e in second if e.inertia.m > 0]
    assert not any(reason in str(e.warnings) for e in first)
    assert all(reason in str(e.warnings) for e in second)
    assert any(e.status == 'waiting' and reason in str(e.warnings) for e in estimates)
    assert node.stderr.count(reason) == 1
    assert node.stop() == 0


def test_sim_time_without_a_clock_and_a_best_effort_publisher_are_named(graph: Graph) -> None:
    parameters = ['-p', f'robot_description_file:={CONFIG}/table1.urdf', '-p', 'use_sim_time:=true']
    node = graph.start('estimator', '--ros-args', *parameters)
    diagnostics = graph.collect('/diagnostics', DiagnosticArray, qos(100))
    graph.wait(lambda: 'nothing has come on /clock' in str(diagnostics), 'the missing clock')
    graph.wait(lambda: 'nothing publishes it: check its name' in str(diagnostics), 'what would help')
    graph.publisher('odom', Odometry, qos(10, best_effort=True))
    text = 'a publisher of /odom offers less than asked for (reliability): best effort is taken instead'
    graph.wait(lambda: text in node.stderr, 'the quality of service')
    assert node.stderr.count(text) == 1
    assert node.stop() == 0


def test_a_clock_that_jumps_stands_still_and_is_negative_is_told(graph: Graph) -> None:
    node = graph.start('estimator', '--ros-args', '-p', 'use_sim_time:=true')
    diagnostics = graph.collect('/diagnostics', DiagnosticArray, qos(100))
    publisher = graph.publisher('/clock', Clock)

    def tell(seconds: int, text: str, shown: int | None = None) -> None:
        """Publish a time until there is a report at it, or at `shown`: /clock is best effort, and its queue is one."""
        message = Clock()
        message.clock.sec = seconds
        now = seconds if shown is None else shown

        def told() -> bool:
            publisher.publish(message)
            return text in str([array for array in diagnostics if array.header.stamp.sec == now])

        graph.wait(told, f'{now} s: {text}')
        diagnostics.clear()

    tell(100, "message='stamps fit the clock'")
    tell(105, "message='stamps fit the clock'")
    tell(50, '/clock jumped 1 times since the last report, the last time by -55 s')
    tell(3000, '/clock jumped 1 times since the last report, the last time by 2950 s')
    tell(-5, ' s it has been 3000 s', shown=3000)
    assert node.stderr.count('/clock stands still: for ') == 1
    assert node.stderr.count('a time on /clock is negative, -5 s: it is not taken') == 1
    assert node.stop() == 0
