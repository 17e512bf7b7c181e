"""The executable `replay`: recorded bags through the estimator, without a graph."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from mbaid_ros.cli import ArgumentParser, run
from mbaid_ros.config.trajectory import METHODS
from mbaid_ros.replay.inputs import add_input_arguments
from mbaid_ros.replay.workers import add_processes_option


def main(argv: Sequence[str] | None = None) -> int:
    """Run the executable: 0 if every bag led to an estimate; else 2, 4 or 3, as the help says."""
    return run(_replay, argv)


def _replay(argv: list[str]) -> int:
    arguments = _parser().parse(argv)
    from mbaid_ros.replay.command import replay  # noqa: PLC0415 - takes a while, and --help needs none of it

    return replay(arguments, argv)


def _parser() -> ArgumentParser:
    parser = ArgumentParser(
        'replay',
        'Identify the inertia of a link from recorded bags, as the estimator node does from live topics.\n'
        'Exit code: 0 an estimate was reached, 4 the data contradict the model: do not trust the numbers,\n'
        '3 the data do not determine an estimate, 2 bad input. Of several bags the worst counts: 2, then 4, then 3.',
        'replay run1 --model robot.urdf --target gripper --report run1.html',
    )
    add = parser.add_argument
    add('--model', required=True, metavar='URDF', help='the robot description')
    add(
        '--target',
        metavar='LINK',
        help='link to identify (default: the last one with an inertia, furthest from the base)',
    )
    add('--params', metavar='YAML', help="the estimator node's ROS parameter file")
    add('-p', dest='assignments', action='append', default=[], metavar='NAME:=VALUE', help='set one parameter')
    add('--method', metavar='METHOD', help=f'identification method: {", ".join(METHODS)}')
    add_input_arguments(parser)
    add('--json', metavar='FILE', help='write the result as JSON; - for standard output')
    add('--report', metavar='HTML', help='write a report')
    add('--truth', metavar='JSON', help='what the report compares with (default: truth.json beside each bag)')
    add('--output', metavar='BAG', help='write the estimates as messages into a new bag')
    add_processes_option(parser)
    return parser


if __name__ == '__main__':
    sys.exit(main())
