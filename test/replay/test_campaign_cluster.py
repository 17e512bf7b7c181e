"""`campaign` on a Dask cluster of this machine: a scheduler and two workers on loopback, as in the document."""

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

import pytest
from distributed import Client

from campaigns import refused, written
from documents import CAMPAIGNS, blocks, project
from mbaid_ros.config.campaign import CampaignRun
from mbaid_ros.replay.campaigns import command
from mbaid_ros.replay.campaigns import make as cluster
from mbaid_ros.replay.campaigns.statistics import Result
from mbaid_ros.replay.start import campaign
from simulated import CONFIG

RUNS = int(os.environ.get('MBAID_ROS_CAMPAIGN_RUNS', '20'))
TEXT = f"""
model: {CONFIG / 'table1.urdf'}
simulator_params: {CONFIG / 'table1_simulator.yaml'}
estimator_params: {CONFIG / 'table1_estimator.yaml'}
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


def told(process: subprocess.Popen[str], pattern: str) -> str:
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
        address = told(scheduler, r'Scheduler at:\s+(tcp://\S+)')
        workers = stack.enter_context(started(start_workers.replace(printed, address), folder))
        for _ in range(2):
            told(workers, r'Starting established connection to (\S+)')
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
    (tmp_path / yaml).write_text(TEXT)
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
    line = refused(capsys, str(written(tmp_path, TEXT)), '--output', str(tmp_path / 'output'), '--scheduler', address)
    assert line.startswith(f"mbaid_ros campaign: --scheduler '{address}' cannot be reached: ")
    assert line.endswith('accepted: the address that `dask scheduler` prints\n')
