"""What a replay says of repairs: in text, JSON and report, and in the parameter file that stands for them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from made_runs import estimate, run
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.config.parameter_files import load_parameter_file
from mbaid_ros.core.repair import Conversion, Repair
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.parameters import build
from mbaid_ros.replay.arguments import replay, simulate
from mbaid_ros.replay.json_output import as_json, parameter_file
from mbaid_ros.replay.report.page import html
from mbaid_ros.replay.text import summary, verdict
from simulated import CONFIG, assigned

ZERO = Repair(
    'the zero of joint4 is off by +30.2 ± 2.2 mrad',
    {'known_joints.joint4.zero_std': 0.05},
    value=0.0302,
    std=0.0011,
    unit='rad',
)
SIGN = Repair('the sign of joint3 is wrong', conversion=Conversion(factors={'joint3': -1.0}))
SENTENCE = (
    'repaired: the zero of joint4 is off by +30.2 ± 2.2 mrad (as if known_joints.joint4.zero_std were 0.05); the '
    'inertia of link7 is identified'
)


def test_the_first_line_of_text_and_report_begins_with_the_repair() -> None:
    made = run(estimate(repairs=(ZERO,)))
    assert verdict(made) == SENTENCE
    assert SENTENCE in summary(made).splitlines()[0]
    assert f'R{SENTENCE[1:]}' in html([made])


def test_the_json_has_the_repairs_and_none_without_any() -> None:
    assert as_json(run(estimate()))['repairs'] == []
    zero, sign = as_json(run(estimate(repairs=(ZERO, SIGN))))['repairs']
    assert zero == {
        'cause': 'the zero of joint4 is off by +30.2 ± 2.2 mrad',
        'parameters': {'known_joints.joint4.zero_std': 0.05},
        'value': 0.0302,
        'std': 0.0011,
        'unit': 'rad',
        'since': None,
    }
    assert sign['parameters'] is None


def test_the_parameter_file_has_what_the_repairs_stand_for(tmp_path: Path) -> None:
    path = tmp_path / 'repaired.yaml'
    path.write_text(parameter_file(run(estimate(repairs=(ZERO,)))), encoding='utf-8')
    config = build(EstimatorConfig, load_parameter_file(path, 'estimator'))
    assert config.known_joints.joints == {'joint4': {'zero_std': 0.05}}
    assert not config.repair


def test_a_contradicted_run_says_that_repair_would_take_its_cause_into_account() -> None:
    final = estimate(status='inconsistent', causes=(('zero', 1000.0),), remedies={'zero': ZERO})
    text = summary(run(final))
    assert '--repair takes the leading cause into account (as if known_joints.joint4.zero_std were 0.05)' in text
    unknown = estimate(status='inconsistent', causes=(('zero', 1000.0),))
    assert '--repair' not in summary(run(unknown))


def test_a_run_that_is_contradicted_all_the_same_says_what_was_tried() -> None:
    text = verdict(run(estimate(status='inconsistent', repairs=(ZERO,))))
    assert text.startswith('repaired: the zero of joint4')
    assert 'all the same, the data contradict the model' in text


@pytest.mark.long
def test_a_sensor_that_contradicts_the_others_is_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag, robot, named = str(tmp_path / 'bag'), ['--model', str(CONFIG / 'servicer7.urdf')], {'poses.names': '[mocap]'}
    wandering = {'position_noise': 8e-3, 'orientation_noise': 1e-4, 'correlation_time': 3.0, 'rate': 50.0}
    made = named | {f'poses.mocap.{name}': value for name, value in wandering.items()}
    made |= {'imu.rate': 100.0, 'imu.noise_density': 1e-4}
    config = ['--params', str(CONFIG / 'servicer7_simulator.yaml'), *assigned(made)]
    assert simulate([*robot, *config, '--duration', '22', '--output', bag]) == 0
    declared = {'position_std': 1e-3, 'orientation_std': 1e-4, 'same_world': 'true'}
    used = named | {'imu.noise_density': 1e-4} | {f'poses.mocap.{name}': value for name, value in declared.items()}
    config = ['--params', str(CONFIG / 'servicer7_estimator.yaml'), *assigned(used), '--json', str(tmp_path / 'out')]
    capsys.readouterr()
    assert replay([bag, *robot, *config, '--repair']) == 0
    text, found = capsys.readouterr().out, json.loads((tmp_path / 'out').read_text(encoding='utf-8'))
    assert 'repaired: poses.mocap contradicts the other sensors' in text
    assert [each['parameters'] for each in found['repairs']] == [{'poses.mocap.use': False}]
    assert list(found['sensors'][-1]['dropped']) == ['left out by a repair']
    truth = json.loads((tmp_path / 'bag' / 'truth.json').read_text(encoding='utf-8'))
    assert found['estimate']['mass'] == pytest.approx(truth['mass'], abs=4.0 * found['std']['mass'])


@pytest.mark.parametrize(
    ('warnings', 'said'),
    [
        ((), 'the data contain no complete window'),
        (('no solution; started again', 'late'), 'no solution; started again'),
    ],
)
def test_a_run_without_a_window_ends_with_its_reason(warnings: tuple[str, ...], said: str) -> None:
    nothing = Estimate(method='trajectory', status='waiting')
    assert verdict(run(nothing, warnings=warnings)) == f'no estimate of link7: {said}'
