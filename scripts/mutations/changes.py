"""Plausible mistakes in Python code: none in texts, types, assertions or raised errors."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

_OPPOSITE: dict[type[ast.cmpop], ast.cmpop] = {
    ast.Lt: ast.GtE(),
    ast.GtE: ast.Lt(),
    ast.Gt: ast.LtE(),
    ast.LtE: ast.Gt(),
    ast.Eq: ast.NotEq(),
    ast.NotEq: ast.Eq(),
    ast.Is: ast.IsNot(),
    ast.IsNot: ast.Is(),
    ast.In: ast.NotIn(),
    ast.NotIn: ast.In(),
}
_PAIRS = (('min', 'max'), ('minimum', 'maximum'), ('argmin', 'argmax'), ('any', 'all'), ('floor', 'ceil'))
_SWAPPED = {one: other for pair in _PAIRS for one, other in (pair, pair[::-1])}
# Fields with no code of the program's own: types, and texts.
_TYPES = ('annotation', 'returns', 'decorator_list', 'type_comment', 'bases')
_TEXTS = (ast.JoinedStr, ast.Raise, ast.Assert, ast.Import, ast.ImportFrom)


@dataclass(frozen=True)
class Mutant:
    """A mistake in a file."""

    path: Path
    line: int
    kind: str
    begin: int  # bytes of the file that are replaced
    end: int
    text: str
    before: str

    def applied(self, source: str) -> str:
        """Return the source with the mistake."""
        content = source.encode()
        return (content[: self.begin] + self.text.encode() + content[self.end :]).decode()

    def __str__(self) -> str:
        before, after = (' '.join(each.split()) for each in (self.before, self.text))
        return f'{self.path}:{self.line}: {self.kind}: {before}  ->  {after}'


def mutants_of(path: Path, source: str) -> Iterator[Mutant]:
    """Yield the mutants of a file, in order."""
    lines = source.encode().splitlines(keepends=True)
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line))
    for node in _code(ast.parse(source), inside=False):
        for kind, old, new in _changes(node):
            begin = starts[old.lineno - 1] + old.col_offset
            end = starts[(old.end_lineno or 0) - 1] + (old.end_col_offset or 0)
            before, text = source.encode()[begin:end].decode(), ast.unparse(new)
            # A statement takes the place of a statement; an expression in brackets stands wherever one may.
            yield Mutant(path, old.lineno, kind, begin, end, f'({text})' if isinstance(new, ast.expr) else text, before)


def _code(node: ast.AST, *, inside: bool) -> Iterator[ast.AST]:
    """Yield the nodes in which a mistake may be: all in functions, and numbers outside of them."""
    if isinstance(node, _TEXTS) or (isinstance(node, ast.If) and _name(node.test) == 'TYPE_CHECKING'):
        return
    if inside or (isinstance(node, ast.BinOp | ast.UnaryOp) and not isinstance(getattr(node, 'op', None), ast.BitOr)):
        yield node
    inside = inside or isinstance(node, ast.FunctionDef | ast.Lambda)
    for name, value in ast.iter_fields(node):
        if name not in _TYPES:
            for each in value if isinstance(value, list) else [value]:
                if isinstance(each, ast.AST):
                    yield from _code(each, inside=inside)


def _name(node: ast.AST) -> str:
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ''


Place = ast.expr | ast.stmt
Change = tuple[str, Place, Place]  # of which kind, and what takes the place of what


def _changes(node: ast.AST) -> Iterator[Change]:
    """Yield the mistakes that can be made in a node itself."""
    if isinstance(node, ast.BinOp):
        yield from _in_operation(node)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not | ast.Invert):
        yield 'sign' if isinstance(node.op, ast.USub) else 'negation', node, node.operand
    elif isinstance(node, ast.Compare | ast.BoolOp):
        yield from _in_condition(node)
    elif isinstance(node, ast.Subscript):
        yield from _in_index(node)
    elif isinstance(node, ast.Call) and _name(node.func) in _SWAPPED:
        yield 'min, max', node.func, _renamed(node.func)
    elif isinstance(node, ast.If) and not node.orelse:
        yield 'guard', node.test, ast.Constant(value=False)
    elif isinstance(node, ast.AugAssign):
        yield 'term', node, ast.Pass()
        if isinstance(node.op, ast.Add | ast.Sub):
            opposite = ast.Sub() if isinstance(node.op, ast.Add) else ast.Add()
            yield 'sign', node, ast.AugAssign(node.target, opposite, node.value)


def _in_condition(node: ast.Compare | ast.BoolOp) -> Iterator[Change]:
    """Yield the mistakes in a condition."""
    if isinstance(node, ast.Compare):
        if len(node.ops) == 1:
            yield 'comparison', node, ast.Compare(node.left, [_OPPOSITE[type(node.ops[0])]], node.comparators)
        return
    yield 'and, or', node, ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
    for place in range(len(node.values)):
        left = node.values[:place] + node.values[place + 1 :]
        yield 'term', node, left[0] if len(left) == 1 else ast.BoolOp(node.op, left)


def _in_operation(node: ast.BinOp) -> Iterator[Change]:
    """Yield the mistakes in an operation of two numbers; texts and lists are not added by mistake."""
    if any(isinstance(each, ast.JoinedStr | ast.List | ast.Tuple) for each in (node.left, node.right)):
        return
    if any(isinstance(each, ast.Constant) and isinstance(each.value, str) for each in (node.left, node.right)):
        return
    if isinstance(node.op, ast.Add | ast.Sub):
        subtracts = isinstance(node.op, ast.Sub)
        yield 'sign', node, ast.BinOp(node.left, ast.Add() if subtracts else ast.Sub(), node.right)
        yield 'term', node, node.left
        yield 'term', node, ast.UnaryOp(ast.USub(), node.right) if subtracts else node.right
    elif isinstance(node.op, ast.Mult):
        yield 'factor', node, node.left
        yield 'factor', node, node.right
    elif isinstance(node.op, ast.Div | ast.Pow):
        yield 'factor', node, node.left
    elif isinstance(node.op, ast.BitAnd | ast.BitOr):
        yield (
            'and, or',
            node,
            ast.BinOp(node.left, ast.BitOr() if isinstance(node.op, ast.BitAnd) else ast.BitAnd(), node.right),
        )
        yield 'term', node, node.left
        yield 'term', node, node.right


def _in_index(node: ast.Subscript) -> Iterator[Change]:
    """Yield each whole number in an index or a slice, larger and smaller by one."""
    parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
    for place, part in enumerate(parts):
        for name in ('lower', 'upper', 'step') if isinstance(part, ast.Slice) else ('',):
            number = getattr(part, name) if isinstance(part, ast.Slice) else part
            for value in _beside(number, is_index=not name):
                other: ast.expr = ast.Constant(value=value)
                if isinstance(part, ast.Slice):
                    other = ast.Slice(**{**dict(ast.iter_fields(part)), name: other})
                elements = [*parts[:place], other, *parts[place + 1 :]]
                chosen = ast.Tuple(elements, ast.Load()) if isinstance(node.slice, ast.Tuple) else other
                yield 'index', node, ast.Subscript(node.value, chosen, node.ctx)


def _beside(number: ast.expr | None, *, is_index: bool) -> tuple[int, ...]:
    """Return the whole numbers beside one, that have as plausible a meaning; none of anything else."""
    sign = 1
    if isinstance(number, ast.UnaryOp) and isinstance(number.op, ast.USub):
        sign, number = -1, number.operand
    if not isinstance(number, ast.Constant) or type(number.value) is not int:
        return ()
    value = sign * number.value
    # The first and the last are confused, and so are neighbours; a slice's zero is what is left out.
    beside = (value - 1, value + 1) if value else (-1, 1) if is_index else (1,)
    return tuple(each for each in beside if each or is_index or value > 0)


def _renamed(function: ast.expr) -> ast.expr:
    name = _SWAPPED[_name(function)]
    return ast.Attribute(function.value, name, ast.Load()) if isinstance(function, ast.Attribute) else ast.Name(name)
