"""What the executable `replay` does with its arguments."""

from __future__ import annotations

import argparse
import gc
import json
import sys
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
from mbaid_ros.files import as_utf8, require_writable, write_text
from mbaid_ros.replay.feed import progress_bar
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.many import replay_bags
from mbaid_ros.replay.provenance import hashes, made_by
from mbaid_ros.replay.result_json import as_json
from mbaid_ros.replay.result_text import texts
from mbaid_ros.replay.results import Run
from mbaid_ros.replay.run import EstimateWriter, replay_bag
from mbaid_ros.replay.truth import Truth, read_truth, truth_beside

STDOUT = '-'


def replay(arguments: argparse.Namespace, argv: Sequence[str]) -> int:
    """Send bags through the estimator, write what was asked for, and return the exit code.

    Parameters
    ----------
    arguments : parsed
    argv : as they were given, for the record

    Raises
    ------
    DataError, ModelError, ParameterError
        A bag, the robot or an argument cannot be used.
    """
    _check_outputs(arguments)
    truths = _truths(arguments)
    config = _config(arguments)
    urdf = read_robot_description(arguments.model)
    inputs = Inputs.of(arguments, config)
    if not gc.get_freeze_count():
        gc.freeze()  # what there is by now stays: looking through it for garbage takes time, again and again
    if len(arguments.bags) > 1:
        runs = replay_bags(arguments.bags, config, urdf, inputs, arguments.processes)
    else:
        with _estimate_writer(arguments.output, with_debris=config.debris.report) as writer:
            runs = [_replay_one(arguments.bags[0], config, urdf, inputs, writer)]
    if arguments.json or arguments.report:
        made = made_by('replay', argv, arguments.model, urdf)
        runs = [replace(each, made_by=made, files=hashes(each.bag)) for each in runs]
    _write_results(runs, arguments, truths)
    return exit_code(runs)


def exit_code(runs: Sequence[Run]) -> int:
    """Return what the worst of the runs leads to: data that contradict the model, then data that say nothing."""
    if any(run.contradicted for run in runs):
        return EXIT_INCONSISTENT
    return 0 if all(run.reached for run in runs) else EXIT_NOT_DETERMINED


def _check_outputs(arguments: argparse.Namespace) -> None:
    """Refuse before the long work what could not be written after it."""
    for option in ('json', 'report'):
        path = getattr(arguments, option)
        if path and path != STDOUT:
            require_writable(f'--{option}', path)
    if arguments.output and len(arguments.bags) > 1:
        raise ParameterError(f'--output takes the estimates of one BAG; {len(arguments.bags)} are given')


def _truths(arguments: argparse.Namespace) -> list[Truth | None]:
    """Return the truth of each bag: the file given for all, or what lies beside the bag."""
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
    if arguments.method is not None:
        values['method'] = arguments.method
    if arguments.target is not None:
        values['target_link'] = arguments.target
    return build(EstimatorConfig, values)


@contextmanager
def _estimate_writer(path: str | None, *, with_debris: bool) -> Iterator[EstimateWriter | None]:
    if path is None:
        yield None
        return
    with BagWriter(path) as bag:
        yield EstimateWriter(bag, with_debris=with_debris)


def _replay_one(bag: str, config: EstimatorConfig, urdf: str, inputs: Inputs, writer: EstimateWriter | None) -> Run:
    with progress_bar(bag) as progress:
        return replay_bag(bag, config, urdf, inputs, writer=writer, progress=progress)


def _write_results(runs: Sequence[Run], arguments: argparse.Namespace, truths: Sequence[Truth | None]) -> None:
    results = [as_json(result) for result in runs]
    text = json.dumps(results[0] if len(results) == 1 else results, allow_nan=False, ensure_ascii=False) + '\n'
    # Files first: whoever reads the output may leave early (`| head`).
    if arguments.json and arguments.json != STDOUT:
        write_text(arguments.json, text)
    if arguments.report:
        from mbaid_ros.replay.report import html  # noqa: PLC0415 - matplotlib takes a while, and only a report needs it

        write_text(arguments.report, html(runs, truths))
    if arguments.json == STDOUT:
        sys.stdout.write(as_utf8(text))
    else:
        print(texts(runs))
