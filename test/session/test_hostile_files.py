"""Robot descriptions and parameter files that mean harm: refused in one line, in little memory."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mbaid_ros.config.calibration_file import read_calibration
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.config.parameter_files import load_parameter_file, read_robot_description
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.errors import MbaidError, ModelError
from mbaid_ros.parameters import build
from mbaid_ros.replay.read_back import read_identified, read_truth, truth_beside
from mbaid_ros.session.model_summary import summarise
from mbaid_ros.session.robot import mesh_points

MEMORY = 600_000_000  # bytes, for any of them
pytestmark = pytest.mark.usefixtures('_little_memory')
HEAD = '/**:\n  ros__parameters:\n'
LINK = '<link name="{}"/>'
BOMB = '<!DOCTYPE r [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]><robot name="&b;"/>'
JOINT = '<joint name="{}" type="{}"><parent link="a"/><child link="b"/></joint>'

ROBOTS = {
    'entity bomb': (BOMB, 'DOCTYPE or ENTITY'),
    'a million links': ('<robot name="r">' + LINK.format('a') * 1_000_000 + '</robot>', 'more than 4000000 characters'),
    'too many links': (
        '<robot name="r">' + ''.join(LINK.format(number) for number in range(40_000)) + '</robot>',
        '40000 links; at most 1000',
    ),
    'a link of a long name': ('<robot name="r">' + LINK.format('a' * 1_000_000) + '</robot>', 'of 1000000 characters'),
    'deep nesting': ('<robot name="r">' + '<a>' * 1_300_000, 'not valid XML'),
    'elements in elements': (
        '<robot name="r"><link name="a"/>' + '<a>' * 100_000 + '</a>' * 100_000 + '</robot>',
        'more than 50 deep',
    ),
    'many attributes': (
        '<robot name="r"><link name="a"/><x ' + ' '.join(f'a{k}=""' for k in range(100_000)) + '/></robot>',
        'an element <x> has 100000 attributes; at most 50',
    ),
    'many elements': ('<robot name="r"><link name="a"/>' + '<x/>' * 100_000 + '</robot>', 'more than 50000 elements'),
    'a far origin': (
        '<robot name="r"><link name="a"/><link name="b"/>'
        + JOINT.format('j', 'fixed').replace('<parent', '<origin xyz="0 1e308 0"/><parent')
        + '</robot>',
        "joint 'j' has origin xyz '0 1e308 0'; numbers up to 1e+06",
    ),
    'a large mass': (
        '<robot name="r"><link name="a"><inertial><mass value="1e300"/></inertial></link></robot>',
        "link 'a' has mass 1e+300; at most 1e+15",
    ),
}
PARAMETERS = {
    'bytes': (HEAD + '    window: !!binary aGk=\n', 'tags (!!binary) are not supported'),
    'aliases': (HEAD + '    a: &a [1, 1]\n    b: [*a, *a]\n', 'aliases are not supported'),
    'deep nesting': (HEAD + '    window: ' + '[' * 3_000, 'nested too deeply'),
    'a long name': (HEAD + '    ? ' + 'a' * 200_000 + '\n    : 1\n', 'unknown parameter'),
    'a long value': (HEAD + '    method: ' + 'a' * 200_000 + '\n', 'accepted: trajectory, difference'),
    'a hexadecimal number': (HEAD + '    window: 0x1' + '0' * 10_000 + '\n', 'a number of 10003 characters'),
    'a sexagesimal number': (HEAD + '    window: 1' + ':1' * 5_000 + '\n', 'a number of 10001 characters'),
    'merged mappings': (HEAD + '    <<: {window: 1}\n', 'merge keys (<<) are not supported'),
    'a size whose square no float holds': (
        HEAD + '    known_joints: {axis_std: 1e308}\n',
        'of a size from 1e-30 to 1e+15',
    ),
    'a window of no time': (HEAD + '    window: 1e-300\n', 'of a size from 1e-09 to 1e+06'),
    'a long file': (HEAD + '    window: 0.5\n' * 100_000, 'more than 250000 characters'),
}


def is_refused(reader: Callable[[Any], object], path: object, text: str) -> None:
    with pytest.raises(MbaidError) as caught:
        reader(path)
    line = str(caught.value)
    assert text in line
    assert '\n' not in line
    assert len(line) < 3_000


def robot_in(path: Path) -> object:
    return load_model(read_robot_description(path))


def parameters_in(path: Path) -> object:
    return build(EstimatorConfig, load_parameter_file(path, 'estimator'))


@pytest.mark.parametrize(
    ('reader', 'content', 'text'),
    [pytest.param(robot_in, *case, id=f'robot: {name}') for name, case in ROBOTS.items()]
    + [pytest.param(parameters_in, *case, id=f'parameters: {name}') for name, case in PARAMETERS.items()],
)
def test_robots_and_parameters(reader: Callable[[Path], object], content: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / 'file'
    path.write_text(content)
    is_refused(reader, path, text)


@pytest.mark.parametrize(
    'reader', [read_robot_description, lambda path: load_parameter_file(path, 'estimator'), read_truth]
)
def test_pipes_and_folders(reader: Callable[[Path], object], tmp_path: Path) -> None:
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)
    for path, kind in ((pipe, 'a pipe'), (tmp_path, 'a folder'), (Path('/dev/zero'), 'a device')):
        is_refused(reader, path, f'it is {kind}; accepted: a regular file')


TRUTH = {
    'target_link': 'link7',
    'mass': 1.0,
    'com': [0.0, 0.0, 0.0],
    'inertia': dict.fromkeys(('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz'), 1.0),
    'momentum': {'linear': [0.0] * 3, 'angular': [0.0] * 3},
}
TRUTHS = {
    'deep nesting': ('[' * 300_000, 'nested too deeply'),
    'an integer of 400 digits': (json.dumps({**TRUTH, 'mass': 10**400}), 'an integer of 401 digits'),
    'an integer of 5000 digits': ('{"mass": 1' + '0' * 5_000 + '}', 'an integer of 5001 digits'),
    'momentum as text': (json.dumps({**TRUTH, 'momentum': 'abc'}), 'momentum is no object'),
    'half a momentum': (
        json.dumps({**TRUTH, 'momentum': {'linear': [1.0] * 6, 'angular': []}}),
        'linear is no list of 3',
    ),
    'inertia as a list': (json.dumps({**TRUTH, 'inertia': [1] * 6}), 'inertia is no object'),
    'mass as a list': (json.dumps({**TRUTH, 'mass': [1]}), 'TypeError'),
    'infinite': (json.dumps({**TRUTH, 'mass': float('inf')}), 'Infinity is no number of JSON'),
    'a list': ('[]', 'it is no object of JSON'),
    'nothing': ('', 'is not JSON'),
    'a mass alone': ('{"mass": 1}', "'inertia'"),
    'a long file': (' ' * 1_100_000, 'more than 1000000 characters'),
}


@pytest.mark.parametrize('name', TRUTHS)
def test_truths(name: str, tmp_path: Path) -> None:
    content, text = TRUTHS[name]
    path = tmp_path / 'truth.json'
    path.write_text(content)
    is_refused(read_truth, path, text)
    beside = truth_beside(str(tmp_path))
    assert beside is not None
    assert text in beside.problem


def test_results_and_calibrations_of_many_values(tmp_path: Path) -> None:
    path = tmp_path / 'results.json'
    path.write_text('[' + '[],' * 7_000_000 + '[]]')
    for read in (read_identified, read_calibration):
        is_refused(read, str(path), 'more than 6000000 values')


# -- The robot of a run: its summary, and its collision meshes.

FINE = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
HEAVY = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="3"/>'  # izz > ixx + iyy
PLATE = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="2.001"/>'  # thin, and rounded
HINGE = '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><axis xyz="0 0 1"/></joint>'


def body(name: str, inertia: str = FINE) -> str:
    return f'<link name="{name}"><inertial><mass value="2"/>{inertia}</inertial></link>'


def odd() -> str:
    """Return a robot with a base that weighs nothing, a frame, a hollow link, and an inertia that cannot be."""
    links = '<link name="base"/><link name="camera"/><link name="rod"/>' + body('fore', HEAVY) + body('hand', PLATE)
    ends = [('c', 'fixed', 'fore', 'camera'), ('a', 'continuous', 'base', 'rod'), ('b', 'continuous', 'rod', 'fore')]
    ends += [('w', 'continuous', 'fore', 'hand'), ('x', 'continuous', 'hand', 'tool')]
    return f'<robot name="odd">{links}{body("tool")}{"".join(HINGE.format(*each) for each in ends)}</robot>'


def test_what_is_odd_is_named() -> None:
    found = summarise(load_model(odd()), 'tool', chosen=False, heard=['a', 'b', 'c', 'x', 'gripper'])
    assert found.mass == 4.0
    assert found.without_inertia == ('base', 'rod', 'camera')
    assert found.bare == ('base', 'rod')
    assert found.impossible == ('fore',)
    assert found.foreign == ('gripper',)
    assert found.unheard == ('w',)
    text = '\n'.join(found.lines)
    assert "robot 'odd': 'base' floats, 4 joints, 4 kg without target link 'tool'" in text
    assert "'tool' is a guess" in text
    assert 'links without inertia: camera' in text
    assert 'lacks: gripper' in text
    assert 'no message has: w' in text
    base, rod, fore = found.warnings
    assert "base 'base' has no inertia" in base
    assert rod.endswith(': rod')
    assert 'gives fore' in fore


def test_a_base_that_is_to_be_identified_needs_no_inertia() -> None:
    assert not any('base' in warning for warning in summarise(load_model(odd()), unknown=['base']).warnings)
    assert not any('base' in warning for warning in summarise(load_model(odd()), 'base').warnings)


# -- Collision meshes: found as ROS finds them, and refused in a line.

CORNERS = np.concatenate((np.zeros((1, 3)), np.eye(3)))
FACES = '1 2 3', '1 2 4', '1 3 4', '2 3 4'


@pytest.fixture(name='mesh')
def written_mesh(tmp_path: Path) -> Path:
    """Return a tetrahedron in the share of a package."""
    path = tmp_path / 'share' / 'arm_description' / 'the hand.obj'
    path.parent.mkdir(parents=True)
    corners = '\n'.join(f'v {x} {y} {z}' for x, y, z in CORNERS)
    path.write_text('\n'.join((corners, *(f'f {face}' for face in FACES))) + '\n')
    return path


def test_meshes_are_found_by_package_and_by_path(mesh: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'/nowhere:{tmp_path}')
    for name in ('package://arm_description/the%20hand.obj', f'file://{mesh}', str(mesh)):
        assert {tuple(corner) for corner in mesh_points(name)} == {tuple(corner) for corner in CORNERS}


@pytest.mark.parametrize('content', [b'', b'no mesh', b'solid x', bytes(84)])
def test_what_is_no_mesh_is_refused_in_a_line(
    tmp_path: Path, content: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / 'hand.stl').write_bytes(content)
    with pytest.raises(ModelError, match=r"mesh '.*hand\.stl' cannot be read: [^\n]+$"):
        mesh_points(str(tmp_path / 'hand.stl'))
    assert capfd.readouterr() == ('', '')


ENCODED = {
    'utf-8-sig': 'utf-8',
    'utf-16': 'UTF-16',
    'utf-16-be': 'UTF-16',
    'utf-32': 'utf-32',
    'gb2312': 'gb2312',
    'cp1252': 'windows-1252',
    'iso8859-15': 'ISO-8859-15',
    'shift_jis': 'Shift_JIS',
}


@pytest.mark.parametrize('codec', ENCODED)
def test_a_robot_description_is_read_in_its_encoding(codec: str, tmp_path: Path) -> None:
    name = {'gb2312': '卫星', 'shift_jis': '衛星'}.get(codec, 'Prüfling')
    body = f"?><robot name='{name}'><link name='base'/></robot>"
    path = tmp_path / 'robot.urdf'
    path.write_bytes(f"<?xml version='1.0' encoding='{ENCODED[codec]}'{body}".encode(codec))
    assert read_robot_description(path) == f"<?xml version='1.0' encoding='utf-8'{body}"


@pytest.mark.parametrize(
    ('content', 'text'),
    [
        (b'<robot name="\xfc"/>', 'is not text in UTF-8, and states no other encoding; save it in UTF-8'),
        (b'<?xml version="1.0" encoding="gb2312"?><robot name="\xff"/>', 'is not text in GB2312, as it states'),
        (
            b'<?xml version="1.0" encoding="zlib_codec"?><robot/>',
            "states the encoding 'zlib_codec', which is not known",
        ),
        (b'<?xml version="1.0" encoding="klingon"?><robot/>', "states the encoding 'klingon', which is not known"),
    ],
)
def test_an_encoding_that_does_not_fit_is_one_line(content: bytes, text: str, tmp_path: Path) -> None:
    path = tmp_path / 'robot.urdf'
    path.write_bytes(content)
    with pytest.raises(ModelError, match=text):
        read_robot_description(path)
