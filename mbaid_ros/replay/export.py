"""The executable `export`: an identified body in the form the next tool takes."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from mbaid_ros.cli import ArgumentParser, run

FORMATS = ('urdf-link', 'urdf', 'mjcf', 'mjcf-body', 'basilisk-hub', 'basilisk-effector', 'json')


def main(argv: Sequence[str] | None = None) -> int:
    """Run the executable: 0 if it has written; else 2, 3 or 4, as the help says."""
    return run(_export, argv)


def _export(argv: list[str]) -> int:
    arguments = _parser().parse(argv)
    from mbaid_ros.replay.export_command import export  # noqa: PLC0415 - takes a while, and --help needs none of it

    return export(arguments)


def _parser() -> ArgumentParser:
    parser = ArgumentParser(
        'export',
        'Write an identified body as URDF link, whole URDF, MuJoCo model or body, Basilisk parameters or plain JSON.\n'
        'Exit code: 0 written, 4 the data contradict the model, 3 they do not determine the body, 2 bad input.',
        'ros2 run mbaid_ros export run1.json --format mjcf --output captured.xml',
    )
    add = parser.add_argument
    add('input', metavar='FILE', help='what replay --json wrote, or a bag that holds estimates (the last one counts)')
    add('--format', choices=FORMATS, default=FORMATS[0], help='default: %(default)s')
    add('--output', metavar='FILE', help='default: standard output')
    add('--model', metavar='URDF', help='the robot description, for the format urdf and for --fill')
    add('--result', type=_count, default=1, metavar='N', help='which result of a JSON of several bags (default: 1)')
    add('--topic', default='', metavar='TOPIC', help='which estimates of a bag with those of several estimators')
    add('--debris', action='store_true', help='write the captured body alone (a run with debris.report: true has it)')
    add('--principal', action='store_true', help='write the inertia in its principal axes')
    add('--equivalent', choices=('box', 'ellipsoid'), help='add the uniform body of the same inertia')
    add('--fill', action='store_true', help='take what the data do not determine from the link in --model')
    return parser


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"'{text}' is not accepted; accepted: a whole number > 0")
    return int(text)


if __name__ == '__main__':
    sys.exit(main())
