"""Send damaged files through the executables that read them: bags, robots, parameters, truths, results, logs.

Each has to end with 0, 2, 3 or 4, with one line of error at most, within 10 s of the processor and 30 s of the clock,
in less than 500 MB. All run in this process.
"""

import argparse
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tqdm import tqdm

from fuzzing.formats import CONVERTED, formats
from fuzzing.trial import Found


def fuzz(count: int, seed: int, wanted: Sequence[str] | None = None) -> dict[str, Found]:
    """Return the outcomes of so many inputs of each format, or of the wanted ones."""
    outcome: dict[str, Found] = {}
    with tempfile.TemporaryDirectory() as name:
        there = formats(Path(name))
        for kind in wanted or there:
            each, found = there[kind], outcome.setdefault(kind, Found())
            for number in tqdm(range(count), unit=f' {kind}', disable=None, leave=False):
                each.path.write_bytes(each.damaged(each.content, np.random.default_rng([seed, number])))
                wrong = found.add(each.main, each.arguments(number), each.reported)
                shutil.rmtree(Path(name) / CONVERTED, ignore_errors=True)
                found.wrong += [f'{kind} {number}: {wrong}'] if wrong else []
            each.path.write_bytes(each.content)
    return outcome


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--inputs', type=int, default=400, metavar='N', help='of each format (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=0, metavar='N')
    parser.add_argument('--formats', nargs='+', metavar='F', help="such as URDF or 'MCAP bytes' (default: all)")
    asked = parser.parse_args()
    results = fuzz(asked.inputs, asked.seed, asked.formats)
    for name, found in results.items():
        print(f'{name}: {found}')
    sys.exit(any(found.wrong for found in results.values()))
