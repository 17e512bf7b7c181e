"""The runs of a campaign on a Dask cluster."""

from __future__ import annotations

import logging
import sys
from collections.abc import Generator, Sequence

from mbaid_ros.config.campaign import CampaignRun
from mbaid_ros.core.errors import DataError, ParameterError
from mbaid_ros.replay.campaigns.make import Result, failed, make

_PATIENCE = 10.0  # s for the scheduler to answer


def made_on_cluster(runs: Sequence[CampaignRun], urdf: str, scheduler: str) -> Generator[Result]:
    """Yield the results of runs as they end.

    Parameters
    ----------
    runs : what to make
    urdf : text of the robot description
    scheduler : address, as `dask scheduler` prints it

    Raises
    ------
    ParameterError
        Dask is not installed, or there is no scheduler at the address.
    DataError
        The cluster is lost, or cannot run this package.
    """
    try:
        from distributed import Client, KilledWorker, as_completed  # noqa: PLC0415 - optional, and slow to import
    except ImportError as error:
        raise ParameterError(
            '--scheduler needs Dask, which is not installed; accepted after: pip install distributed'
        ) from error
    for logger in ('distributed', 'distributed.client'):  # of a lost connection they print tracebacks; it is told below
        logging.getLogger(logger).setLevel(logging.CRITICAL)
    try:
        client = Client(scheduler, timeout=_PATIENCE, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise ParameterError(
            f"--scheduler '{scheduler}' cannot be reached: {error}; accepted: the address that `dask scheduler` prints"
        ) from error
    with client:
        if not client.scheduler_info()['workers']:
            print(f"mbaid_ros campaign: waiting for the scheduler '{scheduler}' to get workers", file=sys.stderr)
        # Impure: what another campaign left on the cluster is not taken for the result of a run.
        futures = client.map(make, runs, urdf=urdf, pure=False)
        run_of = dict(zip((future.key for future in futures), runs, strict=True))
        flying = as_completed(futures, loop=client.loop)  # type: ignore[no-untyped-call]
        del futures  # the cluster keeps a result as long as somebody holds its future
        for future in flying:
            run = run_of.pop(future.key)
            try:
                result = future.result()
            except KilledWorker as error:
                result = failed(run, f'the worker that made it died {error.allowed_failures + 1} times')
            except Exception as error:  # connections, other versions there: each package has its own
                raise DataError(
                    f"the cluster of scheduler '{scheduler}' fails: {type(error).__name__}: {error}; what it made is "
                    'kept, and the same command goes on from there'
                ) from error
            yield result
