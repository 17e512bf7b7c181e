"""The estimator as a managed node: what each transition does, on a live graph."""

from __future__ import annotations

from typing import Any

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from mbaid_msgs.msg import InertiaEstimate
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters
from sensor_msgs.msg import JointState

from graph import Graph
from mbaid_ros.nodes.subscriptions import qos
from simulated import CONFIG
from streams import run


def transition(graph: Graph, number: int) -> bool:
    request = ChangeState.Request(transition=Transition(id=number))
    return bool(graph.call('/estimator/change_state', ChangeState, request).success)


def state(graph: Graph) -> int:
    return int(graph.call('/estimator/get_state', GetState, GetState.Request()).current_state.id)


def set_text(graph: Graph, name: str, value: str) -> Any:
    return assign(graph, name, ParameterValue(type=4, string_value=value))


def set_number(graph: Graph, name: str, value: float) -> Any:
    return assign(graph, name, ParameterValue(type=3, double_value=value))


def assign(graph: Graph, name: str, value: ParameterValue) -> Any:
    setting = Parameter(name=name, value=value)
    request = SetParameters.Request(parameters=[setting])
    return graph.call('/estimator/set_parameters', SetParameters, request).results[0]


def topics(graph: Graph) -> set[str]:
    return {name for name, _ in graph.node.get_topic_names_and_types()}


def test_a_life(graph: Graph) -> None:
    node = graph.start('estimator', '--lifecycle', '--ros-args', '-p', 'known_joints.joint2.zero_std:=0.002')
    assert state(graph) == State.PRIMARY_STATE_UNCONFIGURED
    assert '/estimator/estimate' not in topics(graph)

    # The robot is read by `configure`: what is wrong with it is told, and can be mended.
    assert set_text(graph, 'robot_description_file', '/absent.urdf').successful
    assert not transition(graph, Transition.TRANSITION_CONFIGURE)
    graph.wait(lambda: '/absent.urdf' in node.stderr, 'the reason')
    assert state(graph) == State.PRIMARY_STATE_UNCONFIGURED
    assert set_text(graph, 'robot_description_file', str(CONFIG / 'table1.urdf')).successful
    assert transition(graph, Transition.TRANSITION_CONFIGURE)
    graph.wait(lambda: '/estimator/estimate' in topics(graph), 'the topics')
    refused = set_text(graph, 'target_link', 'link3')
    assert refused.reason == "'target_link' is read when the node is configured: clean up first"

    # Data are taken while it is active.
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    publishers = {
        'joint_states': graph.publisher('joint_states', JointState, qos(10_000)),
        'odom': graph.publisher('odom', Odometry, qos(10_000)),
    }
    messages = run('table1', 6.0)
    third = len(messages) // 3
    for begin, active in ((0, False), (third, True)):
        if active:
            assert not any(estimate.samples for estimate in estimates)
            assert transition(graph, Transition.TRANSITION_ACTIVATE)
        for timed in messages[begin : begin + third]:
            publishers[timed.topic].publish(timed.message)
    graph.wait(lambda: estimates and estimates[-1].samples, 'an estimate')
    assert estimates[-1].samples <= third // 2
    assert not estimates[-1].stale
    assert transition(graph, Transition.TRANSITION_DEACTIVATE)
    graph.wait(lambda: estimates[-1].stale, 'that the estimate is the last one')
    assert estimates[-1].warnings[-1] == 'not active: no samples are taken'
    refused = set_number(graph, 'known_joints.joint2.zero_std', 1e-3)
    assert refused.reason == "'known_joints.joint2.zero_std' is read when the node is configured: clean up first"
    assert transition(graph, Transition.TRANSITION_CLEANUP)

    def published() -> set[str]:
        return {name for name, _ in graph.node.get_publisher_names_and_types_by_node('estimator', '/')}

    graph.wait(lambda: '/estimator/estimate' not in published(), 'the end of the topics')
    assert transition(graph, Transition.TRANSITION_CONFIGURE)
    assert node.stop() == 0


def test_parameters_that_cannot_be_used_end_it_at_once(graph: Graph) -> None:
    node = graph.start('estimator', '--lifecycle', '--ros-args', '-p', 'window:=-1.0')
    assert node.wait() == 2
    assert "'window' is -1.0 s; accepted: a number > 0" in node.stderr
