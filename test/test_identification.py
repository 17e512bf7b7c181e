"""The function `identify`: the numbers of `replay` from arrays, without ROS; wrong arguments are named."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest

from documents import README, ROOT, python_blocks
from mbaid_ros import identify
from mbaid_ros.bags import BagReader
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.config.parameter_files import load_parameter_file
from mbaid_ros.core.results.estimate import BAND
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.parameters import build
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.json_output import as_json
from mbaid_ros.replay.one_bag import replay_bag

URDF = ROOT / 'config' / 'servicer7.urdf'
PAGE = ROOT / 'docs' / 'how-to' / 'python.md'


@cache
def arrays(bag: str) -> dict[str, Any]:
    """Return the arguments that stand for a shipped bag."""
    with BagReader(ROOT / 'bags' / bag) as content:
        joints = [message for _, message, _ in content.read(['/joint_states'])]
        poses = [message for _, message, _ in content.read(['/odom'])]
    where = [each.pose.pose for each in poses]
    twists = [each.twist.twist for each in poses]
    velocity = np.array([each.velocity for each in joints])
    return {
        'joint_names': list(joints[0].name),
        'joint_time': times(joints),
        'joint_position': np.array([each.position for each in joints]),
        'joint_velocity': velocity if velocity.size else None,
        'base_time': times(poses),
        'base_position': np.array([vector(each.position) for each in where]),
        'base_orientation': np.array([(*vector(each.orientation), each.orientation.w) for each in where]),
        'base_twist': np.array([(*vector(each.linear), *vector(each.angular)) for each in twists]),
    }


def beginning(bag: str, samples: int) -> dict[str, Any]:
    """Return the same of the first samples alone."""
    return {name: each[:samples] if isinstance(each, np.ndarray) else each for name, each in arrays(bag).items()}


def times(messages: list[Any]) -> Any:
    stamps = [each.header.stamp.sec * 1_000_000_000 + each.header.stamp.nanosec for each in messages]
    return np.array(stamps).astype('datetime64[ns]')


def vector(message: Any) -> tuple[float, float, float]:
    return message.x, message.y, message.z


def parameters(robot: str) -> dict[str, object]:
    return load_parameter_file(ROOT / 'config' / f'{robot}_estimator.yaml', 'estimator')


@pytest.mark.parametrize(
    'bag',
    [
        'ets7_pose_only',
        *(pytest.param(each, marks=pytest.mark.long) for each in ('table1_live', 'servicer7_clean', 'servicer7_mid')),
    ],
)
def test_the_numbers_are_those_of_replay_to_the_bit(bag: str) -> None:
    robot = bag.split('_', maxsplit=1)[0]
    urdf = ROOT / 'config' / f'{robot}.urdf'
    found = identify(urdf, **arrays(bag), parameters=parameters(robot)).to_dict()
    config = build(EstimatorConfig, parameters(robot))
    expected = as_json(replay_bag(str(ROOT / 'bags' / bag), config, urdf.read_text(encoding='utf-8'), Inputs()))
    assert {name for name, value in expected.items() if found[name] != value} == {'bag', 'made_by'}
    assert len(found['history']) > 50
    json.dumps(found, allow_nan=False)


def test_the_result_is_arrays_a_report_and_a_urdf(tmp_path: Path) -> None:
    given = beginning('servicer7_mid', 600)
    found = identify(URDF, **given, target_link='link7', parameters=parameters('servicer7'))
    ten = found.run.final.parameters
    assert (str(found.status), found.target_link) == ('estimating', 'link7')
    assert np.all(found.identifiable)
    assert [found.mass, *found.com, *found.inertia[np.triu_indices(3)]] == ten.tolist()
    np.testing.assert_array_equal(found.inertia, found.inertia.T)
    np.testing.assert_allclose(found.std, np.sqrt(np.diag(found.covariance)), rtol=1e-12)
    assert found.momentum.shape == (6,)
    assert (found.causes, found.repairs) == ((), ())
    history = found.history
    np.testing.assert_array_equal(history.parameters[-1], ten)
    assert history.time.shape == (len(history.status),)
    assert history.std.shape == history.parameters.shape
    assert 'mass' in str(found)
    found.report(tmp_path / 'report.html')
    assert '<svg' in (tmp_path / 'report.html').read_text(encoding='utf-8')
    link = load_model(found.to_urdf()).link('link7')
    np.testing.assert_allclose(physical(link.parameters), ten, rtol=1e-9)


def test_what_no_other_program_can_use_is_no_urdf() -> None:
    given = beginning('table1_live', 400)
    with pytest.raises(ValueError, match='do not determine com_z'):
        identify(ROOT / 'config' / 'table1.urdf', **given, parameters=parameters('table1')).to_urdf()


# The second of times and the first 50 samples are enough to be refused.
N, M, K = 50, 40, 30
GOOD: dict[str, Any] = {
    'urdf': URDF,
    'joint_time': 0.02 * np.arange(N),
    'joint_position': np.zeros((N, 7)),
    'base_time': 0.025 * np.arange(M),
    'base_position': np.zeros((M, 3)),
    'base_orientation': np.tile([0.0, 0.0, 0.0, 1.0], (M, 1)),
}
JOINTS = [f'joint{number}' for number in range(1, 8)]


@pytest.mark.parametrize(
    ('wrong', 'text'),
    [
        ({'urdf': 3}, r'urdf is of type int; accepted: the text of a URDF, or a path'),
        ({'urdf': 'no/such.urdf'}, r'urdf: .*no/such\.urdf'),
        ({'urdf': '<robot name="x"/>'}, r'urdf: '),
        ({'joint_time': np.zeros((N, 1))}, r'joint_time has the shape \(50, 1\); accepted: \(N,\) with N >= 2, in s'),
        ({'joint_time': np.zeros(N)}, r'joint_time\[1\] is not later than the one before; accepted: increasing times'),
        ({'joint_time': np.full(N, np.nan)}, r'joint_time has nan; accepted: seconds'),
        ({'joint_time': 1e9 * np.arange(N)}, r'joint_time has 5e\+09; accepted: seconds, of a size up to 4e\+09'),
        ({'joint_time': ['a'] * N}, r'joint_time is of type <U1; accepted: an array of real numbers'),
        (
            {'joint_position': np.zeros((7, N))},
            r'joint_position has the shape \(7, 50\); accepted: \(N, 7\) with N = 50',
        ),
        ({'joint_position': np.zeros((N, 6))}, r'joint_position has the shape \(50, 6\); .*joint1, .*joint7'),
        ({'joint_position': [[0.0], [0.0, 1.0]]}, r'joint_position has rows of different lengths'),
        ({'joint_position': np.zeros((N, 7), complex)}, r'joint_position is of type complex128; .* real numbers'),
        ({'joint_velocity': np.zeros(N)}, r'joint_velocity has the shape \(50,\); accepted: \(N, 7\) with N = 50'),
        ({'joint_names': 'joint1'}, r'joint_names is of type str; accepted: a list of names, joint1, '),
        ({'joint_names': [*JOINTS[:6], 'elbow']}, r'joint_names has elbow, no joint of the robot; accepted: joint1, '),
        ({'joint_names': JOINTS[:6]}, r'joint_names lacks joint7; accepted: every joint of joint1, '),
        ({'joint_names': [*JOINTS, 'joint1']}, r'joint_names has a name twice; accepted: each name once'),
        ({'base_time': 100.0 + GOOD['base_time']}, r'base_time is from 100 to 100.975 s; .* one clock that overlap'),
        ({'base_time': GOOD['base_time'][::-1]}, r'base_time\[1\] is not later than the one before; accepted: increas'),
        ({'base_position': np.zeros((M, 2))}, r'base_position has the shape \(40, 2\); accepted: \(M, 3\) with M = 40'),
        ({'base_orientation': None}, r'base_orientation is of type object; accepted: an array of real numbers'),
        ({'base_orientation': np.zeros((M, 3))}, r'base_orientation has the shape \(40, 3\); .*: x, y, z, w'),
        ({'base_orientation': np.full((M, 4), 2.0)}, r'base_orientation\[0\] has the length 4; accepted: unit quater'),
        ({'base_twist': np.zeros((M, 3))}, r'base_twist has the shape \(40, 3\); .*: linear, then angular velocity'),
        ({'gyro': np.zeros((K, 3))}, r'gyro is of type ndarray; accepted: a pair of times \(K,\) and rates \(K, 3\)'),
        (
            {'gyro': (None, np.zeros((K, 3))), 'parameters': {'imu.noise_density': 1e-5}},
            r'gyro\[0\] is of type object; accepted: an array of real numbers',
        ),
        ({'gyro': (np.arange(K), np.zeros((K, 3)))}, r"gyro is given without its noise; accepted: 'imu.noise_density'"),
        (
            {'gyro': (0.01 * np.arange(K), np.zeros((3, K))), 'parameters': {'imu.noise_density': 1e-5}},
            r'gyro\[1\] has the shape \(3, 30\); accepted: \(K, 3\) with K = 30',
        ),
        ({'target_link': 7}, r'target_link is of type int; accepted: the name of a link'),
        ({'target_link': 'link70'}, r"target_link is 'link70', no link of the robot; accepted: base_link, .*link7"),
        ({'parameters': [1]}, r'parameters is of type list; accepted: a dict of dotted names'),
        ({'parameters': {'windw': 1.0}}, r"parameters: unknown parameter 'windw'; known: window"),
        (
            {'parameters': {'poses.names': ['camera'], 'gyros.names': ['hand'], 'gyros.hand.noise_density': 1e-5}},
            r'parameters has gyros\.hand, poses\.camera, whose readings no argument holds; accepted: imu alone',
        ),
        ({'parameters': {'window': -1.0}}, r"parameters: parameter 'window' is -1.0 s; accepted: "),
    ],
)
def test_a_wrong_argument_is_named_with_what_is_accepted(wrong: dict[str, Any], text: str) -> None:
    with pytest.raises(ValueError, match=text) as caught:
        identify(**{**GOOD, **wrong})
    assert '\n' not in str(caught.value)


def test_neither_ros_nor_a_bag_is_imported(tmp_path: Path) -> None:
    """As in an environment where nothing of ROS is installed: a name in sys.modules that is None cannot be imported."""
    absent = 'rclpy', 'rosbags', 'mcap', 'mbaid_msgs', 'std_msgs', 'ament_index_python', 'matplotlib', 'tqdm'
    np.savez(tmp_path / 'arrays.npz', **beginning('servicer7_mid', 300))
    code = f"""
