"""`plan`: from the end of a run to a motion, and what simulated robots make of it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mbaid_ros.bags import BagReader
from mbaid_ros.config.motion_files import as_yaml, read_trajectory
from mbaid_ros.errors import ParameterError
from mbaid_ros.joint_trajectory import JointTrajectory, trajectory_of
from mbaid_ros.replay import plan as planning
from mbaid_ros.replay.arguments import plan as main
from mbaid_ros.replay.arguments import replay, simulate
from mbaid_ros.replay.one_bag import replay_bag
from mbaid_ros.replay.whole_run import Run
from simulated import CONFIG, NOISE, assigned, options

MODEL = ['--model', str(CONFIG / 'servicer7.urdf')]
PLAN = {'effort': 20, 'duration': 4.0, 'base_rotation': 0.01, 'joint_velocity': 0.05}
QUICK = assigned({f'plan.{name}': value for name, value in PLAN.items()})


@pytest.fixture(scope='module')
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the result of a run of eight seconds."""
    folder = tmp_path_factory.mktemp('run')
    noise = [f'noise.{name}:={size}' for name, size in NOISE.items()]
    rates = ['joint_rate:=20.0', 'odometry_rate:=20.0', 'duration:=8.0']
    given = options(*noise, *rates)
    params = ['--params', str(CONFIG / 'servicer7_simulator.yaml')]
    assert simulate([*MODEL, *params, *given, '--output', str(folder / 'bag')]) == 0
    estimator = ['--params', str(CONFIG / 'servicer7_estimator.yaml')]
    assert replay([str(folder / 'bag'), *MODEL, *estimator, '--json', str(folder / 'result.json')]) == 0
    return folder / 'result.json'


def begin(result: Path) -> list[str]:
    """Return the arguments of the run that a plan continues."""
    return [str(result.parent / 'bag'), *MODEL, '--params', str(CONFIG / 'servicer7_estimator.yaml')]


@pytest.fixture(scope='module')
def planned(result: Path) -> dict[str, Any]:
    """Return the plan of a motion of four seconds, with the files it is in."""
    folder = result.parent
    files = ['--yaml', 'motion.yaml', '--output', 'motion', '--json', 'plan.json']
    files = [word if word.startswith('--') else str(folder / word) for word in files]
    assert main([*begin(result), *QUICK, *files]) in {0, 3}
    plan: dict[str, Any] = json.loads((folder / 'plan.json').read_text())
    return plan


def test_a_motion_from_where_a_run_has_ended(result: Path, planned: dict[str, Any]) -> None:
    trajectory = planned['trajectory']
    with BagReader(str(result.parent / 'bag')) as bag:
        *_, last = (message for _, message, _ in bag.read(['/joint_states']))
    assert trajectory['joint_names'] == list(last.name)
    # The run ends with its last complete window, a few samples earlier.
    assert trajectory['positions'][0] == pytest.approx(last.position, abs=0.05)
    assert trajectory['time_from_start'][-1] == planned['duration'] == 4.0
    assert not np.any([trajectory['velocities'][place] for place in (0, -1)])
    assert planned['base']['rotation']['certain'] <= planned['base']['rotation']['limit'] == 0.01
    for known in planned['relative_std'].values():
        assert known['after'] <= known['now']
    assert planned['notes'][0].startswith('best single joint: joint')
    assert planned['notes'][1].startswith('moved at the end of the run, and must rest before')


def test_what_is_known_at_the_end_is_what_the_result_says(result: Path, planned: dict[str, Any]) -> None:
    content = json.loads(result.read_text())
    assert planned['relative_std']['mass']['now'] == pytest.approx(content['std']['mass'] / content['estimate']['mass'])
    assert planned['relative_std']['com_z']['now'] == pytest.approx(content['std']['com'][2], rel=1e-6)


def test_the_motion_as_yaml_and_as_a_message_is_the_same(result: Path, planned: dict[str, Any]) -> None:
    motion = read_trajectory(result.parent / 'motion.yaml')
    with BagReader(str(result.parent / 'motion')) as bag:
        ((topic, message, _),) = list(bag.read(['/joint_trajectory']))
    assert topic == '/joint_trajectory'
    other = trajectory_of(message)
    assert motion.joints == other.joints == tuple(planned['trajectory']['joint_names'])
    for name, plural in (('position', 'positions'), ('velocity', 'velocities'), ('acceleration', 'accelerations')):
        assert np.array_equal(getattr(motion, name), getattr(other, name))
        assert getattr(motion, name).tolist() == planned['trajectory'][plural]
    assert motion.time == pytest.approx(other.time, abs=1e-9)


