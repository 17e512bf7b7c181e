"""The captured body alone: from a bag with known truth to JSON, bag, report and exports."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

import recorded
from benchmarks.precapture import BARE_LINK7, free_model, free_urdf
from captured import alone, capture, sensed
from checked import answer
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.replay.start import export, replay
from simulated import CONFIG

BAG = CONFIG.parent / 'bags' / 'servicer7_mid'


@pytest.fixture(scope='module', name='folder')
def replayed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with what a replay writes."""
    folder = tmp_path_factory.mktemp('captured')
    (folder / 'robot.urdf').write_text(free_urdf(), encoding='utf-8')
    parameters = (CONFIG / 'servicer7_estimator.yaml').read_text(encoding='utf-8')
    (folder / 'estimator.yaml').write_text(f'{parameters}    debris: {{report: true}}\n')
    outputs = (('--json', 'result.json'), ('--report', 'report.html'), ('--output', 'estimates'))
    arguments = [str(BAG), '--model', str(folder / 'robot.urdf'), '--params', str(folder / 'estimator.yaml')]
    assert replay([*arguments, *(word for option, name in outputs for word in (option, str(folder / name)))]) == 0
    return folder


def test_the_body_is_found(folder: Path) -> None:
    result = json.loads((folder / 'result.json').read_text())
    found = result['debris']
    values = np.array([found['mass'], *found['com'], *found['inertia'].values()])
    covariance = np.array(found['covariance'])
    error = values - physical(alone())
    assert float(error @ np.linalg.solve(covariance, error)) < chi2.isf(1e-3, 10)
    assert found['mass'] == pytest.approx(result['estimate']['mass'] - BARE_LINK7[0])
    std = [found['std']['mass'], *found['std']['com'], *found['std']['inertia'].values()]
    assert std == pytest.approx(np.sqrt(np.diag(covariance)))


exported = partial(answer, export)


def test_it_is_exported_from_json_and_bag_alike(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    from_json, from_bag = (
        json.loads(exported(capsys, str(folder / name), '--debris', '--format', 'json'))
        for name in ('result.json', 'estimates')
    )
    assert from_json == from_bag
    together = json.loads(exported(capsys, str(folder / 'estimates'), '--format', 'json'))
    assert together['target_link'] == 'link7'
    assert together['mass'] - from_json['mass'] == pytest.approx(BARE_LINK7[0])
    text = exported(capsys, str(folder / 'result.json'), '--debris', '--output', str(folder / 'body.urdf'))
    assert "body.urdf: the body that 'link7' holds as " in text


def test_a_capture_in_a_bag(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    run = capture(4.0, 10.0, np.array([0.004, -0.006, 0.003]), np.array([0.02, -0.03, 0.015]))
    bag = recorded.write(tmp_path / 'bag', free_model(), sensed(run.truth, 2))
    urdf, parameters, report = (tmp_path / name for name in ('robot.urdf', 'estimator.yaml', 'report.html'))
    urdf.write_text(free_urdf(), encoding='utf-8')
    given = 'estimator: {ros__parameters: {capture.time: 4.0, debris.report: true}}'
    parameters.write_text(given)
    arguments = [str(bag), '--model', str(urdf), '--target', 'link7', '--params', str(parameters), '--json', '-']
    assert replay([*arguments, '--report', str(report)]) == 0
    result = json.loads(capsys.readouterr().out)
    found = result['capture']
    assert found['t'] == 4.0
    for part, expected in (('linear', run.momentum[:3]), ('angular', run.momentum[3:])):
        z = (np.array(found[f'target_{part}_momentum']) - expected) / np.array(found[f'target_{part}_momentum_std'])
        assert np.all(np.abs(z) < 4.0)
    assert found['chaser']['residual'] == pytest.approx(1.0, abs=0.4)
    assert found['chaser']['samples'] == 350
    assert np.linalg.norm(found['target_angular_velocity']) == pytest.approx(0.039, abs=0.02)
    text = report.read_text()
    assert 'Captured at 4 s.' in text
    assert 'spin z' in text
    # A capture that is not announced is momentum that is not conserved.
    parameters.write_text(given.replace('4.0', '400.0'))
    assert replay(arguments) == 4
    result = json.loads(capsys.readouterr().out)
    assert (result['status'], result['capture']) == ('inconsistent', None)
    assert any('the known model changes' in warning for warning in result['warnings'])
    # A bag that ends before the capture leads to no estimate.
    early = recorded.write(tmp_path / 'early', free_model(), sensed(run.truth, 2)[:350])
    assert replay([str(early), *arguments[1:-2]]) == 3
    assert 'the data end before the capture: capture.time puts it at 400 s' in capsys.readouterr().out
