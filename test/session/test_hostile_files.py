"""Robot descriptions and parameter files that mean harm: refused in one line, in little memory."""

from __future__ import annotations

import resource
from pathlib import Path

import pytest

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.parameters import build
from mbaid_ros.config.robot import read_robot_description
from mbaid_ros.core.errors import MbaidError
from mbaid_ros.core.robot.model import load_model

MEMORY = 600_000_000  # bytes, for any of them
HEAD = '/**:\n  ros__parameters:\n'
LINK = '<link name="{}"/>'
BOMB = '<!DOCTYPE r [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]><robot name="&b;"/>'
JOINT = '<joint name="{}" type="{}"><parent link="a"/><child link="b"/></joint>'

ROBOTS = {
    'entity bomb': (BOMB, 'DOCTYPE or ENTITY'),
    'a million links': ('<robot name="r">' + LINK.format('a') * 1_000_000 + '</robot>', 'characters; at most'),
    'too many links': (
        '<robot name="r">' + ''.join(LINK.format(number) for number in range(100_000)) + '</robot>',
        '100000 links; at most 1000',
    ),
    'a link of a long name': ('<robot name="r">' + LINK.format('a' * 1_000_000) + '</robot>', 'of 1000000 characters'),
    'a joint of a long name': (
        '<robot name="r"><link name="a"/><link name="b"/>' + JOINT.format('j' * 1_000_000, 'fixed') + '</robot>',
        'of 1000000 characters',
    ),
    'a joint of a long type': (
        '<robot name="r"><link name="a"/><link name="b"/>' + JOINT.format('j', 't' * 1_000_000) + '</robot>',
        "joint 'j' is of type",
    ),
    'deep nesting': ('<robot name="r">' + '<a>' * 1_300_000, 'not valid XML'),
}
PARAMETERS = {
    'a tag': (HEAD + '    window: !!python/object/apply:os.system ["true"]\n', 'not YAML'),
    'bytes': (HEAD + '    window: !!binary aGk=\n', 'accepted: a number > 0 s'),
    'aliases': (HEAD + '    a: &a [1, 1]\n    b: [*a, *a]\n', 'aliases are not supported'),
    'merged aliases': (HEAD + '    a: &a {b: 1}\n    <<: *a\n', 'aliases are not supported'),
    'deep nesting': (HEAD + '    window: ' + '[' * 3_000, 'nested too deeply'),
    'a long name': (HEAD + '    ? ' + 'a' * 900_000 + '\n    : 1\n', 'unknown parameter'),
    'a long value': (HEAD + '    method: ' + 'a' * 900_000 + '\n', 'accepted: trajectory, difference'),
    'a long number': (HEAD + '    window: 1' + '0' * 10_000 + '\n', 'not YAML'),
    'a long file': (HEAD + '    window: 0.5\n' * 100_000, 'more than 1000000 characters'),
}


def refused_by(error: MbaidError, text: str) -> None:
    line = str(error)
    assert text in line
    assert '\n' not in line
    assert len(line) < 3_000


@pytest.fixture(autouse=True)
def _little_memory() -> object:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024 < MEMORY


@pytest.mark.parametrize('name', ROBOTS)
def test_robot_descriptions(name: str, tmp_path: Path) -> None:
    document, text = ROBOTS[name]
    path = tmp_path / 'robot.urdf'
    path.write_text(document)
    with pytest.raises(MbaidError) as caught:
        load_model(read_robot_description(path))
    refused_by(caught.value, text)


@pytest.mark.parametrize('name', PARAMETERS)
def test_parameter_files(name: str, tmp_path: Path) -> None:
    content, text = PARAMETERS[name]
    path = tmp_path / 'estimator.yaml'
    path.write_text(content)
    with pytest.raises(MbaidError) as caught:
        build(EstimatorConfig, load_parameter_file(path, 'estimator'))
    refused_by(caught.value, text)


def test_files_without_an_end() -> None:
    with pytest.raises(MbaidError):
        load_model(read_robot_description('/dev/zero'))
    with pytest.raises(MbaidError):
        load_parameter_file('/dev/zero', 'estimator')
