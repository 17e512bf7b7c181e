"""The executable `campaign`: many simulated runs, identified, with their statistics."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from mbaid_ros.cli import ArgumentParser, run
from mbaid_ros.replay.workers import add_processes_option


def main(argv: Sequence[str] | None = None) -> int:
    """Run the executable: 0 if every run was made, 3 if one failed, 2 after a user's error."""
    return run(_campaign, argv)


def _campaign(argv: list[str]) -> int:
    arguments = _parser().parse(argv)
    from mbaid_ros.replay.campaigns.command import make_campaign  # noqa: PLC0415 - takes a while

    return make_campaign(arguments)


def _parser() -> ArgumentParser:
    parser = ArgumentParser(
        'campaign',
        'Simulate and identify many times over seeds, motions, robots, noise and methods, on all cores or a Dask '
        'cluster.\n'
        'Stopped by anything, the same command goes on from the runs that were made.\n'
        'Exit code: 0 every run was made, 3 some failed, 2 bad input.',
        'campaign config/table1_campaign.yaml --output table1_campaign',
    )
    add = parser.add_argument
    add('campaign', metavar='YAML', help='what is varied, and the parameters of simulator and estimator')
    add('--output', metavar='FOLDER', help="where results are kept (default: the YAML's name without its ending)")
    add('--scheduler', metavar='ADDRESS', help='of a Dask cluster that makes the runs, like tcp://10.0.0.1:8786')
    add('--retry-failed', action='store_true', help='make runs again that failed')
    add_processes_option(parser)
    return parser


if __name__ == '__main__':
    sys.exit(main())
