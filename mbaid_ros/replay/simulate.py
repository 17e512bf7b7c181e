"""The simulator without a graph: straight to a bag, faster than real time, with the truth beside it."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from mbaid_ros import cli

_EXAMPLE = (
    'simulate --model config/table1.urdf --params config/table1_simulator.yaml --output /tmp/table1\n'
    '  a minute of the robot as the folder /tmp/table1: an MCAP bag, and the truth in truth.json'
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run `simulate` and return its exit code."""
    return cli.run(_simulate, argv)


def _simulate(argv: list[str]) -> int:
    arguments = _parser().parse(argv)
    from mbaid_ros.replay.simulate_command import simulate  # noqa: PLC0415 - takes a while, and --help needs none of it

    return simulate(arguments)


def _parser() -> cli.ArgumentParser:
    parser = cli.ArgumentParser(
        'simulate', 'Simulate a free-floating robot and write what its sensors say to an MCAP bag.', _EXAMPLE
    )
    parser.add_argument('--model', metavar='URDF', help='robot description (or the parameter robot_description_file)')
    parser.add_argument('--params', metavar='YAML', help='parameter file of the simulator node')
    parser.add_argument(
        '--duration', type=cli.number(0.0, 's', exclusive=True), metavar='S', help='length of the run, s'
    )
    parser.add_argument(
        '--trajectory', metavar='YAML', help='let the joints follow a JointTrajectory, as plan --yaml writes it'
    )
    parser.add_argument('--seed', type=_seed, metavar='N', help='seed of the sensor noise')
    parser.add_argument('--output', type=Path, default=Path('simulation'), metavar='BAG', help='folder to make')
    parser.add_argument(
        '--truth', type=Path, metavar='JSON', help='where the truth is written, instead of BAG/truth.json'
    )
    parser.add_argument(
        '-p', dest='assignments', action='append', default=[], metavar='NAME:=VALUE', help='set one parameter'
    )
    return parser


def _seed(text: str) -> int:
    """Return a seed from the command line.

    Raises
    ------
    argparse.ArgumentTypeError
        It is none.
    """
    if not (text.isascii() and text.isdigit()):
        raise argparse.ArgumentTypeError(f"'{text}' is not accepted; accepted: a whole number >= 0")
    return int(text)
