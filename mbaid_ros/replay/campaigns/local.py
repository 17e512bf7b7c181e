"""The runs of a campaign on the cores of this machine."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait

from mbaid_ros.config.campaign import CampaignRun
from mbaid_ros.replay.campaigns.make import Result, failed, make
from mbaid_ros.replay.workers import ProcessDiedError, Workers


def made_here(runs: Sequence[CampaignRun], urdf: str, processes: int) -> Generator[Result]:
    """Yield the results of runs as they end.

    Parameters
    ----------
    runs : what to make
    urdf : text of the robot description
    processes : that work at the same time
    """
    waiting = deque(runs)
    while waiting:
        flying: dict[Future[Result], CampaignRun] = {}
        try:
            with Workers(min(processes, len(waiting)), urdf) as workers:
                while waiting or flying:
                    while waiting and len(flying) < processes:
                        flying[workers.submit(_make, waiting[0])] = waiting[0]
                        waiting.popleft()
                    for future in wait(flying, return_when=FIRST_COMPLETED).done:
                        result = future.result()
                        del flying[future]
                        yield result
        except ProcessDiedError:
            # One of them took its process down, and nothing says which: each gets one to itself.
            for run in flying.values():
                yield _made_alone(run, urdf)


def _made_alone(run: CampaignRun, urdf: str) -> Result:
    try:
        with Workers(1, urdf) as workers:
            return workers.submit(_make, run).result()
    except ProcessDiedError:
        return failed(run, 'its process died, among others and alone: it was killed, or memory ran out')


def _make(urdf: str, run: CampaignRun) -> Result:
    return make(run, urdf)
