"""The executable `campaign`: its results, and how it goes on after whatever stopped it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from campaigns import TEXT, refused, written
from mbaid_ros.config.campaign_file import CampaignRun
from mbaid_ros.core.results.estimate import PARAMETERS
from mbaid_ros.replay.arguments import campaign, replay, simulate
from mbaid_ros.replay.campaigns import campaign as command
from mbaid_ros.replay.campaigns.make import make
from mbaid_ros.replay.campaigns.statistics import Result, statistics
from simulated import CONFIG

RUNS = 8
FILES = ('runs.jsonl', 'summary.json', 'campaign.json')


def lines(folder: Path) -> list[Any]:
    return [json.loads(line) for line in (folder / 'runs.jsonl').read_text().splitlines()]


def content(folder: Path) -> list[bytes]:
    return [(folder / name).read_bytes() for name in FILES]


@pytest.fixture(scope='module', name='whole')
def made_in_one_go(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('whole')
    output = folder / 'output'
    assert campaign([str(written(folder)), '--output', str(output), '--processes', '2']) == 0
    return output


@pytest.fixture(name='numbers')
def runs_in_this_process(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Make runs in this process; return a list that their numbers are appended to."""
    numbers: list[int] = []

    def made(runs: Sequence[CampaignRun], urdf: str, _processes: int) -> Generator[Result]:
        for run in runs:
            numbers.append(run.number)
            with np.errstate(all='ignore'):  # as in a process without pytest
                result = make(run, urdf)
            yield result

    monkeypatch.setattr(command, 'made_here', made)
    return numbers


# -- results


def test_a_run_is_that_of_simulate_and_replay_to_the_last_bit(
    capsys: pytest.CaptureFixture[str], whole: Path, tmp_path: Path
) -> None:
    run = lines(whole)[6]
    assert (run['run'], run['case'], run['seed'], run['motion']) == (6, {'noise': 'mid'}, 2, None)
    cases = json.loads((whole / 'campaign.json').read_text())['cases']
    for node in ('simulator', 'estimator'):
        section = {'/**': {'ros__parameters': cases[1][node]}}
        (tmp_path / f'{node}.yaml').write_text(json.dumps(section))
    bag, model = str(tmp_path / 'bag'), str(CONFIG / 'table1.urdf')
    simulator, estimator = (str(tmp_path / f'{node}.yaml') for node in ('simulator', 'estimator'))
    assert simulate(['--model', model, '--params', simulator, '--seed', '2', '--output', bag]) == 0
    capsys.readouterr()
    assert replay([bag, '--model', model, '--params', estimator, '--json', '-']) == 0
    result = json.loads(capsys.readouterr().out)
    for key in ('status', 'estimate', 'std', 'samples', 'span_s'):
        assert run[key] == result[key]
    truth = json.loads((tmp_path / 'bag' / 'truth.json').read_text())
    assert run['truth'] == {key: truth[key] for key in ('mass', 'com', 'inertia')}
    assert run['error']['mass'] == (run['estimate']['mass'] - truth['mass']) / run['std']['mass']


def test_every_run_is_there_in_order_and_the_statistics_are_theirs(
    capsys: pytest.CaptureFixture[str], whole: Path
) -> None:
    results = lines(whole)
    assert [(run['run'], run['case']['noise'], run['seed']) for run in results] == [
        (number, name, seed) for number, (name, seed) in enumerate((n, s) for n in ('low', 'mid') for s in range(4))
    ]
    low, mid = json.loads((whole / 'summary.json').read_text())['cases']
    errors = np.array([run['estimate']['mass'] - run['truth']['mass'] for run in results[4:]])
    assert mid['rmse']['mass'] == pytest.approx(np.sqrt(np.mean(errors**2)))
    assert mid['mean_std']['mass'] == pytest.approx(np.mean([run['std']['mass'] for run in results[4:]]))
    assert mid['inside_95']['mass'] == np.mean([abs(run['error']['mass']) < 1.959964 for run in results[4:]])
    assert mid['nees'] == pytest.approx(np.mean([run['nees'] for run in results[4:]]))
    assert mid['determined'] == {
        'mass': 1.0, 'com': [1.0, 1.0, 0.0], 'inertia': {name: float(name == 'izz') for name in PARAMETERS[4:]}
    }  # fmt: skip
    assert low['rmse']['mass'] < mid['rmse']['mass']
    # Complete: nothing is made, the statistics are printed again.
    before = content(whole)
    assert campaign([str(whole.parent / 'campaign.yaml'), '--output', str(whole)]) == 0
    reported = capsys.readouterr().out
    assert 'noise=mid: 4 runs, ' in reported
    assert '8 runs, 0 of them failed, 0 inconsistent' in reported
    assert content(whole) == before


