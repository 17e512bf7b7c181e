"""Logs of TU Delft's throws, as CSV or Blackbox: a twin's log becomes a bag of gyro, accelerometer and flywheel."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.benches import Twin
from checked import answer, some
from mbaid_ros.bags import BagReader
from mbaid_ros.core.geometry import Array, cross, rotate, rotate_back, rotation_from_quaternion
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.urdf import replace_inertial
from mbaid_ros.errors import DataError
from mbaid_ros.recordings.convert import main
from mbaid_ros.recordings.throws import OBJECTS, Thrown, read_tudelft_throw, throw_urdf
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
    poses, imu, joints = some(log.poses), some(log.imu), some(log.joints)
    rotation, rate = rotation_from_quaternion(poses.orientation), imu.angular_velocity
    spin = np.zeros_like(rate)
    spin[:, 2] = 1.687e-6 * some(joints.velocity)[:, 0]
    inertia = np.diag(twin_throw.truth[[4, 7, 9]])
    total = rotate(rotation, rate @ inertia + spin)
    size = np.linalg.norm(total, axis=1).mean()
    assert np.linalg.norm(total - total.mean(axis=0), axis=1).max() < 0.03 * size
    still = rotate(rotation, rate @ inertia)
    assert np.linalg.norm(still - still.mean(axis=0), axis=1).max() > 0.2 * size  # the flywheel is seen
    # The centre of mass falls along: it is where the IMU turns about.
    com = np.tile(twin_throw.truth[1:4], (len(rate), 1))
    slope = np.gradient(rate, imu.time, axis=0)
    smooth = np.ones(41) / 41.0
    expected = -cross(rate, cross(rate, com)) - cross(slope, com)
    off = imu.linear_acceleration - expected
    off = np.stack([np.convolve(axis, smooth, 'valid') for axis in off.T], axis=1)
    assert np.sqrt(np.mean(off**2)) < 0.1 * np.sqrt(np.mean(expected**2))
    centre = poses.position + rotate(rotation, com)
    line = np.polynomial.polynomial.polyfit(poses.time, centre, 1)
    rest = centre - np.polynomial.polynomial.polyval(poses.time, line).T
    assert np.abs(rest).max() < 0.2 * np.abs(rotate_back(rotation, com)).max()


def test_a_thrown_object_has_the_moments_of_its_geometry() -> None:
    assert [OBJECTS[name].mass for name in ('empty', 'a', 'b', 'c')] == pytest.approx([0.1785, 0.4589, 0.7393, 1.3001])
    assert OBJECTS['empty'].moments == pytest.approx([1.2343e-4, 3.6806e-4, 4.3101e-4], rel=1e-4)
    # Four blocks at the ends add most about the axes across the long side.
    assert OBJECTS['a'].moments - OBJECTS['empty'].moments == pytest.approx([6.64e-5, 1.164e-3, 1.148e-3], rel=0.02)


def standing_in(names: list[str], rows: Array) -> SimpleNamespace:
    """Return a stand-in for orangebox whose log holds a table, and which prints events that it does not know."""

    def frames() -> Iterator[SimpleNamespace]:
        sys.stdout.write('Unknown event type: 15')
        yield from (SimpleNamespace(data=['', *row]) for row in rows)

    log = SimpleNamespace(field_names=['loopIteration', *names], frames=frames)
    return SimpleNamespace(Parser=SimpleNamespace(load=lambda _path: log))


def test_blackbox_logs_are_read_by_orangebox(
    twin_throw: Twin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    names = twin_throw.log.read_text().split('\n', 1)[0].split(',')
    rows = np.loadtxt(twin_throw.log, delimiter=',', skiprows=1)
    monkeypatch.setitem(sys.modules, 'orangebox', standing_in(names, rows))
    log = tmp_path / 'LOG1.BFL'
    log.write_bytes(b'H Product:Blackbox')
    read, expected = some(read_tudelft_throw(log, 'a').imu), some(read_tudelft_throw(twin_throw.log).imu)
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
    for content, text in (
        (lines[:2150], 'has no flight'),
        (lines[:100], 'has 99 rows; accepted: 2000 or more'),
        (['time,erpm[0]', '1,2'], "lacks the column 'gyroADC[0]'"),
    ):
        log.write_text('\n'.join(content))
        assert text in convert(log, '--object', 'a')
    assert '--object is for tudelft-throw, not for csv' in refused(capsys, 'csv', str(log), '--object', 'a')
