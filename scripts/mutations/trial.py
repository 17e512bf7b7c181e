"""Tests on mutants: a plugin of pytest that collects them once, and forks for each mutant with its code in place."""

from __future__ import annotations

import gc
import json
import os
import resource
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from importlib.machinery import SourceFileLoader
from itertools import zip_longest
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, NoReturn

import pytest

from mutations.changes import Mutant

_MUTANT = 'MUTANT'  # environment variable: the mutant that the modules of this process are compiled with
_TIME = 'time'
Report = Callable[[int, str], None]


def _ignore(_place: int, _noticed_by: str) -> None:
    """Report nothing."""


class Trials:
    """Runs tests on mutants in place of pytest's own loop over all.

    Parameters
    ----------
    root : folder of the project
    mutants : with the names of their tests
    report : is called with the place of each mutant and the first test that fails: 'time' if none ends, empty for none
    processes : number of them
    seconds : of the processor, that all tests of a mutant may take
    """

    def __init__(
        self,
        root: Path,
        mutants: Sequence[tuple[Mutant, Sequence[str]]],
        report: Report,
        processes: int,
        *,
        seconds: int,
    ) -> None:
        self._root, self._mutants, self._report = root, mutants, report
        self._processes, self._seconds = processes, seconds
        self._running: dict[int, tuple[int, int]] = {}  # by process: place of the mutant, where its answer is read
        self.failing: set[str] = set()  # tests that fail without a mutant, too

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Fork for each mutant, then for each test that has failed."""
        noticed = self._tried(session, self._mutants, self._report)
        tests = sorted({test for test in noticed if '::' in test})
        self.failing = {*self._tried(session, [(None, [test]) for test in tests])} - {''}
        return True

    def _tried(
        self, session: pytest.Session, mutants: Sequence[tuple[Mutant | None, Sequence[str]]], report: Report = _ignore
    ) -> list[str]:
        """Return the first test that fails of each, and report it; without a mutant the code stays as it is."""
        items, found = {item.nodeid: item for item in session.items}, [''] * len(mutants)

        def end() -> None:
            place, failed = self._next_end()
            found[place] = failed
            report(place, failed)

        for place, (mutant, tests) in enumerate(mutants):
            if len(self._running) == self._processes:
                end()
            answer, question = os.pipe()
            process = os.fork()
            if not process:
                os.close(answer)
                self._try(session, mutant, [items[test] for test in tests if test in items], question)
            os.close(question)
            self._running[process] = place, answer
        while self._running:
            end()
        return found

    def _next_end(self) -> tuple[int, str]:
        """Return the place of the mutant whose process ends next, and the first test that failed."""
        process, status = os.wait()
        place, answer = self._running.pop(process)
        with os.fdopen(answer, encoding='utf-8') as pipe:
            found = pipe.read()
        if os.WIFEXITED(status) and os.WEXITSTATUS(status):
            raise RuntimeError(f'a trial ended with an error: {self._mutants[place][0]}')
        return place, _TIME if os.WIFSIGNALED(status) else found

    def _try(
        self, session: pytest.Session, mutant: Mutant | None, chosen: Sequence[pytest.Item], answer: int
    ) -> NoReturn:
        """Write the first of some tests that fails on a mutant, and end the process."""
        status = 1
        try:
            silence = os.open(os.devnull, os.O_WRONLY)
            os.dup2(silence, 1)
            os.dup2(silence, 2)
            resource.setrlimit(resource.RLIMIT_CPU, (self._seconds, self._seconds + 5))
            signal.signal(signal.SIGXCPU, signal.SIG_DFL)
            if mutant is not None and not _in_place(self._root, mutant):
                found = _compiled(self._root, mutant, [item.nodeid for item in chosen])
            else:
                found = _first_failure(session, chosen)
            os.write(answer, found.encode())
            status = 0
        finally:
            os._exit(status)


def _first_failure(session: pytest.Session, chosen: Sequence[pytest.Item]) -> str:
    for item, following in zip_longest(chosen, chosen[1:]):
        session.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        if session.testsfailed:
            return item.nodeid
    return ''


def _in_place(root: Path, mutant: Mutant) -> bool:
    """Return whether all functions of this process have a mutant's code now; what runs on import has not."""
    path = str(root / mutant.path)
    before, after = (_functions(source, path) for source in _sources(root, mutant))
    changed = {key for key, code in before.items() if after.get(key) != code}
    if set(before) != set(after) or not changed or None in {after[key] for key in changed}:
        return False
    found = set()
    for function in [each for each in gc.get_objects() if isinstance(each, FunctionType)]:
        key = _key(function.__code__)
        if key in changed and os.path.realpath(function.__code__.co_filename) == os.path.realpath(path):
            code = after[key]
            if code is None or code.co_freevars != function.__code__.co_freevars:
                return False
            function.__code__ = code
            found.add(key)
    # Code of a function within another one is a constant of that: it has changed with it.
    return bool(found)


def _sources(root: Path, mutant: Mutant) -> tuple[str, str]:
    source = (root / mutant.path).read_text(encoding='utf-8')
    return source, mutant.applied(source)


def _functions(source: str, path: str) -> dict[tuple[str, int], CodeType | None]:
    """Return the code of all functions of a file by name and line; None of several that share these."""
    every = [*_codes(compile(source, path, 'exec', dont_inherit=True))][1:]
    count = Counter(map(_key, every))
    return {_key(code): code if count[_key(code)] == 1 else None for code in every}


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for each in code.co_consts:
        if isinstance(each, CodeType):
            yield from _codes(each)


def _key(code: CodeType) -> tuple[str, int]:
    return code.co_name, code.co_firstlineno


def _compiled(root: Path, mutant: Mutant, tests: Sequence[str]) -> str:
    """Return the first test that fails in a process that imports a mutant; empty if all pass."""
    values = json.dumps({**asdict(mutant), 'path': str(root / mutant.path)})
    paths = os.pathsep.join([str(root / 'scripts'), *filter(None, [os.environ.get('PYTHONPATH')])])
    command = [sys.executable, '-m', 'pytest', '-q', '-x', '-n', '0', '--tb=no', '-p', 'no:cacheprovider']
    done = subprocess.run(
        [*command, '-p', 'mutations.trial', *tests],
        cwd=root,
        env=os.environ | {_MUTANT: values, 'PYTHONPATH': paths},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode == 0:
        return ''
    if done.returncode < 0:
        return _TIME
    failed = [line.split(' - ')[0].split(maxsplit=1) for line in done.stdout.splitlines()]
    return next((words[1] for words in failed if words and words[0] in {'FAILED', 'ERROR'}), 'pytest')


def _compile_with(values: dict[str, Any]) -> None:
    """Let imports compile one file with its mutant."""
    mutant, get_code = Mutant(**values), SourceFileLoader.get_code

    def changed(loader: SourceFileLoader, name: str) -> CodeType | None:
        path = loader.get_filename(name)
        if os.path.realpath(path) != os.path.realpath(mutant.path):
            return get_code(loader, name)
        source = Path(path).read_text(encoding='utf-8')
        return compile(mutant.applied(source), path, 'exec', dont_inherit=True)

    SourceFileLoader.get_code = changed  # type: ignore[assignment, method-assign]


if _MUTANT in os.environ:
    _compile_with(json.loads(os.environ[_MUTANT]))