CAD = f"""
model: {CONFIG / 'servicer7.urdf'}
simulator_params: {CONFIG / 'servicer7_simulator.yaml'}
simulator: {{duration: 15.0, joint_rate: 20.0, odometry_rate: 20.0}}
estimator:
  {{method: difference, target_link: link7, known_joints: {{zero_std: 0.0, origin_std: 0.0, axis_std: 0.0}},
    odometry_mount: {{position_std: 0.0, orientation_std: 0.0}}}}
noise:
  {{joint_position: 1.0e-4, joint_velocity: 1.0e-3, base_position: 1.0e-3, base_orientation: 1.0e-4,
    base_linear_velocity: 1.0e-3, base_angular_velocity: 1.0e-4}}
seeds: 3
cases:
  robot:
    exact: {{}}
    drawn: {{simulator: {{model_errors.links_relative_std: 0.01}}}}
  prior:
    none: {{estimator: {{known_links.relative_std: 0.0}}}}
    same: {{estimator: {{known_links.relative_std: 0.01}}}}
"""


@pytest.mark.long
@pytest.mark.usefixtures('numbers')
def test_errors_of_the_urdf_are_an_axis_like_others(tmp_path: Path) -> None:
    output = tmp_path / 'output'
    assert campaign([str(written(tmp_path, CAD)), '--output', str(output)]) == 0
    results = lines(output)
    by_case = {tuple(runs[0]['case'].values()): runs for runs in (results[i : i + 3] for i in range(0, 12, 3))}
    # The truth is one for all: the target is never drawn.
    assert {json.dumps(run['truth']) for run in results} == {json.dumps(results[0]['truth'])}
    assert [run['robot'] for run in by_case['exact', 'none']] == [None] * 3
    assert [run['robot'] for run in by_case['drawn', 'same']] == [0, 1, 2]
    # A percent of the links is far beyond what the sensors leave, unless it is declared.
    nees = {case: np.mean([run['nees'] for run in runs]) for case, runs in by_case.items()}
    assert nees['exact', 'none'] < 2.0
    assert nees['drawn', 'none'] > 10.0
    assert 0.3 < nees['drawn', 'same'] < 2.0
    assert nees['exact', 'same'] < 0.5


def test_the_band_is_that_of_a_right_covariance() -> None:
    rng = np.random.default_rng(0)
    inertia = dict.fromkeys(PARAMETERS[4:])

    def result(error: float) -> Result:
        values = {'mass': error, 'com': [None] * 3, 'inertia': inertia}
        truth, std = ({'mass': value, 'com': [0.0] * 3, 'inertia': dict.fromkeys(inertia, 0.0)} for value in (0.0, 2.0))
        return {'case': {}, 'status': 'converged', 'estimate': values, 'truth': truth, 'std': std, 'nees': error**2 / 4}

    inside = 0
    for _ in range(200):
        (case,) = statistics([result(error) for error in rng.normal(scale=2.0, size=25)])
        inside += case.nees_band[0] < case.nees < case.nees_band[1]
    assert 200 * 0.95 - 4 * np.sqrt(200 * 0.95 * 0.05) < inside < 200


# -- going on


