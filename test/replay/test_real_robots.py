"""Robot descriptions of others through `simulate` and `replay`, and ten minutes of a robot with noise."""

from __future__ import annotations

import json
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

from mbaid_ros.config.estimator_parameters import EXACT
from mbaid_ros.replay.arguments import replay, simulate
from sessions import NOISE
from simulated import CONFIG, assigned

PACKAGE = 'example-robot-data'
# Those that cannot be used, and why.
REFUSED = {
    'alex_psyonic_hands.urdf': "mimics 'index_q1', which is no joint that moves",  # its joint is called otherwise
    'romeo.urdf': 'nothing that has inertia moves with joints LFinger',
    'romeo_laas_small.urdf': 'nothing that has inertia moves with joints l_gripper_joint',
    'ur3.urdf': 'gives <robot> no name',  # an empty file but for that
}
FEWEST = 62
GRIPPER = """<robot name="gripper">
  <link name="world"/>
  <joint name="stand" type="fixed"><parent link="world"/><child link="base"/></joint>
  <link name="base"><inertial><mass value="40"/>
    <inertia ixx="3" ixy="0.1" ixz="0" iyy="2" iyz="0.2" izz="4"/></inertial></link>
  <link name="camera"><inertial><mass value="0"/>
    <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
  <joint name="mount" type="fixed"><parent link="base"/><child link="camera"/></joint>
  {links}
</robot>"""
LINK = """<link name="{name}"><inertial><origin xyz="0.1 0.02 0.1"/><mass value="{mass}"/>
    <inertia ixx="0.3" ixy="0.01" ixz="0" iyy="0.2" iyz="0.02" izz="0.4"/></inertial></link>
  <joint name="{name}_joint" type="{kind}"><parent link="{parent}"/><child link="{name}"/><origin xyz="0.3 0 0.4"/>
    <axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}" effort="1" velocity="2"/>{mimic}</joint>
"""


def robots() -> list[Path]:
    """Return the descriptions that the package brings; none where it is not installed."""
    try:
        files = metadata.files(PACKAGE) or []
    except metadata.PackageNotFoundError:
        return []
    return sorted(Path(str(file.locate())) for file in files if file.suffix == '.urdf')


ROBOTS = robots()
NAMES = [f'{path.parent.parent.name}/{path.name}' for path in ROBOTS]


def both(urdf: Path, folder: Path) -> tuple[int, int | None]:
    """Return the exit codes of `simulate` and, after 0, of `replay`, for three seconds of the default motion."""
    motion = ['--duration', '3', *assigned({'joint_rate': 20, 'odometry_rate': 20})]
    made = simulate(['--model', str(urdf), *motion, '--output', str(folder / 'bag')])
    return made, replay([str(folder / 'bag'), '--model', str(urdf), '--method', 'difference']) if made == 0 else None


