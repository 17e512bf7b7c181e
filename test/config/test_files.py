"""ROS parameter files and assignments, and the files of config/: which section counts, and what is refused."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.files import load_parameter_file, parse_assignment
from mbaid_ros.config.parameters import build
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.simulated_robot import make_initial_state, make_motion
from simulated import CONFIG, robot


def write(folder: Path, text: str) -> Path:
    path = folder / 'parameters.yaml'
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ('section', 'node'),
    [
        ('/**', 'estimator'),
        ('/**', '/arm/estimator'),
        ('estimator', 'estimator'),
        ('/estimator', 'estimator'),
        ('/arm/estimator', 'estimator'),
        ('/arm/estimator', '/arm/estimator'),
        ('/*/estimator', '/arm/estimator'),
        ('/**/estimator', '/left/arm/estimator'),
        ('/**/estimator', 'estimator'),
        ('/arm/*', '/arm/estimator'),
        ('/*', 'estimator'),
    ],
)
def test_sections_that_apply(tmp_path: Path, section: str, node: str) -> None:
    path = write(tmp_path, f'{section}:\n  ros__parameters:\n    window: 2.0\n')
    assert load_parameter_file(path, node) == {'window': 2.0}


@pytest.mark.parametrize(
    ('section', 'node'),
    [
        ('simulator', 'estimator'),
        ('/leg/estimator', '/arm/estimator'),
        ('/*', '/arm/estimator'),
        ('estimato', 'estimator'),
        ('estimator', '/arm/estimator'),
        ('/arm/estimator', '/estimator'),
    ],
)
def test_sections_that_do_not_apply(tmp_path: Path, section: str, node: str) -> None:
    path = write(tmp_path, f'{section}:\n  ros__parameters:\n    window: 2.0\n')
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
        ('/**:\n  ros__parameters: 5\n', "must hold 'name: value' pairs"),
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
