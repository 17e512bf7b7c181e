"""The estimator's parameter files in config/ say what the declarations say."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.parameters import build, specifications
from mbaid_ros.core.robot.model import load_model

ROOT = Path(__file__).resolve().parents[2]
CONFIG = ROOT / 'config'


def test_the_file_of_all_parameters_is_the_one_the_script_writes() -> None:
    script = runpy.run_path(str(ROOT / 'scripts' / 'write_parameters.py'))
    assert (CONFIG / 'estimator.yaml').read_text(encoding='utf-8') == script['text'](), (
        'run scripts/write_parameters.py'
    )


def test_the_file_of_all_parameters_holds_all_defaults() -> None:
    values = load_parameter_file(CONFIG / 'estimator.yaml', 'estimator')
    assert list(values) == list(specifications(EstimatorConfig))
    assert build(EstimatorConfig, values) == EstimatorConfig()


@pytest.mark.parametrize('robot', ['table1', 'ets7', 'servicer7'])
def test_every_robot_has_a_file_that_names_its_last_link(robot: str) -> None:
    config = build(EstimatorConfig, load_parameter_file(CONFIG / f'{robot}_estimator.yaml', 'estimator'))
    assert config.target_link == load_model((CONFIG / f'{robot}.urdf').read_text(encoding='utf-8')).last_link
