"""Layouts of displays against what an estimator publishes, and numbers that are withdrawn."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import InertiaStamped
from std_msgs.msg import String

from graph import Graph
from graph import graph as new_graph
from made_runs import BODY, estimate, planar
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.estimate_messages import Frames
from mbaid_ros.nodes.publishers import Publishers
from mbaid_ros.nodes.subscriptions import LATCHED, message_class
from simulated import CONFIG
from streams import urdf


@pytest.fixture(scope='module', name='running')
def running_estimator(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Graph]:
    """Give a graph with an estimator that expects the robot description as a topic."""
    with new_graph(tmp_path_factory.mktemp('display')) as place:
        place.start('estimator')
        place.publisher('/robot_description', String, LATCHED).publish(String(data=urdf('table1')))
        yield place


# -- Every topic and field of the layouts for RViz and PlotJuggler is one that a running estimator has.

RVIZ, PLOTJUGGLER = CONFIG / 'mbaid_ros.rviz', CONFIG / 'plotjuggler_layout.xml'


def type_of(topic: str, running: Graph) -> str:
    """Return the type of a topic of a running estimator, whose topics appear one after the other."""

    def found() -> dict[str, list[str]]:
        return dict(running.node.get_topic_names_and_types())

    running.wait(lambda: topic in found(), topic)
    return found()[topic][0]


def has_field(type_name: str, path: str) -> bool:
    """Return whether a message type has a field like inertia.com.x or covariance[3]."""
    if not path:
        return True
    name, _, rest = path.partition('.')
    match = re.fullmatch(r'(\w+)(\[\d+\])?', name)
    fields = message_class(type_name).get_fields_and_field_types()
    if match is None or match[1] not in fields:
        return False
    kind = re.sub(r'^sequence<(.*)>$|\[\d*\]$', r'\1', fields[match[1]])
    if '/' not in kind:
        return not rest
    package, _, message = kind.partition('/')
    return has_field(f'{package}/msg/{message}', rest)


def rviz_displays() -> list[dict[str, Any]]:
    displays: list[dict[str, Any]] = yaml.safe_load(RVIZ.read_text(encoding='utf-8'))['Visualization Manager'][
        'Displays'
    ]
    return displays


def test_rviz_shows_topics_that_exist(running: Graph) -> None:
    seen = 0
    for display in rviz_displays():
        topic = display.get('Topic') or display.get('Description Topic')
        if topic is not None:
            assert (display['Class'], type_of(topic['Value'], running)) == (
                'rviz_default_plugins/RobotModel',
                'std_msgs/msg/String',
            )
            assert topic['Durability Policy'] == 'Transient Local'  # the estimator latches them
            seen += 1
    assert seen == 2


def test_plotjuggler_shows_topics_and_fields_that_exist(running: Graph) -> None:
    root = ET.fromstring(PLOTJUGGLER.read_text(encoding='utf-8'))
    curves = [str(curve.get('name')) for curve in root.iter('curve')]
    selected = [str(topic.get('name')) for topic in root.iter('topic')]
    assert len(curves) == 17
    types = {topic: type_of(topic, running) for topic in selected}
    for curve in curves:
        topic = next(name for name in selected if curve.startswith(f'{name}/'))
        assert has_field(types[topic], curve.removeprefix(f'{topic}/').replace('/', '.')), curve


# -- What was published and cannot be used any more is taken back: from who reads one topic alone, and who comes late.

FRAMES = Frames(target_link='link7', odometry='odom')


def test_numbers_that_are_contradicted_are_taken_back(graph: Graph) -> None:
    outlets, robot = Publishers(graph.node), urdf('servicer7')
    inertia = graph.collect('/test/inertia', InertiaStamped)
    outlets.publish(estimate(), FRAMES, robot)
    graph.wait(lambda: len(inertia) == 1, 'the numbers')
    outlets.publish(estimate(status='inconsistent', stamp=1_700_000_010_500_000_000), FRAMES, robot)
    outlets.publish(estimate(status='inconsistent', stamp=1_700_000_011_000_000_000), FRAMES, robot)
    late = graph.collect('/test/inertia', InertiaStamped, LATCHED)
    graph.wait(lambda: len(inertia) == 2 and late, 'that there are none')
    assert math.isnan(inertia[1].inertia.m)
    assert math.isnan(inertia[1].inertia.com.x)
    assert (inertia[1].header.stamp.sec, inertia[1].header.stamp.nanosec) == (1_700_000_010, 500_000_000)
    assert math.isnan(late[0].inertia.m)
    outlets.publish(estimate(), FRAMES, robot)
    graph.wait(lambda: len(inertia) == 3, 'numbers again, and the loss of the others once')
    assert inertia[2].inertia.m == BODY[0]


def test_a_robot_description_that_is_contradicted_is_not_found_by_who_comes_late(graph: Graph) -> None:
    outlets, robot = Publishers(graph.node), urdf('servicer7')
    descriptions = graph.collect('/test/robot_description', String)
    heavier = np.concatenate(([200.0], BODY[1:]))
    outlets.publish(estimate(), FRAMES, robot)
    graph.wait(lambda: len(descriptions) == 1, 'the robot with the body')
    outlets.publish(estimate(status='inconsistent'), FRAMES, robot)
    late = graph.collect('/test/robot_description', String, LATCHED)
    outlets.publish(estimate(parameters=heavier), FRAMES, robot)
    graph.wait(lambda: late, 'the robot with another body')
    assert [load_model(one.data).link('link7').parameters[0] for one in late] == [200.0]
    # A body of which less is known than a link needs withdraws it, too; known numbers are still published.
    inertia = graph.collect('/test/inertia', InertiaStamped)
    outlets.publish(planar(), FRAMES, robot)
    later = graph.collect('/test/robot_description', String, LATCHED)
    outlets.publish(estimate(), FRAMES, robot)
    graph.wait(lambda: later and inertia and inertia[-1].inertia.iyy == BODY[7], 'the last')
    assert [load_model(one.data).link('link7').parameters[0] for one in later] == [BODY[0]]
