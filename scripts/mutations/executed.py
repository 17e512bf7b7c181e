"""Which tests execute a line of the core, and their time: a plugin of pytest records it, a class reads it.

The time is that of the processor: on a busy machine it stays the same.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import coverage
import pytest

_MEASURED = 'mbaid_ros/core'
_COVERAGE, _TESTS = 'coverage', 'tests.json'
_START = 0.02  # s, that a test takes beyond its own time


class Executed:
    """The tests that execute each line of the core.

    Parameters
    ----------
    root : folder of the project
    folder : of the records
    """

    def __init__(self, root: Path, folder: Path) -> None:
        self._root = root
        record = json.loads((folder / _TESTS).read_text(encoding='utf-8'))
        self._seconds: dict[str, float] = record['tests']
        self._fixtures: dict[str, list[str]] = record['fixtures']  # of a test, all that outlive it
        self._fixture_seconds: dict[str, float] = record['fixture_seconds']
        self._files: dict[str, str] = record['files']
        self._data = coverage.CoverageData(str(folder / _COVERAGE))
        self._data.read()
        self._lines = cache(self._recorded_lines)
        self._tests_in: dict[str, list[str]] = {}
        for test in self._seconds:
            self._tests_in.setdefault(test.partition('::')[0], []).append(test)

    def tests_of(self, path: Path, line: int, limit: float) -> list[str]:
        """Return the passing tests that execute a line, the fastest of them that take some seconds together.

        A test executes what its fixtures execute. Other tests of the same files follow: a file may keep in a cache what
        its first test computes. Tests of a file stand together, so that their fixtures are made once.
        """
        direct = self._users(self._contexts(path, line))
        files = dict.fromkeys(test.partition('::')[0] for test in direct)
        beside = [test for file in files for test in self._tests_in[file] if test not in direct]
        chosen: dict[str, list[str]] = {}
        for test in self._within(limit, sorted(direct, key=self._alone), sorted(beside, key=self._alone)):
            chosen.setdefault(test.partition('::')[0], []).append(test)
        by_cost = sorted(chosen.values(), key=lambda tests: sum(map(self._alone, tests)))
        return [test for tests in by_cost for test in tests]

    def unexecuted(self, path: Path) -> list[int]:
        """Return the lines of functions of a file that no test executes."""
        here = str((self._root / path).resolve())
        executed = self._lines(here)
        found = coverage.Coverage(data_file=None, config_file=False).analysis2(here)[1]
        return [line for line in found if line not in executed]

    def _alone(self, test: str) -> float:
        """Return how long a test takes without any other."""
        return self._seconds[test] + sum(self._fixture_seconds[each] for each in self._fixtures[test])

    def _within(self, limit: float, *parts: Sequence[str]) -> Iterator[str]:
        seconds, made = 0.0, set[str]()
        for test in (test for part in parts for test in part):
            new = set(self._fixtures[test]) - made
            cost = _START + self._seconds[test] + sum(self._fixture_seconds[each] for each in new)
            if seconds and seconds + cost > limit:
                continue
            seconds, made = seconds + cost, made | new
            yield test

    def _contexts(self, path: Path, line: int) -> set[str]:
        """Return by what a line is executed; of a statement outside of functions, all that executes its file."""
        here = str((self._root / path).resolve())
        if _digest(self._root / path) != self._files[str(path)]:
            raise SystemExit(f'{path} has changed since the tests were recorded: run with --record')
        lines = self._lines(here)
        found = lines.get(line, set())
        if not found:
            found = set().union(*(lines.get(each, set()) for each in _statement(here, line)))
        return found if found - {''} else set().union(*lines.values()) if '' in found else set()

    def _recorded_lines(self, path: str) -> dict[int, set[str]]:
        return {line: set(contexts) for line, contexts in self._data.contexts_by_lineno(path).items()}

    def _users(self, contexts: set[str]) -> set[str]:
        """Return the passing tests among some contexts, and those that use a fixture among them."""
        return {test for test in self._seconds if test in contexts or not contexts.isdisjoint(self._fixtures[test])}


def record(root: Path, folder: Path, tests: Iterable[str], processes: int) -> None:
    """Run tests, the whole suite without any, and record what each executes; earlier records of others stay."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = os.pathsep.join([str(Path(__file__).parents[1]), *filter(None, [os.environ.get('PYTHONPATH')])])
    append = ['--cov-append'] if [*tests] else []
    if not append:
        (folder / _COVERAGE).unlink(missing_ok=True)
    elif json.loads((folder / _TESTS).read_text(encoding='utf-8'))['files'] != _digests(root):
        raise SystemExit('the core has changed since the tests were recorded: run with --record, and no names of tests')
    command = [sys.executable, '-m', 'pytest', '-q', '-n', str(processes), '-p', 'mutations.executed']
    command += ['-p', 'no:cacheprovider', f'--cov={_MEASURED}', '--cov-report=', *append, *tests]
    environment = {'PYTHONPATH': paths, 'COVERAGE_FILE': str(folder / _COVERAGE), 'EXECUTED': str(folder / _TESTS)}
    subprocess.run(command, cwd=root, env=os.environ | environment, check=False)


