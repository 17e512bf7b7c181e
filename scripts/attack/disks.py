"""Disks that are full or read-only: executables that write files, and nodes that flow meanwhile."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mbaid_msgs.msg import InertiaEstimate
from tqdm import tqdm

from attack.kills import arguments_of, left_for_replay
from benchmarks.data import CONFIG
from benchmarks.pages import table
from graph import Graph, executable
from mbaid_ros.bags import BagReader
from mbaid_ros.core.errors import DataError

ROBOT = 'servicer7'
BAG = CONFIG.parent / 'bags' / 'servicer7_clean'
_LONG = 120.0  # s, for an executable
_FULL = (1_000, 200_000)  # bytes, that a recorder may write at most


@dataclass
class Disks:
    """What came of disks that take no more.

    Attributes
    ----------
    codes : by what was written and how, how often each exit code came
    left : by the same, what was there afterwards, and how often
    wrong : what should not have been
    """

    codes: dict[tuple[str, str], Counter[int]] = field(default_factory=dict)
    left: dict[tuple[str, str], Counter[str]] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)

    def add(self, name: str, how: str, code: int, said: str, left: str) -> None:
        """Add what came of one; it has to end with one line, and code 2."""
        self.codes.setdefault((name, how), Counter())[code] += 1
        self.left.setdefault((name, how), Counter())[left] += 1
        if code != 2 or said.count('\n') != 1 or 'Traceback' in said:
            self.wrong.append(f'{name}, {how}: exit code {code}, {said[-1000:]!r}')

    def __str__(self) -> str:
        """Return the table of the page."""
        rows = [
            [name, how, _counted(codes, 'of'), _counted(self.left[name, how])]
            for (name, how), codes in self.codes.items()
        ]
        return table(['writes', 'disk', 'exit codes', 'left'], rows, words=True)


def _counted(counter: Counter[int] | Counter[str], between: str = '') -> str:
    return ', '.join(' '.join(filter(None, [str(n), between, str(what)])) for what, n in sorted(counter.items()))


def _commands(folder: Path, known: Path) -> dict[str, tuple[Path, list[object]]]:
    """Return what writes one file each: where it is, and the command."""
    model = ['--model', CONFIG / f'{ROBOT}.urdf']
    replay = ['replay', BAG, *model, '--params', CONFIG / f'{ROBOT}_estimator.yaml']
    simulate = ['simulate', *model, '--params', CONFIG / f'{ROBOT}_simulator.yaml', '--duration', 20]
    names = {
        'run.json': [*replay, '--json'],
        'run.html': [*replay, '--report'],
        'estimates': [*replay, '--output'],
        'simulated': [*simulate, '--output'],
        'robot.urdf': ['export', known, *model, '--format', 'urdf', '--output'],
    }
    return {name: (folder / name, [*command, folder / name]) for name, command in names.items()}


def disks(graph: Graph, folder: Path, count: int, generator: np.random.Generator) -> Disks:
    """Return what came of so many full disks for each that writes, and of a read-only one."""
    found = Disks()
    known = folder / 'known.json'
    _, command = _commands(folder, known)['run.json']
    _run([*command[:-1], known])
    whole = _commands(folder, known)
    with tqdm(total=(count + 1) * (len(whole) + 1), unit=' disks', disable=None, leave=False) as progress:
        for name, (path, command) in whole.items():
            ended = _run(command)
            if ended.returncode:
                found.wrong.append(f'{name}: exit code {ended.returncode}, {ended.stderr[-1000:]!r}')
            size = _largest(path)
            for number in range(count):
                _remove(path)
                before = 'kept\n' * 200 if number % 2 and path.suffix else ''
                if before:
                    path.write_text(before)
                ended = _run(command, int(generator.integers(0, size)))
                found.add(name, 'full', ended.returncode, ended.stderr, _what_is_left(path, before, found.wrong))
                progress.update()
            _remove(path)
            with _read_only(folder / 'locked') as locked:
                ended = _run([*command[:-1], locked / name])
                found.add(
                    name, 'read-only', ended.returncode, ended.stderr, _what_is_left(locked / name, '', found.wrong)
                )
            progress.update()
        _recorders(graph, folder, count, generator, found, progress)
    return found


def _recorders(
    graph: Graph, folder: Path, count: int, generator: np.random.Generator, found: Disks, progress: tqdm[Any]
) -> None:
    """Record a simulator and an estimator that go on, on disks that are full soon, and on a read-only one."""
    name = 'recorder'
    estimates = graph.collect('/estimator/estimate', InertiaEstimate)
    others = [graph.start(each, *arguments_of(each, folder)) for each in ('estimator', 'simulator')]
    graph.wait(lambda: estimates and estimates[-1].samples, 'an estimate')
    for number in range(count):
        bag = folder / f'recorded{number}'
        process = graph.start(name, *arguments_of(name, bag))
        graph.wait(lambda bag=bag: any(bag.glob('*.mcap')), 'a bag')  # type: ignore[misc]
        most = int(generator.integers(*_FULL))
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))
        code = process.wait()
        found.add(name, 'full', code, _own_lines(process.stderr), left_for_replay(bag, found.wrong))
        progress.update()
    with _read_only(folder / 'locked') as locked:
        process = graph.start(name, *arguments_of(name, locked / 'bag'))
        code = process.wait()
        found.add(
            name, 'read-only', code, _own_lines(process.stderr), 'nothing' if not any(locked.iterdir()) else 'a bag'
        )
    progress.update()
    told = len(estimates)
    graph.wait(lambda: len(estimates) > told, 'a further estimate')
    for each in others:
        if each.stop():
            found.wrong.append(f'{each.name} beside full disks: {each.stderr[-1000:]!r}')


def _own_lines(text: str) -> str:
    """Return what is no line of a node's log."""
    return ''.join(line for line in text.splitlines(keepends=True) if not line.startswith('['))


