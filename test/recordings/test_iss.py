"""Telemetry of the space station: written by the conventions of its channels, read as a robot's sensors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from checked import some
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.config.parameter_files import load_parameter_file
from mbaid_ros.core.geometry import Array, exp, log, rotate, rotate_back, rotation_from_quaternion
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.errors import DataError
from mbaid_ros.parameters import build
from mbaid_ros.recordings.convert import main
from mbaid_ros.recordings.iss import _RATES, read_iss, stored_momentum
from mbaid_ros.session.session import Session

MOTION, RADIUS, TORQUE = 1.13e-3, 6.78e6, np.array([2.0, -1.0, 0.5])  # rad/s, m, N m
FIRST, SECONDS = 100.0, 1200  # h, s
MOMENTUM = np.array([3000.0, -2000.0, 1000.0])  # N m s at the begin, inertial axes


def write(folder: Path, *, scale: float = 1.0, drift: float = 0.0) -> Array:
    """Write telemetry of a body that faces along LVLH, pitched by 0.1 rad; return its momentum in body axes.

    The plane of the orbit turns with `drift` rad/s about the first position.
    """
    time = np.arange(SECONDS, dtype=float)
    hours = FIRST + time / 3600.0
    angle = MOTION * time
    rotation = exp(-angle[:, None] * np.array([0.0, 1.0, 0.0])) @ exp(np.array([[0.0, 0.1, 0.0]]))
    axis = np.array([0.0, 0.0, -drift])  # down, in LVLH of the begin
    rotation = exp(time[:, None] * axis) @ rotation
    gone = np.zeros((SECONDS, 3))
    acting = rotate(rotation, np.tile(TORQUE, (SECONDS, 1)))
    gone[1:] = np.cumsum(0.5 * (acting[1:] + acting[:-1]), axis=0)
    momentum = MOMENTUM - gone
    position = RADIUS * np.column_stack((np.cos(angle), np.sin(angle), 0.0 * angle))
    velocity = MOTION * RADIUS * np.column_stack((-np.sin(angle), np.cos(angle), 0.0 * angle))
    turned = exp(time[:, None] * [drift, 0.0, 0.0])
    rates = np.degrees(np.array([0.0, -MOTION, 0.0]) + rotate_back(rotation, np.tile(axis, (SECONDS, 1))))
    channels = {
        **{f'USLAB{6 + axis:06d}': np.full(SECONDS, TORQUE[axis]) for axis in range(3)},
        'USLAB000009': scale * np.linalg.norm(momentum, axis=1),
        **{
            f'USLAB{18 + part:06d}': np.full(SECONDS, (np.cos(0.05), 0.0, np.sin(0.05), 0.0)[part]) for part in range(4)
        },
        **{f'USLAB{25 + axis:06d}': rates[:, axis] for axis in range(3)},
        **{f'USLAB{32 + axis:06d}': 1e-3 * rotate(turned, position)[:, axis] for axis in range(3)},
        **{f'USLAB{35 + axis:06d}': rotate(turned, velocity)[:, axis] for axis in range(3)},
        'S0000003': (350.0 - 0.06 * np.minimum(time, 600.0)) % 360.0,
        'S0000004': (350.0 + 0.06 * np.minimum(time, 600.0)) % 360.0,
    }
    for name, value in channels.items():
        changed = np.concatenate(([True], np.diff(value) != 0.0))  # sent on change; rates have noise
        sent = np.ones(SECONDS, dtype=bool) if name in _RATES or not changed[1:].any() else changed
        lines = [f'{hour!r} {each!r}' for hour, each in zip(hours[sent].tolist(), value[sent].tolist(), strict=True)]
        (folder / f'{name}.txt').write_text('\n'.join(lines) + '\n')
    return rotate(np.swapaxes(rotation, -1, -2), momentum)


@pytest.mark.parametrize('drift', [0.0, 1e-6])
def test_attitude_rates_and_momentum_are_those_that_were_flown(tmp_path: Path, drift: float) -> None:
    momentum = write(tmp_path, drift=drift)
    found = read_iss(tmp_path, FIRST - 0.01, FIRST + 1.0)
    imu, joints = some(found.imu), some(found.joints)
    rotation = rotation_from_quaternion(some(imu.orientation))
    turned = log(np.swapaxes(rotation[:-1], -1, -2) @ rotation[1:]) / np.diff(imu.time)[:, None]
    # What the orientation turns is what the gyro reads, in the plane of the orbit: nadir stays in it.
    np.testing.assert_allclose(turned, imu.angular_velocity[1:], atol=2e-9)
    np.testing.assert_allclose(rotation[:, [0, 2], 1], 0.0, atol=1e-5)  # the body's y is the plane's normal
    np.testing.assert_allclose(some(found.stored).momentum, momentum, atol=0.5)
    assert f'mean_motion: {MOTION:.3g}' in found.parameters
    last = joints.position[-1] - joints.position[0]
    np.testing.assert_allclose(np.degrees(last), [-36.0, 36.0], atol=0.1)
    np.testing.assert_array_equal(joints.position[700], joints.position[-1])  # it stands


def test_the_start_is_found_where_the_magnitude_has_other_minima() -> None:
    rng = np.random.default_rng(1)
    time = np.arange(2000.0)
    rotation = exp(MOTION * time[:, None] * np.array([0.0, -1.0, 0.0]))
    torque = np.cumsum(rng.normal(size=(2000, 3)), axis=0) / 10.0
    acting = rotate(rotation, torque)
    gone = np.concatenate((np.zeros((1, 3)), np.cumsum(0.5 * (acting[1:] + acting[:-1]), axis=0)))
    momentum, misfit = stored_momentum(time, rotation, torque, np.linalg.norm(MOMENTUM - gone, axis=1))
    assert misfit < 1e-3
    np.testing.assert_allclose(momentum[0], MOMENTUM, atol=0.1)


def test_torque_by_thrusters_is_refused(tmp_path: Path) -> None:
    write(tmp_path, scale=3.0)
    with pytest.raises(DataError, match='misses the magnitude'):
        read_iss(tmp_path, FIRST - 0.01, FIRST + 1.0)


def test_the_folder_is_one_that_calibrate_and_replay_take(tmp_path: Path) -> None:
    write(tmp_path)
    folder = tmp_path / 'bag'
    hours = ['--start', str(FIRST - 0.01), '--end', str(FIRST + 1.0)]
    assert main(['iss-mimic', str(tmp_path), *hours, '--output', str(folder)]) == 0
    urdf = (folder / 'robot.urdf').read_text()
    assert load_model(urdf).joint_names == ('sarj_port', 'sarj_starboard')
    Session(build(EstimatorConfig, load_parameter_file(str(folder / 'estimator.yaml'), 'estimator')), urdf)


@pytest.mark.parametrize('hours', [[], ['--start', '2', '--end', '1']])
def test_hours_are_needed(tmp_path: Path, hours: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['iss-mimic', str(tmp_path), *hours]) == 2
    assert '--start' in capsys.readouterr().err


def test_a_channel_that_is_missing_or_empty_is_named(tmp_path: Path) -> None:
    write(tmp_path)
    (tmp_path / 'USLAB000009.txt').write_text('1 two three\n')
    with pytest.raises(DataError, match='USLAB000009'):
        read_iss(tmp_path, FIRST - 0.01, FIRST + 1.0)
    with pytest.raises(DataError, match='no readings'):
        read_iss(tmp_path, FIRST + 5.0, FIRST + 6.0)
