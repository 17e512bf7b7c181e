"""Logs of benches: what a twin of each bench logs becomes a bag that identifies the body."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from benchmarks.benches import Twin, spot_2021, spot_2023
from checked import answer
from mbaid_ros import limits
from mbaid_ros.bags import BagReader
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array, cross, rotate, rotate_back, rotation_from_quaternion
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.urdf_edit import replace_inertial
from mbaid_ros.recordings.convert import main
from mbaid_ros.recordings.spot import COMMANDS_FILE
from mbaid_ros.recordings.throws import OBJECTS, Thrown, read_tudelft_throw, throw_urdf
from mbaid_ros.replay.start import replay
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.motion import Sinusoids
from mbaid_ros.simulation.simulation import Simulation

refused = partial(answer, main, code=2)
_THROWN_RATE, _RESTING = 4030.0, 2100  # Hz; samples before the flywheel starts


def tudelft_throw(folder: Path, seed: int) -> Twin:
    """Write a log of the throwing device as CSV; the truth is of the device, its IMU at the origin."""
    rng = np.random.default_rng(seed)
    body = np.array([0.2792, *rng.uniform(-0.01, 0.01, 2), 0.03, 5.1e-4, 0.0, 0.0, 2.1e-4, 0.0, 5.0e-4])
    robot = load_model(replace_inertial(throw_urdf(OBJECTS['empty']), Thrown.BASE, body))
    # The flywheel runs up to 1300 rad/s and down again, the other way round than z.
    motion = Sinusoids(np.zeros(1), np.array([[-245.0]]), np.array([[0.85]]), np.array([[-np.pi / 2.0]]))
    tumbling = np.concatenate((rng.normal(size=3), rng.normal(size=3) * 6.0, np.zeros(1)))
    start = State(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), motion.start, tumbling)
    time = np.arange(2350) / _THROWN_RATE
    seen = Simulation(robot, motion, start).advance(time)
    rotation = rotation_from_quaternion(seen.base_orientation)
    falling = np.gradient(rotate(rotation, seen.base_linear_velocity), time, axis=0)
    gyro = np.concatenate((np.zeros((_RESTING, 3)), seen.base_angular_velocity))
    acceleration = np.concatenate((np.zeros((_RESTING, 3)), rotate_back(rotation, falling)))
    speed = np.concatenate((np.zeros(_RESTING), np.maximum(np.abs(seen.joint_velocity[:, 0]), 10.5)))
    gyro += rng.normal(size=gyro.shape) * 5e-3 + rng.normal(size=3) * 5e-3
    acceleration += rng.normal(size=acceleration.shape) * 0.3
    raw: list[Array] = [np.arange(len(gyro)) / _THROWN_RATE * 1e6]
    # The board is turned on the device, and its numbers are whole.
    for values, unit in ((gyro, np.pi / 180.0 / 16.384), (acceleration, 9.81 / 2048.0)):
        raw += [values[:, 1] / unit, -values[:, 0] / unit, values[:, 2] / unit]
    raw.append(speed * 60.0 / (2.0 * np.pi) * 7.0 / 100.0)
    names = [f'{name}[{axis}]' for name in ('gyroADC', 'accSmooth') for axis in range(3)]
    header = ','.join(['time', *names, 'erpm[0]'])
    np.savetxt(folder / 'throw.csv', np.transpose(raw), fmt='%.0f', delimiter=',', header=header, comments='')
    return Twin(folder / 'throw.csv', body)


@pytest.fixture(scope='module', name='twin_2021')
def simulated_2021(tmp_path_factory: pytest.TempPathFactory) -> Twin:
    return spot_2021(tmp_path_factory.mktemp('spot'), 1, 16.0)


@pytest.fixture(scope='module', name='bag_2021')
def converted_2021(twin_2021: Twin) -> Path:
    bag = twin_2021.log.parent / 'bag'
    assert main(['spot-2021', str(twin_2021.log), '--output', str(bag)]) == 0
    return bag


def test_every_row_becomes_a_pose_and_what_the_arm_was_told(bag_2021: Path, twin_2021: Twin) -> None:
    table = loadmat(twin_2021.log)['rt_dataPacket']
    with BagReader(bag_2021) as reader:
        poses, joints = ([message for _, message, _ in reader.read([topic])] for topic in ('/odom', '/joint_states'))
    assert len(poses) == len(joints) == len(table)
    assert [pose.header.stamp.sec + 1e-9 * pose.header.stamp.nanosec for pose in poses] == pytest.approx(table[:, 0])
    assert [pose.pose.pose.position.y for pose in poses] == table[:, 5].tolist()
    heading = [2.0 * np.arctan2(pose.pose.pose.orientation.z, pose.pose.pose.orientation.w) for pose in poses]
    assert np.cos(heading - table[:, 6]) == pytest.approx(1.0)
    assert np.isnan(poses[0].twist.twist.linear.x)
    told = loadmat(twin_2021.log.parent / COMMANDS_FILE, squeeze_me=True)['primal']
    expected = np.interp(table[50, 0] - 42.0, told['time'].item(), told['states'].item()[4])
    assert joints[50].position[1] == pytest.approx(expected)


def test_the_folder_has_the_robot_with_its_sources_and_no_truth(bag_2021: Path) -> None:
    text = (bag_2021 / 'robot.urdf').read_text()
    assert 'github.com/TheElectricDream/SPOT' in text
    model = load_model(text)
    assert model.joint_names == ('shoulder', 'elbow', 'wrist')
    assert not (bag_2021 / 'truth.json').exists()


def test_the_base_the_slope_and_the_delay_are_found(
    bag_2021: Path, twin_2021: Twin, capsys: pytest.CaptureFixture[str]
) -> None:
    files = ['--model', str(bag_2021 / 'robot.urdf'), '--params', str(bag_2021 / 'estimator.yaml')]
    flat = ['-p', 'disturbance.force_std:=0.0']  # the table of the twin slopes evenly
    assert replay([str(bag_2021), *files, *flat, '--json', '-']) == 0
    found = json.loads(capsys.readouterr().out)
    mass, inertia = found['estimate']['mass'], found['estimate']['inertia']['izz']
    assert abs(mass - twin_2021.truth[0]) < 3.0 * found['std']['mass']
    assert abs(inertia - twin_2021.truth[9]) < 3.0 * found['std']['inertia']['izz'] < 0.5 * inertia
    offset = found['time_offset']
    assert offset['value'] == pytest.approx(-twin_2021.lag, abs=3.0 * offset['std'])
    (push,) = (event for event in found['events'] if event['kind'] == 'ramp')
    assert np.linalg.norm(push['linear']) / (mass + 0.791) == pytest.approx(twin_2021.slope, rel=0.2)


def test_what_cannot_be_used_is_one_line(
    twin_2021: Twin, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def convert(log: Path, *options: str) -> str:
        return refused(capsys, 'spot-2021', str(log), '--output', str(tmp_path / 'bag'), *options)

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
    other.write_bytes(twin_2021.log.read_bytes()[:3000])
    assert 'is no MAT file that can be read' in convert(other)
    # A few bytes that would become many.
    savemat(other, {'rt_dataPacket': np.zeros((20_000, 65))}, do_compression=True)
    monkeypatch.setattr(limits, 'LOG_BYTES', 1_000_000)
    assert 'larger than 1000000 bytes once decompressed' in convert(other)
    assert not (tmp_path / 'bag').exists()


# -- Logs of SPOT in 2023: what a twin of the bench logs becomes a bag that tells what the arm holds, thrusters on.


@pytest.fixture(scope='module', name='twin_2023')
def simulated_2023(tmp_path_factory: pytest.TempPathFactory) -> Twin:
    return spot_2023(tmp_path_factory.mktemp('spot'), 1, 16.0)


@pytest.fixture(scope='module', name='bag_2023')
def converted_2023(twin_2023: Twin) -> Path:
    bag = twin_2023.log.parent / 'bag'
    assert main(['spot-2023', str(twin_2023.log), '--output', str(bag)]) == 0
    return bag


def test_rows_become_poses_joints_and_thrust_in_axes_of_the_base(bag_2023: Path, twin_2023: Twin) -> None:
    table = np.loadtxt(twin_2023.log, delimiter=',')
    with BagReader(bag_2023) as reader:
        poses, joints, thrust = (
            [message for _, message, _ in reader.read([topic])] for topic in ('/odom', '/joint_states', '/thrust')
        )
    assert len(poses) == len(joints) == len(thrust) == len(table)
    assert np.array([joint.position for joint in joints]) == pytest.approx(table[:, 64:67])
    assert np.array([joint.velocity for joint in joints]) == pytest.approx(table[:, 67:70])
    assert thrust[0].header.frame_id == 'base_link'
    force = np.array([[each.wrench.force.x, each.wrench.force.y] for each in thrust])
    assert np.abs(force) == pytest.approx(0.14, abs=1e-3)  # as the twin is told, turned by a heading that is measured
    assert [each.wrench.torque.z for each in thrust] == pytest.approx(table[:, 3])


def test_rows_before_anything_is_known_are_left_out(twin_2023: Twin, tmp_path: Path) -> None:
    rows = twin_2023.log.read_text().splitlines()
    nothing = ','.join(['0'] * 80)
    log = tmp_path / 'ExpLog'
    # Without the last column, as the first logs are; the pose comes first, then the arm; a row is told twice.
    before = [nothing, nothing.replace('0', '164', 1)]
    silent = rows[0].split(',')[:64] + ['0'] * 16
    log.write_text(
        '\n'.join([*before, ','.join(silent), *(row.rsplit(',', 1)[0] for row in (rows[1], rows[1], rows[2]))])
    )
    assert main(['spot-2023', str(log), '--output', str(tmp_path / 'bag')]) == 0
    with BagReader(tmp_path / 'bag') as reader:
        counts = {topic: len(list(reader.read([topic]))) for topic in ('/odom', '/joint_states', '/thrust')}
    assert counts == {'/odom': 3, '/joint_states': 2, '/thrust': 3}


def test_what_is_held_is_found_with_thrusters_on(
    bag_2023: Path, twin_2023: Twin, capsys: pytest.CaptureFixture[str]
) -> None:
    files = ['--model', str(bag_2023 / 'robot.urdf'), '--params', str(bag_2023 / 'estimator.yaml')]
    assert replay([str(bag_2023), *files, '--json', '-']) == 0
    found = json.loads(capsys.readouterr().out)
    # Links known to 5 % leave as much of the mass open; a tenth of what seems known beside is noise in the rows.
    # Poses at 10 Hz between pulses of thrust look correlated over seconds, which widens the interval by a twentieth.
    assert abs(found['estimate']['mass'] - twin_2023.truth[0]) < 3.0 * found['std']['mass'] < 2.65
    moment = found['estimate']['inertia']['izz']
    assert abs(moment - twin_2023.truth[9]) < 3.0 * found['std']['inertia']['izz'] < 0.065


def test_a_table_of_another_width_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / 'ExpLog'
    log.write_text('0,1,2\n')
    assert 'has 3 columns; accepted: 80 or 81' in refused(capsys, 'spot-2023', str(log))
    log.write_text(','.join(['0'] * 80))
    bag = ['--output', str(tmp_path / 'bag')]
    assert 'holds no joint states and no poses' in refused(capsys, 'spot-2023', str(log), *bag)


# -- TU Delft's throws: a twin's log, in the authors' own CSV, becomes a bag of gyro, accelerometer and flywheel.


@pytest.fixture(scope='module', name='twin_throw')
def simulated_throw(tmp_path_factory: pytest.TempPathFactory) -> Twin:
    folder = tmp_path_factory.mktemp('throws') / 'config_empty'
    folder.mkdir()
    return tudelft_throw(folder, 3)


def test_the_flight_becomes_a_bag(twin_throw: Twin, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['tudelft-throw', str(twin_throw.log), '--output', str(tmp_path / 'bag')]) == 0
    assert 'the bias of the gyro at rest is taken off' in capsys.readouterr().err
    with BagReader(tmp_path / 'bag') as bag:
        readings, wheel = ([message for _, message, _ in bag.read([topic])] for topic in ('/imu', '/joint_states'))
        assert '/odom' not in bag.topics
    assert len(readings) == len(wheel) == 2000  # of 2350, without the authors' 300 at the begin and 50 at the end
    assert readings[0].header.frame_id == 'device'
    assert readings[0].orientation_covariance[0] == -1.0
    assert wheel[0].name == ['flywheel']
    speed = np.array([each.velocity[0] for each in wheel])
    assert -1310.0 < speed.min() < -1300.0
    assert np.gradient([each.position[0] for each in wheel], 1.0 / 4030.0) == pytest.approx(speed, abs=20.0)
    model = load_model((tmp_path / 'bag' / 'robot.urdf').read_text())
    assert model.link('device').parameters[0] == pytest.approx(0.10067 + 0.1785)


def test_angular_momentum_and_fall_are_those_of_the_body(twin_throw: Twin) -> None:
    """Axes, signs and units: only with all of them right is the momentum of body and flywheel constant."""
    log = read_tudelft_throw(twin_throw.log, dead_reckoned=True)
    assert log.poses is not None
    assert log.imu is not None
    assert log.joints is not None
    assert log.joints.velocity is not None
    rotation, rate = rotation_from_quaternion(log.poses.orientation), log.imu.angular_velocity
    spin = np.zeros_like(rate)
    spin[:, 2] = 1.687e-6 * log.joints.velocity[:, 0]
    inertia = np.diag(twin_throw.truth[[4, 7, 9]])
    total = rotate(rotation, rate @ inertia + spin)
    size = np.linalg.norm(total, axis=1).mean()
    assert np.linalg.norm(total - total.mean(axis=0), axis=1).max() < 0.03 * size
    still = rotate(rotation, rate @ inertia)
    assert np.linalg.norm(still - still.mean(axis=0), axis=1).max() > 0.2 * size  # the flywheel is seen
    # The centre of mass falls along: it is where the IMU turns about.
    com = np.tile(twin_throw.truth[1:4], (len(rate), 1))
    slope = np.gradient(rate, log.imu.time, axis=0)
    smooth = np.ones(41) / 41.0
    expected = -cross(rate, cross(rate, com)) - cross(slope, com)
    off = log.imu.linear_acceleration - expected
    off = np.stack([np.convolve(axis, smooth, 'valid') for axis in off.T], axis=1)
    assert np.sqrt(np.mean(off**2)) < 0.1 * np.sqrt(np.mean(expected**2))
    centre = log.poses.position + rotate(rotation, com)
    line = np.polynomial.polynomial.polyfit(log.poses.time, centre, 1)
    rest = centre - np.polynomial.polynomial.polyval(log.poses.time, line).T
    assert np.abs(rest).max() < 0.2 * np.abs(rotate_back(rotation, com)).max()


def test_what_was_thrown_has_the_moments_of_its_geometry() -> None:
    assert [OBJECTS[name].mass for name in ('empty', 'a', 'b', 'c')] == pytest.approx([0.1785, 0.4589, 0.7393, 1.3001])
    assert OBJECTS['empty'].moments == pytest.approx([1.2343e-4, 3.6806e-4, 4.3101e-4], rel=1e-4)
    # Four blocks at the ends add most about the axes across the long side.
    assert OBJECTS['a'].moments - OBJECTS['empty'].moments == pytest.approx([6.64e-5, 1.164e-3, 1.148e-3], rel=0.02)


class Recorded:
    """Stands in for orangebox' parser of a log that holds a table."""

    def __init__(self, names: list[str], rows: Array) -> None:
        self.field_names, self._rows = ['loopIteration', *names], rows

    def frames(self) -> Iterator[SimpleNamespace]:
        """Yield rows, with what the parser says of events that it does not know."""
        sys.stdout.write('Unknown event type: 15')
        for row in self._rows:
            yield SimpleNamespace(data=['', *row])


