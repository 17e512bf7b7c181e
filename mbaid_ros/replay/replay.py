"""The executable `replay`: recorded bags through the estimator, without a graph."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from mbaid_ros.bags import BagWriter
from mbaid_ros.cli import ArgumentParser, run
from mbaid_ros.config.estimator import METHODS, EstimatorConfig
from mbaid_ros.config.files import load_parameter_file
from mbaid_ros.config.parameters import build
from mbaid_ros.config.robot import read_robot_description
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.replay.feed import Inputs, progress_bar
from mbaid_ros.replay.many import replay_bags
from mbaid_ros.replay.results import Run, as_json, summary
from mbaid_ros.replay.run import EstimateWriter, replay_bag
from mbaid_ros.replay.truth import Truth, read_truth, truth_beside
from mbaid_ros.replay.workers import add_processes_option

NOT_DETERMINED = 3
STDOUT = '-'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the executable: 0 if every bag led to an estimate, 3 if one did not, 2 after a user's error."""
    return run(_replay, argv)


def _replay(argv: list[str]) -> int:
    arguments = _parser().parse(argv)
    _check_outputs(arguments)
    truths = _truths(arguments)
    config = _config(arguments)
    urdf = read_robot_description(arguments.model)
    inputs = Inputs(arguments.joint_states, arguments.odom, arguments.thrust)
    if len(arguments.bags) > 1:
        runs = replay_bags(arguments.bags, config, urdf, inputs, arguments.processes)
    else:
        with _estimate_writer(arguments.output, with_debris=config.debris.report) as writer:
            runs = [_replay_one(arguments.bags[0], config, urdf, inputs, writer)]
    _write_results(runs, arguments, truths)
    return 0 if all(result.reached for result in runs) else NOT_DETERMINED


def _parser() -> ArgumentParser:
    parser = ArgumentParser(
        'replay',
        'Identify the inertia of a link from recorded bags, as the estimator node does from live topics.\n'
        'Exit code: 0 an estimate was reached, 3 the data do not determine one, 2 bad input.',
        'replay run1 --model robot.urdf --target gripper --report run1.html',
    )
    add = parser.add_argument
    add('bags', nargs='+', metavar='BAG', help='rosbag2 folder (MCAP or sqlite3), or a bare .mcap or .db3 file')
    add('--model', required=True, metavar='URDF', help='the robot description')
    add('--target', metavar='LINK', help='link to identify (default: the last link)')
    add('--params', metavar='YAML', help="the estimator node's ROS parameter file")
    add('--method', metavar='METHOD', help=f'identification method: {", ".join(METHODS)}')
    add('--joint-states', default=Inputs.joint_states, metavar='TOPIC', help='default: %(default)s')
    add('--odom', default=Inputs.odometry, metavar='TOPIC', help='default: %(default)s')
    add('--thrust', default='', metavar='TOPIC', help='commanded thrust, WrenchStamped (default: /thrust, if recorded)')
    add('--json', metavar='FILE', help='write the result as JSON; - for standard output')
    add('--report', metavar='HTML', help='write a report')
    add('--truth', metavar='JSON', help='what the report compares with (default: truth.json beside each bag)')
    add('--output', metavar='BAG', help='write the estimates as messages into a new bag')
    add_processes_option(parser)
    return parser


def _check_outputs(arguments: argparse.Namespace) -> None:
    """Refuse before the long work what could not be written after it."""
    for option in ('json', 'report'):
        path = getattr(arguments, option)
        if path and path != STDOUT and (not Path(path).parent.is_dir() or Path(path).is_dir()):
            raise ParameterError(f"--{option} '{path}' cannot be written; accepted: a file in a folder that exists")
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
    """Return the parameters of the file, those of the command line over them."""
    values: dict[str, object] = {}
    if arguments.params:
        values.update(load_parameter_file(arguments.params, 'estimator'))
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
        Path(arguments.json).write_text(text, encoding='utf-8')
    if arguments.report:
        from mbaid_ros.replay.report import html  # noqa: PLC0415 - matplotlib takes a while, and only a report needs it

        Path(arguments.report).write_text(html(runs, truths), encoding='utf-8')
    if arguments.json == STDOUT:
        sys.stdout.write(text)
    else:
        print('\n\n'.join(summary(result) for result in runs))


if __name__ == '__main__':
    sys.exit(main())
