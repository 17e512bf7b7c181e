"""`campaign`: the runs of its YAML, its refusals, and a Dask cluster of this machine, as in the document."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from distributed import Client

from campaigns import FILES, TEXT, refused, written
from documents import CAMPAIGNS, blocks, project
from mbaid_ros.config.campaign_file import CampaignRun, load_campaign
from mbaid_ros.replay.arguments import campaign
from mbaid_ros.replay.campaigns import campaign as command
from mbaid_ros.replay.campaigns import make as cluster
from mbaid_ros.replay.campaigns.statistics import Result
from mbaid_ros.simulated_robot import make_springs
from simulated import CONFIG, robot


def test_motions_and_seeds_multiply(tmp_path: Path) -> None:
    text = TEXT.replace('seeds: 4', 'seeds: [7, 3]\nmotions: 3').replace(
        'simulator: {', 'simulator: {motion.kind: random, '
    )
    text = text.replace(
        f'simulator_params: {CONFIG / "table1_simulator.yaml"}', f'simulator_params: {CONFIG / "ets7_simulator.yaml"}'
    )
    plan = load_campaign(written(tmp_path, text.replace('table1.urdf', 'ets7.urdf')))
    runs = list(plan.runs())
    assert [run.number for run in runs] == list(range(12))
    assert [(run.case.simulator.motion.seed, run.case.simulator.seed) for run in runs[:6]] == [
        (0, 7), (0, 3), (1, 7), (1, 3), (2, 7), (2, 3)
    ]  # fmt: skip
    assert str(runs[-1].case) == 'noise=mid'


def test_every_seed_has_a_robot_of_its_own_or_all_have_those_named(tmp_path: Path) -> None:
    def seeds(text: str) -> list[tuple[int, int]]:
        runs = list(load_campaign(written(tmp_path, text)).runs())[:4]
        return [(run.case.simulator.model_errors.seed, run.case.simulator.seed) for run in runs]

    assert seeds(TEXT) == [(0, 0), (1, 1), (2, 2), (3, 3)]
    assert seeds(TEXT.replace('seeds: 4', 'seeds: [5, 6]\nrobots: [8, 9]')) == [(8, 5), (8, 6), (9, 5), (9, 6)]


def test_every_robot_has_frequencies_of_its_own(tmp_path: Path) -> None:
    drawn = 'flexible.joints: [joint2], flexible.joint2.frequency: 0.3, model_errors.frequency_relative_std: 0.05'
    runs = load_campaign(written(tmp_path, TEXT.replace('simulator: {', f'simulator: {{{drawn}, '))).runs()
    springs = [make_springs(run.case.simulator, robot('table1')) for run in list(runs)[:4]]
    stiffness = np.array([each.stiffness[0] for each in springs if each is not None])
    ratio = np.sqrt(stiffness / stiffness[0])
    assert len(set(ratio.tolist())) == 4
    assert np.all(np.abs(ratio - 1.0) < 0.3)


@pytest.mark.parametrize(
    ('old', 'new', 'reported'),
    [
        (TEXT, '', "the key 'model' is missing"),
        (TEXT, '- 1', "is [1]; accepted: 'name: value' pairs"),
        (TEXT, '[', 'is not YAML'),
        ('seeds: 4', 'seed: 4', "unknown key 'seed'; known: seeds, "),
        ('seeds: 4', 'seeds: 0', "'seeds' is 0; accepted: a whole number >= 1, of seeds from 0, or a list"),
        ('seeds: 4', 'seeds: four', "'seeds' is 'four'; accepted"),
        ('seeds: 4', 'seeds: true', "'seeds' is true; accepted"),
        ('seeds: 4', 'seeds: [1, 1]', "'seeds' is [1, 1]; accepted: "),
        ('seeds: 4', 'seeds: [-1]', "'seeds' is [-1]; accepted"),
        ('seeds: 4', 'seeds: 1000000', 'make 2000000 runs; accepted: 1000000 at most'),
        ('seeds: 4', 'motions: 2', "'motion.kind' is 'passive'; accepted: random"),
        ('duration: 5.0', 'duration: 0.0', "'duration' is 0 s"),
        ('duration: 5.0', 'duration: long', "parameter 'duration' is 'long'; accepted: a number >= 0 and <= 1e+06 s"),
        ('duration: 5.0', 'length: 3.0', "unknown parameter 'length'; known: "),
        ('duration: 5.0', 'duration: 5.0, seed: 3', "'simulator.seed' is not accepted; the key for it is 'seeds'"),
        ('seeds: 4', 'robots: none', "'robots' is 'none'; accepted: a whole number >= 1"),
        (
            'duration: 5.0', 'model_errors.seed: 3, duration: 5.0',
            "'simulator.model_errors.seed' is not accepted; the key for it is 'robots'",
        ),
        ('simulator: {', 'simulator: 3 #', "'simulator' is 3; accepted: 'name: value' pairs"),
        ('mid: {noise', 'mid: {sensors', "'cases.noise.mid' has the unknown key 'sensors'; known: "),
        ('{joint_position: 1.0e-4}', '{joint_position: -1.0}', "noise=mid: parameter 'noise.joint_position' is -1"),
        ('    low:', '    1:', "'cases.noise' has the name 1; accepted: text"),
        ('cases:', 'cases:\n  empty:', "'cases.empty' is None; accepted: 'name: value' pairs"),
        (
            'cases:', 'cases:\n  other: {a: {estimator: {noise: {joint_position: 1.0}}}}',
            "'noise.joint_position' of the estimator is set by the groups 'other' and 'noise'; accepted: by one",
        ),
        (
            'noise: {base', 'estimator: {noise.base_position: 1.0}\nnoise: {base',
            "'noise.base_position' and 'estimator.noise.base_position' are both given; accepted: one",
        ),
        (
            'noise: {base', 'estimator: {target_link: link3}\nnoise: {base',
            "noise=low: 'target_link' is 'link4' for the simulator and 'link3' for the estimator",
        ),
        ('table1.urdf', 'absent.urdf', 'absent.urdf'),
        ('table1_estimator.yaml', 'absent.yaml', "absent.yaml': No such file"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_one_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, old: str, new: str, reported: str
) -> None:
    yaml = str(written(tmp_path, TEXT.replace(old, new, 1)))
    line = refused(capsys, yaml, '--output', str(tmp_path / 'output'))
    assert reported in line
    assert f"campaign '{yaml}'" in line
    assert not (tmp_path / 'output').exists()


def test_the_campaign_that_ships_is_accepted() -> None:
    plan = load_campaign(CONFIG / 'table1_campaign.yaml')
    assert len(list(plan.runs())) == 20


RUNS = int(os.environ.get('MBAID_ROS_CAMPAIGN_RUNS', '20'))
BRIEF = f"""{FILES}
simulator: {{duration: 2.0, joint_rate: 20.0, odometry_rate: 20.0}}
noise: {{joint_position: 1.0e-4, base_position: 1e-4}}
seeds: {RUNS}
"""


@contextmanager
def started(command: str, folder: Path) -> Iterator[subprocess.Popen[str]]:
    """Run a command of the document, with two workers where it asks for one a core."""
    environment = {**os.environ, 'OMP_NUM_THREADS': '2'}  # which nproc prints
    process = subprocess.Popen(
        ['bash', '-c', command], cwd=folder, env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)  # with the processes that it started
        process.communicate()


def reported(process: subprocess.Popen[str], pattern: str) -> str:
    """Wait until a program says something; return what stands in the parentheses."""
    assert process.stderr is not None
    said = []
    for line in process.stderr:
        said.append(line)
        found = re.search(pattern, line)
        if found:
            return found[1]
    raise AssertionError(''.join(said))


@dataclass(frozen=True)
class Cluster:
    """A cluster, started as the document says.

    Parameters
    ----------
    address : of its scheduler
    scheduler : process
    campaign : words of the command that uses it, as printed but for the address
    """

    address: str
    scheduler: subprocess.Popen[str]
    campaign: list[str]

    def workers(self) -> list[int]:
        """Return the process identifiers of the workers."""
        with Client(self.address, set_as_default=False) as client:  # type: ignore[no-untyped-call]
            return list(client.run(os.getpid).values())


@pytest.fixture(scope='module', name='two')
def cluster_of_two(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    (block,) = blocks(CAMPAIGNS, 'run by test/replay/test_campaign_cluster.py')
    here = re.sub(r'dask \w+', r'\g<0> --host 127.0.0.1 --no-dashboard', block.text)
    start_scheduler, start_workers, use = here.splitlines()
    (printed,) = set(re.findall(r'tcp://\S+', here))
    with project(tmp_path_factory.mktemp('cluster')) as folder, ExitStack() as stack:
        scheduler = stack.enter_context(started(start_scheduler.partition('#')[0] + ' --port 0', folder))
        address = reported(scheduler, r'Scheduler at:\s+(tcp://\S+)')
        workers = stack.enter_context(started(start_workers.replace(printed, address), folder))
        for _ in range(2):
            reported(workers, r'Starting established connection to (\S+)')
        yield Cluster(address, scheduler, shlex.split(use.replace(printed, address)))


def dying(kill: Callable[[], None], after: int) -> Callable[..., Generator[Result]]:
    """Return what makes runs on a cluster, and kills a process of it when some of the results are there."""

    def made(runs: Sequence[CampaignRun], urdf: str, scheduler: str) -> Generator[Result]:
        for count, result in enumerate(cluster.made_on_cluster(runs, urdf, scheduler), start=1):
            if count == after:
                kill()
            yield result

    return made


@pytest.mark.long
@pytest.mark.parametrize('runs', [RUNS], ids='{} runs'.format)
def test_a_campaign_on_a_cluster_that_loses_a_worker_is_that_of_this_machine(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path, two: Cluster, runs: int
) -> None:
    assert two.campaign[:4] == ['ros2', 'run', 'mbaid_ros', 'campaign']
    yaml, *options = two.campaign[4:]
    (tmp_path / yaml).parent.mkdir()
    (tmp_path / yaml).write_text(BRIEF)
    monkeypatch.chdir(tmp_path)
    victim, other = two.workers()
    monkeypatch.setattr(command, 'made_on_cluster', dying(lambda: os.kill(victim, signal.SIGKILL), runs // 4))
    assert campaign([yaml, *options, '--output', 'cluster']) == 0
    left = two.workers()
    assert other in left
    assert victim not in left
    there = capsys.readouterr()
    assert there.err == ''
    assert campaign([yaml, '--output', 'here']) == 0
    for name in ('runs.jsonl', 'summary.json', 'campaign.json'):
        assert (tmp_path / 'cluster' / name).read_bytes() == (tmp_path / 'here' / name).read_bytes()
    assert there.out.replace('cluster/', 'here/') == capsys.readouterr().out


@pytest.mark.parametrize('address', ['tcp://127.0.0.1:1', 'nowhere', 'ftp://127.0.0.1:1', 'tcp://127.0.0.1:port'])
def test_a_scheduler_that_is_not_there_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path, address: str
) -> None:
    monkeypatch.setattr(cluster, '_PATIENCE', 0.2)
    line = refused(capsys, str(written(tmp_path, BRIEF)), '--output', str(tmp_path / 'output'), '--scheduler', address)
    assert line.startswith(f"mbaid_ros campaign: --scheduler '{address}' cannot be reached: ")
    assert line.endswith('accepted: the address that `dask scheduler` prints\n')