def standing_in(names: list[str], rows: Array) -> SimpleNamespace:
    return SimpleNamespace(Parser=SimpleNamespace(load=lambda _path: Recorded(names, rows)))


def test_blackbox_logs_are_read_by_orangebox(
    twin_throw: Twin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    names, rows = (
        twin_throw.log.read_text().split('\n', 1)[0].split(','),
        np.loadtxt(twin_throw.log, delimiter=',', skiprows=1),
    )
    monkeypatch.setitem(sys.modules, 'orangebox', standing_in(names, rows))
    log = tmp_path / 'LOG1.BFL'
    log.write_bytes(b'H Product:Blackbox')
    read, expected = read_tudelft_throw(log, 'a').imu, read_tudelft_throw(twin_throw.log).imu
    assert read is not None
    assert expected is not None
    assert np.array_equal(read.angular_velocity, expected.angular_velocity)
    assert not capsys.readouterr().out
    monkeypatch.setitem(sys.modules, 'orangebox', standing_in(names[:-1], rows))
    with pytest.raises(DataError, match=r"lacks the column 'erpm\[0\]'"):
        read_tudelft_throw(log, 'a')
    monkeypatch.setitem(sys.modules, 'orangebox', None)
    with pytest.raises(DataError, match=r'needs orangebox: pip install orangebox==0\.3\.1'):
        read_tudelft_throw(log, 'a')


def test_a_throw_that_cannot_be_used_is_one_line(
    twin_throw: Twin, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def convert(log: Path, *options: str) -> str:
        return refused(capsys, 'tudelft-throw', str(log), '--output', str(tmp_path / 'bag'), *options)

    lines = twin_throw.log.read_text().splitlines()
    log = tmp_path / 'throw.csv'
    log.write_text('\n'.join(lines))
    assert f"folder '{tmp_path.name}' does not name the thrown object; accepted: --object device-only" in convert(log)
    assert "--object is 'd'; accepted: device-only, proof-body, empty, a, b, c" in convert(log, '--object', 'd')
    log.write_text('\n'.join(lines[:2150]))
    assert 'has no flight' in convert(log, '--object', 'a')
    log.write_text('\n'.join(lines[:100]))
    assert 'has 99 rows; accepted: 2000 or more' in convert(log, '--object', 'a')
    log.write_text('time,erpm[0]\n1,2')
    assert "lacks the column 'gyroADC[0]'" in convert(log, '--object', 'a')
    assert '--object is for tudelft-throw, not for csv' in refused(capsys, 'csv', str(log), '--object', 'a')
