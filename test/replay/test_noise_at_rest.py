"""The executable `noise_at_rest` finds the noise that the simulator added, and notices when the robot did not rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from checked import answer
from mbaid_ros.bags import BagReader, BagWriter, message_class
from mbaid_ros.config.estimator_parameters import EstimatorConfig, NoiseConfig
from mbaid_ros.config.parameter_files import load_parameter_file
from mbaid_ros.core.geometry import Array
from mbaid_ros.parameters import build
from mbaid_ros.replay.arguments import noise_at_rest as main
from mbaid_ros.replay.arguments import simulate
from mbaid_ros.replay.noise_at_rest import measure
from recorded import JOINT_STATE, TOPICS, Change, changed, same, stamped
from simulated import CONFIG, assigned

refused = partial(answer, main, code=2)
RATE = 100.0  # Hz, of both topics
NOISE = {
    'joint_position': 2e-4,
    'joint_velocity': 1e-3,
    'base_position': 5e-4,
    'base_orientation': 3e-4,
    'base_linear_velocity': 2e-3,
    'base_angular_velocity': 4e-4,
}
BRAKED, JOINTS = 'accepted: 5 s with the joints braked', "'/joint_states' of bag '"
Course = Callable[[float], float]  # of a joint over time, s


@pytest.fixture(scope='module', name='bag')
def bag_at_rest(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Ten seconds of a robot with braked joints that tumbles slowly."""
    path = tmp_path_factory.mktemp('rest') / 'bag'
    parameters: dict[str, object] = {'motion.kind': 'random', 'motion.amplitude': 0.0}
    parameters |= {f'noise.{name}': value for name, value in NOISE.items()}
    words = assigned(parameters)
    files = ['--model', f'{CONFIG}/servicer7.urdf', '--params', f'{CONFIG}/servicer7_simulator.yaml']
    assert simulate([*files, *words, '--duration', '10', '--output', str(path)]) == 0
    return str(path)


def turned(path: Course, joint: int = 2) -> Change:
    """Return what turns a joint along a path over time (s)."""

    def change(number: int, message: Any) -> Any:
        position: Array = np.array(message.position)
        position[joint] += path(number / RATE)
        return replace(message, position=position)

    return change


def until(end: float, change: Change) -> Change:
    """Return a change of what comes before a time (s), without what comes after it."""
    return lambda number, message: change(number, message) if number < end * RATE else None


SWINGING = turned(lambda time: 0.3 * np.sin(time))


def halved(number: int, message: Any) -> Any:
    """Return every other message without some of the joints."""
    return replace(message, name=message.name[:3], position=message.position[:3]) if number % 2 else message


def odd(number: int, message: Any) -> Any:
    """Return a moving second joint of which there is no name."""
    moved = turned(lambda time: 0.3 * np.sin(time), joint=1)(number, message)
    return replace(moved, name=moved.name[:1], position=moved.position[:2], velocity=moved.velocity[:1])


def lost(number: int, message: Any) -> Any:
    """Return a message that lacks one joint or another."""
    return turned(lambda _: np.nan, joint=number % 2)(number, message)


def declared_by(text: str, folder: Path) -> NoiseConfig:
    """Return the noise that a parameter file declares."""
    (folder / 'noise.yaml').write_text(text)
    return build(EstimatorConfig, load_parameter_file(folder / 'noise.yaml', 'estimator')).noise


def test_it_finds_the_noise_that_was_added_and_prints_a_parameter_file(
    bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = measure(bag, *TOPICS)
    assert found.warnings == ()
    # Of several hundred samples, and the noisiest of up to seven channels.
    assert found.stds == pytest.approx(NOISE, rel=0.15)
    given = declared_by(answer(main, capsys, bag), tmp_path)
    assert {name: getattr(given, name) for name in NOISE} == pytest.approx(dict(NOISE), rel=0.3)


@pytest.mark.parametrize(
    ('path', 'span'),
    [
        (lambda time: 0.05 * min(time, 3.0), (3.0, 10.0)),
        (lambda time: 0.002 * np.sin(2.0 * np.pi * time) * (time > 6.0), (0.0, 6.0)),
    ],
)
def test_a_joint_that_moves_at_times_is_named_and_the_rest_counts(
    bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], path: Course, span: tuple[float, float]
) -> None:
    moved = changed(bag, tmp_path / 'moved', turned(path))
    found = measure(moved, *TOPICS)
    (warning,) = found.warnings
    assert f"bag '{moved}': joint3 moves; measured from " in warning
    words = warning.partition('measured from ')[2].split()
    assert (float(words[0]), float(words[3])) == pytest.approx(span, abs=0.6)
    assert found.stds == pytest.approx(NOISE, rel=0.2)
    assert main([moved]) == 0
    captured = capsys.readouterr()
    assert captured.err.startswith('mbaid_ros noise_at_rest: warning: bag ')
    assert captured.err.count('\n') == 1
    assert 'joint_position: ' in captured.out


