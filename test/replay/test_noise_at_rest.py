"""The executable `noise_at_rest` finds the noise that the simulator added, and notices when the robot did not rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mbaid_ros.bags import BagReader, BagWriter
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.parameters import build
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array
from mbaid_ros.replay import simulate
from mbaid_ros.replay.at_rest import measure
from mbaid_ros.replay.noise_at_rest import main
from recorded import JOINT_STATE, ODOMETRY
from simulated import CONFIG

TOPICS = '/joint_states', '/odom'
RATE = 100.0  # Hz, of both topics
NOISE = {
    'joint_position': 2e-4,
    'joint_velocity': 1e-3,
    'base_position': 5e-4,
    'base_orientation': 3e-4,
    'base_linear_velocity': 2e-3,
    'base_angular_velocity': 4e-4,
}


@pytest.fixture(scope='module', name='bag')
def bag_at_rest(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Ten seconds of a robot with braked joints that tumbles slowly."""
    path = tmp_path_factory.mktemp('rest') / 'bag'
    parameters = {
        'motion.kind': 'random',
        'motion.amplitude': 0.0,
        **{f'noise.{name}': value for name, value in NOISE.items()},
    }
    words = [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]
    files = ['--model', f'{CONFIG}/servicer7.urdf', '--params', f'{CONFIG}/servicer7_simulator.yaml']
    assert simulate.main([*files, *words, '--duration', '10', '--output', str(path)]) == 0
    return str(path)


def changed(
    bag: str, path: Path, joints: Callable[[int, Any], Any], base: Callable[[int, Any], Any] | None = None
) -> str:
    """Write a bag anew, every n-th message of a topic as functions of n and the message have it, None is without it."""
    with BagReader(bag) as before, BagWriter(path) as after:
        for topic, kind, change in zip(TOPICS, (JOINT_STATE, ODOMETRY), (joints, base or same), strict=True):
            after.add_topic(topic, kind)
            for number, (_, message, time) in enumerate(before.read([topic])):
                if (made := change(number, message)) is not None:
                    after.write(topic, made, time)
    return str(path)


def same(_number: int, message: Any) -> Any:
    return message


def turned(path: Callable[[float], float], joint: int = 2) -> Callable[[int, Any], Any]:
    """Return what turns a joint along a path over time (s)."""

    def change(number: int, message: Any) -> Any:
        position: Array = np.array(message.position)
        position[joint] += path(number / RATE)
        return replace(message, position=position)

    return change


def test_it_finds_the_noise_that_was_added(bag: str) -> None:
    found = measure(bag, *TOPICS)
    assert found.warnings == ()
    # Of several hundred samples, and the noisiest of up to seven channels.
    assert found.stds == pytest.approx(NOISE, rel=0.15)


