"""The benchmarks' instruments: recordings and methods of the peers, worlds, sensors and verdicts of the honesty."""

from __future__ import annotations

import importlib
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtri

from benchmarks.data import Case, motion, write_bag
from benchmarks.honesty import readings, robots
from benchmarks.honesty.disturbed import CATALOGUE
from benchmarks.honesty.paths import sinusoids
from benchmarks.honesty.runs import Outcome as Ends
from benchmarks.honesty.runs import jointly, judged, run
from benchmarks.honesty.worlds import World, float_freely, swing
from benchmarks.peers import dataset, redysim
from benchmarks.peers.conditions import Condition, moved
from benchmarks.peers.recording import Known
from benchmarks.peers.runs import Outcome, Truth, outcome_of, score
from benchmarks.sensor_bounds import sensors_bound
from benchmarks.sensors import PAIRS, drawn
from documents import blocks
from mbaid_ros.core.geometry import Array, exp, log, rotate, rotation_from_quaternion
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import total_momentum

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
    code = page.partition('<!-- run by test/test_benchmarks.py: on a recording without noise -->\n```python\n')[
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
        return Outcome((truth.parameters + off).tolist(), [std] * 10, doubt, '', 1.0, 1.0)

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


def outcome(status: list[str], error: Array, jointly: float = 0.0) -> Ends:
    """Return runs with errors (R, 10) in standard deviations of 1."""
    none = np.zeros(len(status))
    causes = np.array(['a cause'] * len(status))
    return Ends(
        np.array(status), error, np.ones_like(error), np.full(len(status), jointly), causes, causes, *(none,) * 6
    )


def test_the_base_floats_as_the_simulator_has_it() -> None:
    truth = float_freely(World(robots.servicer(), sinusoids(), seconds=20.0))
    expected = motion('servicer7')[: len(truth)]
    np.testing.assert_allclose(truth.joint_position, expected.joint_position, atol=1e-7)
    np.testing.assert_allclose(truth.base_position, expected.base_position, atol=1e-7)
    np.testing.assert_allclose(truth.base_orientation, expected.base_orientation, atol=1e-7)
    np.testing.assert_allclose(truth.base_angular_velocity, expected.base_angular_velocity, atol=1e-7)


@pytest.mark.parametrize(
    'name', ['a flexible panel of 0.3 Hz', 'fuel that sloshes at 0.1 Hz', 'a flexible joint of 2 Hz']
)
def test_springs_keep_the_momentum_and_swing_at_their_frequency(name: str) -> None:
    world = CATALOGUE[name].world(0)
    truth = swing(replace(world, seconds=20.0))
    robot = load_model(world.urdf)
    momentum = total_momentum(robot, truth)
    np.testing.assert_allclose(momentum - momentum[0], 0.0, atol=1e-4 * np.max(np.abs(momentum)))
    joint, spring = next(iter(world.springs.items()))
    deflection = truth.joint_position[:, robot.joint_names.index(joint)]
    assert deflection[0] == spring.deflection
    frequency = np.fft.rfftfreq(len(deflection), 1.0 / world.rate)
    spectrum = np.abs(np.fft.rfft(deflection)) * (frequency > 0.5 * spring.frequency)  # not what is slow
    # As the robot was at first; the spectrum has a line every 0.05 Hz.
    assert frequency[np.argmax(spectrum)] == pytest.approx(spring.frequency, rel=0.15, abs=0.051)


@pytest.mark.parametrize(
    'view',
    [
        partial(readings.mounted, np.array([0.1, -0.2, 0.3]), np.array([0.2, 0.1, -0.3])),
        partial(readings.in_orbit_frame, 0.01),
        partial(readings.scaled, 1.01),
    ],
)
def test_views_have_the_twist_of_their_poses(view: readings.View) -> None:
    seen = view(motion('servicer7')[:500])
    rotation = rotation_from_quaternion(seen.base_orientation)
    velocity = np.einsum('nij,nj->ni', rotation, seen.base_linear_velocity)
    np.testing.assert_allclose(np.gradient(seen.base_position, 0.01, axis=0)[1:-1], velocity[1:-1], atol=1e-6)
    middle = 0.01 * 0.5 * (seen.base_angular_velocity[1:] + seen.base_angular_velocity[:-1])
    np.testing.assert_allclose(rotation[:-1] @ exp(middle), rotation[1:], atol=1e-7)


def test_a_row_is_silently_wrong_by_error_or_by_coverage() -> None:
    right, off = np.full((2, 10), 0.5), np.full((2, 10), 0.5)
    off[1, 3] = -5.5
    few = np.full((2, 10), 0.5)
    few[:, :5] = 3.0
    assert not judged(outcome(['converged', 'estimating'], right)).silently_wrong
    assert judged(outcome(['converged', 'estimating'], off)).silently_wrong
    assert judged(outcome(['converged', 'estimating'], few)).covered == 0.5
    assert judged(outcome(['converged', 'estimating'], few)).silently_wrong
    assert judged(outcome(['converged'], right[:1], jointly=5.1)).silently_wrong
    assert not judged(outcome(['inconsistent'], right[:1], jointly=5.1)).silently_wrong
    # The run that is off says so.
    assert not judged(outcome(['converged', 'inconsistent'], off)).silently_wrong
    assert np.isnan(judged(outcome(['inconsistent', 'not_identifiable'], off)).largest)


def test_errors_together_are_measured_by_what_a_single_one_would_be_off_by() -> None:
    def last(*pairs: tuple[int, int, float]) -> Estimate:
        covariance = np.full((10, 10), np.nan)
        for row, column, value in pairs:
            covariance[row, column] = covariance[column, row] = value
        return Estimate('trajectory', 'converged', 1.0, 0, samples=1, parameters=np.zeros(10), covariance=covariance)

    both = last((0, 0, 4.0), (1, 1, 4.0), (0, 1, 0.99 * 4.0))
    # One standard deviation each, in opposite directions: 200 of chi-square with two degrees of freedom, exp(-100).
    sought = np.array([2.0, -2.0, *[0.0] * 8])
    assert jointly(both, sought) == pytest.approx(-ndtri(0.5 * np.exp(-100.0)))
    assert jointly(both, abs(sought)) == pytest.approx(-ndtri(0.5 * np.exp(-0.5 / 0.995)))
    assert jointly(last((0, 0, 4.0)), 3.0 * sought) == pytest.approx(3.0)
    assert np.isnan(jointly(last(), sought))


def test_a_run_of_a_condition_says_what_it_ends_with() -> None:
    reported = run(('5 s of data', 'difference'), 0)
    assert reported.error.shape == reported.std.shape == (10,)
    assert reported.status in {'estimating', 'not_identifiable'}
    assert 0.0 <= max(reported.worst, reported.young) < 5.0


def test_bounds_of_sensors_shrink_with_more_of_them_and_as_priors_and_noise_do() -> None:
    case, truth = Case('servicer7', 'mid'), motion('servicer7')[:1001]
    _, tracker, camera, _ = PAIRS
    alone, both, more = (
        sensors_bound(case, truth, drawn(pair, 0, both=second))
        for pair, second in ((tracker, False), (tracker, True), (camera, True))
    )
    assert np.all(both < alone)
    assert np.all(more <= both)
    assert more[0] < 0.9 * both[0]  # of the mass, positions show more than turns do
    gyro, finer = drawn(tracker, 0, both=True)
    finer = finer._replace(used={**finer.used, 'orientation_std': 1e-6})
    assert np.all(sensors_bound(case, truth, [gyro, finer]) < both)
    slower = [each._replace(made={**each.made, 'rate': 0.5}) for each in (finer,)]
    assert np.all(sensors_bound(case, truth, [gyro, *slower]) > sensors_bound(case, truth, [gyro, finer]))
