"""The executable `plan`: the motion of the joints that tells what is still uncertain, within limits."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from mbaid_ros.cli import ArgumentParser, run
from mbaid_ros.replay.inputs import add_topic_arguments


def main(argv: Sequence[str] | None = None) -> int:
    """Run the executable: 0 if the motion reaches what is wanted; else 2, 3 or 4, as the help says."""
    return run(_plan, argv)


def _plan(argv: list[str]) -> int:
    arguments = _parser().parse(argv)
    from mbaid_ros.replay.planned.command import plan  # noqa: PLC0415 - takes a while, and --help needs none of it

    return plan(arguments, argv)


def _parser() -> ArgumentParser:
    parser = ArgumentParser(
        'plan',
        'Plan the motion of the joints that tells most of what a run has left uncertain, or the shortest that reaches\n'
        'a wanted precision, within the limits of the joints (URDF) and of what the motion may do to the base.\n'
        'Nothing is moved. What is wanted and the limits are the parameters plan.*: relative_std, duration,\n'
        'joint_velocity, joint_acceleration, base_rotation, base_translation, base_rate, clearance, stuck, ...\n'
        'Ctrl-C takes the best motion so far.\n'
        'Exit code: 0 the motion reaches what is wanted, 3 no motion within the limits does: the best is written,\n'
        '4 the data of the run contradict the model, 2 bad input.',
        'plan result.json --model robot.urdf -p plan.base_rotation:=0.035 --yaml motion.yaml\n'
        '  with result.json of: replay run1 --model robot.urdf --params estimator.yaml --json result.json',
    )
    add = parser.add_argument
    add('start', metavar='RESULT', help='where the run has ended: a result of replay --json, or its bag')
    add('--model', required=True, metavar='URDF', help='the robot description')
    add('--params', metavar='YAML', help="the estimator node's parameter file (default: what RESULT was made with)")
    add('-p', dest='assignments', action='append', default=[], metavar='NAME:=VALUE', help='set one parameter')
    add_topic_arguments(parser)  # of a bag
    add('--yaml', metavar='FILE', help='write the motion as ros2 topic pub takes it, and simulate --trajectory')
    add('--output', metavar='BAG', help='write the motion as a message into a new bag')
    add('--json', metavar='FILE', help='write the plan as JSON; - for standard output')
    add('--report', metavar='HTML', help='write a report')
    return parser


if __name__ == '__main__':
    sys.exit(main())
