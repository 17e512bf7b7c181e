"""The document of a robot that is not its URDF says what its arrays say."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.model_errors import ModelErrors, changing_link, displaced, with_bodies
from random_robots import random_urdf
from simulated import drawn

ALL = {'links_relative_std': 0.02, 'origin_std': 0.01, 'axis_std': 0.02, 'zero_std': 0.01, 'mount_position_std': 0.01}


def differences(left: RobotModel, right: RobotModel) -> float:
    """Return the largest difference between two robots' arrays."""
    pairs = [(getattr(left, name), getattr(right, name)) for name in ('positions', 'rotations', 'axes')]
    pairs += [(a.parameters, b.parameters) for a, b in zip(left.links, right.links, strict=True)]
    return float(max(np.abs(a - b).max() for a, b in pairs))


@pytest.mark.parametrize('seed', range(8))
def test_the_document_says_what_the_arrays_say(seed: int) -> None:
    model = load_model(random_urdf(np.random.default_rng(seed)))
    errors, true = drawn(model, seed, **ALL)
    fixed = (model.last_link,)
    assert differences(true, with_bodies(displaced(model, errors.origins, errors.tilts), errors.bodies, fixed)) < 1e-12
    assert differences(true, model) > 1e-3
    assert (true.joint_names, true.parents, true.prismatic) == (model.joint_names, model.parents, model.prismatic)
    # What a whole body has more is what was drawn, whichever of its links takes it.
    assert true.body_parameters() - model.body_parameters() == pytest.approx(errors.bodies, abs=1e-12)
    assert np.array_equal(true.link(model.last_link).parameters, model.link(model.last_link).parameters)


def test_zeros_and_mount_are_no_part_of_the_robot() -> None:
    model = load_model(random_urdf(np.random.default_rng(3)))
    errors, true = drawn(model, zero_std=0.1, mount_position_std=0.1, mount_orientation_std=0.1)
    assert not errors.exact
    assert true is model
    assert ModelErrors.none(model.joints).exact


INERTIA = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
CORNER = f"""<?xml version="1.0" encoding="UTF-8"?>
<robot name="corner" xmlns:xacro="http://ros.org/wiki/xacro">
  <link name="base"><inertial><mass value="5"/>{INERTIA}
  <link name="arm"><inertial><mass value="2"/>{INERTIA}
  <link name="hand"><inertial><mass value="1"/>{INERTIA}
  <joint name="elbow" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
  <joint name="wrist" type="continuous"><parent link="arm"/><child link="hand"/><axis xyz="0 1 0"/>
    <origin xyz="1 0 0" rpy="0.3 1.5707963267948966 0"/></joint>
</robot>"""


def test_a_joint_without_origin_and_one_whose_angles_are_singular() -> None:
    model = load_model(CORNER)
    errors, true = drawn(model, origin_std=0.01, axis_std=1e-3)
    assert differences(true, displaced(model, errors.origins, errors.tilts)) < 1e-12
    assert np.any(true.positions[0] != 0.0)


def test_the_heaviest_link_of_a_body_takes_the_change() -> None:
    bracket = f'<link name="bracket"><inertial><mass value="1e-3"/>{INERTIA}'.replace('="1"', '="1e-6"')
    fixed = '<joint name="fix" type="fixed"><parent link="base"/><child link="bracket"/>'
    text = CORNER.replace('  <link name="base">', f'{bracket}<link name="base">')
    text = text.replace('</robot>', f'{fixed}<origin xyz="1 2 3" rpy="1 1 1"/></joint></robot>')
    model = load_model(text)
    link = changing_link(model, 0)
    assert link is not None
    assert link.name == 'base'
    assert changing_link(model, 2, ('hand',)) is None
    errors, true = drawn(model, links_relative_std=0.1)
    assert np.array_equal(true.link('bracket').parameters, model.link('bracket').parameters)
    assert true.body_parameters() - model.body_parameters() == pytest.approx(errors.bodies, abs=1e-12)