import sys
sys.modules.update(dict.fromkeys({absent}))
import numpy as np
from mbaid_ros import identify
with np.load({str(tmp_path / 'arrays.npz')!r}) as file:
    found = identify({str(URDF)!r}, **{{**file, 'joint_names': file['joint_names'].tolist()}})
print(found.status)
assert len(found.to_dict()) > 30
import mbaid_ros.replay.export
del sys.modules['matplotlib']
found.report({str(tmp_path / 'report.html')!r})
"""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(('ROS_', 'AMENT_', 'RMW_'))}
    run = subprocess.run(
        [sys.executable, '-c', code],
        env={**environment, 'PYTHONPATH': str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (run.returncode, run.stderr) == (0, '')
    assert run.stdout == 'estimating\n'


def test_a_gyro_beside_poses_is_used() -> None:
    given = beginning('servicer7_mid', 400)
    rates, own = given['base_twist'][:, 3:], {**parameters('servicer7'), 'imu.noise_density': 2e-5}
    found = identify(URDF, **{**given, 'base_twist': None}, gyro=(given['base_time'], rates), parameters=own)
    assert found.run.topics[2].topic == 'imu'
    alone = identify(URDF, **{**given, 'base_twist': None}, parameters=own)
    assert np.all(found.std[found.identifiable] < alone.std[found.identifiable])


def test_the_example_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mpl.use('svg')
    monkeypatch.chdir(ROOT)
    code = '\n'.join(python_blocks(PAGE)).replace("'docs/images/python.svg'", repr(str(tmp_path / 'python.svg')))
    known: dict[str, Any] = {}
    exec(compile(code, str(PAGE), 'exec'), known)
    result = known['result']
    assert result.mass == pytest.approx(162.0, abs=8.0)
    assert f'{result.mass:.1f} ± {BAND * result.std[0]:.1f} kg' in README.read_text(encoding='utf-8')
    assert (tmp_path / 'python.svg').stat().st_size > 10_000


@pytest.mark.filterwarnings('error::RuntimeWarning')
def test_readings_of_nothing_that_moves_have_a_status_and_no_warning_of_numpy() -> None:
    time, upright = 0.01 * np.arange(400), np.tile([0.0, 0.0, 0.0, 1.0], (400, 1))
    found = identify(URDF, time, np.zeros((400, 7)), time, np.zeros((400, 3)), upright)
    assert found.status == 'not_identifiable'
    assert np.isnan(found.mass)