@pytest.mark.parametrize(
    ('joints', 'base', 'texts'),
    [
        (SWINGING, same, ['is of no robot at rest: joint3 moves, all joints rest for ', BRAKED]),
        (until(0.6, SWINGING), until(0.6, same), [JOINTS, f'last 0.59 s by their stamps; {BRAKED}']),
        (until(0.6, same), until(0.6, same), [JOINTS, f'last 0.59 s by their stamps; {BRAKED}']),
        (stamped(lambda _: 0, SWINGING), same, [JOINTS, f'last 0 s by their stamps; {BRAKED}']),
        (same, stamped(lambda _: 0), ["topic '/odom' of bag '"]),
        (
            stamped(lambda number: 10**7 * (number - 200 * (number > 700))),
            same,
            [JOINTS, 'is stamped 5.010 s, after one of 7.000 s; accepted: stamps that do not go back'],
        ),
        (odd, same, [f'a message on topic {JOINTS}', 'has 1 names, 2 positions and 1 velocities; acc']),
        (halved, same, ['name other joints; accepted: the same in each']),
        (lost, same, ['has fewer than 50 messages with positions of all joints']),
    ],
    ids=['moving', 'short', 'short at rest', 'no stamps', 'no stamps of the base', 'back', 'unnamed', 'halves', 'NaN'],
)
def test_a_bag_that_cannot_be_measured_is_one_line(
    bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], joints: Change, base: Change, texts: list[str]
) -> None:
    line = refused(capsys, changed(bag, tmp_path / 'changed', joints, base))
    assert all(text in line for text in texts), line


