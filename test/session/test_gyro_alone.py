"""A gyro where nothing locates the base: inertia is found, position, heading and linear momentum are not."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gyros import KNOWN, messages, normalised, taken
from mbaid_ros.bags import BagWriter
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.intake.dead_reckoning import DeadReckoning
from mbaid_ros.core.samples import ImuStream
from mbaid_ros.replay.replay import main as replay
from mbaid_ros.session import Session
from simulated import CONFIG
from streams import urdf
from thrown import AT_REST, INERTIA, calibrated, record


def test_a_robot_is_identified_by_how_it_turns() -> None:
    alone = {**KNOWN, 'imu.alone': True, 'imu.bias_std': 3e-3, 'imu.orientation_std': 1e-3}
    session, found = taken(messages('ets7', 14.0, 3), 'ets7', alone)
    last = found[-1]
    assert (last.stage, last.status) == ('trajectory', 'estimating')
    assert session.received['odom'] == 0
    errors = normalised(last, 'ets7')
    assert len(errors) >= 4
    assert np.abs(errors).max() < 4.0
    assert np.isnan(last.momentum[:3]).all()
    assert np.isfinite(last.momentum[3:]).all()
    assert last.warnings[-1].startswith('nothing locates the base')


def test_a_bag_without_poses_gives_json_and_exit_code(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/joint_states', 'sensor_msgs/msg/JointState')
        bag.add_topic('/imu', 'sensor_msgs/msg/Imu')
        for timed in messages('ets7', 14.0, 3):
            if timed.topic != 'odom':
                bag.write(f'/{timed.topic}', timed.message, 1_700_000_000_000_000_000 + round(1e9 * timed.time))
    given = {**KNOWN, 'imu.alone': True, 'imu.bias_std': 3e-3, 'imu.orientation_std': 1e-3}
    arguments = [str(tmp_path / 'bag'), '--model', str(CONFIG / 'ets7.urdf'), '--json', str(tmp_path / 'found.json')]
    for name, value in given.items():
        arguments += ['-p', f'{name}:={json.dumps(value)}']
    assert replay(arguments) == 0
    found = json.loads((tmp_path / 'found.json').read_text(encoding='utf-8'))
    assert found['momentum']['linear'] == [None] * 3
    assert None not in found['momentum']['angular']
    assert found['estimate']['mass'] is not None


@pytest.mark.parametrize(
    ('more', 'told'),
    [
        ({'imu.noise_density': 0.0}, 'imu.noise_density is 0'),
        ({'method': 'difference'}, 'method is difference, which needs poses'),
        ({'capture.phase': 'pre_capture'}, 'the run has a capture'),
    ],
)
def test_what_needs_poses_is_refused(more: dict[str, object], told: str) -> None:
    with pytest.raises(ParameterError, match=f"'imu.alone' is true, and .*{told}"):
        Session(build(EstimatorConfig, {**KNOWN, 'imu.alone': True, **more}), urdf('table1'))


def test_a_course_is_followed_to_fourth_order() -> None:
    # A cone: the axis of the rate turns in the body's own axes, and the orientation is known in closed form.
    rate, half = 3.0, 0.4
    errors = []
    for count in (200, 400):
        time = np.arange(count + 1) / count
        spin = np.array([np.sin(half) * np.cos(rate * time), np.sin(half) * np.sin(rate * time), 0.0 * time]).T
        stream = ImuStream(np.round(1e9 * time).astype(np.int64), 5.0 * spin)
        whole = DeadReckoning().push(stream)
        fine = np.arange(4001) / 4000
        spin = np.array([np.sin(half) * np.cos(rate * fine), np.sin(half) * np.sin(rate * fine), 0.0 * fine]).T
        exact = DeadReckoning().push(ImuStream(np.round(1e9 * fine).astype(np.int64), 5.0 * spin))
        assert whole is not None
        assert exact is not None
        errors.append(np.abs(whole.rotation[-1] - exact.rotation[-1]).max())
        pieces = DeadReckoning()
        cut = [pieces.push(stream[begin : begin + 7]) for begin in range(0, count + 1, 7)]
        again = np.concatenate([each.rotation for each in cut if each is not None])
        assert np.array_equal(again, whole.rotation)
    assert errors[1] < errors[0] / 3.5
    assert errors[1] < 1e-5


def test_a_thrown_body_with_a_flywheel_is_calibrated(tmp_path: Path) -> None:
    values: dict[str, object] = {
        'imu.rate': 2000.0,
        'imu.bias': [2e-3, -1e-3, 2e-3],
        'imu.scale': [1e-3, -2e-3, 1e-3],
        'initial.base_angular_velocity': [1.8, -2.0, 14.7],
    }
    record(tmp_path, values, 0.5)
    found = calibrated(tmp_path, [2.4e-4, 3e-4, 3.7e-4, 0.0, -2e-5, 1.5e-5])
    assert found is not None
    inertia, std = found['links']['base_link']['estimate']['inertia'], found['links']['base_link']['std']['inertia']
    assert 0.7 < found['residual'] < 1.3
    for name, value in INERTIA.items():
        assert abs(inertia[name] - value) < 4.0 * std[name]
        assert std[name] < 5e-3 * 3e-4


@pytest.mark.parametrize('seed', range(3))
def test_a_tumbling_body_whose_joint_rests_tells_the_ratios_of_its_moments(
    tmp_path: Path, seed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    values: dict[str, object] = {
        'seed': seed,
        'imu.rate': 2000.0,
        'imu.bias': [2e-3, -1e-3, 2e-3],
        'imu.scale': [1e-3, -2e-3, 1e-3],
        'initial.base_angular_velocity': [5.8, -6.0, 11.7],
        **AT_REST,
    }
    record(tmp_path, values, 0.5)
    found = calibrated(tmp_path, [2.4e-4, 3e-4, 3.7e-4, 0.0, -2e-5, 1.5e-5])
    assert found is not None
    link = found['links']['base_link']
    ratios, trace = link['inertia_ratios'], sum(INERTIA[name] for name in ('ixx', 'iyy', 'izz'))
    for name, value in INERTIA.items():
        assert abs(ratios['of_trace'][name] - value / trace) < 4.0 * ratios['std'][name]
        assert ratios['std'][name] < 1e-3
    # The scale is that of the prior, and is said to be.
    assert ratios['scale_relative_std'] > 0.1
    assert {'mass', 'com_x', 'com_y', 'com_z'} <= set(link['stayed_at_cad'])
    assert any('mass, centre of mass and the scale of the inertia stay at CAD' in each for each in found['warnings'])
    given = ['-p', 'target_link:=base_link', '-p', 'window:=0.02', '-p', 'imu.alone:=true']
    given += ['-p', 'imu.noise_density:=1.0e-4', '-p', 'noise.joint_position:=1.0e-3']
    assert replay([str(tmp_path / 'throw'), '--model', str(tmp_path / 'drawn.urdf'), *given]) == 3
    assert 'calibrate gives their ratios' in capsys.readouterr().out
