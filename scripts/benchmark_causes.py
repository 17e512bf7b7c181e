"""Conditions with one thing wrong: at which place the true cause stands among those that are named.

usage: benchmark_causes.py [--seeds N] [--rows PATTERN] [--method M] [--processes N]
"""

from __future__ import annotations

import sys

from benchmarks.honesty.catalogue import CATALOGUE
from benchmarks.honesty.command import outcomes, parsed
from benchmarks.honesty.runs import PUBLISHED
from benchmarks.honesty.true_causes import TRUE_CAUSES, rank

_SHOWN = 3


def main() -> int:
    """Run the benchmark and return the exit code."""
    arguments = parsed(__doc__.partition('\n')[0], [CATALOGUE[name] for name in TRUE_CAUSES], 1, '')
    places: list[int] = []
    for condition, outcome in outcomes(arguments):
        found = [rank(condition.name, told.split('\n')) for told in outcome.causes]
        # Where the run is right and names nothing, nothing is to be named.
        places += [
            place
            for place, status, told in zip(found, outcome.status, outcome.causes, strict=True)
            if told or status not in PUBLISHED
        ]
        print(f'{condition.name}: {", ".join(str(place or "-") for place in found)}')
        for status, told in zip(outcome.status[:1], outcome.causes[:1], strict=True):
            print(f'    {status}: ' + '\n        '.join(told.split('\n')[:_SHOWN]), flush=True)
    first, among = (sum(0 < place <= most for place in places) for most in (1, _SHOWN))
    print(f'the true cause stands first in {first}, among the first {_SHOWN} in {among} of {len(places)} runs')
    return 0


if __name__ == '__main__':
    sys.exit(main())
