"""The robot of a run: its survey, and its collision meshes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mbaid_ros.core.errors import ModelError
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.session.model_summary import summarise
from mbaid_ros.session.robot import mesh_points

FINE = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
HEAVY = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="3"/>'  # izz > ixx + iyy
PLATE = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="2.001"/>'  # thin, and rounded
JOINT = '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><axis xyz="0 0 1"/></joint>'


def body(name: str, inertia: str = FINE) -> str:
    return f'<link name="{name}"><inertial><mass value="2"/>{inertia}</inertial></link>'


def odd() -> str:
    """Return a robot with a base that weighs nothing, a frame, a hollow link, and an inertia that cannot be."""
    links = '<link name="base"/><link name="camera"/><link name="rod"/>' + body('fore', HEAVY) + body('hand', PLATE)
    ends = [('c', 'fixed', 'fore', 'camera'), ('a', 'continuous', 'base', 'rod'), ('b', 'continuous', 'rod', 'fore')]
    ends += [('w', 'continuous', 'fore', 'hand'), ('x', 'continuous', 'hand', 'tool')]
    return f'<robot name="odd">{links}{body("tool")}{"".join(JOINT.format(*each) for each in ends)}</robot>'


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
