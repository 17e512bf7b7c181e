#!/usr/bin/env python3
"""Put plausible mistakes into the core, one at a time, and print those that no test notices.

The mistakes are drawn by a seed: a sign, a factor, a comparison, an index off by one, a guard or a term left out, min
for max, `and` for `or`. Each is made in a copy of the project. First the tests of the mirrored folder run, those first
that import the file most directly, then other tests that import it. A mistake after which the tests take longer than
--seconds of the processor counts as noticed. mutmut and cosmic-ray make every mutant, in texts as well: days of work.
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
from mutations.imports import Imports

ROOT = Path(__file__).resolve().parents[1]
_COPIED = ('bags', 'config', 'docs', 'mbaid_ros', 'msg_defs', 'scripts', 'test', 'wheel_msgs')


@dataclass(frozen=True)
class Outcome:
    """The fate of a mutant."""

    mutant: Mutant
    noticed_by: str  # the first test that fails, 'time' if none ends, empty if all pass
    mirrored: bool = False  # whether a test of the mirrored folder notices it


class Copies:
    """Copies of the project, one for each process that runs tests."""

    def __init__(self, folder: Path, count: int, seconds: int) -> None:
        self._free: SimpleQueue[Path] = SimpleQueue()
        self._seconds = seconds
        self._changes = 0
        for number in range(count):
            copy = folder / str(number)
            for name in _COPIED:
                shutil.copytree(ROOT / name, copy / name, symlinks=True)
            for path in (path for path in ROOT.iterdir() if path.is_file()):
                shutil.copy2(path, copy)
            (copy / 'install').symlink_to(ROOT / 'install')
            self._free.put(copy)

    def outcome(self, mutant: Mutant, stages: Sequence[Sequence[str]]) -> Outcome:
        """Return the fate of a mutant in stages of test files, the mirrored ones first."""
        copy = self._free.get()
        path = copy / mutant.path
        before = path.read_text(encoding='utf-8')
        try:
            self._write(path, mutant.applied(before))
            for number, files in enumerate(stages):
                if files and (test := self.failure(copy, files)):
                    return Outcome(mutant, test, mirrored=number == 0)
            return Outcome(mutant, '')
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


def run(mutants: Sequence[Mutant], arguments: argparse.Namespace) -> list[Outcome]:
    """Return the fate of each mutant, and print the survivors as they are known.

    A test that fails without any mutant notices none.
    """
    imports = Imports(ROOT)
    whole = [['test']] if arguments.whole else []
    stages = []
    for mutant in mutants:
        mirrored, neighbours = imports.tests_of(ROOT / mutant.path)
        stages.append([mirrored, neighbours[: arguments.neighbours], *whole])
    outcomes = []
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(arguments.processes) as pool:
        copies = Copies(Path(name), arguments.processes, arguments.seconds)
        found = pool.map(copies.outcome, mutants, stages)
        for each in tqdm(found, total=len(mutants), unit=' mutant', disable=None):
            outcomes.append(each)
            if not each.noticed_by:
                tqdm.write(f'not noticed: {each.mutant}')
                sys.stdout.flush()
        failing = copies.unchanged_failures([each.noticed_by for each in outcomes])
    for test in sorted(failing):
        print(f'fails without a mutant, too, and notices none: {test}')
    return [replace(each, noticed_by='', mirrored=False) if each.noticed_by in failing else each for each in outcomes]


def summary(outcomes: Sequence[Outcome]) -> Iterator[str]:
    """Yield how many mutants of each folder are noticed."""
    folders: dict[str, list[Outcome]] = {}
    for each in outcomes:
        folders.setdefault(str(each.mutant.path.parent), []).append(each)
    for folder, some in [*sorted(folders.items()), ('all', [*outcomes])]:
        noticed, mirrored = (sum(bool(getattr(each, name)) for each in some) for name in ('noticed_by', 'mirrored'))
        yield f'{folder}: {noticed} of {len(some)} noticed, {mirrored} of them by the mirrored tests'


def main() -> int:
    """Print the survivors, and how many mutants of each folder the tests notice."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('--count', type=int, default=100, metavar='N', help='mutants (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=0, metavar='N')
    parser.add_argument('--folder', default='mbaid_ros/core', help='of the mutants (default: %(default)s)')
    parser.add_argument('--neighbours', type=int, default=10, metavar='N', help='test files (default: %(default)s)')
    parser.add_argument('--whole', action='store_true', help='run the whole default suite on survivors, too')
    parser.add_argument('--processes', type=int, default=os.cpu_count(), metavar='N')
    parser.add_argument('--seconds', type=int, default=300, metavar='S', help='of the processor (default: %(default)s)')
    parser.add_argument('--list', action='store_true', help='print the mutants and run nothing')
    arguments = parser.parse_args()
    mutants = drawn(ROOT / arguments.folder, arguments.count, arguments.seed)
    print('\n'.join(map(str, mutants) if arguments.list else summary(run(mutants, arguments))))
    return 0


if __name__ == '__main__':
    sys.exit(main())