def _run(command: Sequence[object], most: int | None = None) -> subprocess.CompletedProcess[str]:
    """Run an executable of the package, with files of at most so many bytes."""

    def limit() -> None:
        if most is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))

    words = [str(executable(str(command[0]))), *map(str, command[1:])]
    # Python itself would leave cut byte code of modules on a full disk.
    environment = {**os.environ, 'PYTHONDONTWRITEBYTECODE': '1'}
    return subprocess.run(
        words, env=environment, capture_output=True, text=True, timeout=_LONG, check=False, preexec_fn=limit
    )


@contextmanager
def _read_only(folder: Path) -> Iterator[Path]:
    """Give a folder that nothing can be written into: root may write into any but what is mounted so."""
    folder.mkdir()
    root = os.geteuid() == 0
    if root:
        subprocess.run(['mount', '-t', 'tmpfs', '-o', 'ro', 'none', str(folder)], check=True)
    else:
        folder.chmod(0o500)
    try:
        yield folder
    finally:
        if root:
            subprocess.run(['umount', str(folder)], check=True)
        folder.chmod(0o700)
        folder.rmdir()


def _files(path: Path) -> list[Path]:
    return [each for each in (path.rglob('*') if path.is_dir() else [path]) if each.is_file()]


def _largest(path: Path) -> int:
    """Return the size of the largest file of an output, bytes."""
    return max(each.stat().st_size for each in _files(path))


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _what_is_left(path: Path, before: str, wrong: list[str]) -> str:
    """Return what there is of an output where there was some text before, none for an empty one."""
    parts = [each.name for each in path.parent.glob('.*.new')]
    if parts:
        wrong.append(f'{path.name}: {parts} stay')
    if path.is_dir() and not any(path.glob('*.mcap')):
        return 'the truth alone'
    if path.is_dir():
        try:
            with BagReader(path) as bag:
                return 'a bag that was cut off' if bag.warnings else 'a bag'
        except DataError as error:
            if 'holds no messages' not in str(error):
                wrong.append(f'{path.name}: {error}')
            return 'a bag without messages'
    if not path.exists():
        if before:
            wrong.append(f'{path.name}: what was there is gone')
        return 'nothing'
    if path.read_text(encoding='utf-8') != before:
        wrong.append(f'{path.name}: a part')
        return 'a part'
    return 'what was there before'
