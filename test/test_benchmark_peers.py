"""The benchmark of all methods: recordings by seed, a least-squares method on one, and its page's own example."""

from __future__ import annotations

import importlib
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.bags import write_bag
from benchmarks.peers import dataset, redysim
from benchmarks.peers.conditions import Condition, moved
from benchmarks.peers.recording import Known
from benchmarks.peers.runs import Outcome, Truth, outcome_of, score
from documents import blocks
from mbaid_ros.core.geometry import log, rotate, rotation_from_quaternion
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.simulation.sensors import Sensors

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / 'docs' / 'measured' / 'benchmark.md'
HOW_TO = ROOT / 'docs' / 'how-to' / 'benchmark.md'
RUN = dataset.Run(Condition('ets7', 'low'), 0, 10.0)


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp('peers')


@pytest.fixture(scope='module')
def manifest(folder: Path) -> dict[str, dict[str, str]]:
    return dataset.make([RUN], folder)


def test_a_seed_gives_the_same_files_and_another_seed_others(
    manifest: dict[str, dict[str, str]], tmp_path: Path
) -> None:
    again = dataset.make([RUN], tmp_path)
    assert dataset.manifest_digest(again) == dataset.manifest_digest(manifest)
    other = dataset.make([dataset.Run(RUN.condition, 1, RUN.seconds)], tmp_path)
    bags = [
        next(value for name, value in files.items() if name.endswith('.mcap'))
        for files in (*manifest.values(), *other.values())
    ]
    assert bags[0] != bags[1]


@pytest.fixture(scope='module')
def exact(folder: Path, manifest: dict[str, dict[str, str]]) -> Path:
    """Return the folder of the same run as sensors without noise record it."""
    run = folder / 'exact'
    shutil.copytree(folder / next(iter(manifest)), run, ignore=shutil.ignore_patterns(dataset.BAG))
    motion = moved(RUN.condition, RUN.seed, RUN.seconds)
    write_bag(run / dataset.BAG, motion.nominal, Sensors(SensorNoise(*[0.0] * 6), 0), [(0.0, motion.truth)])
    return run


@pytest.mark.parametrize(
    ('method', 'share'),
    [
        ('least_squares', 1e-6),
        ('weighted_least_squares', 1e-6),
        ('instrumental_variables', 1e-6),
        ('torque_regressor', 0.05),
    ],
)
def test_equations_hold_without_noise(exact: Path, method: str, share: float) -> None:
    outcome, truth = outcome_of(method, exact), Truth.read(exact)
    assert not outcome.failure
    assert np.all(np.abs(np.array(outcome.parameters) - truth.parameters) < share * truth.sizes)


def test_the_page_s_own_method_answers(exact: Path, tmp_path: Path) -> None:
    page = HOW_TO.read_text(encoding='utf-8')
    code = page.partition('<!-- run by test/test_benchmark_peers.py: on a recording without noise -->\n```python\n')[
        2
    ].partition('```')[0]
    assert 10 < len(code.splitlines()) < 30
    (tmp_path / 'every_tenth_sample.py').write_text(code, encoding='utf-8')
    sys.path.insert(0, str(tmp_path))
    try:
        module = importlib.import_module('every_tenth_sample')
    finally:
        sys.path.remove(str(tmp_path))
    urdf, known = (exact / dataset.URDF).read_text(encoding='utf-8'), Known.read(exact / dataset.KNOWN)
    answer, truth = module.identify(exact / dataset.BAG, urdf, known), Truth.read(exact)
    assert np.all(np.abs(answer.parameters - truth.parameters) < 1e-6 * truth.sizes)


