"""The executable `replay`: bags through the estimator, one by one or by processes on all cores, and the results."""

from __future__ import annotations

import argparse
import gc
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import active_children, get_context, parent_process
from types import TracebackType
from typing import Any, TypeVar

from tqdm import tqdm

from mbaid_ros.bags import BagWriter
from mbaid_ros.cli import EXIT_INCONSISTENT, EXIT_NOT_DETERMINED
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.config.parameter_files import given_parameters, read_robot_description
from mbaid_ros.errors import DataError, ParameterError
from mbaid_ros.files import write_text
from mbaid_ros.parameters import build
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.json_output import as_json, parameter_file
from mbaid_ros.replay.one_bag import progress_bar, replay_bag
from mbaid_ros.replay.provenance import hashes, made_by
from mbaid_ros.replay.read_back import Truth, read_truth, truth_beside
from mbaid_ros.replay.text import texts
from mbaid_ros.replay.whole_run import DEFAULT_FRACTION, LONG_ENOUGH, Holdout, Run, holdout_of
from mbaid_ros.replay.writers import EstimateWriter, check_outputs, write_results

T = TypeVar('T')


class Workers:
    """Processes that work, as a context: at its end they end; after an error or an interrupt, at once.

    They are new ones (spawn), not copies of this one with locks that its threads hold. Every call gets `common` as its
    first argument. Where one dies, all results that are due are a BrokenProcessPool.
    """

    def __init__(self, count: int, common: object) -> None:
        self._pool = ProcessPoolExecutor(count, get_context('spawn'), _begin, (common,))

    def submit(self, function: Callable[..., T], *arguments: object) -> Future[T]:
        """Call a function in one of the processes."""
        # Processes begin here, and inherit the mask: an interrupt, which reaches all of them, is left to this one.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return self._pool.submit(_called, function, *arguments)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def __enter__(self) -> Workers:
        """Return the processes."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the processes."""
        if kind is not None:
            for process in active_children():
                process.kill()
        self._pool.shutdown(cancel_futures=True)


_common: Any = None  # of a worker


def _begin(common: object) -> None:
    """Keep the first argument of all calls, and end this process when its parent does."""
    global _common  # noqa: PLW0603 - a process of a pool has no other place
    _common = common
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _called(function: Callable[..., T], *arguments: object) -> T:
    return function(_common, *arguments)


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


Task = tuple[EstimatorConfig, str, Inputs]


def _replayed(task: Task, bag: str) -> Run:
    return replay_bag(bag, *task)


def replay_bags(bags: Sequence[str], config: EstimatorConfig, urdf: str, inputs: Inputs, processes: int) -> list[Run]:
    """Replay bags in so many processes at a time, with the results of one after the other; a terminal shows a bar.

    Raises DataError, ModelError, ParameterError: The error of the first bag, in the order given, that cannot be
    replayed.
    """
    task: Task = (config, urdf, inputs)
    with (
        tqdm(total=len(bags), unit=' bags', disable=None, leave=False) as bar,
        Workers(min(processes, len(bags)), task) as workers,
    ):
        futures = [workers.submit(_replayed, bag) for bag in bags]
        for future in futures:
            future.add_done_callback(lambda _: bar.update())
        try:
            return [future.result() for future in futures]
        except BrokenProcessPool as error:
            raise DataError(
                'a process died over a bag: it was killed, or memory ran out; fewer --processes take less of it'
            ) from error