def test_it_prints_a_parameter_file(bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([bag]) == 0
    captured = capsys.readouterr()
    assert captured.err == ''
    file = tmp_path / 'noise.yaml'
    file.write_text(captured.out)
    given = build(EstimatorConfig, load_parameter_file(file, 'estimator')).noise
    assert {name: getattr(given, name) for name in NOISE} == pytest.approx(dict(NOISE), rel=0.3)


@pytest.mark.parametrize(
    ('path', 'begin', 'end'),
    [
        (lambda time: 0.05 * min(time, 3.0), 3.0, 10.0),
        (lambda time: 0.002 * np.sin(2.0 * np.pi * time) * (time > 6.0), 0.0, 6.0),
    ],
)
def test_a_joint_that_moves_at_times_is_told_and_the_rest_counts(
    bag: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    path: Callable[[float], float],
    begin: float,
    end: float,
) -> None:
    moved = changed(bag, tmp_path / 'moved', turned(path))
    (warning,) = measure(moved, *TOPICS).warnings
    assert f"bag '{moved}': joint3 moves; measured from " in warning
    words = warning.partition('measured from ')[2].split()
    assert float(words[0]) == pytest.approx(begin, abs=0.6)
    assert float(words[3]) == pytest.approx(end, abs=0.6)
    assert measure(moved, *TOPICS).stds == pytest.approx(NOISE, rel=0.2)
    assert main([moved]) == 0
    captured = capsys.readouterr()
    assert captured.err.startswith('mbaid_ros noise_at_rest: warning: bag ')
    assert captured.err.count('\n') == 1
    assert 'joint_position: ' in captured.out


def test_a_robot_that_moves_all_the_time_is_refused(
    bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = refused(capsys, changed(bag, tmp_path / 'moved', turned(lambda time: 0.3 * np.sin(time))))
    assert 'is of no robot at rest: joint3 moves, all joints rest for ' in line
    assert 'accepted: 5 s with the joints braked' in line


def until(end: float, change: Callable[[int, Any], Any]) -> Callable[[int, Any], Any]:
    """Return a change of what comes before a time (s), without what comes after it."""
    return lambda number, message: change(number, message) if number < end * RATE else None


@pytest.mark.parametrize('path', [lambda time: 0.3 * np.sin(time), lambda time: 0.0 * time], ids=['moving', 'resting'])
def test_less_than_five_seconds_are_refused_whether_or_not_it_moves(
    bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], path: Callable[[float], float]
) -> None:
    short = changed(bag, tmp_path / 'short', until(0.6, turned(path)), until(0.6, same))
    assert "topic '/joint_states' of bag '" in (line := refused(capsys, short))
    assert 'last 0.59 s by their stamps; accepted: 5 s with the joints braked' in line


def stamped(stamp: Callable[[int], int], change: Callable[[int, Any], Any] = same) -> Callable[[int, Any], Any]:
    """Return a change with the n-th message stamped with a number of nanoseconds of n."""

    def also(number: int, message: Any) -> Any:
        stamped = message.header.stamp
        seconds, nanoseconds = divmod(stamp(number), 1_000_000_000)
        time = replace(stamped, sec=seconds, nanosec=nanoseconds)
        return change(number, replace(message, header=replace(message.header, stamp=time)))

    return also


def test_stamps_that_were_never_filled_in_are_refused(
    bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arm = stamped(lambda _: 0, turned(lambda time: 0.3 * np.sin(time)))
    line = refused(capsys, changed(bag, tmp_path / 'unstamped', arm))
    assert "topic '/joint_states' of bag '" in line
    assert 'last 0 s by their stamps; accepted: 5 s with the joints braked' in line
    line = refused(capsys, changed(bag, tmp_path / 'base', same, stamped(lambda _: 0)))
    assert "topic '/odom' of bag '" in line


def test_stamps_that_go_back_are_refused(bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    back = changed(bag, tmp_path / 'back', stamped(lambda number: 10**7 * (number - 200 * (number > 700))))
    line = refused(capsys, back)
    assert "a message on topic '/joint_states' of bag '" in line
    assert 'is stamped 5.010 s, after one of 7.000 s; accepted: stamps that do not go back' in line


def test_more_positions_than_names_are_refused(bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def unnamed(_number: int, message: Any) -> Any:
        return replace(message, name=message.name[:1], position=message.position[:2], velocity=message.velocity[:1])

    moved = turned(lambda time: 0.3 * np.sin(time), joint=1)
    odd = changed(bag, tmp_path / 'odd', lambda number, message: unnamed(number, moved(number, message)))
    line = refused(capsys, odd)
    assert "a message on topic '/joint_states' of bag '" in line
    assert 'has 1 names, 2 positions and 1 velocities; accepted: as many as names, or none' in line


def test_a_bag_that_was_cut_off_is_told(bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (file,) = Path(bag).glob('*.mcap')
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(file.read_bytes()[: file.stat().st_size * 8 // 10])
    assert main([str(cut)]) == 0
    captured = capsys.readouterr()
    assert captured.err.startswith(f"mbaid_ros noise_at_rest: warning: bag '{cut}' was cut off while it was written")
    assert captured.err.count('\n') == 1
    assert 'joint_position: ' in captured.out


def test_a_damaged_bag_is_one_line(bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (file,) = Path(bag).glob('*.mcap')
    content = bytearray(file.read_bytes())
    content[content.index(b'\x28\xb5\x2f\xfd')] = 0  # what zstd begins with
    damaged = tmp_path / 'damaged.mcap'
    damaged.write_bytes(content)
    line = refused(capsys, str(damaged))
    assert f"bag '{damaged}' has fewer than 50 messages of '/joint_states'" in line
    assert 'is damaged: read 0 of 1001 messages' in line


def test_a_base_that_is_pushed_is_told(bag: str, tmp_path: Path) -> None:
    def pushed(number: int, message: Any) -> Any:
        pose = message.pose.pose
        place = replace(pose.position, x=pose.position.x + 0.05 * max(number / RATE - 5.0, 0.0))
        return replace(message, pose=replace(message.pose, pose=replace(pose, position=place)))

    (warning,) = measure(changed(bag, tmp_path / 'pushed', same, pushed), *TOPICS).warnings
    assert 'base_position is not noise about a smooth curve alone' in warning


def test_errors_that_last_for_some_samples_are_no_motion(bag: str, tmp_path: Path) -> None:
    # What an encoder says that averages over 0.1 s.
    white = np.random.default_rng(4).normal(size=1100)
    filtered = 1e-3 * np.convolve(white, np.full(10, 1.0 / np.sqrt(10.0)), mode='valid')
    noisy = changed(bag, tmp_path / 'noisy', turned(lambda time: float(filtered[round(time * RATE)])))
    found = measure(noisy, *TOPICS)
    assert found.warnings == ()
    assert found.stds['joint_position'] == pytest.approx(np.hypot(1e-3, NOISE['joint_position']), rel=0.2)


def test_an_encoder_that_goes_to_and_fro_by_a_step_does_not_move(bag: str, tmp_path: Path) -> None:
    def coarse(number: int, message: Any) -> Any:
        return replace(message, position=np.full(7, 1e-3 * (number % 97 > 80)))

    assert measure(changed(bag, tmp_path / 'coarse', coarse), *TOPICS).warnings == ()


def test_what_is_not_measured_has_no_number(bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def without(_number: int, message: Any) -> Any:
        return replace(message, velocity=np.zeros(0))

    def untwisted(_number: int, message: Any) -> Any:
        linear = replace(message.twist.twist.linear, x=np.nan)
        return replace(message, twist=replace(message.twist, twist=replace(message.twist.twist, linear=linear)))

    assert main([changed(bag, tmp_path / 'poses', without, untwisted)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert '      # joint_velocity: not measured' in lines
    assert '      # base_linear_velocity: not measured' in lines
    assert sum('not measured' in line for line in lines) == 2


def test_other_joints_in_later_messages_are_refused(bag: str, tmp_path: Path) -> None:
    def halved(number: int, message: Any) -> Any:
        return replace(message, name=message.name[:3], position=message.position[:3]) if number % 2 else message

    with pytest.raises(DataError, match='name other joints; accepted: the same in each'):
        measure(changed(bag, tmp_path / 'halves', halved), *TOPICS)


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(arguments) == 2
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
