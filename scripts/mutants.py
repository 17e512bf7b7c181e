#!/usr/bin/env python3
"""Put plausible mistakes into the core, one at a time, and print those that no test notices.

The mistakes are drawn by a seed: a sign, a factor, a comparison, an index off by one, a guard or a term left out, min
for max, `and` for `or`. Each is made in a copy of the project, where the tests run that execute the changed line, the
fastest first, as many as take --limit seconds together. A mistake after which they take a multiple of that counts as
noticed. --record runs the whole suite once, and keeps which test executes what in build/mutants; after a change of the
core it is due again, after new tests with their files only. mutmut and cosmic-ray make every mutant: days of work.
"""

import argparse
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from queue import SimpleQueue

from tqdm import tqdm

from mutations.changes import Mutant, mutants_of
from mutations.executed import Executed, record

ROOT = Path(__file__).resolve().parents[1]
RECORDS = ROOT / 'build' / 'mutants'
_COPIED = ('bags', 'config', 'docs', 'mbaid_ros', 'msg_defs', 'scripts', 'test', 'wheel_msgs')


@dataclass(frozen=True)
class Outcome:
    """The fate of a mutant."""

    mutant: Mutant
    noticed_by: str  # the first test that fails, 'time' if none ends, empty if all pass
    tests: int  # how many were run at most


class Copies:
    """Copies of the project, one for each process that runs tests."""

    def __init__(self, folder: Path, count: int, limit: float) -> None:
        self._free: SimpleQueue[Path] = SimpleQueue()
        self._seconds = 60 + 3 * round(limit)
        self._changes = 0
        for number in range(count):
            copy = folder / str(number)
            for name in _COPIED:
                shutil.copytree(ROOT / name, copy / name, symlinks=True)
            for path in (path for path in ROOT.iterdir() if path.is_file()):
                shutil.copy2(path, copy)
            (copy / 'install').symlink_to(ROOT / 'install')
            self._free.put(copy)

    def outcome(self, mutant: Mutant, tests: Sequence[str]) -> Outcome:
        """Return the fate of a mutant in some tests."""
        if not tests:
            return Outcome(mutant, '', 0)
        copy = self._free.get()
        path = copy / mutant.path
        before = path.read_text(encoding='utf-8')
        try:
            self._write(path, mutant.applied(before))
            return Outcome(mutant, self.failure(copy, tests), len(tests))
        finally:
            self._write(path, before)
            self._free.put(copy)

    def unchanged_failures(self, tests: Sequence[str]) -> set[str]:
        """Return which of some tests fail without any mutant."""
        copy = self._free.get()
        found, left = set(), sorted({each for each in tests if '::' in each})
        while left and (test := self.failure(copy, left)):
            found.add(test)
            left = [each for each in left if each != test]
        self._free.put(copy)
        return found

    def _write(self, path: Path, text: str) -> None:
        """Write a file under a time that none of its versions has had: Python compiles it anew by that."""
        path.write_text(text, encoding='utf-8')
        self._changes += 2
        os.utime(path, (2e9 + self._changes,) * 2)

    def failure(self, copy: Path, tests: Sequence[str]) -> str:
        """Return the first test that fails in a copy, or 'time'; empty if all pass."""
        command = [sys.executable, '-m', 'pytest', '-q', '-x', '-n', '0', '--tb=no', '-p', 'no:cacheprovider', *tests]
        paths = os.pathsep.join([str(copy), *filter(None, [os.environ.get('PYTHONPATH')])])
        done = subprocess.run(
            command,
            cwd=copy,
            env=os.environ | {'PYTHONPATH': paths, 'OPENBLAS_NUM_THREADS': '1'},
            capture_output=True,
            text=True,
            check=False,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (self._seconds, self._seconds + 5)),
        )
        if done.returncode in {0, 5}:  # all pass, or only long tests are there
            return ''
        if done.returncode < 0:
            return 'time'
        failed = [line.split(' - ')[0].split(maxsplit=1) for line in done.stdout.splitlines()]
        return next((words[1] for words in failed if words and words[0] in {'FAILED', 'ERROR'}), 'pytest')


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
    outcomes = []
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(processes) as pool:
        copies = Copies(Path(name), processes, limit)
        found = pool.map(copies.outcome, mutants, tests)
        for each in tqdm(found, total=len(mutants), unit=' mutant', disable=None):
            outcomes.append(each)
            if not each.noticed_by:
                tqdm.write(f'not noticed by {each.tests} tests: {each.mutant}')
                sys.stdout.flush()
        failing = copies.unchanged_failures([each.noticed_by for each in outcomes])
    for test in sorted(failing):
        print(f'fails without a mutant, too, and notices none: {test}')
    return [replace(each, noticed_by='') if each.noticed_by in failing else each for each in outcomes]


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
