"""Commanded thrust at a live estimator and recorder: used, told of, and in the bag."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from mbaid_msgs.msg import InertiaEstimate
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

import recorded
from graph import Graph
from mbaid_ros.bags import BagReader, serialize
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.sensors.thrust import EXACT_THRUST
from mbaid_ros.nodes.subscriptions import TYPES, qos
from mbaid_ros.outgoing import Frames, estimate_message
from mbaid_ros.session import Session
from simulated import CONFIG, robot
from streams import every_bit
from thrusting import WRENCH, messages, pulse

CLASSES = {
    '/joint_states': (JointState, recorded.JOINT_STATE),
    '/odom': (Odometry, recorded.ODOMETRY),
    '/thrust': (WrenchStamped, WRENCH),
}
ESTIMATE = 'mbaid_msgs/msg/InertiaEstimate'


def test_thrust_is_used_told_of_and_recorded(graph: Graph, tmp_path: Path) -> None:
    recorder = graph.start('recorder', '--ros-args', '-p', f'output:={tmp_path / "run"}')
    graph.start('estimator', '--ros-args', '-p', f'robot_description_file:={CONFIG / "servicer7.urdf"}')
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    diagnostics = graph.collect('/diagnostics', DiagnosticArray, qos(100))
    publishers = {topic: graph.publisher(topic, each, qos(10_000)) for topic, (each, _) in CLASSES.items()}
    graph.wait(lambda: 'none is commanded on /thrust' in str(diagnostics), 'that no thrust is commanded')

    session = Session(EstimatorConfig(), robot('servicer7').urdf)
    read = [*pulse(), *messages(2)]

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
    assert recorder.stop() == 0
    with BagReader(tmp_path / 'run') as bag:
        assert bag.topics['/thrust'].count == 2
