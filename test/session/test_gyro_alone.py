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
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.intake.dead_reckoning import DeadReckoning
from mbaid_ros.core.samples import ImuStream
from mbaid_ros.replay.bag_types import BAG_TYPES
from mbaid_ros.replay.calibrate import main as calibrate
from mbaid_ros.replay.replay import main as replay
from mbaid_ros.session import Session
from mbaid_ros.simulated_run import SimulatedRun
from simulated import CONFIG
from streams import urdf

THROWN = """<robot name="thrown">
  <link name="base_link"><inertial><origin xyz="0.001 -0.002 0.003"/><mass value="0.28"/>
    <inertia ixx="2.2e-4" iyy="3.1e-4" izz="4.0e-4" ixy="1e-5" ixz="-2e-5" iyz="1.5e-5"/></inertial></link>
  <link name="wheel"><inertial><mass value="0.005"/>
    <inertia ixx="1e-6" iyy="1e-6" izz="1.687e-6" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="spin" type="continuous"><parent link="base_link"/><child link="wheel"/>
    <origin xyz="0 0.01 0.02"/><axis xyz="0 0 1"/></joint>
</robot>"""
CALIBRATE = """calibrate:
  ros__parameters:
    window: 0.02
    imu: {alone: true, noise_density: 1.0e-4, bias_std: 3.0e-3, bias_walk: 1.0e-4, scale_std: 2.0e-3,
          orientation_std: 1.0e-3}
    noise: {joint_position: 1.0e-3, joint_velocity: 1.0}
    time_offset: {prior_std: 1.0e-3}
    prior: {mass_relative_std: 1.0e-3, com_std: 2.0e-3, inertia_relative_std: 0.2, zero_std: 0.0, origin_std: 0.0,
            axis_std: 0.0}
"""


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
    config = build(
        SimulatorConfig,
        {
            'step': 1e-3,
            'joint_rate': 1000.0,
            'imu.rate': 2000.0,
            'imu.noise_density': 1e-4,
            'imu.bias': [2e-3, -1e-3, 2e-3],
            'imu.scale': [1e-3, -2e-3, 1e-3],
            'initial.base_angular_velocity': [1.8, -2.0, 14.7],
            'initial.joint_positions': [-400.0],
            'motion.kind': 'sinusoids',
            'motion.amplitudes': [400.0],
            'motion.frequencies': [0.4],
            'motion.phases': [-0.5 * np.pi],
            'noise.joint_position': 1e-3,
        },
    )
    run = SimulatedRun(config, THROWN, BAG_TYPES)
    with BagWriter(tmp_path / 'throw') as bag:
        bag.add_topic('/joint_states', 'sensor_msgs/msg/JointState')
        bag.add_topic('/imu', 'sensor_msgs/msg/Imu')
        for timed in run.read(0.5):
            if timed.topic != 'odom':
                bag.write(f'/{timed.topic}', timed.message, run.stamp(timed.time))
    drawn = THROWN.replace(
        'ixx="2.2e-4" iyy="3.1e-4" izz="4.0e-4" ixy="1e-5"', 'ixx="2.4e-4" iyy="3e-4" izz="3.7e-4" ixy="0"'
    )
    (tmp_path / 'drawn.urdf').write_text(drawn, encoding='utf-8')
    (tmp_path / 'calibrate.yaml').write_text(CALIBRATE, encoding='utf-8')
    arguments = [tmp_path / 'throw', '--model', tmp_path / 'drawn.urdf', '--params', tmp_path / 'calibrate.yaml']
    arguments += ['--unknown', 'base_link', '--json', tmp_path / 'found.json']
    assert calibrate([str(each) for each in arguments]) == 0
    found = json.loads((tmp_path / 'found.json').read_text(encoding='utf-8'))
    inertia, std = found['links']['base_link']['estimate']['inertia'], found['links']['base_link']['std']['inertia']
    truth = {'ixx': 2.2e-4, 'iyy': 3.1e-4, 'izz': 4.0e-4, 'ixy': 1e-5, 'ixz': -2e-5, 'iyz': 1.5e-5}
    assert 0.7 < found['residual'] < 1.3
    for name, value in truth.items():
        assert abs(inertia[name] - value) < 4.0 * std[name]
        assert std[name] < 5e-3 * 3e-4
