"""Every topic and field of the layouts for RViz, Foxglove and PlotJuggler is one that a running estimator has."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree as ET

import pytest
import yaml

from graph import Graph
from mbaid_ros.nodes.markers import NAMESPACE
from mbaid_ros.nodes.subscriptions import message_class
from simulated import CONFIG, robot

RVIZ, FOXGLOVE, PLOTJUGGLER = (CONFIG / f'{name}' for name in (
    'mbaid_ros.rviz', 'foxglove_layout.json', 'plotjuggler_layout.xml'
))  # fmt: skip


@pytest.fixture(name='topics')
def topics_of_a_running_estimator(graph: Graph) -> dict[str, str]:
    """Return the type of each topic, with the robot description expected as a topic."""
    graph.start('estimator')

    def found() -> dict[str, str]:
        return {name: types[0] for name, types in graph.node.get_topic_names_and_types()}

    graph.wait(lambda: {'/estimator/markers', '/robot_description', '/diagnostics'} <= set(found()), 'the topics')
    return found()


def has_field(type_name: str, path: str) -> bool:
    """Tell whether a message type has a field like inertia.com.x or covariance[3]."""
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


def test_rviz_shows_topics_that_exist(topics: dict[str, str]) -> None:
    expected = {'RobotModel': 'std_msgs/msg/String', 'MarkerArray': 'visualization_msgs/msg/MarkerArray'}
    seen = 0
    for display in rviz_displays():
        topic = display.get('Topic') or display.get('Description Topic')
        if topic is not None:
            assert topics[topic['Value']] == expected[display['Class'].split('/')[1]]
            assert topic['Durability Policy'] == 'Transient Local'  # the estimator latches them
            seen += 1
    assert seen == 3


def test_rviz_names_what_the_markers_are_called() -> None:
    namespaces = [display['Namespaces'] for display in rviz_displays() if 'Namespaces' in display]
    assert namespaces == [{NAMESPACE: True}]


def test_the_fixed_frame_is_the_base_link_of_every_robot() -> None:
    content = yaml.safe_load(RVIZ.read_text(encoding='utf-8'))['Visualization Manager']
    for name in ('table1', 'servicer7', 'ets7'):
        assert content['Global Options']['Fixed Frame'] == robot(name).base_link


def test_foxglove_shows_topics_and_fields_that_exist(topics: dict[str, str]) -> None:
    layout = json.loads(FOXGLOVE.read_text(encoding='utf-8'))
    panels = layout['configById']
    assert sorted(leaves(layout['layout'])) == sorted(panels)
    paths = [path['value'] for panel in panels.values() for path in panel.get('paths', [])]
    paths += [panel['topicPath'] for panel in panels.values() if 'topicPath' in panel]
    assert len(paths) == 18
    for path in paths:
        topic, _, field = path.partition('.')
        assert has_field(topics[topic], field), path
    assert panels['DiagnosticSummary!all']['topicToRender'] in topics
    scene = panels['3D!robot']
    assert set(scene['topics']) <= set(topics)
    assert scene['layers']['robot']['topic'] in topics


def leaves(layout: Any) -> Iterator[str]:
    if isinstance(layout, str):
        yield layout
    else:
        yield from leaves(layout['first'])
        yield from leaves(layout['second'])


def test_plotjuggler_shows_topics_and_fields_that_exist(topics: dict[str, str]) -> None:
    root = ET.fromstring(PLOTJUGGLER.read_text(encoding='utf-8'))
    curves = [str(curve.get('name')) for curve in root.iter('curve')]
    selected = [str(topic.get('name')) for topic in root.iter('topic')]
    assert len(curves) == 17
    for curve in curves:
        topic = next(name for name in selected if curve.startswith(f'{name}/'))
        assert has_field(topics[topic], curve.removeprefix(f'{topic}/').replace('/', '.')), curve


@pytest.mark.parametrize('path', ['inertia.mass', 'covariance.x', 'residual.x', 'inertia.com.w', 'no'])
def test_a_field_that_does_not_exist_is_noticed(path: str) -> None:
    assert not has_field('mbaid_msgs/msg/InertiaEstimate', path)
    assert has_field('mbaid_msgs/msg/InertiaEstimate', 'covariance[3]')