def replay(arguments: argparse.Namespace) -> int:
    """Send bags through the estimator, write the results, and return the exit code.

    Raises DataError, ModelError, ParameterError: A bag, the robot or an argument cannot be used.
    """
    check_outputs(arguments, 'params-output')
    for option in ('output', 'params_output'):
        if getattr(arguments, option) and len(arguments.bags) > 1:
            words = 'estimates' if option == 'output' else 'parameters'
            name = option.replace('_', '-')
            raise ParameterError(f'--{name} takes the {words} of one BAG; {len(arguments.bags)} are given')
    truths = _truths(arguments)
    config = _config(arguments)
    urdf = read_robot_description(arguments.model)
    inputs = Inputs.from_arguments(arguments, config)
    if not gc.get_freeze_count():
        gc.freeze()  # present objects stay: looking through them for garbage takes time, again and again
    if arguments.continues:
        runs = _continued(arguments.bags, config, urdf, inputs)
    elif len(arguments.bags) > 1:
        runs = replay_bags(arguments.bags, config, urdf, inputs, arguments.processes)
    else:
        bag = arguments.bags[0]
        with _writer(arguments.output, config) as writer, progress_bar(bag) as progress:
            runs = [replay_bag(bag, config, urdf, inputs, writer=writer, progress=progress)]
    runs = [replace(each, holdout=_holdout(each, arguments)) for each in runs]
    if arguments.json or arguments.report:
        made = made_by('replay', arguments.argv, arguments.model, urdf)
        runs = [replace(each, made_by=made, files=hashes(each.bag)) for each in runs]
    results = [as_json(run) for run in runs]
    content = results[0] if len(results) == 1 else results
    if arguments.params_output:
        write_text(arguments.params_output, parameter_file(runs[0]))
    write_results(arguments, content, lambda: texts(runs), lambda: _page(runs, truths))
    return exit_code(runs)


def _continued(bags: Sequence[str], config: EstimatorConfig, urdf: str, inputs: Inputs) -> list[Run]:
    """Replay bags one after the other, each from the posterior of those before it."""
    runs: list[Run] = []
    before: Run | None = None
    notes: tuple[str, ...] = ()
    for bag in bags:
        with progress_bar(bag) as progress:
            run = replay_bag(bag, config, urdf, inputs, progress=progress, before=before)
        runs.append(replace(run, warnings=(*run.warnings, *notes)))
        if run.posterior is None or run.contradicted or run.final.repairs:
            why = 'was repaired' if run.final.repairs else 'reached no estimate that can be trusted'
            notes = (*notes, f'nothing goes on from {bag}, which {why}')
        else:
            before = run
    return runs


def exit_code(runs: Sequence[Run]) -> int:
    """Return the worst of the runs' exit codes: a contradiction of the model, then data that determine nothing."""
    if any(run.contradicted for run in runs):
        return EXIT_INCONSISTENT
    return 0 if all(run.reached for run in runs) else EXIT_NOT_DETERMINED


def _holdout(run: Run, arguments: argparse.Namespace) -> Holdout | None:
    """Return the check on the last part of a run: where asked for, and in the report of a run that is long enough."""
    by_default = DEFAULT_FRACTION if arguments.report and run.final.time >= LONG_ENOUGH else 0.0
    fraction = arguments.holdout or by_default
    return holdout_of(run.history, fraction) if fraction else None


def _truths(arguments: argparse.Namespace) -> list[Truth | None]:
    """Return the truth of each bag: the file given for all, or the one beside the bag."""
    if arguments.truth is not None:
        return [read_truth(arguments.truth)] * len(arguments.bags)
    if arguments.report is None:
        return [None] * len(arguments.bags)
    return [truth_beside(bag) for bag in arguments.bags]


def _config(arguments: argparse.Namespace) -> EstimatorConfig:
    """Return the parameters: the file's, then those of -p, then those with an argument of their own."""
    values = given_parameters(arguments, 'estimator')
    given = {'method': arguments.method, 'target_link': arguments.target, 'repair': arguments.repair or None}
    return build(EstimatorConfig, values | {name: value for name, value in given.items() if value is not None})


@contextmanager
def _writer(path: str | None, config: EstimatorConfig) -> Iterator[EstimateWriter | None]:
    if path is None:
        yield None
        return
    with BagWriter(path) as bag:
        yield EstimateWriter(bag, with_debris=config.debris.report)


def _page(runs: Sequence[Run], truths: Sequence[Truth | None]) -> str:
    from mbaid_ros.replay.report.page import html  # noqa: PLC0415 - matplotlib takes a while, and only a report needs it

    return html(runs, truths)
