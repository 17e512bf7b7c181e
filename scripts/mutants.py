#!/usr/bin/env python3
"""Put plausible mistakes into the core, one at a time, and print those that no test notices.

The mistakes are drawn by a seed: a sign, a factor, a comparison, an index off by one, a guard or a term left out, min
for max, `and` for `or`. Each is made in a process of its own, where the tests run that execute the changed line, the
fastest first, as many as take --limit seconds together. A mistake after which they take a multiple of that counts as
noticed. --record runs the whole suite once, and keeps which test executes what in build/mutants; after a change of the
core it is due again, after new tests with their files only. mutmut and cosmic-ray make every mutant: days of work.
"""

import argparse
import os
import random
import sys
from collections.abc import Iterator, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import pytest
from tqdm import tqdm

from mutations.changes import Mutant, mutants_of
from mutations.executed import Executed, record
from mutations.trial import Trials

ROOT = Path(__file__).resolve().parents[1]
RECORDS = ROOT / 'build' / 'mutants'


@dataclass(frozen=True)
class Outcome:
    """The fate of a mutant."""

    mutant: Mutant
    noticed_by: str  # the first test that fails, 'time' if none ends, empty if all pass


def drawn(folder: Path, count: int, seed: int) -> list[Mutant]:
    """Return so many mutants of the files below a folder, of one line one at most."""
    every = [
        mutant
        for path in sorted(folder.rglob('*.py'))
        for mutant in mutants_of(path.relative_to(ROOT), path.read_text(encoding='utf-8'))
    ]
    random.Random(seed).shuffle(every)
    lines: dict[tuple[Path, int], Mutant] = {}
    for mutant in every:
        lines.setdefault((mutant.path, mutant.line), mutant)
    return [*lines.values()][:count]


def run(mutants: Sequence[Mutant], executed: Executed, limit: float, processes: int) -> list[Outcome]:
    """Return the fate of each mutant, and print the survivors as they are known.

    A test that fails without any mutant notices none.
    """
    tests = [executed.tests_of(each.path, each.line, limit) for each in mutants]
    output, noticed = sys.stdout, [''] * len(mutants)
    with (
        tqdm(total=len(mutants), unit=' mutant', disable=None) as bar,
        Path(os.devnull).open('w', encoding='utf-8') as silence,
        redirect_stdout(silence),
    ):

        def report(place: int, noticed_by: str) -> None:
            noticed[place] = noticed_by
            bar.update()
            if not noticed_by:
                tqdm.write(f'not noticed by {len(tests[place])} tests: {mutants[place]}', output)
                output.flush()

        trials = Trials(ROOT, [*zip(mutants, tests, strict=True)], report, processes, seconds=60 + 3 * round(limit))
        files = sorted({test.partition('::')[0] for part in tests for test in part})
        options = ['-q', '-s', '-n', '0', '-p', 'no:cacheprovider', f'--rootdir={ROOT}']
        if pytest.main([*options, *files], plugins=[trials]) == pytest.ExitCode.INTERNAL_ERROR:
            raise SystemExit('pytest ended with an internal error')
    for test in sorted(trials.failing):
        print(f'fails without a mutant, too, and notices none: {test}')
    return [Outcome(mutant, '' if by in trials.failing else by) for mutant, by in zip(mutants, noticed, strict=True)]


def summary(outcomes: Sequence[Outcome]) -> Iterator[str]:
    """Yield how many mutants of each folder are noticed."""
    folders: dict[str, list[Outcome]] = {}
    for each in outcomes:
        folders.setdefault(str(each.mutant.path.parent), []).append(each)
    for folder, some in [*sorted(folders.items()), ('all', [*outcomes])]:
        yield f'{folder}: {sum(bool(each.noticed_by) for each in some)} of {len(some)} noticed'


def unexecuted(folder: Path, executed: Executed) -> Iterator[str]:
    """Yield the lines of each file below a folder that no test executes."""
    for path in (path.relative_to(ROOT) for path in sorted(folder.rglob('*.py'))):
        yield from (f'{path}:{line}' for line in executed.unexecuted(path))


def main() -> int:
    """Print the survivors, and how many mutants of each folder the tests notice."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('--count', type=int, default=100, metavar='N', help='mutants (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=0, metavar='N')
    parser.add_argument('--folder', default='mbaid_ros/core', help='of the mutants (default: %(default)s)')
    parser.add_argument('--limit', type=float, default=40.0, metavar='S', help='of tests each (default: %(default)s)')
    parser.add_argument('--processes', type=int, default=os.cpu_count(), metavar='N')
    parser.add_argument('--record', nargs='*', metavar='TESTS', help='run them first, without names all, and record')
    parser.add_argument('--list', action='store_true', help='print the mutants and run nothing')
    parser.add_argument('--unexecuted', action='store_true', help='print the lines that no test executes')
    arguments = parser.parse_args()
    mutants = drawn(ROOT / arguments.folder, arguments.count, arguments.seed)
    if arguments.list:
        print('\n'.join(map(str, mutants)))
        return 0
    if arguments.record is not None or not RECORDS.is_dir():
        record(ROOT, RECORDS, arguments.record or [], arguments.processes)
    executed = Executed(ROOT, RECORDS)
    if arguments.unexecuted:
        print('\n'.join(unexecuted(ROOT / arguments.folder, executed)))
    else:
        print('\n'.join(summary(run(mutants, executed, arguments.limit, arguments.processes))))
    return 0


if __name__ == '__main__':
    sys.exit(main())