@pytest.mark.skipif(not ROBOTS, reason=f'{PACKAGE} is not installed')
@pytest.mark.parametrize('urdf', ROBOTS, ids=NAMES)
def test_robots_of_others_are_taken(urdf: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    codes = both(urdf, tmp_path)
    errors = capfd.readouterr().err
    if urdf.name in REFUSED:
        assert codes == (2, None)
        assert REFUSED[urdf.name] in errors
        assert errors.count('\n') == 1
    else:
        assert codes[0] == 0
        assert codes[1] in {0, 3}  # 3: so short a motion need not determine anything
        assert not errors


@pytest.mark.skipif(not ROBOTS, reason=f'{PACKAGE} is not installed')
def test_most_of_them_are() -> None:
    assert sum(path.name not in REFUSED for path in ROBOTS) >= FEWEST


@pytest.mark.parametrize('method', ['difference', 'trajectory'])
def test_a_robot_without_joints_determines_nothing(
    method: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    urdf = tmp_path / 'body.urdf'
    urdf.write_text(
        '<robot name="body"><link name="base"><inertial><mass value="100"/>'
        '<inertia ixx="10" ixy="0" ixz="0" iyy="20" iyz="0" izz="15"/></inertial></link></robot>'
    )
    bag, turning = tmp_path / 'bag', 'initial.base_angular_velocity:=[0.1, 0.2, 0.3]'
    made = ['--model', str(urdf), '-p', 'motion.kind:=passive', '-p', turning, '--duration', '3', '--output', str(bag)]
    assert simulate(made) == 0
    assert replay([str(bag), '--model', str(urdf), '--method', method]) == 3
    assert not capfd.readouterr().err


def test_a_hand_whose_fingers_follow_each_other_is_identified(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """On the ground in its file, with a frame that has mass 0: the estimate is that of what moved."""
    slide = {'kind': 'prismatic', 'parent': 'hand', 'axis': '0 1 0', 'lower': 0.0, 'upper': 0.3}
    turn = {'kind': 'revolute', 'lower': -2.0, 'upper': 2.0, 'mimic': ''}
    parts = [
        {'name': 'arm', 'mass': 6, 'parent': 'base', 'axis': '0 0 1', **turn},
        {'name': 'fore', 'mass': 5, 'parent': 'arm', 'axis': '0 1 0', **turn},
        {'name': 'hand', 'mass': 8, 'parent': 'fore', 'axis': '1 0 0', **turn},
        {'name': 'left', 'mass': 2, 'mimic': '', **slide},
        {'name': 'right', 'mass': 3, 'mimic': '<mimic joint="left_joint" multiplier="-1" offset="0.01"/>', **slide},
    ]
    parts[-1] |= {'lower': -0.3, 'upper': 0.05}
    urdf = tmp_path / 'gripper.urdf'
    urdf.write_text(GRIPPER.format(links='  '.join(LINK.format(**part) for part in parts)))
    bag, result = tmp_path / 'bag', tmp_path / 'result.json'
    motion = {'kind': 'random', 'period_min': 3.0, 'period_max': 8.0}
    moving = {f'motion.{name}': value for name, value in motion.items()} | {'joint_rate': 50, 'odometry_rate': 50}
    made = ['--model', str(urdf), '--duration', '12', *assigned({**moving, 'target_link': 'hand'})]
    assert simulate([*made, '--output', str(bag)]) == 0
    options = assigned({**EXACT, 'target_link': 'hand'})
    assert replay([str(bag), '--model', str(urdf), *options, '--json', str(result)]) == 0
    found = json.loads(result.read_text())
    assert found['model']['without_inertia'] == ['camera']
    assert (found['model']['foreign'], found['model']['unheard'], found['model']['chosen']) == ([], [], True)
    assert 'world' in found['model']['dropped'][0]
    text = capsys.readouterr().out
    assert text.index("'base' floats") < text.index('the inertia of hand is identified')
    assert found['estimate']['mass'] == pytest.approx(8.0, rel=1e-3)
    assert np.array(found['estimate']['com']) == pytest.approx([0.1, 0.02, 0.1], abs=1e-3)


# -- Ten minutes of a robot that may differ from its URDF: what is small in a minute must not add up.


@pytest.mark.long
def test_noise_of_the_joints_pulls_no_unknown_aside(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, bag = ['--model', str(CONFIG / 'servicer7.urdf')], tmp_path / 'bag'
    noise = assigned(NOISE)
    motion = ['--params', str(CONFIG / 'servicer7_simulator.yaml'), '--duration', '600']
    assert simulate([*model, *motion, *noise, '--output', str(bag)]) == 0
    capsys.readouterr()
    assert replay([str(bag), *model, *noise, '-p', 'target_link:=link7', '--json', '-']) == 0
    made, truth = json.loads(capsys.readouterr().out), json.loads((bag / 'truth.json').read_text())
    error, std = (
        np.array([one['mass'], *one['com'], *one['inertia'].values()]) for one in (made['estimate'], made['std'])
    )
    error -= [truth['mass'], *truth['com'], *truth['inertia'].values()]
    # 1.9 standard deviations and more when the noise was taken off the target's numbers alone.
    assert np.all(np.abs(error) < 1.5 * std)