# A program that is killed as it asks for the third result.
KILLED = """
import os, signal
from mbaid_ros.replay.arguments import campaign
from mbaid_ros.replay.campaigns import campaign as command

def made(*arguments):
    for count, result in enumerate(here(*arguments), start=1):
        yield result
        if count == 2:
            os.kill(os.getpid(), signal.SIGKILL)

here, command.made_here = command.made_here, made
exit(campaign())
"""


def test_after_a_kill_the_same_command_makes_what_is_missing_and_nothing_else(
    numbers: list[int], whole: Path, tmp_path: Path
) -> None:
    yaml, output = str(whole.parent / 'campaign.yaml'), tmp_path / 'output'
    arguments = [yaml, '--output', str(output), '--processes', '1']
    killed = subprocess.run([sys.executable, '-c', KILLED, *arguments], capture_output=True, check=False)
    assert killed.returncode == -signal.SIGKILL
    assert b'Traceback' not in killed.stderr  # until the workers have ended, too
    kept = {result['run'] for result in lines(output)}
    assert len(kept) == 2
    with (output / 'runs.jsonl').open('ab') as file:  # what a full disk or a power cut may leave
        file.write(b'{"run": 7, "case": {"noi')
    assert campaign(arguments) == 0
    assert numbers == sorted(set(range(RUNS)) - kept)
    assert content(output) == content(whole)


def test_a_changed_campaign_is_refused_with_what_has_changed(
    capsys: pytest.CaptureFixture[str], whole: Path, tmp_path: Path
) -> None:
    before = content(whole)
    for change, reported in [
        (('seeds: 4', 'seeds: 5'), 'seeds was [0, 1, 2, 3], is [0, 1, 2, 3, 4];'),
        (('duration: 5.0', 'duration: 4.0'), 'cases[0].simulator.duration was 5.0, is 4.0;'),
        (('1.0e-4}', '2.0e-4}'), 'cases[1].simulator.noise.joint_position was 0.0001, is 0.0002;'),
        (('mid:', 'high:'), 'cases[1].choices.noise was "mid", is "high";'),
        (('seeds: 4', 'seeds: 4\nmotions: 2\n'), 'accepted: random'),
    ]:
        line = refused(capsys, str(written(tmp_path, TEXT.replace(*change))), '--output', str(whole))
        assert reported in line
    # Comments and layout change nothing.
    same = TEXT.replace('seeds: 4', 'seeds: [0, 1, 2, 3]  # four')
    assert campaign([str(written(tmp_path, same)), '--output', str(whole)]) == 0
    assert content(whole) == before


# -- failures

WILD = '  motion:\n    gentle: {}\n    wild: {simulator: {initial.joint_velocities: [1.0e+14, 9.0, 9.0, 9.0]}}\n'


def test_a_run_that_fails_is_kept_with_its_reason_and_the_others_are_made(
    numbers: list[int], capsys: pytest.CaptureFixture[str], whole: Path, tmp_path: Path
) -> None:
    output = str(tmp_path / 'output')
    few = TEXT.replace('seeds: 4', 'seeds: 1')
    arguments = [str(written(tmp_path, few + WILD)), '--output', output]
    assert campaign(arguments) == 3
    reported = capsys.readouterr().out
    results = lines(tmp_path / 'output')
    bad = [result for result in results if result['case']['motion'] == 'wild']
    assert len(bad) == len(results) / 2 == 2
    assert all(result['status'] == 'failed' and result['reason'].startswith('ModelError: ') for result in bad)
    assert '4 runs, 2 of them failed' in reported
    assert f'run {bad[0]["run"]}: {bad[0]["reason"]}' in reported
    good = [result['estimate'] for result in results if result['case']['motion'] == 'gentle']
    assert good == [result['estimate'] for result in lines(whole) if result['seed'] == 0]
    numbers.clear()
    assert campaign(arguments) == 3
    assert numbers == []
    assert campaign([*arguments, '--retry-failed']) == 3
    assert numbers == [result['run'] for result in bad]
