"""The script that measures the sensors' noise finds what the simulator added."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from mbaid_ros.replay import simulate
from simulated import CONFIG

SCRIPT = runpy.run_path(str(CONFIG.parent / 'scripts' / 'noise_at_rest.py'))
NOISE = {
    'joint_position': 2e-4,
    'joint_velocity': 1e-3,
    'base_position': 5e-4,
    'base_orientation': 3e-4,
    'base_linear_velocity': 2e-3,
    'base_angular_velocity': 4e-4,
}


@pytest.fixture(name='bag')
def bag_at_rest(tmp_path: Path) -> str:
    """Ten seconds of a robot with braked joints that tumbles slowly."""
    parameters = {
        'motion.kind': 'random',
        'motion.amplitude': 0.0,
        **{f'noise.{name}': value for name, value in NOISE.items()},
    }
    words = [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]
    files = ['--model', f'{CONFIG}/servicer7.urdf', '--params', f'{CONFIG}/servicer7_simulator.yaml']
    assert simulate.main([*files, *words, '--duration', '10', '--output', str(tmp_path / 'bag')]) == 0
    return str(tmp_path / 'bag')


def test_it_finds_the_noise_that_was_added(bag: str) -> None:
    found = SCRIPT['channels'](bag, '/joint_states', '/odom')
    for name, std in NOISE.items():
        # Of several hundred samples, and the noisiest of up to seven channels.
        assert SCRIPT['scatter'](found[name]) == pytest.approx(std, rel=0.15)


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert SCRIPT['main'](arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ''
    assert captured.err.count('\n') == 1
    return captured.err


def test_a_topic_that_the_bag_lacks_is_one_line(bag: str, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused(capsys, bag, '--odom', '/mocap')
    assert "'/mocap'" in line
    assert '/odom' in line


def test_topics_of_other_types_are_one_line(bag: str, capsys: pytest.CaptureFixture[str]) -> None:
    for option, topic, found, accepted in (
        ('--odom', '/joint_states', 'sensor_msgs/msg/JointState', 'nav_msgs/msg/Odometry'),
        ('--joint-states', '/odom', 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/JointState'),
    ):
        line = refused(capsys, bag, option, topic)
        assert f"topic '{topic}' of bag '{bag}' is of type {found}; accepted: {accepted}" in line