@pytest.mark.usefixtures('planned')
def test_a_simulated_robot_follows_it(result: Path, tmp_path: Path) -> None:
    motion = ['--trajectory', str(result.parent / 'motion.yaml'), '-p', 'motion.trajectory_begin:=0.5']
    # Accelerations have kinks, which the integration takes for smooth within a step.
    rates = ['-p', 'joint_rate:=10.0', '-p', 'odometry_rate:=10.0']  # as long as it takes
    assert simulate([*MODEL, *motion, *rates, '--output', str(tmp_path / 'bag')]) == 0
    with BagReader(str(tmp_path / 'bag')) as bag:
        positions = np.array([message.position for _, message, _ in bag.read(['/joint_states'])])
    expected = read_trajectory(result.parent / 'motion.yaml').state_at(np.arange(51) / 10.0 - 0.5)[0]
    assert positions == pytest.approx(expected, abs=1e-6)
    truth = json.loads((tmp_path / 'bag' / 'truth.json').read_text())
    assert truth['parameters']['motion.trajectory_file'] == str(result.parent / 'motion.yaml')
    assert truth['parameters']['motion.trajectory_begin'] == 0.5


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['-p', 'method:=difference'], 'leads to no state to plan from: it needs a solution of method trajectory'),
        (['-p', 'plan.stuck:=[elbow]'], "names 'elbow'; accepted: joint1, joint2"),
        (['-p', 'plan.relative_std:=[0.0]'], 'accepted: numbers > 0, one or ten'),
        (['-p', 'plan.relative_std:=[10.0]', '-p', 'plan.duration:=0.0'], 'has the wanted precision already'),
        (['--yaml', '/none/of/it.yaml'], "--yaml '/none/of/it.yaml' cannot be written"),
    ],
)
def test_an_unusable_start_of_a_plan_is_one_line(
    result: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    assert main([*begin(result), *QUICK, *arguments]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count('mbaid_ros plan: ') == 1 + error.count('warning')


def test_a_contradicted_run_is_not_planned_from(
    result: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def contradicted(*arguments: Any, **options: Any) -> Run:
        run = replay_bag(*arguments, **options)
        return replace(run, final=replace(run.final, status='inconsistent'))

    monkeypatch.setattr(planning, 'replay_bag', contradicted)
    assert main([*begin(result), *QUICK]) == 4
    assert 'contradicts its model' in capsys.readouterr().err


def test_yaml_keeps_every_bit_and_strange_names(tmp_path: Path) -> None:
    time = np.array([0.0, 1.0 / 3.0])
    position, nothing = np.array([[0.1, -1e-17], [np.pi, 1e300]]), np.zeros((0, 0))
    path = tmp_path / 'motion.yaml'
    path.write_text(as_yaml(JointTrajectory(("o'clock: 1", 'null'), time, position, nothing, nothing)))
    found = read_trajectory(path)
    assert found.joints == ("o'clock: 1", 'null')
    assert np.array_equal(found.position, position)
    assert not found.velocity.size
    assert found.time == pytest.approx(time, abs=1e-9)


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('[]', 'it is no mapping'),
        ('joint_names: [a]', "it lacks 'points'"),
        ('{joint_names: [a], points: [{positions: [1.0]}]}', "it lacks 'time_from_start'"),
        ('{joint_names: [a], points: [{positions: [1.0, 2.0], time_from_start: {sec: 0}}]}', 'shape'),
        ('{joint_names: [a], points: [{positions: [x], time_from_start: {sec: 0}}]}', 'could not convert'),
        ('{joint_names: [1], points: []}', 'joint_names are no strings'),
    ],
)
def test_files_that_hold_no_trajectory_are_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / 'motion.yaml'
    path.write_text(text)
    with pytest.raises(ParameterError, match=words):
        read_trajectory(path)
