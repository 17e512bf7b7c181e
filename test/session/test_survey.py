"""What a run takes the robot for: what is said of it, and what is warned of."""

from __future__ import annotations

import pytest

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.session import Session, summarise
from simulated import CONFIG, robot

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
    assert "robot 'odd': 'base' floats, 4 joints, 4 kg beside target link 'tool'" in text
    assert "'tool' is a guess" in text
    assert 'links without inertia: camera' in text
    assert 'lacks: gripper' in text
    assert 'no message has: w' in text
    base, rod, fore = found.warnings
    assert "base 'base' has no inertia" in base
    assert rod.endswith(': rod')
    assert 'gives fore' in fore


def test_a_robot_that_is_as_it_should_be_takes_one_line() -> None:
    found = summarise(robot('servicer7'), 'link7', heard=robot('servicer7').joint_names)
    assert found.lines == ["robot 'servicer7': 'base_link' floats, 7 joints, 633 kg beside target link 'link7'"]
    assert not found.warnings


def test_a_base_that_is_to_be_identified_needs_no_inertia() -> None:
    assert not any('base' in warning for warning in summarise(load_model(odd()), unknown=['base']).warnings)
    assert not any('base' in warning for warning in summarise(load_model(odd()), 'base').warnings)


@pytest.mark.parametrize(('target', 'chosen'), [('', False), ('link7', True)])
def test_a_session_knows_who_chose_its_target(target: str, chosen: bool) -> None:
    urdf = (CONFIG / 'servicer7.urdf').read_text()
    found = Session(build(EstimatorConfig, {'target_link': target}), urdf).model_summary()
    assert (found.target_link, found.chosen, found.foreign, found.unheard) == ('link7', chosen, (), ())
