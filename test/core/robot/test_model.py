"""The robot as arrays, against pinocchio, joints that follow others, and robots that are not their URDF."""

from __future__ import annotations

import os
import re

import numpy as np
import pinocchio
import pytest

from mbaid_ros.core.geometry import Array, vec
from mbaid_ros.core.links import independent_errors, known_bodies
from mbaid_ros.core.robot.body import are_physical, is_physical, standard
from mbaid_ros.core.robot.model import RobotModel, displaced, load_model, parse
from mbaid_ros.core.robot.momentum import KnownErrors
from mbaid_ros.core.robot.urdf import Mimic, transmission
from mbaid_ros.errors import ModelError
from mbaid_ros.simulation.true_robot import ErrorStds, draw, generator, with_bodies
from random_robots import random_inertial, random_urdf
from simulated import CONFIG, drawn, robot

SEEDS = range(8)
# Sums of at most ten bodies, each rounded a few times.
ROUNDING = 1e-12


def standard_of(inertia: pinocchio.Inertia) -> Array:
    """Return (m, h, I_o) of pinocchio's inertia, which is about the centre of mass."""
    return standard(np.concatenate(([inertia.mass], inertia.lever, vec(inertia.inertia))))


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
    # The name of a body is that of a part of it that is known.
    names = {
        target: set(known_bodies(model, KnownErrors((1,), np.eye(10)), unknown=(target,)).labels)
        for target in ('debris', 'arm')
    }
    assert names == {'debris': {'link:arm'}, 'arm': {'link:debris'}}


@pytest.mark.parametrize(('name', 'last'), [('table1', 'link4'), ('ets7', 'link6'), ('servicer7', 'link7')])
def test_the_last_link_is_the_furthest_with_a_mass(name: str, last: str) -> None:
    model = robot(name)
    assert model.last_link == last
    tip = f'<link name="tip"/><joint name="t" type="fixed"><parent link="{last}"/><child link="tip"/></joint></robot>'
    urdf = (CONFIG / f'{name}.urdf').read_text(encoding='utf-8').replace('</robot>', tip)
    assert load_model(urdf).last_link == last


def test_the_last_link_is_behind_most_joints_whichever_branch_comes_last() -> None:
    body = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    tree = {'upper': 'base', 'lower': 'upper', 'hand': 'lower', 'wing': 'base', 'flap': 'wing'}
    links = ''.join(f'<link name="{name}">{body}</link>' for name in ('base', *tree))
    joints = ''.join(
        f'<joint name="to_{child}" type="continuous"><parent link="{parent}"/><child link="{child}"/></joint>'
        for child, parent in tree.items()
    )
    model = load_model(f'<robot name="r">{links}{joints}</robot>')
    assert model.links[-1].name != 'hand'
    assert model.last_link == 'hand'


@pytest.mark.parametrize(
    ('before', 'after', 'reported'),
    [
        ('<axis', '<dynamics damping="x"/><axis', 'damping value (x) is not a valid float'),
        ('<robot ', '<robot version="9.9" ', "Invalid 'version' specified"),
        ('</link>', '<visual><geometry><box size="a b c"/></geometry></visual></link>', ''),
    ],
)
def test_what_the_parser_complains_of_is_in_the_error_alone(
    before: str, after: str, reported: str, capfd: pytest.CaptureFixture[str]
) -> None:
    urdf = (CONFIG / 'table1.urdf').read_text(encoding='utf-8').replace(before, after, 1)
    if reported:
        with pytest.raises(ModelError, match=re.escape(reported)):
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
        ({'left': Mimic('missing', 1.0, 0.0)}, "'left' mimics 'missing', which is no joint that moves"),
        ({'left': Mimic('right', 1.0, 0.0), 'right': Mimic('left', 1.0, 0.0)}, 'mimics joints that mimic it'),
    ],
)
def test_what_moves_nothing_is_refused(mimics: dict[str, Mimic], named: str) -> None:
    with pytest.raises(ModelError, match=named):
        transmission(JOINTS, mimics)


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


SIZES = ErrorStds(0.01, 1e-3, 2e-3, 3e-3, 4e-3, 5e-3)
BLOCK = {
    'links_relative_std': 'bodies', 'zero_std': 'zeros', 'origin_std': 'origins', 'axis_std': 'tilts',
    'mount_position_std': 'mount', 'mount_orientation_std': 'mount',
}  # fmt: skip


def test_the_spread_is_that_of_the_sizes() -> None:
    model, count = robot('servicer7'), 400
    draws = [draw(model, 'link7', SIZES, generator(seed)) for seed in range(count)]
    prior = independent_errors(model.body_parameters(without='link7'), SIZES.links_relative_std)
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
    prior = independent_errors(known, 0.4).factor
    plain = prior @ np.random.default_rng(0).standard_normal((len(prior), 50))
    assert np.mean(are_physical((plain.T.reshape(50, -1, 10) + known[:7]).reshape(-1, 10))) < 0.7
