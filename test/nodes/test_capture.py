"""Captures and thrust on a live graph: phases, numbers, and commands that are refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, WrenchStamped
from mbaid_msgs.msg import InertiaEstimate
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

import recorded
from benchmarks.precapture import free_model, free_urdf
from benchmarks.tracked import caught, parameters, session_of
from benchmarks.tracked import messages as read_messages
from benchmarks.tracked import robot as robot_of
from graph import Graph
from mbaid_ros.bags import serialize
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.capture import BEFORE
from mbaid_ros.core.forces import EXACT_THRUST
from mbaid_ros.estimate_messages import Frames, debris_message, estimate_message
from mbaid_ros.nodes.subscriptions import TYPES, qos
from mbaid_ros.parameters import build
from mbaid_ros.session.session import Session
from servicers import WRENCH, capture, pulse, sensed
from servicers import thrust_messages as pushed_messages
from simulated import CONFIG, assigned, robot
from streams import every_bit

BEGIN = 3.0  # s
PARAMETERS = {'capture.phase': 'pre_capture', 'debris.report': True}
CLASSES = {
    '/joint_states': (JointState, recorded.JOINT_STATE),
    '/odom': (Odometry, recorded.ODOMETRY),
    '/thrust': (WrenchStamped, WRENCH),
}
TRACKED = {
    'joint_states': CLASSES['/joint_states'],
    'odom': CLASSES['/odom'],
    'target_pose': (PoseStamped, 'geometry_msgs/msg/PoseStamped'),
}
ESTIMATE = 'mbaid_msgs/msg/InertiaEstimate'

Timed = tuple[str, Any]


def call(graph: Graph) -> Any:
    return graph.call('/estimator/capture', Trigger, Trigger.Request())


def messages() -> tuple[list[Timed], list[Timed]]:
    """Return what the sensors say until the capture and after it, as rclpy's messages."""
    run = capture(BEGIN, 10.0, np.array([0.004, -0.006, 0.003]), np.array([0.02, -0.03, 0.015]))
    parts: tuple[list[Timed], list[Timed]] = ([], [])
    for topic, message, time in recorded.messages(free_model(), sensed(run.truth, 3)):
        ours, name = CLASSES[topic]
        parts[time > BEGIN * 1e9].append((topic, deserialize_message(serialize(message, name), ours)))
    return parts


def expected(before: list[Timed], after: list[Timed]) -> Any:
    """Return the last message on ~/debris."""
    session = Session(build(EstimatorConfig, PARAMETERS), free_urdf())
    for topic, message in before:
        (session.add_joint_state if topic == '/joint_states' else session.add_odometry)(message)
    assert session.capture() == f'captured {BEGIN:.3f} s after the first sample'
    for topic, message in after:
        (session.add_joint_state if topic == '/joint_states' else session.add_odometry)(message)
    last = session.process()[-1]
    alone = session.robot.debris(last)
    assert alone is not None
    return debris_message(alone, last, TYPES, Frames('link7', 'odom'), session.robot.captured(last))


def test_a_capture_called_at_a_live_estimator(graph: Graph, tmp_path: Path) -> None:
    (tmp_path / 'robot.urdf').write_text(free_urdf(), encoding='utf-8')
    file = {'robot_description_file': tmp_path / 'robot.urdf'}
    words = assigned({**file, **PARAMETERS})
    graph.start('estimator', '--ros-args', *words)
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    bodies = graph.collect('/estimator/debris', InertiaEstimate)
    diagnostics = graph.collect('/diagnostics', DiagnosticArray, qos(100))
    publishers = {topic: graph.publisher(topic, CLASSES[topic][0], qos(10_000)) for topic in ('/joint_states', '/odom')}
    refused = call(graph)
    assert not refused.success
    assert 'no samples yet' in refused.message

    before, after = messages()
    for topic, message in before:
        publishers[topic].publish(message)
    graph.wait(lambda: estimates and estimates[-1].samples == 200, 'the momentum of the robot alone')
    assert estimates[-1].status == 'waiting'
    assert list(estimates[-1].warnings) == [BEFORE]
    assert np.isfinite(estimates[-1].linear_momentum.x)
    graph.wait(lambda: "value='pre_capture'" in str(diagnostics), 'the phase in the diagnostics')
    answer = call(graph)
    assert answer.success, answer.message
    assert answer.message == f'captured {BEGIN:.3f} s after the first sample'
    again = call(graph)
    assert not again.success
    assert 'announced before, at 3 s' in again.message

    for topic, message in after:
        publishers[topic].publish(message)
    last = every_bit(expected(before, after), ESTIMATE)
    graph.wait(lambda: bodies and every_bit(bodies[-1], ESTIMATE) == last, 'the captured body')
    assert bodies[-1].inertia.m == pytest.approx(155.0, rel=0.05)
    assert np.isfinite(bodies[-1].angular_momentum.x)


