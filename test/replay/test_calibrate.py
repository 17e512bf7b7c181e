"""The executable `calibrate`: from bags and a URDF of CAD values to a calibrated one, and what it refuses."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pinocchio
import pytest
from scipy.stats import chi2

import recorded
from benchmarks.precapture import free_model, free_urdf, perturbed
from checked import answer
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.links import declared_errors
from mbaid_ros.core.robot.body import physical, physical_jacobian
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.robot.urdf import replace_inertial
from mbaid_ros.parameters import build
from mbaid_ros.replay.arguments import calibrate as main
from mbaid_ros.replay.arguments import replay
from mbaid_ros.session.session import Session
from mbaid_ros.simulation.simulation import Truth
from mbaid_ros.simulation.true_robot import ErrorStds, draw, generator, true_robot
from observed import configured_motion, kernel, true_body
from servicers import LINKS, PRIORS, free_motion, motion_of, sensed

PARAMETERS = """
/**:
  ros__parameters:
    noise.joint_position: 1.0e-4
calibrate:
  ros__parameters:
    known_links:
      relative_std: 0.05
      base_link.mass_relative_std: 0.001
"""


def described(folder: Path) -> Path:
    """Write a URDF that is off, and parameters."""
    cad = free_urdf()
    for link in perturbed(free_model(), PRIORS, 7).links:
        cad = replace_inertial(cad, link.name, physical(link.parameters))
    (folder / 'cad.urdf').write_text(cad, encoding='utf-8')
    (folder / 'calibrate.yaml').write_text(PARAMETERS, encoding='utf-8')
    return folder


@pytest.fixture(scope='module')
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a bag of a free motion, a URDF that is off, and parameters."""
    folder = tmp_path_factory.mktemp('calibration')
    recorded.write(folder / 'before', free_model(), sensed(free_motion(1, 60.0)[:800], 1))
    recorded.write(folder / 'again', free_model(), sensed(free_motion(2, 30.0)[:300], 2))
    return described(folder)


def run(place: Path, *arguments: str, code: int = 0) -> int:
    assert main([str(place / 'before'), '--model', str(place / 'cad.urdf'), *arguments]) == code
    return code


@pytest.fixture(scope='module')
def result(place: Path) -> Any:
    """Return the JSON of a calibration that also wrote URDF and report."""
    files = {name: str(place / f'out.{name}') for name in ('json', 'urdf', 'html')}
    options = ['--params', str(place / 'calibrate.yaml'), '--json', files['json'], '--report', files['html']]
    run(place, *options, '--output', files['urdf'])
    return json.loads((place / 'out.json').read_text(encoding='utf-8'))


def test_the_json_has_links_covariance_and_what_is_identifiable(result: Any) -> None:
    assert result['status'] == 'calibrated'
    assert list(result['links']) == list(LINKS)
    base = result['links']['base_link']
    for key in ('cad', 'estimate', 'std', 'prior_std', 'learnt', 'moved'):
        assert set(base[key]) == {'mass', 'com', 'inertia'}
    assert base['prior_std']['mass'] == pytest.approx(0.001 * base['cad']['mass'], rel=1e-6)
    assert result['covariance']['order'][:5] == [f'base_link.{name}' for name in ('m', 'hx', 'hy', 'hz', 'Ixx')]
    assert result['covariance']['order'][80:83] == ['joint1.zero', 'joint1.origin_x', 'joint1.origin_y']
    assert result['covariance']['order'][-6:] == [
        f'odometry_mount.{name}' for name in ('turn_x', 'turn_y', 'turn_z', *'xyz')
    ]
    matrix = np.array(result['covariance']['matrix'])
    assert matrix.shape == (128, 128)
    std = np.sqrt(np.diag(matrix))
    joint = result['joints']['joint3']
    assert [joint['zero_std'], *joint['origin_std'], *joint['axis_std']] == pytest.approx(std[92:98])
    assert result['odometry_mount']['position_std'] == pytest.approx(std[-3:])
    # The motion determines a zero in part, of the position of a joint along its axis next to nothing.
    assert joint['zero_std'] < 0.9e-3 < joint['origin_std'][2] <= 1e-3
    assert np.linalg.eigvalsh(matrix / np.sqrt(np.outer(np.diag(matrix), np.diag(matrix))))[0] > -1e-9
    # Each of seven revolute joints exchanges mass, first moment and a rod's inertia between two of eight bodies.
    assert 0 < result['identifiability']['determined'] <= 59 + 7 * 6 + 6
    masses = [link['estimate']['mass'] for link in result['links'].values()]
    total_std = np.sqrt(np.sum(matrix[:80:10, :80:10]))
    assert total_std == pytest.approx(result['scale']['relative_std'] * sum(masses), rel=1e-6)
    assert len(result['momentum']) == 1


def test_the_estimates_are_right_within_their_covariance(result: Any) -> None:
    theta = np.concatenate([link.parameters for link in free_model().links])
    error = np.array(result['covariance']['values'])
    error[:80] -= theta
    covariance = np.array(result['covariance']['matrix'])
    # Eighty chi-squares: joints and mount are right, which makes the other 48 smaller.
    assert error @ np.linalg.solve(covariance, error) < 80.0 + 4.0 * np.sqrt(160.0)
    assert error[:80] @ np.linalg.solve(covariance[:80, :80], error[:80]) > 40.0
    assert result['residual'] == pytest.approx(1.0, abs=0.1)


def test_other_programs_read_the_calibrated_values(place: Path, result: Any) -> None:
    path = str(place / 'out.urdf')
    model = pinocchio.buildModelFromUrdf(path, pinocchio.JointModelFreeFlyer())
    spec = mujoco.MjSpec.from_file(path)
    spec.body('base_link').add_freejoint()
    other = spec.compile()
    for index, (name, link) in enumerate(result['links'].items()):
        mass, com = link['estimate']['mass'], link['estimate']['com']
        inertia = np.array([link['estimate']['inertia'][key] for key in ('ixx', 'iyy', 'izz')])
        body = model.inertias[index + 1]
        assert body.mass == pytest.approx(mass, rel=1e-8)
        assert body.lever == pytest.approx(np.array(com), abs=1e-8)
        assert np.diag(body.inertia) == pytest.approx(inertia, rel=1e-8)
        assert other.body(name).mass[0] == pytest.approx(mass, rel=1e-8)
        assert other.body(name).ipos == pytest.approx(np.array(com), abs=1e-8)
        assert other.body(name).inertia.sum() == pytest.approx(inertia.sum(), rel=1e-6)


def test_data_that_contradict_the_model_end_with_4_and_no_urdf(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # CAD values that are wrong, and said to be exact; a joint that moves, and is said to be fixed.
    robot = (place / 'cad.urdf').read_text()
    (tmp_path / 'fixed.urdf').write_text(re.sub(r'(<joint name="joint7" type=)"\w+"', r'\1"fixed"', robot))
    (tmp_path / 'exact.yaml').write_text('calibrate: {ros__parameters: {known_links.relative_std: 1.0e-3}}')
    files = {name: tmp_path / f'out.{name}' for name in ('json', 'urdf', 'html')}
    outputs = ['--json', str(files['json']), '--report', str(files['html']), '--output', str(files['urdf'])]
    run(place, '--model', str(tmp_path / 'fixed.urdf'), '--params', str(tmp_path / 'exact.yaml'), *outputs, code=4)
    shown = capsys.readouterr().out
    assert 'so the values of 8 bodies must not be trusted' in shown.split('\n\n')[1].splitlines()[0]
    assert 'likely cause: joint states contain joint7, fixed or missing in the robot description' in shown
    assert json.loads(files['json'].read_text())['status'] == 'inconsistent'
    assert '<p class="verdict wrong">the data contradict the model' in files['html'].read_text()
    assert not files['urdf'].exists()


@pytest.mark.parametrize(
    ('parameters', 'arguments', 'reason'),
    [
        ('known_links.moon.com_std: 0.1', [], "link 'moon' is not in the robot description"),
        ('prior.com_std: 0.1', [], "unknown parameter 'prior.com_std'"),
        ('', ['--unknown', 'link3', 'link3'], '--unknown names link3 twice; accepted: each link once'),
        ('known_links.relative_std: 0.0', [], "'known_links.relative_std' is 0, which makes base_link exact"),
        ('', ['-p', 'known_links.total_mass:=400.0'], 'are 400 kg and 0 kg; accepted: both above 0, or none'),
        ('', ['--unknown', 'link9'], "link 'link9' is not in the robot description; links: base_link, link1"),
        ('', ['--output', '.'], "--output '.' cannot be written"),
    ],
)
def test_bad_input_is_one_line_that_says_what_to_add(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], parameters: str, arguments: list[str], reason: str
) -> None:
    file = tmp_path / 'calibrate.yaml'
    file.write_text(f'calibrate:\n  ros__parameters:\n    window: 0.5\n    {parameters}\n')
    files = [str(place / 'before'), '--model', str(place / 'cad.urdf'), '--params', str(file)]
    assert reason in answer(main, capsys, *files, *arguments, code=2)


def test_links_without_an_inertial_that_the_data_leave_open_are_named(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = ET.fromstring((place / 'cad.urdf').read_text(encoding='utf-8'))
    for link in robot.findall("link[@name='link2']"):
        link.remove(*link.findall('inertial'))
    model = tmp_path / 'bare.urdf'
    model.write_text(ET.tostring(robot, encoding='unicode'), encoding='utf-8')
    arguments = ['--unknown', *(f'link{index}' for index in range(1, 8))]
    assert main([str(place / 'before'), '--model', str(model), *arguments]) == 3
    assert 'the data do not determine link2.' in capsys.readouterr().err


def test_a_model_that_would_be_overwritten_or_has_an_unphysical_prior_is_refused(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(place, '--output', str(place / 'cad.urdf'), code=2)
    assert 'is the model itself; accepted: another file' in capsys.readouterr().err
    urdf = (place / 'cad.urdf').read_text(encoding='utf-8')
    values = physical(load_model(urdf).link('link3').parameters)
    values[4] *= 9.0
    model = tmp_path / 'odd.urdf'
    model.write_text(replace_inertial(urdf, 'link3', values), encoding='utf-8')
    said = answer(main, capsys, str(place / 'before'), '--model', str(model), code=2)
    assert "link 'link3' has an inertia that no body has" in said


def test_one_moving_joint_is_flagged_and_none_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / 'free.urdf').write_text(free_urdf(), encoding='utf-8')
    recorded.write(tmp_path / 'one', free_model(), sensed(free_motion(3, 20.0, joints=(3,)), 1))
    found = {name: str(tmp_path / f'found.{name}') for name in ('urdf', 'json')}
    outputs = ['--output', found['urdf'], '--json', found['json']]
    assert main([str(tmp_path / 'one'), '--model', str(tmp_path / 'free.urdf'), *outputs]) == 0
    said = capsys.readouterr().out
    assert 'only joint4 moves: bodies on both sides of a joint at rest count as one' in said
    assert f'{found["urdf"]}, with known_links.calibration {found["json"]}' in said.splitlines()[-1]
    still = free_motion(3, 20.0, joints=(3,))[np.zeros(400, dtype=int)]
    motions = {name: 0.0 * value for name, value in vars(still).items() if 'velocity' in name}
    motions['time'] = np.arange(400) / 20.0
    recorded.write(tmp_path / 'none', free_model(), sensed(Truth(**{**vars(still), **motions}), 1))
    assert main([str(tmp_path / 'none'), '--model', str(tmp_path / 'free.urdf')]) == 3
    assert 'the data add nothing to the prior: move all joints' in capsys.readouterr().err


def test_the_estimator_takes_what_it_leaves_uncertain(
    place: Path, result: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parameters = tmp_path / 'estimator.yaml'
    parameters.write_text(f'estimator: {{ros__parameters: {{known_links.calibration: {place / "out.json"}}}}}')
    values = {'known_links.calibration': str(place / 'out.json')}
    session = Session(build(EstimatorConfig, values), (place / 'out.urdf').read_text(encoding='utf-8'))
    given = np.array(result['covariance']['matrix'])[:70, :70]
    size = np.sqrt(np.diag(given))
    used = session.robot.kernel.errors.covariance
    assert used / np.outer(size, size) == pytest.approx(given / np.outer(size, size), abs=1e-9)
    arguments = [str(place / 'again'), '--model', str(place / 'cad.urdf'), '--params', str(parameters)]
    assert replay(arguments) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1
    assert "link 'base_link' has other values in the robot description than in calibration" in error


def test_one_declaration_serves_calibration_and_estimator_and_the_whole_robot_may_be_weighed(place: Path) -> None:
    """The prior of each link is the estimator's own; the total mass is known as well as the scale."""
    (place / 'one.yaml').write_text(
        'estimator: {ros__parameters: {known_links: {relative_std: 0.05, link2: {mass_relative_std: 0.01}, '
        'calibration: none.json}, known_joints: {joint3: {zero_std: 2.0e-3}}}}'
    )
    options = ['--params', str(place / 'one.yaml'), '--json', str(place / 'one.json')]
    whole = float(sum(link.parameters[0] for link in free_model().links))
    weighed = ['-p', f'known_links.total_mass:={whole}', '-p', 'known_links.total_mass_std:=0.5']
    run(place, '--start', '30', *options, *weighed)
    found = json.loads((place / 'one.json').read_text(encoding='utf-8'))
    cad = load_model((place / 'cad.urdf').read_text(encoding='utf-8'))
    config = build(EstimatorConfig, {'known_links.relative_std': 0.05, 'known_links.link2.mass_relative_std': 0.01})
    errors = declared_errors(MomentumKernel(cad, 'link7'), config.known_links)
    for index, name in enumerate(LINKS[:7]):
        rows = slice(10 * index, 10 * index + 10)
        jacobian = physical_jacobian(cad.link(name).parameters)
        std = np.sqrt(np.diag(jacobian @ errors.covariance[rows, rows] @ jacobian.T))
        prior = found['links'][name]['prior_std']
        assert [prior['mass'], *prior['com'], *prior['inertia'].values()] == pytest.approx(std, rel=1e-4)
    assert found['joints']['joint3']['zero_std'] > found['joints']['joint2']['zero_std']
    total = sum(link['estimate']['mass'] for link in found['links'].values())
    assert total == pytest.approx(whole, abs=2.0)
    assert found['scale']['relative_std'] * total <= 0.51


@pytest.fixture(scope='module')
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the calibration of a robot that is not its URDF, and a bag of it with the target in hand."""
    folder = described(tmp_path_factory.mktemp('drawn'))
    errors = draw(free_model(), 'link7', ErrorStds(0.0, 1e-3, 1e-3, 1e-3, 2e-3, 2e-3), generator(5))
    before = motion_of(true_robot(free_model(), errors, ('link7',)), 4, 60.0)
    recorded.write(folder / 'before', free_model(), sensed(before, 1, errors))
    after = configured_motion('servicer7', 30.0, 20.0, errors)
    recorded.write(folder / 'after', free_model(), sensed(after, 2, errors))
    options = ['--params', str(folder / 'calibrate.yaml'), '--json', str(folder / 'out.json')]
    arguments = [str(folder / 'before'), '--model', str(folder / 'cad.urdf'), '--output', str(folder / 'out.urdf')]
    assert main([*arguments, *options]) == 0
    return folder


@pytest.mark.long
def test_the_estimator_goes_on_from_the_file_of_a_robot_that_is_not_its_urdf(drawn: Path) -> None:
    (drawn / 'after.yaml').write_text(
        'estimator: {ros__parameters: {target_link: link7, noise.joint_position: 1.0e-4, '
        f'known_links.calibration: {drawn / "out.json"}}}}}'
    )
    (drawn / 'cad.yaml').write_text('estimator: {ros__parameters: {target_link: link7, noise.joint_position: 1.0e-4}}')
    last = {}
    for name, model in (('after', 'out'), ('cad', 'cad')):
        files = ['--model', str(drawn / f'{model}.urdf'), '--params', str(drawn / f'{name}.yaml')]
        replay([str(drawn / 'after'), *files, '--json', str(drawn / f'{name}.json')])
        last[name] = json.loads((drawn / f'{name}.json').read_text(encoding='utf-8'))
    true, found = true_body(kernel('servicer7')), last['after']
    estimate = found['estimate']
    error = np.array([estimate['mass'], *estimate['com'], *estimate['inertia'].values()]) - true
    assert chi2.ppf(1e-4, 10) < error @ np.linalg.solve(np.array(found['covariance']), error) < chi2.isf(1e-4, 10)
    assert found['status'] in {'converged', 'estimating'}
    # What was learnt before the capture counts: from CAD values the mass is known half as well, at most.
    assert found['std']['mass'] < 0.5 * last['cad']['std']['mass']
