"""The node `estimator` where poses on a topic of their own locate the base, of whichever type, beside an IMU."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from mbaid_msgs.msg import InertiaEstimate
from sensor_msgs.msg import Imu, JointState

from graph import Graph
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.nodes.subscriptions import TYPES, qos
from mbaid_ros.outgoing import Frames, estimate_message
from mbaid_ros.session import Session
from simulated import CONFIG
from streams import every_bit, run, urdf

USED = {'imu.noise_density': 1e-4}
ESTIMATE = 'mbaid_msgs/msg/InertiaEstimate'


def test_poses_locate_the_base_and_odometry_is_not_missed(graph: Graph) -> None:
    assigned = [f'robot_description_file:={CONFIG}/table1.urdf', *(f'{name}:={value}' for name, value in USED.items())]
    graph.start('estimator', '--ros-args', *(word for text in assigned for word in ('-p', text)))
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    diagnostics = graph.collect('/diagnostics', DiagnosticArray, qos(100))
    poses = graph.publisher('pose', PoseWithCovarianceStamped, qos(10_000))
    joints = graph.publisher('joint_states', JointState, qos(10_000))

    gyro = graph.publisher('imu', Imu, qos(10_000))

    session = Session(build(EstimatorConfig, USED), urdf('table1'))
    for timed in run('table1', 5.6):
        message: Any = timed.message
        if timed.topic == 'odom':
            message = PoseWithCovarianceStamped(header=deepcopy(message.header), pose=message.pose)
            poses.publish(message)
            session.add_odometry(message)
            turning = Imu(header=message.header, angular_velocity=timed.message.twist.twist.angular)
            turning.header.frame_id = 'base_link'
            gyro.publish(turning)
            session.add_imu(turning)
        else:
            joints.publish(message)
            session.add_joint_state(message)
    expected = every_bit(estimate_message(session.process()[-1], TYPES, Frames('link4', 'odom')), ESTIMATE)
    assert session.received['imu'] > 200
    graph.wait(lambda: estimates and every_bit(estimates[-1], ESTIMATE) == expected, 'the estimate')
    graph.wait(lambda: any('estimator: pose' in status.name for status in diagnostics[-1].status), 'the topic')
    assert not any('estimator: odom' in status.name for status in diagnostics[-1].status)
