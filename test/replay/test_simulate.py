"""`simulate`: a bag and its truth from the command line, with a capture and with thrust."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import recorded
from benchmarks.precapture import free_urdf
from checked import answer
from mbaid_ros.bags import BagReader, BagWriter
from mbaid_ros.core.forces import EXACT_THRUST
from mbaid_ros.replay.arguments import replay
from mbaid_ros.replay.arguments import simulate as main
from servicers import WRENCH, pulse, thrust_messages
from simulated import CONFIG, assigned

TABLE1 = ['--model', str(CONFIG / 'table1.urdf'), '--params', str(CONFIG / 'table1_simulator.yaml'), '--duration', '2']


def contents(bag: Path) -> list[tuple[str, bytes, int]]:
    with BagReader(bag) as reader:
        return [(topic, bytes(data), time) for topic, data, time in reader.raw()]


def test_a_bag_and_its_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = tmp_path / 'bag'
    assert main([*TABLE1, '--output', str(bag), '--seed', '5']) == 0
    captured = capsys.readouterr()
    assert captured.out.startswith('404 messages, 2 s of table1')
    assert not captured.err
    counts: dict[str, int] = {}
    for topic, _, _ in contents(bag):
        counts[topic] = counts.get(topic, 0) + 1
    assert counts == {'/robot_description': 1, '/simulator/truth': 1, '/joint_states': 201, '/odom': 201}

    truth = json.loads((bag / 'truth.json').read_text())
    assert (truth['robot'], truth['target_link'], truth['seed'], truth['mass']) == ('table1', 'link4', 5, 934.45)
    assert truth['com'] == pytest.approx([2.3, 0.9, 0.0])
    assert truth['inertia'] == pytest.approx({'ixx': 1100, 'ixy': 0, 'ixz': 0, 'iyy': 2800, 'iyz': 0, 'izz': 3435})
    assert truth['momentum']['linear'] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert truth['momentum']['angular'] == pytest.approx([0.0, 0.0, 4597.634], abs=5e-4)
    assert truth['parameters']['initial.zero_linear_momentum'] is True
    assert truth['parameters']['duration'] == 2.0


ERRORS = {
    'links_relative_std': 0.01, 'zero_std': 1e-3, 'origin_std': 2e-3, 'axis_std': 3e-3,
    'mount_position_std': 4e-3, 'mount_orientation_std': 5e-3, 'seed': 7,
}  # fmt: skip


def test_the_truth_says_what_the_robot_has_more_than_its_urdf(tmp_path: Path) -> None:
    drawn = assigned({f'model_errors.{name}': value for name, value in ERRORS.items()})
    for name, options in (('exact', []), ('drawn', drawn)):
        assert main([*TABLE1, *options, '--output', str(tmp_path / name)]) == 0
    exact, truth = (json.loads((tmp_path / name / 'truth.json').read_text()) for name in ('exact', 'drawn'))
    assert exact['model_errors'] is None
    assert all(truth[key] == exact[key] for key in ('target_link', 'mass', 'com', 'inertia'))
    reported = truth['model_errors']
    assert set(reported['links']) == {'base_link', 'link1', 'link2', 'link3'}
    assert 0.0 < abs(reported['links']['base_link']['mass']) < 4.0 * 0.01 * 2552.0
    assert set(reported['links']['link1']) == {'mass', 'com', 'inertia'}
    assert list(reported['joints']) == ['joint1', 'joint2', 'joint3', 'joint4']
    for joint in reported['joints'].values():
        assert 0.0 < abs(joint['zero']) < 4e-3
        assert 0.0 < np.linalg.norm(joint['origin']) < 1e-2
        assert (len(joint['axis']), joint['axis'][2]) == (3, 0.0)  # all turn about z
    assert {key: len(values) for key, values in reported['mount'].items()} == {'position': 3, 'orientation': 3}
    # The bags: one description, other data.
    bags = [contents(tmp_path / name) for name in ('exact', 'drawn')]
    descriptions, data = ([[x for x in bag if (x[0] == '/robot_description') == own] for bag in bags] for own in (1, 0))
    assert descriptions[0] == descriptions[1]
    assert data[0] != data[1]
    # Without linear momentum is the robot that moves, not its URDF.
    assert np.linalg.norm(truth['momentum']['linear']) < 1e-9


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        ([], '--model URDF'),
        (TABLE1[:2], "'duration' is 0 s"),
        (['--model', 'none.urdf', '--duration', '1'], "'none.urdf': No such file"),
        ([*TABLE1, '--seed', '1.5'], "'1.5' is not accepted; accepted: a whole number"),
        ([*TABLE1, '--duration', '0'], "'0' is not accepted; accepted: a number > 0 s"),
        ([*TABLE1, '-p', 'noise.joint:=1'], "'noise.joint'; known: noise.joint_position"),
        ([*TABLE1, '-p', 'joint_rate:=-2'], "'joint_rate' is -2 Hz; accepted"),
        ([*TABLE1, '-p', 'model_errors.zero_std:=-1e-3'], "'model_errors.zero_std' is -0.001 rad; accepted"),
        ([*TABLE1, '-p', 'model_errors.zero:=1e-3'], "'model_errors.zero'; known: model_errors.zero_std"),
        ([*TABLE1, '-p', 'seed'], "'seed' is not a parameter; accepted: name:=value"),
        ([*TABLE1, '--sed', '3'], "'--sed'; options: --seed"),
        ([*TABLE1, '--truth', '/nowhere/truth.json'], "'/nowhere/truth.json'"),
        ([*TABLE1, '--output', '.'], 'exists already'),
    ],
)
def test_mistakes_are_one_line(
    arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = tmp_path / 'bag'
    assert words in answer(main, capsys, '--output', str(bag), *arguments, code=2)
    assert not bag.exists()


CAPTURE = {
    'capture.time': '8.0',
    'capture.mass': '155.0',
    'capture.com': '[0.34, -0.22, 0.78]',
    'capture.inertia': '[24.0, -2.5, 2.0, 33.0, -0.5, 29.0]',
    'capture.linear_velocity': '[0.004, -0.006, 0.003]',
    'capture.angular_velocity': '[0.02, -0.03, 0.015]',
}
NOISE = {'joint_position': 1e-4, 'joint_velocity': 1e-3, 'base_position': 1e-3, 'base_orientation': 1e-4}
TWIST_NOISE = {'base_linear_velocity': 1e-3, 'base_angular_velocity': 1e-4}
SERVICER = ['--params', str(CONFIG / 'servicer7_simulator.yaml'), '--duration', '20']


def test_a_capture_from_simulate_to_replay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    urdf, parameters, bag = tmp_path / 'free.urdf', tmp_path / 'estimator.yaml', tmp_path / 'bag'
    urdf.write_text(free_urdf(), encoding='utf-8')
    noise = {f'noise.{name}': str(value) for name, value in {**NOISE, **TWIST_NOISE}.items()}
    options = assigned({**CAPTURE, **noise})
    assert main(['--model', str(urdf), *SERVICER, *options, '--output', str(bag)]) == 0
    truth = json.loads((bag / 'truth.json').read_text())
    assert truth['mass'] == pytest.approx(162.0)
    reported = truth['capture']
    assert (reported['t'], reported['mass'], reported['inertia']['iyy']) == (8.0, 155.0, 33.0)
    assert reported['target_linear_momentum'] == pytest.approx([0.62, -0.93, 0.465])
    parameters.write_text('estimator: {ros__parameters: {capture.time: 8.0, debris.report: true, method: trajectory}}')
    capsys.readouterr()
    assert replay([str(bag), '--model', str(urdf), '--params', str(parameters), '--json', '-']) == 0
    result = json.loads(capsys.readouterr().out)
    found = result['capture']
    for key in ('target_linear_momentum', 'target_angular_momentum'):
        assert np.all(np.abs(np.array(found[key]) - reported[key]) < 4.0 * np.array(found[f'{key}_std']))
    for part in ('linear', 'angular'):
        momentum, std = (np.array(result['momentum'][name]) for name in (part, f'{part}_std'))
        assert np.all(np.abs(momentum - truth['momentum'][part]) < 4.0 * std)
    body = result['debris']
    off = np.array([body['mass'], *body['com'], *body['inertia'].values()])
    off -= [reported['mass'], *reported['com'], *reported['inertia'].values()]
    assert off @ np.linalg.solve(np.array(body['covariance']), off) < 36.0  # ten chi-squares: 1 in 10 000


THRUST = {'thrust.time': '4.0', 'thrust.duration': '1.3', 'thrust.force': '[1.5, -1.4, 1.2]', 'thrust.link': 'link1'}


def test_thrust_from_simulate_to_replay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = ['--model', str(CONFIG / 'servicer7.urdf')]
    noise = {f'noise.{name}': str(value) for name, value in {**NOISE, **TWIST_NOISE}.items()}
    events = {}
    for reported in ('true', 'false'):
        bag = tmp_path / reported
        options = assigned({**THRUST, **noise, 'thrust.publish': reported})
        assert main([*model, *SERVICER, '--duration', '12', *options, '--output', str(bag)]) == 0
        with BagReader(bag) as reader:
            assert ('/thrust' in reader.topics) == (reported == 'true')
            if reported == 'true':
                assert reader.topics['/thrust'].count == 14  # ten a second, and the end
        assert json.loads((bag / 'truth.json').read_text())['momentum'] is None
        capsys.readouterr()
        # An undeclared second of thrust among twelve may leave the body open: that is reported as well.
        assert replay([str(bag), *model, '--json', '-']) in ({0} if reported == 'true' else {0, 3, 4})
        events[reported] = json.loads(capsys.readouterr().out)['events']
    assert events['true'] == []
    assert events['false'] != []


# -- Recorded thrust in replay and calibrate: taken from the bag, or from the topic that is named.

TYPES = {'/joint_states': recorded.JOINT_STATE, '/odom': recorded.ODOMETRY}
MODEL = ['--model', str(CONFIG / 'servicer7.urdf')]
PARAMETERS = ['--params', str(CONFIG / 'servicer7_estimator.yaml')]


def write(path: Path, topic: str) -> str:
    with BagWriter(path) as bag:
        for name, kind in {**TYPES, topic: WRENCH}.items():
            bag.add_topic(name, kind)
        for name, message, time in thrust_messages(2, *pulse()):
            bag.write(topic if name == '/thrust' else name, message, recorded.EPOCH * 1_000_000_000 + time)
    return str(path)


def test_thrust_in_a_bag_on_another_topic(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write(tmp_path / 'bag', '/base/thrust')
    assert replay([bag, *MODEL, *PARAMETERS, '--json', '-', '--thrust', '/base/thrust']) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['events'] == []
    assert result['warnings'] == [EXACT_THRUST]
    # Not without the parameter.
    assert replay([bag, *MODEL, *PARAMETERS, '--json', '-']) == 0
    assert [event['kind'] for event in json.loads(capsys.readouterr().out)['events']] == ['step']
