"""The executable `noise_at_rest`: the sensors' noise, from a bag recorded with the joints braked."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence

from mbaid_ros.cli import ArgumentParser, run, warn
from mbaid_ros.replay.inputs import ODOMETRY, Inputs


def main(argv: Sequence[str] | None = None) -> int:
    """Run the executable: 0 if it printed, 2 after a user's error."""
    return run(_noise_at_rest, argv)


def _noise_at_rest(argv: list[str]) -> int:
    arguments = _parser().parse(argv)
    from mbaid_ros.replay.at_rest import measure  # noqa: PLC0415 - takes a while, and --help needs none of it

    measured = measure(arguments.bag, arguments.joint_states, arguments.odom)
    warn('noise_at_rest', measured.warnings)
    print('/**:\n  ros__parameters:\n    noise:')
    for name, std in measured.stds.items():
        print(f'      {name}: {std:.1e}' if math.isfinite(std) else f'      # {name}: not measured')
    return 0


def _parser() -> ArgumentParser:
    parser = ArgumentParser(
        'noise_at_rest',
        "Print the sensors' noise as a parameter file, from a bag recorded with the joints braked, the base drifting\n"
        'freely: the standard deviation of each channel about a cubic in time, of the noisiest axis or joint. Where\n'
        'joints move, the longest part of the bag in which none does counts, and a warning says so.\n'
        'Exit code: 0 printed, 2 bad input, or no five seconds in which all joints rest.',
        'ros2 run mbaid_ros noise_at_rest rest_run > noise.yaml',
    )
    add = parser.add_argument
    add('bag', metavar='BAG', help='rosbag2 folder (MCAP or sqlite3), or a bare .mcap or .db3 file')
    add('--joint-states', default=Inputs.joint_states, metavar='TOPIC', help='default: %(default)s')
    add('--odom', default=ODOMETRY, metavar='TOPIC', help='default: %(default)s')
    return parser


if __name__ == '__main__':
    sys.exit(main())
