"""The executable `calibrate`: any set of a robot's bodies from recorded motions, with CAD values as a prior."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from mbaid_ros.cli import ArgumentParser, run
from mbaid_ros.replay.inputs import add_input_arguments


def main(argv: Sequence[str] | None = None) -> int:
    """Run the executable: 0 if there is a calibration; else 2, 3 or 4, as the help says."""
    return run(_calibrate, argv)


def _calibrate(argv: list[str]) -> int:
    arguments = _parser().parse(argv)
    from mbaid_ros.replay.calibrate_command import calibrate_bags  # noqa: PLC0415 - takes a while

    return calibrate_bags(arguments)


def _parser() -> ArgumentParser:
    parser = ArgumentParser(
        'calibrate',
        'Identify any set of bodies of a free-floating robot from recorded motions, before it captures anything. The\n'
        'values in the URDF are where it starts from; the parameters prior.* say how well they are known.\n'
        'Exit code: 0 calibrated, 4 the data contradict the model: no --output is written, 3 data and prior do not\n'
        'determine the bodies, 2 bad input.',
        'calibrate before_capture --model robot.urdf --params calibrate.yaml --output calibrated.urdf',
    )
    add = parser.add_argument
    add('--model', required=True, metavar='URDF', help='the robot description, with the CAD values')
    add('--unknown', nargs='+', metavar='LINK', help='links to calibrate (default: every link with an <inertial>)')
    add('--params', metavar='YAML', help="parameter file with a section for 'calibrate': prior.*, and the estimator's")
    add_input_arguments(parser)
    add('--json', metavar='FILE', help='write the result with its covariance as JSON; - for standard output')
    add('--report', metavar='HTML', help='write a report')
    add('--output', metavar='URDF', help='write the robot description with the calibrated values')
    return parser


if __name__ == '__main__':
    sys.exit(main())
