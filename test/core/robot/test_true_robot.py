"""Robots that are not their URDF: drawn at random, written as a description, and read back."""

from __future__ import annotations

import numpy as np
import pytest

from mbaid_ros.core.robot.model import RobotModel, displaced, load_model
from mbaid_ros.core.robot.model_errors import declared, with_bodies
from mbaid_ros.core.robot.momentum import are_physical, is_physical
from mbaid_ros.simulation.true_robot import ErrorSizes, draw, generator
from random_robots import random_urdf
from simulated import drawn, robot

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


SIZES = ErrorSizes(0.01, 1e-3, 2e-3, 3e-3, 4e-3, 5e-3)
BLOCK = {
    'links_relative_std': 'bodies', 'zero_std': 'zeros', 'origin_std': 'origins', 'axis_std': 'tilts',
    'mount_position_std': 'mount', 'mount_orientation_std': 'mount',
}  # fmt: skip


def test_the_spread_is_that_of_the_sizes() -> None:
    model, count = robot('servicer7'), 400
    draws = [draw(model, 'link7', SIZES, generator(seed)) for seed in range(count)]
    prior = declared(model.body_parameters(without='link7'), SIZES.links_relative_std)
    units = np.linalg.solve(prior.factor, np.array([errors.bodies[list(prior.bodies)].ravel() for errors in draws]).T).T
    blocks = {'bodies': (units, 1.0)}
    for name in ('zero_std', 'origin_std', 'mount_position_std', 'mount_orientation_std'):
        part = {'mount_position_std': np.s_[3:], 'mount_orientation_std': np.s_[:3]}.get(name, np.s_[:])
        blocks[name] = (np.array([getattr(e, BLOCK[name])[part].ravel() for e in draws]), vars(SIZES)[name])
    for name, (values, std) in blocks.items():
        assert values.std() == pytest.approx(std, rel=4.0 / np.sqrt(2.0 * values.size)), name
        assert abs(values.mean()) < 4.0 * std / np.sqrt(values.size), name
    tilts = np.array([errors.tilts for errors in draws])
    assert np.abs(np.sum(tilts * model.axes, axis=-1)).max() < 1e-17
    # Two directions of three.
    assert np.sum(tilts**2, axis=-1).mean() == pytest.approx(2.0 * SIZES.axis_std**2, rel=0.1)


def test_the_target_is_exact_whatever_else_its_body_holds() -> None:
    for seed in range(10):
        model = load_model(random_urdf(np.random.default_rng(seed)))
        known = model.body_parameters(without=model.last_link)
        errors, true = drawn(model, seed, links_relative_std=0.05)
        assert np.array_equal(true.link(model.last_link).parameters, model.link(model.last_link).parameters)
        assert np.array_equal(errors.bodies.any(axis=1), known[:, 0] > 0.0)


def test_bodies_that_cannot_exist_are_drawn_again() -> None:
    model = robot('servicer7')
    for seed in range(5):
        _, true = drawn(model, seed, links_relative_std=0.4)
        assert are_physical(true.body_parameters()).all()
        assert all(is_physical(link.parameters) for link in true.links if link.parameters[0] > 0.0)
    # Such a spread does ask for it: of plain draws most are no bodies.
    known = model.body_parameters(without='link7')
    prior = declared(known, 0.4).factor
    plain = prior @ np.random.default_rng(0).standard_normal((len(prior), 50))
    assert np.mean(are_physical((plain.T.reshape(50, -1, 10) + known[:7]).reshape(-1, 10))) < 0.7
