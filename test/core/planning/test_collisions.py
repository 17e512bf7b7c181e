from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.errors import ModelError
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.planning.collisions import Collisions, no_mesh
from mbaid_ros.session.robot import mesh_points

INERTIAL = '<inertial><mass value="5"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
BOX, BALL = '<box size="1 1 1"/>', '<sphere radius="0.1"/>'


def link(name: str, shape: str = '', place: str = '0 0 0') -> str:
    collision = f'<collision><origin xyz="{place}"/><geometry>{shape}</geometry></collision>' if shape else ''
    return f'<link name="{name}">{INERTIAL}{collision}</link>'


def joint(name: str, parent: str, child: str, place: str, kind: str = 'revolute') -> str:
    limit = '<limit lower="-3.1" upper="3.1" effort="1" velocity="1"/>' if kind == 'revolute' else ''
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{place}"/><axis xyz="0 0 1"/>{limit}</joint>'
    )


def arm(kind: str = 'revolute', hand: str = BALL) -> RobotModel:
    """Return a box with two links of 1 m at its side, the hand at the end of the second."""
    parts = [
        link('base', BOX), link('upper'), link('lower', hand, '1 0 0'),
        joint('shoulder', 'base', 'upper', '0.5 0 0'), joint('elbow', 'upper', 'lower', '1 0 0', kind),
    ]  # fmt: skip
    return load_model(f'<robot name="arm">{"".join(parts)}</robot>')


@pytest.mark.parametrize('kind', ['revolute', 'continuous'])
def test_an_arm_that_folds_back_onto_its_base_is_not_clear(kind: str) -> None:
    shapes = Collisions(arm(kind), 0.02, np.zeros(2), no_mesh)
    assert shapes.pairs == 1
    stretched, folded = np.array([0.0, 0.5]), np.array([0.0, np.pi - 0.01])
    assert shapes.clear(np.stack([stretched, stretched]))
    assert not shapes.clear(np.stack([stretched, folded]))


@pytest.mark.parametrize(('clearance', 'clear'), [(0.0, True), (0.1, True), (0.2, False)])
def test_shapes_keep_the_clearance_that_is_asked_for(clearance: float, clear: bool) -> None:
    # The upper arm stands off the base's side, the lower one comes back over it: the hand is 0.15 m above the box.
    over = np.array([np.pi / 2.0, np.pi - np.arccos(0.25)])
    assert Collisions(arm(), clearance, np.zeros(2), no_mesh).clear(over[None]) == clear


def test_what_touches_where_the_motion_begins_is_told_and_left_out() -> None:
    folded = np.array([0.0, np.pi - 0.01])
    shapes = Collisions(arm(), 0.02, folded, no_mesh)
    assert shapes.notes == ('touch where the motion begins, and are not compared: base and lower',)
    assert shapes.clear(folded[None])


@pytest.mark.parametrize(('clearance', 'clear'), [(0.0, True), (0.1, True), (0.2, False)])
def test_a_mesh_keeps_it_as_its_hull(clearance: float, clear: bool) -> None:
    """An octahedron, of the ball's height, given ten times as large."""
    corners = np.concatenate((np.eye(3), -np.eye(3)))
    over = np.array([np.pi / 2.0, np.pi - np.arccos(0.25)])
    made = arm(hand='<mesh filename="octahedron.stl" scale="0.1 0.1 0.1"/>')
    shapes = Collisions(made, clearance, np.zeros(2), {'octahedron.stl': corners}.__getitem__)
    assert (shapes.shapes, shapes.notes) == (2, ())
    assert shapes.clear(over[None]) == clear


def test_a_mesh_that_cannot_be_read_is_left_out_and_named_with_the_reason() -> None:
    made = arm(hand='<mesh filename="package://none/hand.stl"/>')
    shapes = Collisions(made, 0.02, np.zeros(2), mesh_points)
    (note,) = shapes.notes
    assert note.startswith("collision meshes of lower are left out: mesh 'package://none/hand.stl': AMENT_PREFIX_PATH")
    assert not shapes.pairs
    flat = Collisions(made, 0.02, np.zeros(2), lambda _: np.zeros((4, 3)))
    assert flat.notes[0].startswith(
        "collision meshes of lower are left out: mesh 'package://none/hand.stl' has no hull"
    )


def test_a_shape_that_is_none_is_refused() -> None:
    with pytest.raises(ModelError, match='a collision shape of the robot description cannot be read'):
        Collisions(arm(hand='<sphere/>'), 0.02, np.zeros(2), no_mesh)
