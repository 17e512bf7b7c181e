"""Collision meshes: found as ROS finds them, and refused in a line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mbaid_ros.core.errors import ModelError
from mbaid_ros.session.robot import mesh_points

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


def test_what_is_not_there_too_large_or_relative_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    large = tmp_path / 'large.stl'
    large.write_bytes(bytes(100))
    monkeypatch.setattr('mbaid_ros.limits.MESH_BYTES', 99)
    for name, reason in (
        (str(tmp_path / 'none.stl'), 'No such file'),
        (str(tmp_path), 'accepted: a regular file'),
        (str(large), 'more than 99 bytes'),
        ('meshes/hand.stl', 'is relative'),
        ('package://none/hand.stl', 'AMENT_PREFIX_PATH has no package'),
    ):
        with pytest.raises(ModelError, match=reason):
            mesh_points(name)
