"""Mistakes that `make mutants` puts into code, and the tests that it runs on them."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from documents import ROOT
from mutations import executed as executed_tests
from mutations.changes import mutants_of
from mutations.executed import Executed, record

CODE = '''"""A text - with - signs."""

LIMIT = 2.0 * 3.0
KINDS: int | None = None


def total(values: list[int], scale: float) -> float | None:
    """Return - or not."""
    if not values:
        return None
    if scale < LIMIT:
        raise ValueError(f'{scale - 1.0} is {"less" + "er"} than {LIMIT}')
    assert scale > 0.0 and values
    return max(values[1:]) * scale + values[-1]
'''


def changes(code: str) -> set[str]:
    """Return each replacement."""
    return {f'{each.kind}: {each.before} -> {each.text}' for each in mutants_of(Path('some.py'), code)}


def test_mistakes_are_made_in_code_alone() -> None:
    """None in texts, types, assertions, or raised errors."""
    found = changes(CODE)
    assert found == {
        'factor: 2.0 * 3.0 -> (2.0)',
        'factor: 2.0 * 3.0 -> (3.0)',
        'guard: not values -> (False)',
        'negation: not values -> (values)',
        'guard: scale < LIMIT -> (False)',
        'comparison: scale < LIMIT -> (scale >= LIMIT)',
        'min, max: max -> (min)',
        'index: values[1:] -> (values[2:])',
        'index: values[1:] -> (values[0:])',
        'factor: max(values[1:]) * scale -> (max(values[1:]))',
        'factor: max(values[1:]) * scale -> (scale)',
        'sign: max(values[1:]) * scale + values[-1] -> (max(values[1:]) * scale - values[-1])',
        'term: max(values[1:]) * scale + values[-1] -> (max(values[1:]) * scale)',
        'term: max(values[1:]) * scale + values[-1] -> (values[-1])',
        'index: values[-1] -> (values[-2])',
        'index: values[-1] -> (values[0])',
        'sign: -1 -> (1)',
    }


@pytest.mark.parametrize(
    ('code', 'wrong'),
    [
        ('a and b or c', {'and, or: a and b -> (a or b)', 'term: a and b -> (a)', 'term: a and b or c -> (c)'}),
        ('np.minimum(a, b)', {'min, max: np.minimum -> (np.maximum)'}),
        ('a[:, 2]', {'index: a[:, 2] -> (a[:, 3])', 'index: a[:, 2] -> (a[:, 1])'}),
        ('a[0]', {'index: a[0] -> (a[-1])', 'index: a[0] -> (a[1])'}),
        ('a & ~b', {'and, or: a & ~b -> (a | ~b)', 'negation: ~b -> (b)'}),
        ('a is not None', {'comparison: a is not None -> (a is None)'}),
    ],
)
def test_each_kind_of_mistake(code: str, wrong: set[str]) -> None:
    assert wrong <= changes(f'def of(a, b, c):\n    return {code}\n')


def test_a_statement_is_left_out_or_turned() -> None:
    assert changes('def of(a, b):\n    a += b\n    return a\n') == {
        'term: a += b -> pass',
        'sign: a += b -> a -= b',
    }


def test_a_mutant_is_python_and_differs_in_one_place() -> None:
    path = next((ROOT / 'mbaid_ros').rglob('outliers.py'))
    source = path.read_text(encoding='utf-8')
    for mutant in list(mutants_of(path, source))[::20]:
        changed = mutant.applied(source)
        assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(source)), mutant


CORE = """
LIMIT = 2.0 * 3.0


def twice(value):
    return (
        2.0
        * value
    )


def halved(value):
    return 0.5 * value


def squared(value):
    return value**2
"""
TESTS = """
import pytest
from functools import cache
from mbaid_ros.core.numbers import halved, twice

@pytest.fixture(scope='module')
def four():
    return twice(2.0)

@cache
def one():
    return halved(2.0)

def test_fails(four):
    assert twice(1.0) == 3.0

def test_first(four):
    assert four == 4.0

def test_second(four):
    assert four > 3.0

def test_third():
    assert one() == 1.0

def test_fourth():
    assert one() < 2.0
"""


NUMBERS = Path('mbaid_ros/core/numbers.py')


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Return the folder of a project with a module and its tests."""
    for name, text in {str(NUMBERS): CORE, 'mbaid_ros/__init__.py': '', 'test/test_numbers.py': TESTS}.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    (tmp_path / 'pyproject.toml').write_text('[tool.pytest.ini_options]\npythonpath = ["."]\n')
    return tmp_path


def test_the_tests_of_a_line_are_those_that_execute_it(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By themselves or by a fixture, then others of the file; none that fails."""
    monkeypatch.setattr(executed_tests, '_START', 10.0)  # times on a busy machine differ by less
    record(project, project / 'records', [], 0)
    executed = Executed(project, project / 'records')

    def tests(line: int, limit: float = 60.0) -> list[str]:
        return [test.partition('::test_')[2] for test in executed.tests_of(NUMBERS, line, limit)]

    assert executed.unexecuted(NUMBERS) == [17]
    assert set(tests(7)) == {'first', 'second', 'third', 'fourth'}
    assert set(tests(7, limit=25.0)) == {'first', 'second'}
    assert tests(13, limit=1e-3) == ['third']
    assert len(tests(2)) == 4
    assert not tests(17)
    (project / NUMBERS).write_text(CORE + '\n')
    with pytest.raises(SystemExit, match='--record'):
        tests(7)
    with pytest.raises(SystemExit, match='--record'):
        record(project, project / 'records', ['test/test_numbers.py::test_first'], 0)


TRIALS = """
import sys
from pathlib import Path

import pytest

from mutations import executed as executed_tests
from mutations.changes import mutants_of
from mutations.trial import Trials

root, path = Path(sys.argv[1]), Path(sys.argv[2])
mutants = [*mutants_of(path, (root / path).read_text())]
tests = [f'test/test_numbers.py::test_{name}' for name in ('second', 'third', 'fails')]
found = {}
tried = [(each, tests[:2]) for each in mutants] + [(mutants[0], tests)]
trials = Trials(root, tried, found.__setitem__, 2, seconds=60)
pytest.main(['-q', '-n', '0', '-p', 'no:cacheprovider', f'--rootdir={root}', 'test/test_numbers.py'], plugins=[trials])
for place, noticed in sorted(found.items()):
    print('::', tried[place][0].text, noticed.partition('::test_')[2])
print('::', *trials.failing)
"""


def test_a_mutant_is_noticed_by_the_first_test_that_fails_with_it(project: Path) -> None:
    """Code in a function is changed in place, that of the module compiled anew; tests that fail anyway are known."""
    command = [sys.executable, '-c', TRIALS, str(project), str(NUMBERS)]
    paths = os.pathsep.join([str(ROOT / 'scripts'), os.environ.get('PYTHONPATH', '')])
    done = subprocess.run(
        command, cwd=project, env=os.environ | {'PYTHONPATH': paths}, capture_output=True, text=True, check=True
    )
    assert [line for line in done.stdout.splitlines() if line.startswith('::')] == [
        ':: (2.0) ',
        ':: (3.0) ',
        ':: (2.0) second',
        ':: (value) second',
        ':: (0.5) third',
        ':: (value) third',
        ':: (value) ',
        ':: (2.0) fails',
        ':: test/test_numbers.py::test_fails',
    ]
