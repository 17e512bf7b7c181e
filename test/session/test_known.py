"""How well the known links are known: a calibration's file, and what is said of one that cannot be used."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.session.known import with_known_errors
from servicing import LINKS, free_servicer, standard_parameters

ROBOT = MomentumKernel(free_servicer(), 'link7')


def matrix() -> Array:
    factor = np.random.default_rng(1).normal(size=(80, 80)) * 10.0 ** np.linspace(-3.0, 0.0, 80)[:, None]
    return factor @ factor.T


def content(**changed: Any) -> dict[str, Any]:
    covariance = {'values': standard_parameters(free_servicer()).tolist(), 'matrix': matrix().tolist()}
    return {'links': {name: {} for name in LINKS}, 'covariance': {**covariance, **changed}}


def read(path: Path, found: object, **parameters: object) -> tuple[MomentumKernel, Array | None]:
    path.write_text(found if isinstance(found, str) else json.dumps(found), encoding='utf-8')
    values = {'known_links.calibration': str(path), **{f'known_links.{key}': x for key, x in parameters.items()}}
    return with_known_errors(ROBOT, build(EstimatorConfig, values).known_links)


def test_the_covariance_is_that_of_the_file(tmp_path: Path) -> None:
    robot, own = read(tmp_path / 'calibration.json', content())
    assert robot.errors.bodies == tuple(range(7))
    size = np.sqrt(np.diag(matrix()))
    wanted = matrix() / np.outer(size, size)
    assert robot.errors.covariance / np.outer(size[:70], size[:70]) == pytest.approx(wanted[:70, :70], abs=1e-11)
    assert own == pytest.approx(matrix()[70:, 70:])


def test_a_part_of_the_links(tmp_path: Path) -> None:
    part = content(values=standard_parameters(free_servicer())[:20].tolist(), matrix=matrix()[:20, :20].tolist())
    part['links'] = {'base_link': {}, 'link1': {}}
    robot, own = read(tmp_path / 'calibration.json', part)
    assert robot.errors.bodies == (0, 1)
    assert own is None


def changed_values() -> list[float]:
    values = standard_parameters(free_servicer())
    values[30] *= 1.01
    return values.tolist()


@pytest.mark.parametrize(
    ('found', 'parameters', 'reason'),
    [
        ('[1, 2', {}, 'is no calibration: Expecting'),
        ('[]', {}, 'is no calibration: it is no object of JSON; accepted: what calibrate --json writes'),
        ({'mass': 1.0}, {}, "is no calibration: it lacks 'links'"),
        ({'links': {}, 'covariance': None}, {}, 'is no calibration: '),
        (
            {**content(), 'status': 'inconsistent'},
            {},
            'must not be trusted, for its data contradict the model; accepted',
        ),
        (
            content(matrix=[[1.0]]),
            {},
            'is no calibration: values and covariance of 8 links have the shapes (80,), (1, 1)',
        ),
        (content(matrix=(-matrix()).tolist()), {}, 'its matrix is no covariance'),
        (content(values=changed_values()), {}, "link 'link3' has other values in the robot description than in"),
        (
            {**content(), 'links': {name: {} for name in (*LINKS[:7], 'claw')}},
            {},
            'is of claw; accepted: links of the robot',
        ),
        (content(), {'names': ['link1'], 'stds': [0.1]}, "parameter 'known_links.names' is ('link1',)"),
    ],
)
def test_what_cannot_be_used_is_one_line(
    tmp_path: Path, found: object, parameters: dict[str, object], reason: str
) -> None:
    with pytest.raises(ParameterError) as caught:
        read(tmp_path / 'calibration.json', found, **parameters)
    assert reason in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_file_that_is_not_there() -> None:
    config = build(EstimatorConfig, {'known_links.calibration': 'nowhere.json'}).known_links
    with pytest.raises(ParameterError, match=r"cannot read calibration 'nowhere\.json': No such file"):
        with_known_errors(ROBOT, config)


def test_a_file_that_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / 'calibration.json'
    path.write_bytes(b'\xff\xfe\x00')
    config = build(EstimatorConfig, {'known_links.calibration': str(path)}).known_links
    with pytest.raises(ParameterError, match=r'not text in UTF-8; accepted: what calibrate --json writes$'):
        with_known_errors(ROBOT, config)
