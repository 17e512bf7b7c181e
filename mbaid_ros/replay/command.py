"""The executable `replay`: bags through the estimator, one by one or on all cores, and the results written."""

from __future__ import annotations

import argparse
import gc
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from mbaid_ros.bags import BagWriter
from mbaid_ros.cli import EXIT_INCONSISTENT, EXIT_NOT_DETERMINED
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.files import load_parameter_file, parse_assignment
from mbaid_ros.config.parameters import build
from mbaid_ros.config.robot import read_robot_description
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.replay.holdout import DEFAULT_FRACTION, LONG_ENOUGH, Holdout, holdout_of
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.output import as_json, check_outputs, texts, write_results
from mbaid_ros.replay.provenance import hashes, made_by
from mbaid_ros.replay.results import Run
from mbaid_ros.replay.run import EstimateWriter, progress_bar, replay_bag
from mbaid_ros.replay.saved import Truth, read_truth, truth_beside
from mbaid_ros.replay.workers import replay_bags


def replay(arguments: argparse.Namespace) -> int:
    """Send bags through the estimator, write the results, and return the exit code.

    Raises
    ------
    DataError, ModelError, ParameterError
        A bag, the robot or an argument cannot be used.
    """
    check_outputs(arguments)
    if arguments.output and len(arguments.bags) > 1:
        raise ParameterError(f'--output takes the estimates of one BAG; {len(arguments.bags)} are given')
    truths = _truths(arguments)
    config = _config(arguments)
    urdf = read_robot_description(arguments.model)
    inputs = Inputs.from_arguments(arguments, config)
    if not gc.get_freeze_count():
        gc.freeze()  # present objects stay: looking through them for garbage takes time, again and again
    if len(arguments.bags) > 1:
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
    write_results(arguments, content, lambda: _page(runs, truths), lambda: texts(runs))
    return exit_code(runs)


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
    values: dict[str, object] = {}
    if arguments.params:
        values.update(load_parameter_file(arguments.params, 'estimator'))
    values |= dict(map(parse_assignment, arguments.assignments))
    given = {'method': arguments.method, 'target_link': arguments.target}
    return build(EstimatorConfig, values | {name: value for name, value in given.items() if value is not None})


@contextmanager
def _writer(path: str | None, config: EstimatorConfig) -> Iterator[EstimateWriter | None]:
    if path is None:
        yield None
        return
    with BagWriter(path) as bag:
        yield EstimateWriter(bag, with_debris=config.debris.report)


def _page(runs: Sequence[Run], truths: Sequence[Truth | None]) -> str:
    from mbaid_ros.replay.report import html  # noqa: PLC0415 - matplotlib takes a while, and only a report needs it

    return html(runs, truths)
