"""A robot with panels: calibrated with a free hand, then what it holds is identified from the calibration's file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.appendages import PANELS, with_free_panels, with_panels
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.replay.arguments import calibrate, replay, simulate
from observed import true_body
from simulated import CONFIG

NOISE = 'noise: {joint_position: 1.0e-4, joint_velocity: 1.0e-3, base_position: 1.0e-3, base_linear_velocity: 1.0e-3, '
NOISE += 'base_orientation: 1.0e-4, base_angular_velocity: 1.0e-4}'
START = '0.4, 0.7, -0.3, 0.9, 0.5, -0.6, 0.2'
TRUE = (0.3, 0.31)  # Hz


def parameters(path: Path, frequencies: tuple[float, float], *more: str) -> str:
    """Write a parameter file for any node and return its name."""
    joints = ', '.join(f'{name}: {{frequency: {each}}}' for name, each in zip(PANELS, frequencies, strict=True))
    own = (NOISE, f'flexible: {{joints: [{", ".join(PANELS)}], {joints}}}', *more)
    path.write_text('\n    '.join(('/**:\n  ros__parameters:', *own)), encoding='utf-8')
    return str(path)


@pytest.mark.long
def test_panels_are_calibrated_before_a_capture(tmp_path: Path) -> None:
    motion = (CONFIG / 'servicer7_simulator.yaml').read_text(encoding='utf-8').partition('ros__parameters:')[2]
    motion = motion.strip().replace(START, f'{START}, 0.02, -0.01').replace('100.0', '50.0')
    for seed, (name, urdf) in enumerate((('free', with_free_panels()), ('held', with_panels())), start=1):
        (tmp_path / f'{name}.urdf').write_text(urdf, encoding='utf-8')
        moved = parameters(tmp_path / f'{name}.yaml', TRUE, f'seed: {seed}', motion)
        files = ['--model', str(tmp_path / f'{name}.urdf'), '--params', moved, '--output', str(tmp_path / name)]
        assert simulate([*files, '--duration', '30']) == 0
    declared, found = (0.315, 0.295), {name: tmp_path / name for name in ('out.urdf', 'out.json', 'held.json')}
    files = [str(tmp_path / 'free'), '--model', str(tmp_path / 'free.urdf'), '--output', str(found['out.urdf'])]
    files += ['--params', parameters(tmp_path / 'calibrate.yaml', declared), '--json', str(found['out.json'])]
    assert calibrate(files) == 0
    panels = json.loads(found['out.json'].read_text(encoding='utf-8'))['flexible']
    assert [panels[name]['frequency'] for name in PANELS] == pytest.approx(TRUE, rel=5e-3)
    known = f'known_links: {{calibration: {found["out.json"]}}}'
    files = [str(tmp_path / 'held'), '--model', str(found['out.urdf']), '--json', str(found['held.json'])]
    files += ['--params', parameters(tmp_path / 'replay.yaml', declared, 'target_link: link7', known)]
    assert replay(files) == 0
    result = json.loads(found['held.json'].read_text(encoding='utf-8'))
    estimate = result['estimate']
    error = np.array([estimate['mass'], *estimate['com'], *estimate['inertia'].values()])
    error -= true_body(MomentumKernel(load_model(with_panels()), 'link7'))
    assert error @ np.linalg.solve(np.array(result['covariance']), error) < chi2.isf(1e-4, 10)
