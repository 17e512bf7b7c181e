"""One run of a campaign, simulated and identified in memory; many of them on this machine's cores or a cluster."""

from __future__ import annotations

import logging
import socket
import sys
from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool

import numpy as np

from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.cli import one_line
from mbaid_ros.config.campaign_file import CampaignRun, Case
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.errors import DataError, ParameterError
from mbaid_ros.replay.campaigns.statistics import FAILED, Result, nees
from mbaid_ros.replay.json_output import plain, shaped, shaped_std
from mbaid_ros.replay.replay import Workers
from mbaid_ros.session.session import Session
from mbaid_ros.simulated_run import SimulatedRun

_CHUNK = 10.0  # s of the run that are in memory at once; it does not change the numbers
_PATIENCE = 10.0  # s for the scheduler to answer


def prepare(case: Case, urdf: str) -> tuple[SimulatedRun, Session]:
    """Return the simulated robot at time 0 and the session that is to identify it.

    Raises ModelError, ParameterError: The robot or the parameters cannot be used, alone or together.
    """
    simulated, session = SimulatedRun(case.simulator, urdf, BAG_TYPES), Session(case.estimator, urdf)
    if simulated.target.name != session.robot.target_link:
        raise ParameterError(
            f"'target_link' is '{simulated.target.name}' for the simulator and '{session.robot.target_link}' for the "
            'estimator; accepted: the same link'
        )
    return simulated, session


def make(run: CampaignRun, urdf: str) -> Result:
    """Make a run and return its result; an error of any kind is a result, too, with its reason."""
    try:
        return _result(run, urdf)
    except Exception as error:  # noqa: BLE001 - one run of thousands: its reason is kept, and the others go on
        return _failed(run, f'{type(error).__name__}: {error}')


def _failed(run: CampaignRun, reason: str) -> Result:
    return {**_head(run), 'status': FAILED, 'reason': one_line(reason)}


def _head(run: CampaignRun) -> Result:
    simulator = run.case.simulator
    motion = simulator.motion.seed if simulator.motion.kind == 'random' else None
    sizes = {name: size for name, size in vars(simulator.model_errors).items() if name != 'seed'}
    return {
        'run': run.number,
        'case': dict(run.case.choices),
        'robot': simulator.model_errors.seed if any(sizes.values()) else None,
        'motion': motion,
        'seed': simulator.seed,
    }


def _result(run: CampaignRun, urdf: str) -> Result:
    simulated, session = prepare(run.case, urdf)
    final = _last_estimate(simulated, session) or Estimate(run.case.estimator.method, 'waiting')
    truth = simulated.target_inertia
    return {
        **_head(run),
        'status': final.status,
        'truth': shaped(truth),
        'estimate': shaped(final.parameters),
        'std': shaped_std(final.std),
        'error': shaped_std((final.parameters - truth) / final.std),
        'nees': plain(nees(final, truth)),
        'samples': final.samples,
        'span_s': final.time,
        'warnings': list(final.warnings),
    }


def _last_estimate(simulated: SimulatedRun, session: Session) -> Estimate | None:
    """Hand the simulated robot's messages to the session, and return the last estimate."""
    add = {
        'joint_states': session.add_joint_state,
        'odom': session.add_odometry,
        'thrust': session.add_thrust,
        'stored_momentum': session.add_stored_momentum,
        'imu': session.add_named,
    }
    last, duration = None, simulated.config.duration
    for end in np.minimum(np.arange(1, np.ceil(duration / _CHUNK) + 1) * _CHUNK, duration):
        for timed in simulated.read(float(end)):
            add[timed.topic](timed.message)
        estimates = session.process()
        last = estimates[-1] if estimates else last
    return last


def made_here(runs: Sequence[CampaignRun], urdf: str, processes: int) -> Generator[Result]:
    """Yield the results of runs as they end, made by so many processes of this machine at the same time."""
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
        except BrokenProcessPool:
            # One of them took its process down, and it is unknown which: each gets one to itself.
            for run in flying.values():
                yield _made_alone(run, urdf)


def _made_alone(run: CampaignRun, urdf: str) -> Result:
    try:
        with Workers(1, urdf) as workers:
            return workers.submit(_make, run).result()
    except BrokenProcessPool:
        return _failed(run, 'its process died, among others and alone: it was killed, or memory ran out')


def _make(urdf: str, run: CampaignRun) -> Result:
    return make(run, urdf)


def made_on_cluster(runs: Sequence[CampaignRun], urdf: str, scheduler: str) -> Generator[Result]:
    """Yield the results of runs as they end, made on the Dask cluster whose scheduler has an address.

    Raises ParameterError: Dask is not installed, or there is no scheduler at the address.
    Raises DataError: The cluster is lost, or cannot run this package.
    """
    try:
        from distributed import Client, KilledWorker, as_completed  # noqa: PLC0415 - optional, and slow to import
        from distributed.comm.addressing import get_address_host_port  # noqa: PLC0415
    except ImportError as error:
        raise ParameterError(
            '--scheduler needs Dask, which is not installed; accepted after: pip install distributed'
        ) from error
    for logger in ('distributed', 'distributed.client'):  # which print tracebacks of a lost connection
        logging.getLogger(logger).setLevel(logging.CRITICAL)
    try:
        # A client starts threads before it looks at its address.
        socket.create_connection(get_address_host_port(scheduler), _PATIENCE).close()
        client = Client(scheduler, timeout=_PATIENCE, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise ParameterError(
            f"--scheduler '{scheduler}' cannot be reached: {error}; accepted: the address that `dask scheduler` prints"
        ) from error
    with client:
        if not client.scheduler_info()['workers']:
            print(f"mbaid_ros campaign: waiting for the scheduler '{scheduler}' to get workers", file=sys.stderr)
        # Impure: results of another campaign on the cluster do not count as those of a run.
        futures = client.map(make, runs, urdf=urdf, pure=False)
        run_of = dict(zip((future.key for future in futures), runs, strict=True))
        flying = as_completed(futures, loop=client.loop)  # type: ignore[no-untyped-call]
        del futures  # the cluster keeps a result as long as its future is held
        for future in flying:
            run = run_of.pop(future.key)
            try:
                result = future.result()
            except KilledWorker as error:
                result = _failed(run, f'the worker that made it died {error.allowed_failures + 1} times')
            except Exception as error:  # connections, other versions there: each package has its own
                raise DataError(
                    f"the cluster of scheduler '{scheduler}' fails: {type(error).__name__}: {error}; its results are "
                    'kept, and the same command goes on from there'
                ) from error
            yield result
