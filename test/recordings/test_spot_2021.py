"""Logs of SPOT in 2021: what a twin of the bench logs becomes a bag that identifies the base."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from benchmarks.benches import Twin, spot_2021
from mbaid_ros import limits
from mbaid_ros.bags import BagReader
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.recordings.convert import main
from mbaid_ros.recordings.spot import COMMANDS_FILE
from mbaid_ros.replay.replay import main as replay


@pytest.fixture(scope='module', name='twin')
def simulated_bench(tmp_path_factory: pytest.TempPathFactory) -> Twin:
    return spot_2021(tmp_path_factory.mktemp('spot'), 1, 16.0)


@pytest.fixture(scope='module', name='bag')
def converted(twin: Twin) -> Path:
    bag = twin.log.parent / 'bag'
    assert main(['spot-2021', str(twin.log), '--output', str(bag)]) == 0
    return bag


def test_every_row_becomes_a_pose_and_what_the_arm_was_told(bag: Path, twin: Twin) -> None:
    table = loadmat(twin.log)['rt_dataPacket']
    with BagReader(bag) as reader:
        poses, joints = ([message for _, message, _ in reader.read([topic])] for topic in ('/odom', '/joint_states'))
    assert len(poses) == len(joints) == len(table)
    assert [pose.header.stamp.sec + 1e-9 * pose.header.stamp.nanosec for pose in poses] == pytest.approx(table[:, 0])
    assert [pose.pose.pose.position.y for pose in poses] == table[:, 5].tolist()
    heading = [2.0 * np.arctan2(pose.pose.pose.orientation.z, pose.pose.pose.orientation.w) for pose in poses]
    assert np.cos(heading - table[:, 6]) == pytest.approx(1.0)
    assert np.isnan(poses[0].twist.twist.linear.x)
    told = loadmat(twin.log.parent / COMMANDS_FILE, squeeze_me=True)['primal']
    expected = np.interp(table[50, 0] - 42.0, told['time'].item(), told['states'].item()[4])
    assert joints[50].position[1] == pytest.approx(expected)


def test_the_folder_has_the_robot_with_its_sources_and_no_truth(bag: Path) -> None:
    text = (bag / 'robot.urdf').read_text()
    assert 'github.com/TheElectricDream/SPOT' in text
    model = load_model(text)
    assert model.joint_names == ('shoulder', 'elbow', 'wrist')
    assert not (bag / 'truth.json').exists()


def test_the_base_the_slope_and_the_delay_are_found(bag: Path, twin: Twin, capsys: pytest.CaptureFixture[str]) -> None:
    files = ['--model', str(bag / 'robot.urdf'), '--params', str(bag / 'estimator.yaml')]
    assert replay([str(bag), *files, '--json', '-']) == 0
    found = json.loads(capsys.readouterr().out)
    mass, inertia = found['estimate']['mass'], found['estimate']['inertia']['izz']
    assert abs(mass - twin.truth[0]) < 3.0 * found['std']['mass']
    assert abs(inertia - twin.truth[9]) < 3.0 * found['std']['inertia']['izz'] < 0.5 * inertia
    offset = found['time_offset']
    assert offset['value'] == pytest.approx(-twin.lag, abs=3.0 * offset['std'])
    (push,) = (event for event in found['events'] if event['kind'] == 'ramp')
    assert np.linalg.norm(push['linear']) / (mass + 0.791) == pytest.approx(twin.slope, rel=0.2)


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert main(arguments) == 2
    text = capsys.readouterr().err
    assert text.count('\n') == 1
    return text


def test_what_cannot_be_used_is_one_line(
    twin: Twin, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def convert(log: Path, *options: str) -> str:
        return refused(['spot-2021', str(log), '--output', str(tmp_path / 'bag'), *options], capsys)

    other = tmp_path / 'run.mat'
    assert 'accepted: a regular file' in convert(tmp_path)
    other.write_text('no MAT file')
    assert 'is no MAT file; accepted: version 5 to 7' in convert(other)
    savemat(other, {'rt_tout': np.zeros(3)})
    assert "lacks the variable 'rt_dataPacket'" in convert(other)
    savemat(other, {'rt_dataPacket': np.zeros((5, 64))})
    assert 'accepted: rows of 65 numbers' in convert(other)
    savemat(other, {'rt_dataPacket': np.zeros((5, 65))})
    assert f'no {COMMANDS_FILE} in a folder above' in convert(other)
    savemat(tmp_path / 'told.mat', {'primal': {'time': np.arange(3.0), 'states': np.zeros((4, 3))}})
    assert 'primal.states of shape (4, 3)' in convert(other, '--commands', str(tmp_path / 'told.mat'))
    savemat(tmp_path / 'told.mat', {'primal': 'nothing'})
    assert 'no primal.time' in convert(other, '--commands', str(tmp_path / 'told.mat'))
    other.write_bytes(twin.log.read_bytes()[:3000])
    assert 'is no MAT file that can be read' in convert(other)
    # A few bytes that would become many.
    savemat(other, {'rt_dataPacket': np.zeros((20_000, 65))}, do_compression=True)
    monkeypatch.setattr(limits, 'LOG_BYTES', 1_000_000)
    assert 'larger than 1000000 bytes once decompressed' in convert(other)
    assert not (tmp_path / 'bag').exists()
