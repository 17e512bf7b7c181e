"""Mistakes that `make mutants` puts into code, and the tests that it runs on them."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from documents import ROOT
from mutations.changes import mutants_of
from mutations.imports import Imports

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


def test_the_tests_of_a_file_follow_from_their_imports(tmp_path: Path) -> None:
    for name, text in {
        'mbaid_ros/core/part/near.py': '',
        'mbaid_ros/core/part/far.py': 'from mbaid_ros.core.part.near import x\n',
        'test/helper.py': 'from mbaid_ros.core.part import near\n',
        'test/core/part/test_far.py': 'from mbaid_ros.core.part.far import y\n',
        'test/core/part/test_near.py': 'from mbaid_ros.core.part.near import x\n',
        'test/core/part/test_other.py': '',
        'test/core/test_whole.py': 'from helper import z\n',
        'test/test_indirect.py': 'from mbaid_ros.core.part.far import y\n',
    }.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    imports = Imports(tmp_path)
    mirrored, neighbours = imports.tests_of(tmp_path / 'mbaid_ros/core/part/near.py')
    assert [Path(each).name for each in mirrored] == ['test_near.py', 'test_far.py', 'test_other.py']
    assert [Path(each).name for each in neighbours] == ['test_whole.py']
    mirrored, neighbours = imports.tests_of(tmp_path / 'mbaid_ros/core/part/far.py')
    assert [Path(each).name for each in mirrored] == ['test_far.py', 'test_other.py', 'test_near.py']
    assert [Path(each).name for each in neighbours] == ['test_indirect.py']
