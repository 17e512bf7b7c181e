"""The estimator's parameters: the names and defaults that scripts rely on."""

from __future__ import annotations

import pytest

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build, specifications, values_of
from mbaid_ros.config.trajectory import METHODS
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.core.sensors.levels import CHANNELS


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
    ['window', 'maximum_gap', 'paper.forgetting_factor'],
)
def test_zero_is_refused_where_something_divides_by_it(name: str) -> None:
    with pytest.raises(ParameterError, match=f"'{name}' is 0.0"):
        build(EstimatorConfig, {name: 0.0})


def test_noise_that_nobody_declares_is_what_sensors_have_and_known_for_undeclared() -> None:
    noise = build(EstimatorConfig, {'noise.base_position': 3e-3}).noise
    assert [name for name, open_ in zip(CHANNELS, noise.undeclared, strict=True) if not open_] == ['base_position']
    assert noise.declared == SensorNoise(1e-4, 1e-3, 3e-3, 1e-4, 1e-3, 1e-4)
