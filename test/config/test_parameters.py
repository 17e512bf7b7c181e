"""Parameters: what is accepted and what an error says; their files and assignments, and the files of config/."""

from __future__ import annotations

import math
import runpy
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.config.parameter_files import load_parameter_file, parse_assignment
from mbaid_ros.config.simulator_parameters import SimulatorConfig
from mbaid_ros.core.noise import CHANNELS
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import build, parameter, specifications, values_of
from mbaid_ros.simulated_robot import make_initial_state, make_motion
from simulated import CONFIG, robot


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


def test_undeclared_noise_has_typical_levels_and_counts_as_undeclared() -> None:
    noise = build(EstimatorConfig, {'noise.base_position': 3e-3}).noise
    assert [name for name, open_ in zip(CHANNELS, noise.undeclared, strict=True) if not open_] == ['base_position']
    assert noise.declared == SensorNoise(1e-4, 1e-3, 3e-3, 1e-4, 1e-3, 1e-4)


def write(folder: Path, text: str) -> Path:
    path = folder / 'parameters.yaml'
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ('section', 'applies', 'does_not'),
    [
        ('/**', ['estimator', '/arm/estimator'], []),
        ('estimator', ['estimator'], ['/arm/estimator']),
        ('/estimator', ['estimator'], []),
        ('/arm/estimator', ['estimator', '/arm/estimator'], ['/estimator']),
        ('/*/estimator', ['/arm/estimator'], []),
        ('/**/estimator', ['/left/arm/estimator', 'estimator'], []),
        ('/arm/*', ['/arm/estimator'], []),
        ('/*', ['estimator'], ['/arm/estimator']),
        ('/leg/estimator', [], ['/arm/estimator']),
        ('estimato', [], ['estimator']),
        ('simulator', [], ['estimator']),
    ],
)
def test_nodes_that_a_section_applies_to(tmp_path: Path, section: str, applies: list[str], does_not: list[str]) -> None:
    path = write(tmp_path, f'{section}:\n  ros__parameters:\n    window: 2.0\n')
    for node in applies:
        assert load_parameter_file(path, node) == {'window': 2.0}
    for node in does_not:
        with pytest.raises(ParameterError, match='has no section for node') as caught:
            load_parameter_file(path, node)
        assert section.strip('/') in str(caught.value)


def test_names_may_be_nested_or_dotted_and_a_later_section_wins(tmp_path: Path) -> None:
    text = """
        /**:
          ros__parameters:
            noise: {joint_position: 1.0, base_position: 3}
            window: 1.0
        estimator:
          ros__parameters:
            noise.joint_position: 2.0
    """
    values = load_parameter_file(write(tmp_path, text), 'estimator')
    assert values == {'noise.joint_position': 2.0, 'noise.base_position': 3, 'window': 1.0}


@pytest.mark.parametrize(
    ('text', 'value'), [('1e6', 1e6), ('1e-4', 1e-4), ('-2.5E+3', -2500.0), ('.5e1', 5.0), ("'1e6'", '1e6')]
)
def test_numbers_are_read_as_ros_reads_them(tmp_path: Path, text: str, value: object) -> None:
    path = write(tmp_path, f'/**:\n  ros__parameters:\n    x: {text}\n')
    assert load_parameter_file(path, 'estimator') == {'x': value}


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('', 'has no section'),
        ('- 1\n- 2\n', 'has no section'),
        ('window: 1.0\n', "'window' stands outside a section"),
        ('estimator:\n  window: 1.0\n', "'window' stands outside a section"),
        ('/**:\n  ros__parameters: 5\n', "must have 'name: value' pairs"),
        ('a: [1, 2\nb: }', 'is not YAML'),
        ('x: !!python/object/apply:os.system [ls]', 'is not YAML'),
        ("x: !!int ''", 'is not YAML: tags (!!int) are not supported'),
        ('x: !!bool maybe', 'is not YAML: tags (!!bool) are not supported'),
        ('x: !!timestamp foo', 'is not YAML: tags (!!timestamp) are not supported'),
        ('!!set x: 1', 'is not YAML: tags (!!set) are not supported'),
        ('!own [x]: 1', 'is not YAML: tags (!own) are not supported'),
        ('x: ! 1', 'is not YAML: tags (!) are not supported'),
        ('x: ' + '1' * 5000, 'is not YAML'),
    ],
)
def test_what_is_no_parameter_file_is_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        load_parameter_file(write(tmp_path, text), 'estimator')
    assert message in str(caught.value)
    assert 'parameters.yaml' in str(caught.value)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('seed:=3', ('seed', 3)),
        ('noise.joint_position:=1e-3', ('noise.joint_position', 1e-3)),
        ('initial.joint_positions:=[1, 2.5]', ('initial.joint_positions', [1, 2.5])),
        ('motion.kind:=random', ('motion.kind', 'random')),
    ],
)
def test_assignments(text: str, expected: tuple[str, object]) -> None:
    assert parse_assignment(text) == expected


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        *((text, '.') for text in ('seed', ':=3', 'seed=3', 'a:=[1', 'a:={')),
        ("window:=!!int ''", r"the value of 'window' is not YAML: tags \(!!int\) are not supported"),
    ],
)
def test_what_is_no_assignment_is_refused(text: str, reason: str) -> None:
    with pytest.raises(ParameterError, match=reason):
        parse_assignment(text)


# -- The simulator's parameters, and the parameter files of config/.

FILES = sorted(CONFIG.glob('*_simulator.yaml'))


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.stem)
def test_the_files_fit_their_robots(path: object) -> None:
    config = build(SimulatorConfig, load_parameter_file(str(path), 'simulator'))
    model = robot(str(path).rsplit('/', 1)[-1].removesuffix('_simulator.yaml'))
    motion = make_motion(config, model)
    make_initial_state(config, model, motion)
    assert config.duration == 60.0


# -- The estimator's parameter files in config/ say what the declarations say.


def test_the_file_of_all_parameters_is_the_one_the_script_writes() -> None:
    script = runpy.run_path(str(CONFIG.parent / 'scripts' / 'write_parameters.py'))
    assert (CONFIG / 'estimator.yaml').read_text(encoding='utf-8') == script['text'](), (
        'run scripts/write_parameters.py'
    )


@pytest.mark.parametrize('robot', ['table1', 'ets7', 'servicer7'])
def test_every_robot_has_a_file_that_names_its_last_link(robot: str) -> None:
    config = build(EstimatorConfig, load_parameter_file(CONFIG / f'{robot}_estimator.yaml', 'estimator'))
    assert config.target_link == load_model((CONFIG / f'{robot}.urdf').read_text(encoding='utf-8')).last_link
