"""Parameters: what is accepted, what an error says, and the estimator's and the simulator's own."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import pytest

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build, parameter, specifications, values_of
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.core.sensors.levels import CHANNELS


@dataclass(frozen=True)
class Inner:
    """A group."""

    ratio: float = parameter(0.5, minimum=0.0, maximum=1.0, exclusive_minimum=True)
    """A ratio."""
    names: tuple[str, ...] = parameter(())
    """Names."""


@dataclass(frozen=True)
class Outer:
    """One parameter of each type, and a group."""

    enabled: bool = parameter(default=False)
    """A switch."""
    count: int = parameter(3, minimum=0)
    """A count."""
    length: float = parameter(1.0, unit='m')
    """A length."""
    kind: str = parameter('round', choices=('round', 'square'))
    """A shape."""
    axis: tuple[float, ...] = parameter((), unit='m', lengths=(0, 3))
    """An axis."""
    inner: Inner = field(default_factory=Inner)


@pytest.mark.parametrize(
    'values',
    [{'inner': {'ratio': 1, 'names': ['a']}}, {'inner.ratio': 1, 'inner.names': ('a',)}],
    ids=['nested', 'dotted'],
)
def test_build_takes_nested_and_dotted_names(values: dict[str, object]) -> None:
    assert build(Outer, values) == Outer(inner=Inner(ratio=1.0, names=('a',)))


def test_an_unknown_name_lists_the_known_ones_closest_first() -> None:
    with pytest.raises(ParameterError) as caught:
        build(Outer, {'inner': {'ration': 1.0}})
    text = str(caught.value)
    assert text.startswith("unknown parameter 'inner.ration'; known: inner.ratio, ")
    assert all(name in text for name in specifications(Outer))


def test_a_name_given_twice_is_refused() -> None:
    with pytest.raises(ParameterError, match='given twice'):
        build(Outer, {'inner': {'ratio': 1.0}, 'inner.ratio': 1.0})


@pytest.mark.parametrize(
    ('values', 'text'),
    [
        ({'enabled': 1}, "parameter 'enabled' is 1; accepted: true or false"),
        ({'count': True}, "parameter 'count' is true; accepted: a whole number >= 0"),
        ({'count': 1.0}, "parameter 'count' is 1.0; accepted: a whole number >= 0"),
        ({'count': -1}, "parameter 'count' is -1; accepted: a whole number >= 0"),
        ({'count': 2**63}, "parameter 'count' is 9223372036854775808; accepted: a whole number >= 0"),
        ({'length': True}, "parameter 'length' is true; accepted: a number m"),
        ({'length': '1'}, "parameter 'length' is '1'; accepted: a number m"),
        ({'length': None}, "parameter 'length' is None; accepted: a number m"),
        ({'length': math.nan}, "parameter 'length' is nan m; accepted: a number m"),
        ({'length': -math.inf}, "parameter 'length' is -inf m; accepted: a number m"),
        ({'length': [1.0]}, "parameter 'length' is [1.0]; accepted: a number m"),
        ({'inner.ratio': 0.0}, "parameter 'inner.ratio' is 0.0; accepted: a number > 0 and <= 1"),
        ({'inner.ratio': 1.1}, "parameter 'inner.ratio' is 1.1; accepted: a number > 0 and <= 1"),
        ({'kind': 'oval'}, "parameter 'kind' is 'oval'; accepted: round, square"),
        ({'kind': 7}, "parameter 'kind' is 7; accepted: round, square"),
        ({'axis': [1, 2]}, "parameter 'axis' is [1, 2]; accepted: a list of numbers (empty or of length 3) m"),
        ({'axis': [1, 2, math.nan]}, 'a list of numbers'),
        ({'axis': 'abc'}, "parameter 'axis' is 'abc'; accepted: a list of numbers"),
        ({'inner.names': 'abc'}, "parameter 'inner.names' is 'abc'; accepted: a list of strings"),
        ({'inner.names': ['a', 1]}, "accepted: a list of strings"),
    ],
)  # fmt: skip
def test_what_is_refused_is_named_in_one_line(values: dict[str, object], text: str) -> None:
    with pytest.raises(ParameterError) as caught:
        build(Outer, values)
    assert text in str(caught.value)
    assert '\n' not in str(caught.value)


# -- The estimator's parameters: the names and defaults that scripts rely on.


@pytest.mark.parametrize(('config', 'shortest'), [(EstimatorConfig, 20), (SimulatorConfig, 1)])
def test_every_default_is_accepted_and_every_parameter_described_in_a_sentence(config: type, shortest: int) -> None:
    for name, spec in specifications(config).items():
        assert spec.check(spec.default) == spec.default, name
        assert spec.description.endswith('.'), name
        assert len(spec.description) > shortest, name
    assert values_of(config()) == {name: spec.default for name, spec in specifications(config).items()}


def test_noise_that_nobody_declares_is_what_sensors_have_and_known_for_undeclared() -> None:
    noise = build(EstimatorConfig, {'noise.base_position': 3e-3}).noise
    assert [name for name, open_ in zip(CHANNELS, noise.undeclared, strict=True) if not open_] == ['base_position']
    assert noise.declared == SensorNoise(1e-4, 1e-3, 3e-3, 1e-4, 1e-3, 1e-4)