@pytest.mark.parametrize('frame', ['odom', 'camera'])
def test_a_target_is_tracked_at_a_live_estimator(graph: Graph, tmp_path: Path, frame: str) -> None:
    """As a session has it, to the bit; poses in an unknown frame leave the estimates as they are without."""
    run = caught('servicer7', 4, 0.05, after=2.9)
    run = replace(run, poses=replace(run.poses, frame=frame))
    (tmp_path / 'robot.urdf').write_text(robot_of('servicer7').urdf, encoding='utf-8')
    words = assigned({'robot_description_file': tmp_path / 'robot.urdf', **parameters({})})
    graph.start('estimator', '--ros-args', *words)
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    publishers = {topic: graph.publisher(topic, kind, qos(10_000)) for topic, (kind, _) in TRACKED.items()}
    for topic, message in read_messages(run, tracked=True):
        kind, name = TRACKED[topic]
        publishers[topic].publish(deserialize_message(serialize(message, name), kind))
    last = session_of(run, tracked=True)[0][-2]  # the last window that ends before the messages do
    wanted = every_bit(estimate_message(last, TYPES, Frames('link7', 'odom')), ESTIMATE)
    graph.wait(lambda: any(every_bit(each, ESTIMATE) == wanted for each in estimates), 'the tracked target')
    unknown = "298 poses of the target are in the frame 'camera', which is neither 'odom' nor that of a link"
    assert (unknown in last.warnings) == (frame == 'camera')
    if frame == 'odom':
        assert last.parameters[0] == pytest.approx(162.0, rel=0.1)
        return
    without = session_of(run, tracked=False)[0][-2]
    assert np.array_equal(last.parameters, without.parameters, equal_nan=True)
    assert np.array_equal(last.momentum, without.momentum, equal_nan=True)
    assert np.array_equal(last.momentum_covariance, without.momentum_covariance, equal_nan=True)


# -- Commanded thrust at a live estimator and recorder: used, reported, and in the bag.


@pytest.mark.long
def test_thrust_is_used_and_reported(graph: Graph) -> None:
    graph.start('estimator', '--ros-args', '-p', f'robot_description_file:={CONFIG / "servicer7.urdf"}')
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    diagnostics = graph.collect('/diagnostics', DiagnosticArray, qos(100))
    publishers = {topic: graph.publisher(topic, each, qos(10_000)) for topic, (each, _) in CLASSES.items()}
    graph.wait(lambda: 'none is commanded on /thrust' in str(diagnostics), 'that no thrust is commanded')

    session = Session(EstimatorConfig(), robot('servicer7').urdf)
    read = [*pulse(), *pushed_messages(2)]

    def publish(topic: str, message: Any) -> None:
        ours, name = CLASSES[topic]
        publishers[topic].publish(deserialize_message(serialize(message, name), ours))

    for topic, message, _ in read[:2]:
        publish(topic, message)
        session.add_thrust(message)
    graph.wait(lambda: '2 commands used' in str(diagnostics), 'the commands')
    for topic, message, _ in read[2:]:
        publish(topic, message)
        (session.add_joint_state if topic == '/joint_states' else session.add_odometry)(message)
    last = estimate_message(session.process()[-1], TYPES, Frames('link7', 'odom'))
    assert list(last.warnings) == [EXACT_THRUST]
    expected = every_bit(last, ESTIMATE)
    graph.wait(lambda: estimates and every_bit(estimates[-1], ESTIMATE) == expected, 'the estimate')
