"""The robot as arrays, against pinocchio's own model, and joints that follow others."""

from __future__ import annotations

import os
import re

import numpy as np
import pinocchio
import pytest

from mbaid_ros.core import geometry
from mbaid_ros.core.errors import ModelError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import RobotModel, load_model, parse
from mbaid_ros.core.robot.momentum import standard
from mbaid_ros.core.robot.urdf import Mimic, transmission
from random_robots import random_inertial, random_urdf
from simulated import CONFIG, robot

SEEDS = range(8)
# Sums of at most ten bodies, each rounded a few times.
ROUNDING = 1e-12


def standard_of(inertia: pinocchio.Inertia) -> Array:
    """Return (m, h, I_o) of pinocchio's inertia, which is about the centre of mass."""
    return standard(np.concatenate(([inertia.mass], inertia.lever, geometry.vec(inertia.inertia))))


def random_tree(seed: int, joints: int = 8) -> RobotModel:
    return load_model(random_urdf(np.random.default_rng(seed), joints))


@pytest.mark.parametrize('seed', SEEDS)
def test_bodies_are_those_of_pinocchio(seed: int) -> None:
    model = random_tree(seed)
    expected = [standard_of(inertia) for inertia in parse(model).inertias[1:]]
    found = model.body_parameters()
    assert found == pytest.approx(np.array(expected), rel=ROUNDING, abs=ROUNDING * float(np.abs(found).max()))


@pytest.mark.parametrize('seed', SEEDS)
def test_joints_are_those_of_pinocchio(seed: int) -> None:
    model = random_tree(seed)
    peer = parse(model)
    assert model.joint_names == tuple(peer.names)[2:]
    for index, joint in enumerate(list(peer.joints)[2:]):
        placement = peer.jointPlacements[joint.id]
        assert np.array_equal(model.rotations[index], placement.rotation)
        assert np.array_equal(model.positions[index], placement.translation)
        assert model.parents[index] == peer.parents[joint.id] - 1
        assert model.parents[index] <= index  # a body's number is above its parent's
        kind = joint.shortname()
        assert model.prismatic[index] == ('Prismatic' in kind or 'JointModelP' in kind)
        assert model.continuous[index] == (joint.nq == 2)
    assert np.linalg.norm(model.axes, axis=1) == pytest.approx(np.ones(model.joints), abs=1e-15)


def test_a_link_on_a_fixed_joint_belongs_to_the_body_that_carries_it() -> None:
    rng = np.random.default_rng(1)
    urdf = (
        f'<robot name="r"><link name="base">{random_inertial(rng)}</link><link name="arm">{random_inertial(rng)}</link>'
        f'<link name="tool"/><link name="debris">{random_inertial(rng)}</link>'
        '<joint name="elbow" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>'
        '<joint name="mount" type="fixed"><parent link="arm"/><child link="tool"/>'
        '<origin xyz="0.1 0.2 0.3" rpy="0.1 0.2 0.3"/></joint>'
        '<joint name="grip" type="fixed"><parent link="tool"/><child link="debris"/>'
        '<origin xyz="0 0 1" rpy="1 0 0"/></joint></robot>'
    )
    model = load_model(urdf)
    debris, tool = model.link('debris'), model.link('tool')
    assert (model.base_link, model.joints, debris.body, tool.body) == ('base', 1, 1, 1)
    assert not tool.parameters.any()
    frame = parse(model).frames[parse(model).getFrameId('debris')]
    assert np.array_equal(debris.rotation, frame.placement.rotation)
    assert np.array_equal(debris.position, frame.placement.translation)
    # The arm itself stays known when the debris fixed to it is not.
    assert model.body_parameters(without='debris')[1] == pytest.approx(model.link('arm').parameters)
    # Of links that are fixed to each other what comes last is what is held.
    assert model.last_link == 'debris'


@pytest.mark.parametrize(('name', 'last'), [('table1', 'link4'), ('ets7', 'link6'), ('servicer7', 'link7')])
def test_the_last_link_is_the_furthest_with_a_mass(name: str, last: str) -> None:
    model = robot(name)
    assert model.last_link == last
    tip = f'<link name="tip"/><joint name="t" type="fixed"><parent link="{last}"/><child link="tip"/></joint></robot>'
    urdf = (CONFIG / f'{name}.urdf').read_text(encoding='utf-8').replace('</robot>', tip)
    assert load_model(urdf).last_link == last


@pytest.mark.parametrize(
    ('before', 'after', 'told'),
    [
        ('<axis', '<dynamics damping="x"/><axis', 'damping value (x) is not a valid float'),
        ('<robot ', '<robot version="9.9" ', "Invalid 'version' specified"),
        ('</link>', '<visual><geometry><box size="a b c"/></geometry></visual></link>', ''),
    ],
)
def test_what_the_parser_complains_of_is_in_the_error_alone(
    before: str, after: str, told: str, capfd: pytest.CaptureFixture[str]
) -> None:
    urdf = (CONFIG / 'table1.urdf').read_text(encoding='utf-8').replace(before, after, 1)
    if told:
        with pytest.raises(ModelError, match=re.escape(told)):
            load_model(urdf)
    else:
        assert load_model(urdf).joints == 4
    assert capfd.readouterr() == ('', '')
    os.write(2, b'still there')
    assert capfd.readouterr().err == 'still there'


JOINTS = ('a', 'left', 'right', 'b', 'tip')
MIMICS = {'left': Mimic('right', -1.0, 0.1), 'tip': Mimic('left', 2.0, 0.5)}


def test_followers_are_where_their_driver_puts_them() -> None:
    moved = transmission(JOINTS, MIMICS)
    assert [JOINTS[place] for place in moved.independent] == ['a', 'right', 'b']
    a, right, b = positions = np.array([0.3, -0.7, 1.1])
    left = -right + 0.1
    assert moved.positions(positions) == pytest.approx([a, left, right, b, 2.0 * left + 0.5], abs=1e-15)
    step = 1e-3
    change = (moved.positions(positions + step) - moved.positions(positions)) / step
    assert moved.rates(np.ones(3)) == pytest.approx(change, abs=1e-9)
    assert not moved.direct


@pytest.mark.parametrize(
    ('mimics', 'named'),
    [
        ({'left': Mimic('nobody', 1.0, 0.0)}, "'left' mimics 'nobody', which is no joint that moves"),
        ({'left': Mimic('right', 1.0, 0.0), 'right': Mimic('left', 1.0, 0.0)}, 'mimics joints that mimic it'),
    ],
)
def test_what_moves_nothing_is_refused(mimics: dict[str, Mimic], named: str) -> None:
    with pytest.raises(ModelError, match=named):
        transmission(JOINTS, mimics)
