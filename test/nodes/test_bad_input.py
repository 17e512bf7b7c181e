"""Whatever the node `estimator` is given on its topics: it says what is wrong in /diagnostics, and goes on."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from itertools import cycle
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from mbaid_msgs.msg import InertiaEstimate
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from graph import Graph
from mbaid_ros.nodes.subscriptions import qos
from streams import run, urdf

OTHER_ROBOT = urdf('table1').replace('"link4"', '"gripper"')
NAN = float('nan')


class Talk:
    """An estimator, what is sent to it, and what it says about that."""

    def __init__(self, graph: Graph, *arguments: str) -> None:
        self.graph = graph
        self.node = graph.start('estimator', '--ros-args', *arguments)
        self.estimates = graph.collect('/estimator/estimate', InertiaEstimate)
        self.diagnostics = graph.collect('/diagnostics', DiagnosticArray, qos(1000))
        self._descriptions = graph.publisher('robot_description', String)
        self._joints = graph.publisher('joint_states', JointState)
        self._odometry = graph.publisher('odom', Odometry)
        self._messages = iter(run('table1', 8.0, rate=50.0))

    def describe(self, text: str) -> None:
        """Publish a robot description."""
        self._descriptions.publish(String(data=text))

    def send(
        self,
        change_joints: Callable[[JointState], None] = lambda _message: None,
        change_odometry: Callable[[Odometry], None] = lambda _message: None,
        samples: int = 30,
    ) -> None:
        """Publish the next samples of a run, each changed before it goes out."""
        for _ in range(2 * samples):
            timed = next(self._messages)
            message = deepcopy(timed.message)
            if timed.topic == 'joint_states':
                change_joints(message)
                self._joints.publish(message)
            else:
                change_odometry(message)
                self._odometry.publish(message)

    def send_bytes(self, data: bytes) -> None:
        """Publish bytes as a JointState."""
        self._joints.publish(data)

    def hear(self, part: str, level: bytes, *texts: str) -> None:
        """Wait until diagnostic statuses have said each of some texts; forget what has been said up to then."""

        def missing() -> list[str]:
            statuses = [status for array in self.diagnostics for status in array.status]
            said = [s.message for s in statuses if s.name == f'estimator: {part}' and s.level == level]
            return [text for text in texts if not any(text in message for message in said)]

        self.graph.wait(lambda: not missing(), f'{part}: {texts}')
        self.diagnostics.clear()

    def made(self) -> list[Any]:
        """Return the estimates that are more than waiting."""
        return [estimate for estimate in self.estimates if estimate.samples]


def test_robot_descriptions_that_cannot_be_used(graph: Graph) -> None:
    talk = Talk(graph, '-p', 'target_link:=link4')
    warn, error, fine = DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.OK
    talk.hear('robot description', warn, 'no robot description on /robot_description yet')
    graph.wait(lambda: talk.estimates, 'the estimate that waits')
    assert 'no robot description on /robot_description yet' in talk.estimates[0].warnings
    talk.send()
    talk.hear('samples', warn, 'no sample can be used without a robot description')
    talk.describe('<robot name="half"><link')
    talk.hear('robot description', error, 'the robot description is not valid XML')
    talk.describe(OTHER_ROBOT)
    talk.hear('robot description', error, "link 'link4' is not in the robot description; links: base_link")
    graph.wait(lambda: "link 'link4' is not in the robot" in str(talk.estimates[-1].warnings), 'the reason to wait')
    talk.describe(urdf('table1'))
    talk.hear('robot description', fine, "robot 'table1', target link 'link4'")
    talk.send(samples=40)
    graph.wait(talk.made, 'an estimate')
    # A bad one later changes nothing; another good one starts again.
    talk.describe('<robot name="empty"/>')
    talk.hear('robot description', error, 'has no <link>; the one before stays in use')
    talk.send()
    graph.wait(lambda: talk.made()[-1].samples > 40, 'a further estimate')
    talk.estimates.clear()
    talk.describe(urdf('table1').replace('"table1"', '"another"'))
    talk.hear('robot description', fine, "robot 'another'")
    graph.wait(lambda: any(estimate.status == 'waiting' for estimate in talk.estimates), 'an estimate that waits')
    assert talk.node.stop() == 0


def rename(message: JointState) -> None:
    message.name = ['shoulder', 'elbow', 'joint3', 'joint4']


def shorten(message: JointState) -> None:
    message.position = message.position[:2]


def spoil(message: JointState) -> None:
    message.position[1] = NAN


def turn_back(message: JointState) -> None:
    message.header.stamp.sec -= 100


def misplace(message: Odometry) -> None:
    message.child_frame_id = 'gripper_base'


def spoil_pose(message: Odometry) -> None:
    message.pose.pose.position.x = float('inf')


def undo_rotation(message: Odometry) -> None:
    message.pose.pose.orientation.w = message.pose.pose.orientation.z = 0.0


def test_messages_that_cannot_be_used(graph: Graph) -> None:
    talk = Talk(graph)
    talk.describe(urdf('table1'))
    talk.hear('robot description', DiagnosticStatus.OK, "target link 'link4'")
    for change in (rename, shorten, spoil):
        talk.send(change)
    for change in (misplace, spoil_pose, undo_rotation):
        talk.send(change_odometry=change)
    causes = [
        'joint missing: the joint states lack joint1, joint2; they hold shoulder, elbow, joint3, joint4',
        "child_frame_id is 'gripper_base'; accepted: 'base_link'",
        'names and values differ in number',
        'NaN or infinite value',
        'orientation is not a unit quaternion',
    ]
    talk.hear('samples', DiagnosticStatus.ERROR, *causes)
    assert not talk.made()
    talk.send(samples=60)
    graph.wait(talk.made, 'an estimate')
    talk.hear('samples', DiagnosticStatus.OK, ' used')
    talk.send(turn_back)
    talk.hear(
        'samples', DiagnosticStatus.ERROR, 'ahead of those of joint_states: joint_states has stopped, or their clocks'
    )
    assert 'stamps on joint_states jumped back by 99.98 s' in talk.node.stderr
    talk.hear('odom', DiagnosticStatus.STALE, 'no messages on /odom for')
    assert talk.made()
    log = talk.node.stderr
    assert [log.count(cause) for cause in causes] == [1] * len(causes)
    assert talk.node.stop() == 0


def test_covariances_that_are_none(graph: Graph) -> None:
    def spoil_covariance(message: Odometry) -> None:
        message.pose.covariance[0] = -1.0

    talk = Talk(graph)
    talk.describe(urdf('table1'))
    talk.hear('robot description', DiagnosticStatus.OK, "target link 'link4'")
    talk.send(change_odometry=spoil_covariance, samples=100)
    talk.hear(
        'samples', DiagnosticStatus.WARN, ' not used wholly since the last report: covariance of the pose is none'
    )
    graph.wait(talk.made, 'an estimate')
    graph.wait(lambda: talk.diagnostics, 'a report')
    values = [pair for status in talk.diagnostics[-1].status for pair in status.values]
    assert [pair.value for pair in values if pair.key == 'not used wholly, covariance of the pose is none'] == ['100']
    assert talk.node.stderr.count('messages not used wholly: covariance of the pose is none') == 1
    talk.send(samples=100)
    talk.hear('samples', DiagnosticStatus.OK, ' used')
    assert talk.node.stop() == 0


def test_bytes_that_are_no_message(graph: Graph) -> None:
    talk = Talk(graph)
    talk.describe(urdf('table1'))
    talk.hear('robot description', DiagnosticStatus.OK, "target link 'link4'")
    text = 'a message on /joint_states is not a sensor_msgs/msg/JointState: it is not used'
    for data in (b'\0\1\0\0', b'\0\1\0\0' + b'\xff' * 60):
        talk.send_bytes(data)
    graph.wait(lambda: text in talk.node.stderr, text)
    talk.send(samples=100)
    graph.wait(talk.made, 'an estimate')
    assert talk.node.stderr.count('is not a sensor_msgs') == 1
    assert talk.node.stop() == 0


def test_publishers_of_another_type(graph: Graph) -> None:
    node = graph.start('estimator', '--ros-args', '-r', '__ns:=/servicer')
    diagnostics = graph.collect('/diagnostics', DiagnosticArray, qos(1000))
    graph.node.create_publisher(String, '/servicer/odom', 10)
    text = 'no messages on /servicer/odom yet; its publishers send std_msgs/msg/String, not nav_msgs/msg/Odometry'
    graph.wait(lambda: text in str(diagnostics), text)
    assert node.stop() == 0


def test_two_publishers_of_one_sensor(graph: Graph) -> None:
    talk = Talk(graph)
    talk.describe(urdf('table1'))
    rival = graph.node.create_publisher(Odometry, 'odom', 10)
    talk.send(samples=100)
    name = f'/{graph.node.get_name()}'
    text = f'from {name}, {name}: all is taken for the same sensor'
    talk.hear('odom', DiagnosticStatus.WARN, text)
    talk.hear('joint_states', DiagnosticStatus.OK, 'Hz')
    graph.node.destroy_publisher(rival)
    talk.send(samples=10)
    talk.hear('odom', DiagnosticStatus.OK, 'Hz')
    assert talk.node.stop() == 0


def test_a_publisher_of_another_type_beside_one_that_is_heard(graph: Graph) -> None:
    talk = Talk(graph)
    talk.describe(urdf('table1'))
    with graph.stranger('wheel_odometry') as other:
        other.create_publisher(String, 'odom', 10)
        talk.send(samples=100)
        text = 'not heard is what /wheel_odometry sends there as std_msgs/msg/String'
        talk.hear('odom', DiagnosticStatus.WARN, text)
    talk.hear('joint_states', DiagnosticStatus.OK, 'Hz')
    assert talk.node.stop() == 0


def test_frames_that_alternate(graph: Graph) -> None:
    def change_odometry(message: Odometry) -> None:
        message.header.frame_id = next(frames)

    frames = cycle(['odom', '/odom', 'map'])
    talk = Talk(graph)
    talk.describe(urdf('table1'))
    talk.send(samples=100)
    talk.hear('samples', DiagnosticStatus.OK, 'used')
    talk.send(change_odometry=change_odometry)
    talk.hear(
        'samples', DiagnosticStatus.WARN, "the base is located in the frames 'odom', 'map', which are taken for one"
    )
    assert talk.node.stop() == 0