@cache
def _statement(path: str, line: int) -> range:
    """Return the lines of the innermost statement around a line, or of its head if others are in it."""
    found = range(line, line + 1)
    for node in ast.walk(ast.parse(Path(path).read_text(encoding='utf-8'))):
        if isinstance(node, ast.stmt):
            inner = getattr(node, 'body', None)
            end = inner[0].lineno - 1 if inner else node.end_lineno or node.lineno
            if node.lineno <= line <= end:
                found = range(node.lineno, end + 1)
    return found


def _digests(root: Path) -> dict[str, str]:
    return {str(each.relative_to(root)): _digest(each) for each in sorted((root / _MEASURED).rglob('*.py'))}


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


# The plugin: it runs where the tests do, and on the process that collects their reports.
_current = ['']  # contexts, the innermost last
_item: list[pytest.Item] = []
_begin: list[float] = []
_failed: set[str] = set()
_passed: dict[str, float] = {}
_kept: dict[str, list[str]] = {}
_fixture_seconds: dict[str, float] = {}


def _switch(context: str) -> None:
    measured = coverage.Coverage.current()
    if measured is not None:
        measured.switch_context(context)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Any:
    """Measure each test by its name."""
    definitions = getattr(item, '_fixtureinfo').name2fixturedefs  # noqa: B009 - pytest has no other way to it
    item.user_properties.append(('fixtures', [_name(each[-1]) for each in definitions.values() if _outlives(each[-1])]))
    _item[:], _begin[:] = [item], [time.process_time()]
    _current[:] = [item.nodeid]
    _switch(item.nodeid)
    try:
        return (yield)
    finally:
        _switch('')


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item) -> Any:
    """Note the time of a test."""
    try:
        return (yield)
    finally:
        item.user_properties.append(('seconds', time.process_time() - _begin[0]))


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: Any) -> Any:
    """Measure a fixture of several tests by its own name."""
    if not _outlives(fixturedef):
        return (yield)
    _current.append(_name(fixturedef))
    _switch(_current[-1])
    start = time.process_time()
    try:
        return (yield)
    finally:
        _item[0].user_properties.append(('fixture', [_current.pop(), time.process_time() - start]))
        _switch(_current[-1])


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Collect the time of tests that pass, without the fixtures of several tests."""
    if report.outcome != 'passed':
        _failed.add(report.nodeid)
    if report.when != 'teardown':
        return
    properties: list[tuple[str, Any]] = report.user_properties
    fixtures = dict(value for name, value in properties if name == 'fixture')
    _fixture_seconds.update(fixtures)  # also of a test that fails: others use the same
    if report.nodeid not in _failed:
        _kept[report.nodeid] = dict(properties)['fixtures']
        _passed[report.nodeid] = dict(properties)['seconds'] - sum(fixtures.values())


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write what was collected."""
    if hasattr(session.config, 'workerinput'):
        return
    path = Path(os.environ['EXECUTED'])
    before = json.loads(path.read_text(encoding='utf-8')) if path.is_file() and session.config.option.cov_append else {}
    files = _digests(session.config.rootpath)
    parts = {'tests': _passed, 'fixtures': _kept, 'fixture_seconds': _fixture_seconds, 'files': files}
    path.write_text(json.dumps({name: before.get(name, {}) | part for name, part in parts.items()}), encoding='utf-8')


def _outlives(fixture: Any) -> bool:
    return fixture.scope != 'function'


def _name(fixture: Any) -> str:
    return f'fixture {fixture.baseid}::{fixture.argname}'
