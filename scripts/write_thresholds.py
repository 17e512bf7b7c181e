"""Write thresholds.md: every number of the estimators that is no parameter, with the reason beside it."""

import ast
import io
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / 'mbaid_ros'
PAGE = ROOT / 'docs' / 'reference' / 'thresholds.md'
# By subject: folders and modules of the package.
SECTIONS = {
    'Method `trajectory`': ('core/method.py', 'core/filter', 'core/state.py', 'core/windows.py', 'core/contracts.py'),
    'Fault isolation': ('core/diagnosis', 'core/joints/faults.py', 'core/odometry/faults.py'),
    'Repair': ('core/repair.py', 'session/repairing.py'),
    'Method `difference`, the first stage of `trajectory`, and the methods of the paper': (
        'core/difference.py',
        'core/difference_solver.py',
        'core/paper.py',
    ),
    'Status and publication': ('core/results',),
    'Joints, odometry and gyro': (
        *('core/joints/stream.py', 'core/joints/model.py', 'core/odometry/stream.py', 'core/odometry/model.py'),
        'core/gyro.py',
        'core/poses.py',
    ),
    'Other things': (
        *('core/passive.py', 'core/swing.py', 'core/clocks.py', 'core/links.py', 'core/wheels.py', 'core/forces.py'),
        *('core/orbit.py', 'core/target.py'),
    ),
    'Capture': ('core/capture.py',),
    '`calibrate`': ('calibration',),
    'Readings': ('core/pipeline.py', 'core/outliers.py', 'core/noise.py', 'core/samples.py'),
    'Robots': ('core/robot',),
    'Numbers': ('core/geometry.py',),
}
HEAD = """\
# Thresholds

The fixed numbers of the estimators, by subject, each with its reason. A user sets [parameters](parameters.md) instead.
`scripts/write_thresholds.py` writes this page from the comments beside the constants.
"""


class Threshold(NamedTuple):
    """Constants of a module that are set together, and the comment beside them."""

    module: str
    names: tuple[str, ...]
    value: str
    why: str


def row(threshold: Threshold) -> str:
    """Return a row of the table."""
    first, *others = threshold.names
    names = ', '.join([f'`{threshold.module}.{first}`', *(f'`{name}`' for name in others)])
    word, space, rest = threshold.why.partition(' ')
    begin = word.lower() if word == 'A' or word[1:].islower() else word  # no unit
    return f'| {names} | {threshold.value} | {(begin + space + rest).replace("|", chr(92) + "|")} |'


def text() -> str:
    """Return the page."""
    head = ['', '| constant | value | meaning and reason |', '|---|---|---|']
    found = all_thresholds().items()
    return '\n'.join([HEAD, *('\n'.join([f'## {title}', *head, *map(row, each), '']) for title, each in found)])


def all_thresholds() -> dict[str, list[Threshold]]:
    """Return those of all sections by title."""
    found: dict[str, list[Threshold]] = {title: [] for title in SECTIONS}
    for title, places in SECTIONS.items():
        for place in places:
            for file in sorted(PACKAGE.glob(place if place.endswith('.py') else f'{place}/*.py')):
                found[title] += thresholds(file)
    return found


def thresholds(file: Path) -> Iterator[Threshold]:
    """Yield the numbers that a module sets for itself."""
    source = file.read_text(encoding='utf-8')
    lines, comments = source.splitlines(), _comments(source)
    for node in ast.parse(source).body:
        if not isinstance(node, ast.Assign) or not _is_number(node.value):
            continue
        (target,) = node.targets
        names = target.elts if isinstance(target, ast.Tuple) else [target]
        first = node.lineno - 1
        while first > 0 and lines[first - 1].startswith('#'):
            first -= 1
        above = [comments[line] for line in range(first + 1, node.lineno)]
        why = ' '.join([*above, comments.get(node.end_lineno or node.lineno, '')]).strip().removesuffix('.')
        statement = '\n'.join(lines[node.lineno - 1 : node.end_lineno])  # alone: each search splits all its lines
        ast.increment_lineno(node, 1 - node.lineno)
        value = ' '.join((ast.get_source_segment(statement, node.value) or '').split())
        name = f'{file.parent.name}/{file.stem}' if file.parent.parent.name == 'core' else file.stem
        yield Threshold(name, tuple(ast.unparse(name) for name in names), value, why)


def _comments(source: str) -> dict[int, str]:
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return {token.start[0]: token.string.lstrip('# ') for token in tokens if token.type == tokenize.COMMENT}


def _is_number(value: ast.expr) -> bool:
    """Return whether a value is a number, or a few of them."""
    if isinstance(value, ast.Tuple):
        return bool(value.elts) and all(map(_is_number, value.elts))
    if isinstance(value, ast.BinOp):
        return _is_number(value.left) or _is_number(value.right)
    if isinstance(value, ast.UnaryOp):
        return _is_number(value.operand)
    return isinstance(value, ast.Constant) and type(value.value) in (int, float)


if __name__ == '__main__':
    PAGE.write_text(text(), encoding='utf-8')
    sys.stdout.write(f'{PAGE}\n')
