"""The estimator's parameters: the names and defaults that scripts rely on."""

from __future__ import annotations

import pytest

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.methods import METHODS
from mbaid_ros.config.parameters import build, specifications, values_of
from mbaid_ros.core.errors import ParameterError


def test_every_default_is_accepted() -> None:
    for name, spec in specifications(EstimatorConfig).items():
        assert spec.check(spec.default) == spec.default, name


def test_the_defaults_of_the_specifications_are_those_of_the_class() -> None:
    assert values_of(EstimatorConfig()) == {
        name: spec.default for name, spec in specifications(EstimatorConfig).items()
    }


def test_every_parameter_is_described_in_a_sentence() -> None:
    for name, spec in specifications(EstimatorConfig).items():
        assert spec.description.endswith('.'), name
        assert len(spec.description) > 20, name


@pytest.mark.parametrize('method', METHODS)
def test_methods(method: str) -> None:
    assert build(EstimatorConfig, {'method': method}).method == method


@pytest.mark.parametrize(
    'name',
    ['window', 'maximum_gap', 'noise.joint_position', 'noise.base_angular_velocity', 'paper.forgetting_factor'],
)
def test_zero_is_refused_where_something_divides_by_it(name: str) -> None:
    with pytest.raises(ParameterError, match=f"'{name}' is 0.0"):
        build(EstimatorConfig, {name: 0.0})