def test_recordings_of_redysim_are_read(tmp_path: Path) -> None:
    (tmp_path / 'inputs.m').write_text(
        'n=2; % base and a link\nalp=[0; pi/2];\na=[0; 0.5];\nb=[0; 0.3];\nal=[1; 4];\ndx=[0 al(2)/2];\nay=[0 6];\n'
        'dy=ay/2;\ndz=[0 0];\nm=[500; 10];\nIcxx=zeros(n,1);Icyy=zeros(n,1);Iczz=zeros(n,1);\n'
        'Icxx(2)=0.1;   Icyy(2)=2.05;  Iczz(2)=2.06;\n'
    )
    robot = load_model(redysim.urdf(tmp_path))
    assert physical(robot.link('link1').parameters) == pytest.approx([10, 2, 3, 0, 0.1, 0, 0, 2.05, 0, 2.06])
    assert robot.positions[0] == pytest.approx([0.5, -0.3, 0.0])
    time = np.arange(0.0, 2.05, 0.1)
    phase, rate = np.arange(7.0), np.linspace(0.2, 0.8, 7)
    values, rates = np.sin(np.outer(time, rate) + phase), rate * np.cos(np.outer(time, rate) + phase)
    np.savetxt(tmp_path / 'timevar.dat', time)
    np.savetxt(tmp_path / 'statevar.dat', np.column_stack((values, rates, time)))
    truth = redysim.motion(tmp_path)
    rotation = rotation_from_quaternion(truth.base_orientation)
    turn = log(np.swapaxes(rotation[:-2], 1, 2) @ rotation[2:]) / 0.02
    assert truth.base_angular_velocity[1:-1] == pytest.approx(turn, abs=1e-4)
    slope = (truth.base_position[2:] - truth.base_position[:-2]) / 0.02
    assert rotate(rotation[1:-1], truth.base_linear_velocity[1:-1]) == pytest.approx(slope, abs=1e-4)
    assert truth.joint_position[::10, 0] == pytest.approx(values[:, 6])


def test_the_score_knows_right_wrong_and_doubtful_answers() -> None:
    truth = Truth(np.arange(10.0) + 1.0, np.where(np.arange(10) < 9, 0.1, np.nan))

    def outcome(error: float, std: float, doubt: str = '') -> Outcome:
        off = np.where(np.arange(10) < 9, error, 1e9)  # the last one is open: it does not count
        return Outcome((truth.parameters + off).tolist(), [std] * 10, doubt, '', 1.0, 1.0, 1.0)

    found = score(
        [outcome(0.1, 0.1), outcome(0.6, 0.1), outcome(0.6, 0.1, 'inconsistent'), outcome(0.05, np.nan)], [truth] * 4
    )
    assert found.answers == 3
    assert found.wrong == 1
    assert found.covered == pytest.approx(0.5)
    assert found.ratio == pytest.approx([1.0, 6.0, np.nan, 0.5], nan_ok=True)
    assert found.failures == ('inconsistent',)


@pytest.mark.long
@pytest.mark.parametrize('method', ['extended_kalman_filter', 'difference', 'trajectory', 'mujoco_sysid'])
def test_a_tumbling_robot_is_identified_as_well_as_promised(method: str, tmp_path: Path) -> None:
    """An error of the filter's integration shows only in a base that tumbles: nothing multiplies it in one at rest."""
    if method.startswith('mujoco'):
        pytest.importorskip('tabulate', reason='mujoco[sysid] is optional')
    run = dataset.Run(Condition('servicer7', 'low'), 0, 40.0)
    dataset.make([run], tmp_path)
    outcome, truth = outcome_of(method, tmp_path / run.name), Truth.read(tmp_path / run.name)
    assert not outcome.failure
    assert not outcome.doubt
    assert np.all(np.abs(np.array(outcome.parameters) - truth.parameters) < 5.0 * np.array(outcome.std))
    assert np.all(np.array(outcome.std) < 20.0 * truth.bound)


@pytest.mark.long
def test_the_benchmark_goes_on_and_gives_the_same_numbers(tmp_path: Path) -> None:
    (block,) = blocks(PAGE)
    lines = [shlex.split(line, comments=True) for line in block.text.splitlines()]
    assert all(line[:2] == ['make', 'benchmark-peers'] for line in lines)
    arguments = lines[-1][2].removeprefix('ARGS=').split()
    command = [sys.executable, str(ROOT / 'scripts' / 'benchmark_peers.py'), *arguments, '--seconds', '10']
    command += ['--methods', 'squares|difference|trajectory', '--processes', '1', '--store']

    def scored(store: Path) -> list[str]:
        done = subprocess.run([*command, str(store)], check=True, capture_output=True, text=True)
        return [
            re.sub(r'(\| \d+ of \d+) \| [\d.]+ \| [\d.]+ \|', r'\1 |', line)  # without time and memory
            for line in done.stdout.splitlines()
            if '`' in line and 'Written' not in line
        ]

    first = scored(tmp_path / 'one')
    assert any('trajectory' in line for line in first)
    assert scored(tmp_path / 'one') == first
    assert scored(tmp_path / 'two') == first
