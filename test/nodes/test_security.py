"""The policy for SROS2 admits what the nodes do on the graph: no topic or service of theirs is missing in it."""

from __future__ import annotations

from collections.abc import Callable
from xml.etree import ElementTree as ET

import pytest
import rclpy
from rclpy.node import Node

from graph import free_domain
from mbaid_ros.nodes.estimator import EstimatorNode, ManagedEstimatorNode
from mbaid_ros.nodes.simulator import SimulatorNode
from simulated import CONFIG

POLICY = CONFIG / 'sros2' / 'mbaid_ros.policy.xml'
EVERYTHING = ['publish_tf:=true', 'debris.report:=true', 'wheels.momentum_frame:=base_link']
MOVED = [
    f'robot_description_file:={CONFIG / "servicer7.urdf"}',
    'thrust.duration:=1.0',
    'publish_clock:=true',
    'imu.rate:=100.0',
]


def admitted(node: str) -> dict[str, set[str]]:
    """Return the full names that a node may subscribe to, publish and serve."""
    (enclave,) = ET.parse(POLICY).getroot().findall(f"enclaves/enclave[@path='/mbaid_ros/{node}']")
    (profile,) = enclave.findall('profiles/profile')
    assert (profile.get('ns'), profile.get('node')) == ('/', node)
    found: dict[str, set[str]] = {}
    for kind, what in (('subscribe', 'topic'), ('publish', 'topic'), ('reply', 'service')):
        names = [each.text or '' for each in profile.findall(f"*[@{kind}='ALLOW']/{what}")]
        found[kind] = {name.replace('~', f'/{node}') if name[0] in '~/' else f'/{name}' for name in names}
    return found


@pytest.mark.parametrize(
    ('make', 'parameters'),
    [
        (EstimatorNode, EVERYTHING),
        (EstimatorNode, ['pose.tf_child_frame:=base_link']),
        (lambda: ManagedEstimatorNode('estimator'), []),
        (SimulatorNode, MOVED),
    ],
    ids=['estimator', 'on tf', 'managed', 'simulator'],
)
def test_the_policy_admits_all_that_a_node_does(
    make: Callable[[], Node], parameters: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
    with free_domain() as domain:
        words = [word for text in parameters for word in ('-p', text)]
        rclpy.init(args=['', '--ros-args', *words], domain_id=domain)
        try:
            node = make()
            name = node.get_name()
            rules = admitted(name)
            done = {
                'subscribe': node.get_subscriber_names_and_types_by_node(name, '/'),
                'publish': node.get_publisher_names_and_types_by_node(name, '/'),
                'reply': node.get_service_names_and_types_by_node(name, '/'),
            }
        finally:
            rclpy.shutdown()
    for kind, pairs in done.items():
        names = {each for each, _ in pairs}
        assert names or kind == 'subscribe'
        assert names <= rules[kind]
