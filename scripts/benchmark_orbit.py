#!/usr/bin/env python3
"""Measure runs in orbit, with wheels inside or a thruster that is off: the tables of docs/orbit.md.

They are compared with the same in empty space.

Every run that is done is kept as a line of a file; tables are of all that it holds. Several of these may work at the
same file, each at seeds of its own:

    .venv/bin/python scripts/benchmark_orbit.py grid --seeds 0 4 --store runs.jsonl
    .venv/bin/python scripts/benchmark_orbit.py --store runs.jsonl
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.orbit.pages import tables
from benchmarks.orbit.store import PARTS, run_part
from benchmarks.pages import replace_marked


def main() -> int:
    """Run a part, or print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('part', nargs='?', choices=[*PARTS], help='what to run; without, the tables are printed')
    parser.add_argument('--seeds', nargs=2, type=int, default=(0, 5), metavar=('FIRST', 'END'))
    parser.add_argument('--store', type=Path, default=Path('orbit_runs.jsonl'), help='file of the runs')
    parser.add_argument('--output', type=Path, metavar='FOLDER', help='write the tables into the orbit.md there')
    arguments = parser.parse_args()
    if arguments.part:
        run_part(arguments.part, range(*arguments.seeds), arguments.store)
        return 0
    for part, text in tables(arguments.store).items():
        sys.stdout.write(f'{text}\n\n')
        if arguments.output:
            replace_marked(arguments.output / 'orbit.md', part, 'scripts/benchmark_orbit.py', text)
    return 0


if __name__ == '__main__':
    sys.exit(main())
