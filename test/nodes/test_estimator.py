"""The node `estimator` on a live graph: what goes in, what comes out, and that both are as without a graph."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import InertiaStamped
from mbaid_msgs.msg import InertiaEstimate
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.qos import ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from captured import with_bare_link
from graph import Graph, Process
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.core.results.publication import InertiaPublication, is_complete
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.urdf_edit import replace_inertial
from mbaid_ros.nodes.publication import last_of_each_window
from mbaid_ros.nodes.subscriptions import LATCHED, TYPES, qos
from mbaid_ros.outgoing import Frames, debris_message, estimate_message, inertia_message
from mbaid_ros.session import Session
from mbaid_ros.simulated_run import TimedMessage
from simulated import CONFIG
from streams import EPOCH, every_bit, offline, run, urdf

WINDOW = 0.5
ESTIMATE, INERTIA = 'mbaid_msgs/msg/InertiaEstimate', 'geometry_msgs/msg/InertiaStamped'


def start(graph: Graph, *parameters: str, robot: str = 'table1') -> Process:
    """Start an estimator of a robot of config/."""
    assigned = [f'robot_description_file:={CONFIG / robot}.urdf', *parameters]
    return graph.start('estimator', '--ros-args', *(word for text in assigned for word in ('-p', text)))


def publish(graph: Graph, messages: Sequence[TimedMessage], *, best_effort: bool = False) -> None:
    profile = qos(10_000, best_effort=best_effort)
    publishers = {
        'joint_states': graph.publisher('joint_states', JointState, profile),
        'odom': graph.publisher('odom', Odometry, profile),
    }
    for timed in messages:
        publishers[timed.topic].publish(timed.message)


def made(estimates: list[Any]) -> list[Any]:
    """Return the estimates without those that only say what is missing."""
    return [estimate for estimate in estimates if estimate.samples]


def test_live_and_offline_estimates_are_the_same_to_the_last_bit(graph: Graph) -> None:
    messages = run('table1', 12.0)
    node = start(graph)
    live = graph.collect('/estimator/estimate', InertiaEstimate)
    publish(graph, messages)

    expected = last_of_each_window(offline(EstimatorConfig(), 'table1', messages)[0], WINDOW)
    assert len(expected) == 23  # the last window, of 24, is still open
    frames = Frames('link4', 'odom')

    def closed() -> list[InertiaEstimate]:
        # Where the machine stalls the stream, what there is so far is told once more, with that warning.
        return [one for one in made(live) if not any(text.startswith('no messages on') for text in one.warnings)]

    graph.wait(lambda: len(closed()) >= len(expected), 'all estimates')
    for message, estimate in zip(closed(), expected, strict=True):
        offline_message = estimate_message(estimate, TYPES, frames)
        assert every_bit(message, ESTIMATE) == every_bit(offline_message, ESTIMATE), (message, offline_message)
    assert node.stop() == 0


def test_inertia_is_published_once_it_says_something(graph: Graph) -> None:
    messages = run('table1', 16.0)
    start(graph)
    inertia = graph.collect('/estimator/inertia', InertiaStamped)
    publish(graph, messages)
    estimates = last_of_each_window(offline(EstimatorConfig(), 'table1', messages)[0], WINDOW)
    course = InertiaPublication()
    told = [course.follow(estimate) for estimate in estimates]
    usable = [inertia_message(each, TYPES, Frames('link4', 'odom')) for each in told if each is not None]
    assert 0 < len(usable) < len(estimates)
    graph.wait(lambda: len(inertia) >= len(usable), 'all inertias')
    assert [every_bit(message, INERTIA) for message in inertia] == [every_bit(message, INERTIA) for message in usable]


def test_best_effort_publishers_are_heard_too(graph: Graph) -> None:
    start(graph)
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    diagnostics = graph.collect('/diagnostics', DiagnosticArray, qos(100))
    publish(graph, run('table1', 4.0), best_effort=True)
    graph.wait(lambda: len(made(estimates)) >= 3, 'estimates')
    graph.wait(lambda: "value='best effort'" in str(diagnostics), 'the reliability in the diagnostics')


def test_a_fully_identified_link_is_put_into_the_robot_description(graph: Graph) -> None:
    messages = run('servicer7', 25.0, rate=50.0)
    start(graph, robot='servicer7')
    descriptions = graph.collect('/estimator/robot_description', String)
    publish(graph, messages)
    expected = offline(EstimatorConfig(), 'servicer7', messages)[0][-1]
    assert is_complete(expected)
    text = replace_inertial(urdf('servicer7'), 'link7', expected.parameters)
    graph.wait(lambda: descriptions and descriptions[-1].data == text, 'the robot description')
    assert load_model(text).link('link7').parameters[0] == pytest.approx(162.0, rel=0.05)


def test_the_captured_body_alone_is_published_on_request(graph: Graph, tmp_path: Path) -> None:
    messages = run('servicer7', 25.0, rate=50.0)
    (tmp_path / 'robot.urdf').write_text(with_bare_link(), encoding='utf-8')
    parameters = ('debris.report:=true', 'debris.frame:=grasp')
    start(graph, f'robot_description_file:={tmp_path / "robot.urdf"}', *parameters, robot='servicer7')
    found = graph.collect('/estimator/debris', InertiaEstimate)
    publish(graph, messages)
    config = build(EstimatorConfig, {'debris.report': True, 'debris.frame': 'grasp'})
    session = Session(config, with_bare_link())
    expected = offline(EstimatorConfig(), 'servicer7', messages)[0][-1]
    alone = session.robot.debris(expected)
    assert alone is not None
    last = every_bit(debris_message(alone, expected, TYPES, Frames('link7', 'odom')), ESTIMATE)
    graph.wait(lambda: found and every_bit(found[-1], ESTIMATE) == last, 'the captured body')
    assert found[-1].header.frame_id == 'grasp'
    assert found[-1].inertia.m == pytest.approx(155.0, rel=0.05)


def test_reset_forgets_everything(graph: Graph) -> None:
    start(graph)
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    publish(graph, run('table1', 7.51))
    graph.wait(lambda: len(made(estimates)) == 15, 'the estimate that the very last sample closes')
    response = graph.call('/estimator/reset', Trigger, Trigger.Request())
    assert response.success
    graph.wait(lambda: estimates[-1].status == 'waiting', 'an estimate that waits')
    late = graph.collect('/estimator/inertia', InertiaStamped)
    first = made(estimates)[0]
    estimates.clear()
    # Stamps that were passed long ago are new again.
    publish(graph, run('table1', 2.0))
    graph.wait(lambda: made(estimates), 'an estimate')
    assert every_bit(made(estimates)[0], ESTIMATE) == every_bit(first, ESTIMATE)
    assert all(message.header.stamp.sec * 10**9 < EPOCH + 4 * 10**9 for message in late)


def test_nothing_is_taken_during_a_pause(graph: Graph) -> None:
    start(graph)
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    diagnostics = graph.collect('/diagnostics', DiagnosticArray, qos(100))
    assert graph.call('/estimator/pause', SetBool, SetBool.Request(data=True)).success
    graph.wait(lambda: 'paused: no samples are taken' in str(estimates), 'the pause in the estimate')
    messages = run('table1', 4.0)
    publish(graph, messages[:400])
    graph.wait(lambda: "key='not taken, paused', value='400'" in str(diagnostics), 'the count in the diagnostics')
    assert not made(estimates)
    assert graph.call('/estimator/pause', SetBool, SetBool.Request(data=False)).success
    publish(graph, messages[400:])
    graph.wait(lambda: len(made(estimates)) >= 3, 'estimates')
    assert made(estimates)[-1].samples <= 200


def test_names_follow_the_namespace_and_the_node(graph: Graph) -> None:
    arguments = ['-p', f'robot_description_file:={CONFIG}/table1.urdf', '-r', '__ns:=/servicer', '-r', '__node:=x']
    graph.start('estimator', '--ros-args', '--params-file', CONFIG / 'table1_estimator.yaml', *arguments)
    estimates = graph.collect('/servicer/x/estimate', InertiaEstimate)
    diagnostics = graph.collect('/diagnostics', DiagnosticArray, qos(100))
    graph.wait(lambda: estimates, 'the estimate that waits')
    assert estimates[0].header.frame_id == 'link4'
    # For how long, and what would help, follows after a while.
    missing = [warning.partition(', for')[0] for warning in estimates[0].warnings]
    assert missing == ['no messages on /servicer/joint_states yet', 'no messages on /servicer/odom yet']
    graph.wait(lambda: diagnostics, 'diagnostics')
    assert diagnostics[0].status[0].name == 'servicer/x: joint_states'


def test_a_latched_estimate_reaches_who_comes_late(graph: Graph) -> None:
    start(graph)
    publish(graph, run('table1', 6.0))
    watched = graph.collect('/estimator/estimate', InertiaEstimate)
    graph.wait(lambda: len(made(watched)) > 0 and watched[-1].samples == 550, 'the last estimate')
    late = graph.collect('/estimator/estimate', InertiaEstimate, LATCHED)
    graph.wait(lambda: late, 'the latched estimate')
    assert every_bit(late[0], ESTIMATE) == every_bit(watched[-1], ESTIMATE)


@pytest.mark.parametrize('at_once', [1, 37, 300])
def test_one_estimate_a_window_however_many_come_at_once(at_once: int) -> None:
    calls = offline(build(EstimatorConfig, {'method': 'paper_difference'}), 'table1', run('table1', 3.0), at_once)
    published = [estimate for call in calls for estimate in last_of_each_window(call, WINDOW)]
    assert [estimate.samples for estimate in published] == [50, 100, 150, 200, 250]


def test_an_estimate_that_nothing_follows_is_told_as_stale(graph: Graph) -> None:
    node = start(graph)
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    messages = run('table1', 6.0)
    publish(graph, messages)
    graph.wait(lambda: estimates and estimates[-1].stale, 'the stale estimate')
    fresh, stale = estimates[-2:]
    assert not fresh.stale
    # Of one of the two alone, where a report fell between their last messages.
    silent = re.fullmatch(r'no messages on (.*) for more than 2 s', stale.warnings[-1])
    assert silent
    assert silent[1] in {'/joint_states, /odom', '/joint_states', '/odom'}
    assert (stale.header, stale.status, stale.samples) == (fresh.header, fresh.status, fresh.samples)
    np.testing.assert_array_equal(stale.covariance, fresh.covariance)
    assert 'the estimate is stale: no messages' in node.stderr
    graph.call('/estimator/reset', Trigger, Trigger.Request())
    graph.wait(lambda: estimates[-1].status == 'waiting', 'the reset')
    assert not estimates[-1].stale


def test_an_estimate_is_stale_at_once_when_paused(graph: Graph) -> None:
    start(graph)
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    messages = run('table1', 4.0)
    publish(graph, messages)
    graph.wait(lambda: made(estimates), 'an estimate')
    answer = graph.call('/estimator/pause', SetBool, SetBool.Request(data=True)).message
    graph.wait(lambda: estimates[-1].stale, 'the stale estimate')
    assert 'paused: no samples are taken' in estimates[-1].warnings
    told = re.fullmatch(r'paused: no samples are taken; ((\d+) of (\d+) samples are in the estimate, .*)', answer)
    assert told
    assert told[1] in estimates[-1].warnings
    assert int(told[2]) == estimates[-1].samples < int(told[3]) <= len(messages) / 2


def set_parameter(graph: Graph, name: str, value: float) -> Any:
    """Set a number as `ros2 param set` does, and return the answer."""
    setting = Parameter(name=name, value=ParameterValue(type=3, double_value=value))
    return graph.call('/estimator/set_parameters', SetParameters, SetParameters.Request(parameters=[setting])).results[
        0
    ]


def test_thresholds_can_be_set_while_it_runs_and_the_rest_says_why_not(graph: Graph) -> None:
    messages = run('servicer7', 12.0, rate=50.0)
    start(graph, 'method:=difference', robot='servicer7')
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    half = len(messages) // 2
    publish(graph, messages[:half])
    graph.wait(lambda: made(estimates), 'an estimate')
    before = made(estimates)[-1]
    assert before.status != 'converged'
    assert set_parameter(graph, 'convergence.relative_std', 1e6).successful
    assert set_parameter(graph, 'convergence.identifiable_std', 1e6).successful
    publish(graph, messages[half:])
    graph.wait(lambda: made(estimates)[-1].status in {'converged', 'inconsistent'}, 'another judgement')
    assert made(estimates)[-1].status == 'converged'
    assert all(made(estimates)[-1].identifiable)
    refused = set_parameter(graph, 'convergence.relative_std', -1.0)
    assert 'convergence.relative_std out of range' in refused.reason
    fixed = set_parameter(graph, 'window', 2.0)
    assert (fixed.successful, 'read-only' in fixed.reason) == (False, True)


def test_the_quality_of_service_can_be_overridden(graph: Graph) -> None:
    prefix = 'qos_overrides.'
    parameters = (
        f'{prefix}/odom.subscription.reliability:=best_effort',
        f'{prefix}/estimator/estimate.publisher.depth:=9',
    )
    start(graph, *parameters, f'{prefix}/estimator/inertia.publisher.reliability:=best_effort')

    def reliability(topic: str, *, of_publishers: bool = False) -> Any:
        node = graph.node
        found = (node.get_publishers_info_by_topic if of_publishers else node.get_subscriptions_info_by_topic)(topic)
        return found[0].qos_profile.reliability if found else None

    graph.wait(lambda: reliability('/odom') and reliability('/joint_states'), 'the subscriptions')
    assert reliability('/odom') == ReliabilityPolicy.BEST_EFFORT
    assert reliability('/joint_states') == ReliabilityPolicy.RELIABLE
    graph.wait(lambda: reliability('/estimator/inertia', of_publishers=True), 'the publishers')
    assert reliability('/estimator/inertia', of_publishers=True) == ReliabilityPolicy.BEST_EFFORT
