"""The simulator's parameters, and the parameter files of config/."""

from __future__ import annotations

import pytest

from mbaid_ros.config.files import load_parameter_file, parse_assignment
from mbaid_ros.config.parameters import build, specifications, values_of
from mbaid_ros.config.simulator import MOTIONS, SimulatorConfig
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.simulated_robot import make_initial_state, make_motion
from simulated import CONFIG, robot

FILES = sorted(CONFIG.glob('*_simulator.yaml'))


def test_every_default_is_accepted() -> None:
    for name, spec in specifications(SimulatorConfig).items():
        assert spec.check(spec.default) == spec.default, name
    assert values_of(SimulatorConfig()) == {n: s.default for n, s in specifications(SimulatorConfig).items()}


def test_every_parameter_is_described_in_a_sentence() -> None:
    for name, spec in specifications(SimulatorConfig).items():
        assert spec.description.endswith('.'), name


@pytest.mark.parametrize('kind', MOTIONS)
def test_motions(kind: str) -> None:
    assert build(SimulatorConfig, {'motion': {'kind': kind}}).motion.kind == kind


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.stem)
def test_the_files_fit_their_robots(path: object) -> None:
    config = build(SimulatorConfig, load_parameter_file(str(path), 'simulator'))
    model = robot(str(path).rsplit('/', 1)[-1].removesuffix('_simulator.yaml'))
    motion = make_motion(config, model)
    make_initial_state(config, model, motion)
    assert config.duration == 60.0


def test_there_is_a_file_for_every_robot() -> None:
    assert [path.name for path in FILES] == sorted(f'{path.stem}_simulator.yaml' for path in CONFIG.glob('*.urdf'))


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


@pytest.mark.parametrize('text', ['seed', ':=3', 'seed=3', 'a:=[1', 'a:={'])
def test_what_is_no_assignment_is_refused(text: str) -> None:
    with pytest.raises(ParameterError):
        parse_assignment(text)