def test_topics_that_the_bag_lacks_or_of_other_types_are_one_line(bag: str, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused(capsys, bag, '--odom', '/mocap')
    assert "'/mocap'" in line
    assert '/odom' in line
    for option, topic, found, accepted in (
        ('--odom', '/joint_states', 'sensor_msgs/msg/JointState', 'nav_msgs/msg/Odometry'),
        ('--joint-states', '/odom', 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/JointState'),
    ):
        line = refused(capsys, bag, option, topic)
        assert f"topic '{topic}' of bag '{bag}' is of type {found}; accepted: {accepted}" in line


def test_a_bag_that_was_cut_off_or_damaged_is_named(
    bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (file,) = Path(bag).glob('*.mcap')
    path = tmp_path / 'cut.mcap'
    path.write_bytes(file.read_bytes()[: file.stat().st_size * 8 // 10])
    assert main([str(path)]) == 0
    captured = capsys.readouterr()
    assert captured.err.startswith(f"mbaid_ros noise_at_rest: warning: bag '{path}' was cut off while it was written")
    assert captured.err.count('\n') == 1
    assert 'joint_position: ' in captured.out
    content = bytearray(file.read_bytes())
    content[content.index(b'\x28\xb5\x2f\xfd')] = 0  # what zstd begins with
    path.write_bytes(content)
    line = refused(capsys, str(path))
    assert f"bag '{path}' has fewer than 50 messages of '/joint_states'" in line
    assert 'is damaged: read 0 of 1001 messages' in line


def pushed(number: int, message: Any) -> Any:
    pose = message.pose.pose
    place = replace(pose.position, x=pose.position.x + 0.05 * max(number / RATE - 5.0, 0.0))
    return replace(message, pose=replace(message.pose, pose=replace(pose, position=place)))


def test_a_base_that_is_pushed_is_named(bag: str, tmp_path: Path) -> None:
    (warning,) = measure(changed(bag, tmp_path / 'pushed', same, pushed), *TOPICS).warnings
    assert 'base_position is not noise about a smooth curve alone' in warning


def test_what_an_encoder_does_at_rest_is_no_motion(bag: str, tmp_path: Path) -> None:
    # An encoder that averages over 0.1 s.
    white = np.random.default_rng(4).normal(size=1100)
    filtered = 1e-3 * np.convolve(white, np.full(10, 1.0 / np.sqrt(10.0)), mode='valid')
    found = measure(changed(bag, tmp_path / 'a', turned(lambda time: float(filtered[round(time * RATE)]))), *TOPICS)
    assert found.warnings == ()
    assert found.stds['joint_position'] == pytest.approx(np.hypot(1e-3, NOISE['joint_position']), rel=0.2)

    def coarse(number: int, message: Any) -> Any:
        return replace(message, position=np.full(7, 1e-3 * (number % 97 > 80)))

    assert measure(changed(bag, tmp_path / 'b', coarse), *TOPICS).warnings == ()


def test_what_is_not_measured_has_no_number(bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def untwisted(_number: int, message: Any) -> Any:
        linear = replace(message.twist.twist.linear, x=np.nan)
        return replace(message, twist=replace(message.twist, twist=replace(message.twist.twist, linear=linear)))

    without = changed(bag, tmp_path / 'poses', lambda _, message: replace(message, velocity=np.zeros(0)), untwisted)
    assert main([without]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert '      # joint_velocity: not measured' in lines
    assert '      # base_linear_velocity: not measured' in lines
    assert sum('not measured' in line for line in lines) == 2


def test_an_encoder_is_never_better_than_its_step(bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def rounded(number: int, message: Any) -> Any:
        return replace(message, position=np.where(np.arange(7) == 3, 1e-2 * (number % 97 > 90), 0.3))

    found = measure(changed(bag, tmp_path / 'rounded', rounded), *TOPICS)
    assert found.stds['joint_position'] == pytest.approx(1e-2 / np.sqrt(12.0))
    stuck = changed(bag, tmp_path / 'stuck', lambda _, message: replace(message, position=np.full(7, 0.3)))
    assert main([stuck]) == 0
    captured = capsys.readouterr()
    assert '      # joint_position: not measured' in captured.out
    assert 'no reading of a joint changes: leave noise.joint_position out' in captured.err


def test_poses_without_a_twist_are_measured(bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kind, path = 'geometry_msgs/msg/PoseStamped', tmp_path / 'poses'
    with BagReader(bag) as before, BagWriter(path) as after:
        after.add_topic(TOPICS[0], JOINT_STATE)
        after.add_topic('/mocap', kind)
        for topic, message, time in before.read(TOPICS):
            if topic == '/odom':
                after.write('/mocap', message_class(kind)(header=message.header, pose=message.pose.pose), time)
            else:
                after.write(topic, message, time)
    text = answer(main, capsys, str(path), '--pose', '/mocap')
    given = declared_by(text, tmp_path)
    measured = [name for name in NOISE if 'velocity' not in name]
    assert [getattr(given, name) for name in measured] == pytest.approx([NOISE[name] for name in measured], rel=0.15)
    assert '# base_linear_velocity: not measured' in text


def with_wheel(angle: Course, speed: float = 400.0) -> Change:
    """Return what adds a wheel at an angle over time (s), read between -pi and pi."""

    def change(number: int, message: Any) -> Any:
        shown = float(np.angle(np.exp(1j * angle(number / RATE))))
        position, velocity = np.append(message.position, shown), np.append(message.velocity, speed)
        return replace(message, name=[*message.name, 'wheel'], position=position, velocity=velocity)

    return change


def test_a_wheel_at_constant_speed_is_at_rest_and_another_one_is_named(bag: str, tmp_path: Path) -> None:
    steady = measure(changed(bag, tmp_path / 'steady', with_wheel(lambda time: 400.0 * time)), *TOPICS)
    assert steady.warnings == ()
    assert steady.stds == pytest.approx(NOISE, rel=0.15)
    spun_up = with_wheel(lambda time: 400.0 * time + 0.5 * time**2)
    (warning,) = (found := measure(changed(bag, tmp_path / 'spun up', spun_up), *TOPICS)).warnings
    assert 'wheel turns, and not at constant speed: it is left out' in warning
    assert found.stds == pytest.approx(NOISE, rel=0.15)


def test_joints_at_a_half_turn_lost_poses_and_nan_do_not_change_the_noise(bag: str, tmp_path: Path) -> None:
    def joints(number: int, message: Any) -> Any:
        position: Array = np.array(message.position)
        position[2] = np.angle(np.exp(1j * (np.pi + position[2] - 0.2)))
        position[3] = 0.0 if number % 90 == 50 else position[3]
        position[5] = np.nan
        return replace(message, position=position)

    def base(number: int, message: Any) -> Any:
        if number % 100 != 60:
            return message
        pose = message.pose.pose
        zero = replace(pose.orientation, x=0.0, y=0.0, z=0.0, w=0.0)
        return replace(message, pose=replace(message.pose, pose=replace(pose, orientation=zero)))

    found = measure(changed(bag, tmp_path / 'odd', joints, base), *TOPICS)
    assert found.stds == pytest.approx(NOISE, rel=0.15)
    text = ' '.join(found.warnings)
    assert 'joint6 has no position' in text
    assert '11 messages not used: joint position far' in text
    assert '10 messages not used: tracking' in text
