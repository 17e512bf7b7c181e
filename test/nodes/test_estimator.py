"""The node `estimator` on a live graph: one running node a subject, and its numbers are those without a graph."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from copy import deepcopy
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import InertiaStamped, PoseStamped, PoseWithCovarianceStamped
from mbaid_msgs.msg import InertiaEstimate
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.qos import ReliabilityPolicy
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from benchmarks.data import simulator_config
from benchmarks.precapture import free_urdf
from graph import Graph, Process
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.results.estimate import is_complete
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.urdf import replace_inertial
from mbaid_ros.estimate_messages import Frames, InertiaPublication, debris_message, estimate_message, inertia_message
from mbaid_ros.nodes.publishers import last_of_each_window
from mbaid_ros.nodes.subscriptions import LATCHED, TYPES, message_class, qos
from mbaid_ros.parameters import build
from mbaid_ros.session.explanation import sensor_rows
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_run import SimulatedRun, TimedMessage
from simulated import CONFIG, options
from streams import EPOCH, every_bit, offline, run, urdf

WINDOW = 0.5
ESTIMATE, INERTIA = 'mbaid_msgs/msg/InertiaEstimate', 'geometry_msgs/msg/InertiaStamped'
TABLE1, SERVICER7 = Frames('link4', 'odom'), Frames('link7', 'odom')


def start(graph: Graph, *parameters: str, robot: str = 'table1') -> Process:
    """Start an estimator of a robot of config/."""
    assigned = [f'robot_description_file:={CONFIG / robot}.urdf', *parameters]
    return graph.start('estimator', '--ros-args', *options(*assigned))


def sensors(graph: Graph, *, best_effort: bool = False) -> Callable[[Iterable[TimedMessage]], None]:
    """Return a function that publishes messages."""
    profile = qos(10_000, best_effort=best_effort)
    kinds = {'joint_states': JointState, 'odom': Odometry}
    publishers = {topic: graph.publisher(topic, kind, profile) for topic, kind in kinds.items()}

    def send(messages: Iterable[TimedMessage]) -> None:
        for timed in messages:
            publishers[timed.topic].publish(timed.message)

    return send


def publish(graph: Graph, messages: Sequence[TimedMessage]) -> None:
    sensors(graph)(messages)


def made(estimates: list[Any]) -> list[Any]:
    """Return the estimates of at least one sample."""
    return [estimate for estimate in estimates if estimate.samples]


def bits(messages: Sequence[Any], type_name: str = ESTIMATE) -> list[bytes]:
    return [every_bit(message, type_name) for message in messages]


def reset(graph: Graph) -> None:
    assert graph.call('/estimator/reset', Trigger, Trigger.Request()).success


def pause(graph: Graph, *, paused: bool = True) -> Any:
    answer = graph.call('/estimator/pause', SetBool, SetBool.Request(data=paused))
    assert answer.success
    return answer


def check_that_it_goes_stale(graph: Graph, node: Process, live: list[Any], fresh: Any) -> None:
    graph.wait(lambda: live[-1].stale, 'the stale estimate')
    stale = live[-1]
    # Of one of the two alone, where a report fell between their last messages.
    silent = re.fullmatch(r'no messages on (.*) for more than 2 s', stale.warnings[-1])
    assert silent
    assert silent[1] in {'/joint_states, /odom', '/joint_states', '/odom'}
    assert (stale.header, stale.status, stale.samples) == (fresh.header, fresh.status, fresh.samples)
    np.testing.assert_array_equal(stale.covariance, fresh.covariance)
    assert 'the estimate is stale: no messages' in node.stderr
    late = graph.collect('/estimator/estimate', InertiaEstimate, LATCHED)
    # Silent topics may be found one after the other, with an estimate each.
    graph.wait(lambda: late and bits(late[-1:]) == bits(live[-1:]), 'the latched estimate')


def check_that_it_is_forgotten(graph: Graph, live: list[Any], inertia: list[Any]) -> None:
    reset(graph)
    graph.wait(lambda: np.isnan(inertia[-1].inertia.m), 'the end of the mass properties')
    graph.wait(lambda: live[-1].status == 'waiting', 'an estimate that waits')
    assert not live[-1].stale
    withdrawn = graph.collect('/estimator/inertia', InertiaStamped)
    first = made(live)[0]
    live.clear()
    # Stamps that were passed long ago are new again.
    publish(graph, run('table1', 2.0))
    graph.wait(lambda: made(live), 'an estimate')
    assert bits(made(live)[:1]) == bits([first])
    assert all(message.header.stamp.sec * 10**9 < EPOCH + 4 * 10**9 for message in withdrawn)


def test_a_run_is_that_of_the_core_to_the_last_bit_goes_stale_and_is_forgotten(graph: Graph) -> None:
    node = start(graph)
    live = graph.collect('/estimator/estimate', InertiaEstimate)
    inertia = graph.collect('/estimator/inertia', InertiaStamped)
    graph.node.create_publisher(PoseStamped, '/mocap/pose', qos(1))
    either = '/odom (nav_msgs/msg/Odometry) or /pose (geometry_msgs/msg/PoseStamped)'
    graph.wait(lambda: f'waiting for {either}; nothing publishes it' in node.stderr, 'the wait')
    assert 'such messages come elsewhere: remap by -r pose:=/mocap/pose' in node.stderr
    assert "robot 'table1': 'base_link' floats" in node.stderr
    assert 'waiting for /joint_states (sensor_msgs/msg/JointState)' in node.stderr
    refused = graph.call('/estimator/capture', Trigger, Trigger.Request())
    assert (refused.success, 'capture.phase: pre_capture' in refused.message) == (False, True)

    messages = run('table1', 16.0)
    publish(graph, messages)
    expected = last_of_each_window(offline(EstimatorConfig(), 'table1', messages), WINDOW)
    assert len(expected) == 31  # the last window, of 32, is still open

    def closed() -> list[InertiaEstimate]:
        # Where the machine stalls the stream, the node publishes the last estimate once more, as stale.
        return [one for one in made(live) if not one.stale]

    graph.wait(lambda: len(closed()) >= len(expected), 'all estimates')
    assert bits(closed()) == bits([estimate_message(each, TYPES, TABLE1) for each in expected])
    course = InertiaPublication()
    followed = [course.next_published(estimate) for estimate in expected]
    usable = [inertia_message(each, TYPES, TABLE1) for each in followed if each is not None]
    assert 0 < len(usable) < len(expected)
    graph.wait(lambda: len(inertia) >= len(usable), 'all inertias')
    assert bits(inertia, INERTIA) == bits(usable, INERTIA)
    assert '/tf' not in dict(graph.node.get_topic_names_and_types())

    check_that_it_goes_stale(graph, node, live, closed()[-1])
    check_that_it_is_forgotten(graph, live, inertia)
    assert node.stop() == 0


def test_the_quality_of_service_follows_parameters_and_publishers(graph: Graph) -> None:
    prefix = 'qos_overrides.'
    node = start(
        graph,
        f'{prefix}/odom.subscription.reliability:=best_effort',
        f'{prefix}/estimator/estimate.publisher.depth:=9',
        f'{prefix}/estimator/inertia.publisher.reliability:=best_effort',
    )
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    diagnostics = graph.collect('/diagnostics', DiagnosticArray, qos(100))

    def reliability(topic: str, *, of_publishers: bool = False) -> Any:
        own = graph.node
        found = (own.get_publishers_info_by_topic if of_publishers else own.get_subscriptions_info_by_topic)(topic)
        return found[0].qos_profile.reliability if found else None

    graph.wait(lambda: reliability('/odom') and reliability('/joint_states'), 'the subscriptions')
    assert reliability('/odom') == ReliabilityPolicy.BEST_EFFORT
    assert reliability('/joint_states') == ReliabilityPolicy.RELIABLE
    graph.wait(lambda: reliability('/estimator/inertia', of_publishers=True), 'the publishers')
    assert reliability('/estimator/inertia', of_publishers=True) == ReliabilityPolicy.BEST_EFFORT
    send, messages = sensors(graph, best_effort=True), iter(run('table1', 16.0))

    def are_there() -> bool:
        send(islice(messages, 20))  # a few at a time: best effort loses messages that are not taken in time
        return len(made(estimates)) >= 3

    graph.wait(are_there, 'estimates')
    graph.wait(lambda: "value='best effort'" in str(diagnostics), 'the reliability in the diagnostics')
    text = 'a publisher of /joint_states offers less than asked for (reliability): best effort is taken instead'
    assert node.stderr.count(text) == 1


def test_a_fully_identified_link_and_the_captured_body_alone_are_published(graph: Graph, tmp_path: Path) -> None:
    messages = run('servicer7', 25.0, rate=50.0)
    (tmp_path / 'robot.urdf').write_text(free_urdf(), encoding='utf-8')
    start(graph, f'robot_description_file:={tmp_path / "robot.urdf"}', 'debris.report:=true', robot='servicer7')
    descriptions = graph.collect('/estimator/robot_description', String)
    bodies = graph.collect('/estimator/debris', InertiaEstimate)
    publish(graph, messages)
    expected = offline(EstimatorConfig(), 'servicer7', messages)[-1]
    assert is_complete(expected)
    text = replace_inertial(free_urdf(), 'link7', expected.parameters)
    session = Session(build(EstimatorConfig, {'debris.report': True}), free_urdf())
    alone = session.robot.debris(expected)
    assert alone is not None
    last = bits([debris_message(alone, expected, TYPES, SERVICER7)])
    graph.wait(lambda: descriptions and descriptions[-1].data == text, 'the robot description')
    graph.wait(lambda: bodies and bits(bodies[-1:]) == last, 'the captured body')
    assert load_model(text).link('link7').parameters[0] == pytest.approx(162.0, rel=0.05)
    assert bodies[-1].header.frame_id == 'link7'
    assert bodies[-1].inertia.m == pytest.approx(155.0, rel=0.05)


def set_parameter(graph: Graph, name: str, value: float) -> Any:
    """Set a number as `ros2 param set` does, and return the answer."""
    setting = Parameter(name=name, value=ParameterValue(type=3, double_value=value))
    request = SetParameters.Request(parameters=[setting])
    return graph.call('/estimator/set_parameters', SetParameters, request).results[0]


def test_a_pause_takes_nothing_and_no_parameter_can_be_set_while_it_runs(graph: Graph) -> None:
    messages = run('servicer7', 12.0, rate=50.0)
    start(graph, 'method:=difference', robot='servicer7')
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    diagnostics = graph.collect('/diagnostics', DiagnosticArray, qos(100))
    pause(graph)
    graph.wait(lambda: 'paused: no samples are taken' in str(estimates), 'the pause in the estimate')
    publish(graph, messages[:200])
    graph.wait(lambda: "key='not taken, paused', value='200'" in str(diagnostics), 'the count in the diagnostics')
    assert not made(estimates)

    pause(graph, paused=False)
    half = len(messages) // 2
    publish(graph, messages[200:half])
    graph.wait(lambda: made(estimates), 'an estimate')
    answer = pause(graph).message
    graph.wait(lambda: estimates[-1].stale, 'the stale estimate')
    assert 'paused: no samples are taken' in estimates[-1].warnings
    reported = re.fullmatch(r'paused: no samples are taken; ((\d+) of (\d+) samples are in the estimate, .*)', answer)
    assert reported
    assert reported[1] in estimates[-1].warnings
    assert int(reported[2]) == estimates[-1].samples < int(reported[3]) <= (half - 200) / 2
    assert made(estimates)[-1].status != 'converged'

    before = estimates[-1].samples
    pause(graph, paused=False)
    publish(graph, messages[half:])
    graph.wait(lambda: estimates[-1].samples > before and not estimates[-1].stale, 'an estimate after the pause')
    fixed = set_parameter(graph, 'window', 2.0)
    assert (fixed.successful, 'read-only' in fixed.reason) == (False, True)


SIMULATED = {
    'imu.rate': 200.0, 'gyros.names': ['hand'], 'gyros.hand.rate': 1000.0, 'gyros.hand.link': 'link3',
    'poses.names': ['tracker', 'camera', 'mocap'], 'poses.tracker.rate': 2.0, 'poses.tracker.measures': 'orientation',
    'poses.camera.rate': 5.0, 'poses.camera.link': 'link3', 'poses.mocap.rate': 100.0,
}  # fmt: skip
NAMED = {
    'imu': 'imu',
    'hand': 'gyros.hand',
    'tracker': 'poses.tracker',
    'camera': 'poses.camera',
    'mocap': 'poses.mocap',
}


@pytest.mark.long
def test_of_five_sensors_beside_the_odometry_nothing_is_lost_at_2_to_1000_hz(graph: Graph) -> None:
    used = {
        'imu.noise_density': 1e-4, 'gyros.names': ['hand'], 'gyros.hand.noise_density': 1e-4,
        'gyros.hand.frame': 'link3', 'poses.names': ['tracker', 'camera', 'mocap'],
        'poses.tracker.measures': 'orientation', 'poses.camera.frame': 'link3',
    }  # fmt: skip
    start(graph, *(f'{name}:={str(value).replace(chr(39), "")}' for name, value in used.items()))
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    diagnostics = graph.collect('/diagnostics', DiagnosticArray, qos(100))
    made_by = SimulatedRun(simulator_config('table1', SIMULATED), urdf('table1'), TYPES)
    made_by.start = EPOCH
    publishers = {
        topic: graph.publisher(topic, message_class(kind), qos(10_000)) for topic, kind in made_by.topics.items()
    }
    session = Session(build(EstimatorConfig, used), urdf('table1'))
    for timed in made_by.read(5.6):
        publishers[timed.topic].publish(timed.message)
        if timed.topic in NAMED:
            session.add_named(timed.message, NAMED[timed.topic])
        else:
            (session.add_joint_state if timed.topic == 'joint_states' else session.add_odometry)(timed.message)
    last = session.process()[-1]
    expected = bits([estimate_message(last, TYPES, TABLE1)])
    assert [session.received[name] for name in NAMED.values()] == [1121, 5601, 12, 29, 561]
    used_of = {each.name: each.used for each in sensor_rows(session, last)}

    def reported() -> dict[str, int]:
        rows = {each.key: each.value for status in diagnostics[-1].status for each in status.values}
        return {name: int(re.findall(r'(\d+) used', rows.get(name, '0 used'))[0]) for name in used_of}

    graph.wait(lambda: estimates and bits(estimates[-1:]) == expected, 'the estimate')
    graph.wait(lambda: diagnostics and reported() == used_of, 'all messages of all sensors')


def test_poses_on_a_topic_of_their_own_locate_the_base_beside_an_imu(graph: Graph) -> None:
    used = {'imu.noise_density': 1e-4}
    start(graph, *(f'{name}:={value}' for name, value in used.items()))
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    diagnostics = graph.collect('/diagnostics', DiagnosticArray, qos(100))
    kinds = {'pose': PoseWithCovarianceStamped, 'joint_states': JointState, 'imu': Imu}
    publishers = {topic: graph.publisher(topic, kind, qos(10_000)) for topic, kind in kinds.items()}
    session = Session(build(EstimatorConfig, used), urdf('table1'))
    for timed in run('table1', 5.6):
        message: Any = timed.message
        if timed.topic == 'odom':
            message = PoseWithCovarianceStamped(header=deepcopy(message.header), pose=message.pose)
            publishers['pose'].publish(message)
            session.add_odometry(message)
            turning = Imu(header=message.header, angular_velocity=timed.message.twist.twist.angular)
            turning.header.frame_id = 'base_link'
            publishers['imu'].publish(turning)
            session.add_named(turning)
        else:
            publishers['joint_states'].publish(message)
            session.add_joint_state(message)
    expected = bits([estimate_message(session.process()[-1], TYPES, TABLE1)])
    assert session.received['imu'] > 200
    graph.wait(lambda: estimates and bits(estimates[-1:]) == expected, 'the estimate')
    graph.wait(lambda: diagnostics and 'estimator: pose' in str(diagnostics[-1]), 'the topic')
    assert not any('estimator: odom' in status.name for status in diagnostics[-1].status)
