"""The specification of a parameter: its type, its accepted values, and the check of a value."""

from __future__ import annotations

import array
import ast
import inspect
import sys
from collections.abc import Mapping
from dataclasses import dataclass, is_dataclass
from functools import cache
from itertools import pairwise
from typing import Literal, cast

from mbaid_ros import limits
from mbaid_ros.core.errors import ParameterError, listing

# Named like rclpy's Parameter.Type, in lower case.
Kind = Literal['bool', 'integer', 'double', 'string', 'double_array', 'string_array']
Value = bool | int | float | str | tuple[float, ...] | tuple[str, ...]

KINDS: dict[object, Kind] = {
    bool: 'bool',
    int: 'integer',
    float: 'double',
    str: 'string',
    tuple[float, ...]: 'double_array',
    tuple[str, ...]: 'string_array',
}
_WORDS: dict[Kind, str] = {
    'bool': 'true or false',
    'integer': 'a whole number',
    'double': 'a number',
    'string': 'a string',
    'double_array': 'a list of numbers',
    'string_array': 'a list of strings',
}
Owner = type  # of a field: ParameterSpec has a `type` of its own
_INTEGER_LIMIT = 2**63  # a ROS integer has 64 bits


@dataclass(frozen=True)
class ParameterSpec:
    """A parameter without its value."""

    name: str  # dotted name
    type: Kind  # one of Kind; upper-cased it names a member of rclpy's Parameter.Type
    default: Value
    unit: str = ''  # SI, or empty
    # minimum, maximum: limits of a number, or of each number of a list; None is no limit
    minimum: float | None = None
    maximum: float | None = None
    exclusive_minimum: bool = False  # True if the minimum itself is not accepted
    # choices, lengths: accepted strings, accepted lengths of a list; empty is any
    choices: tuple[str, ...] = ()
    lengths: tuple[int, ...] = ()
    field: tuple[Owner, str] = (object, '')  # its dataclass and the name there, below which the description stands

    @property
    def description(self) -> str:
        """One sentence, as `ros2 param describe` prints it."""
        owner, name = self.field
        texts = (_texts(base.__module__).get((base.__name__, name)) for base in owner.__mro__ if is_dataclass(base))
        return next(filter(None, texts), '')

    @property
    def accepted(self) -> str:
        """The accepted values in words: ``a number > 0 s``."""
        if self.choices:
            return listing(self.choices)
        words = _WORDS[self.type]
        if self.lengths:
            lengths = ' or '.join('empty' if length == 0 else f'of length {length}' for length in self.lengths)
            words += f' ({lengths})'
        limits = []
        if self.minimum is not None:
            limits.append(f'{">" if self.exclusive_minimum else ">="} {self.minimum:g}')
        if self.maximum is not None:
            limits.append(f'<= {self.maximum:g}')
        return ' '.join(filter(None, (words, ' and '.join(limits), self.unit)))

    def check(self, value: object) -> Value:
        """Return the value in this parameter's type.

        Raises ParameterError: Wrong type, not finite, or outside the range or the choices.
        """
        if self.type in ('double_array', 'string_array'):
            if value is None:  # an empty list in a file, in ROS
                value = ()
            if not isinstance(value, list | tuple | array.array) or (self.lengths and len(value) not in self.lengths):
                raise self._refused(value)
            return cast('Value', tuple(self._element(item, value) for item in value))
        return self._element(value, value)

    def _element(self, item: object, value: object) -> bool | int | float | str:
        """Return one entry of a list, or the value of a scalar, in its type; errors show `value`."""
        kind = self.type.removesuffix('_array')
        whole = isinstance(item, int) and not isinstance(item, bool)  # Python's bool is an int, a parameter's is not
        fits = {
            'bool': isinstance(item, bool),
            'string': isinstance(item, str) and (not self.choices or item in self.choices),
            'integer': whole and abs(cast('int', item)) < _INTEGER_LIMIT and self._in_range(cast('int', item)),
            'double': (whole or isinstance(item, float)) and self._in_range(cast('float', item)),
        }
        if not fits[kind]:
            raise self._refused(value)
        return float(cast('float', item)) if kind == 'double' else cast('bool | int | str', item)

    def _in_range(self, number: float) -> bool:
        above = self.minimum is None or number > self.minimum or (number == self.minimum and not self.exclusive_minimum)
        return above and (self.maximum is None or number <= self.maximum) and self._has_a_size(number)

    @property
    def _smallest(self) -> float:
        return limits.SHORTEST if self.unit == 's' else limits.SMALLEST

    def _has_a_size(self, number: float) -> bool:
        """Return whether a number is 0, or its square times another's neither over- nor underflows; NaN is neither."""
        return number == 0 or self.type == 'integer' or self._smallest <= abs(number) <= limits.QUANTITY

    def _refused(self, value: object) -> ParameterError:
        words, accepted = shown(value), self.accepted
        if isinstance(value, int | float) and not isinstance(value, bool):
            words += f' {self.unit}' if self.unit else ''
            if not self._has_a_size(value):
                accepted += f', of a size from {self._smallest:g} to {self.maximum or limits.QUANTITY:g}'
        return ParameterError(f"parameter '{self.name}' is {words}; accepted: {accepted}")


def shown(value: object) -> str:
    """Return a value as an error shows it: one short line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, array.array):
        value = value.tolist()
    text = ' '.join((str(list(value)) if isinstance(value, tuple) else repr(value)).split())
    return text if len(text) <= 80 else f'{text[:77]}...'


@cache
def _texts(module: str) -> Mapping[tuple[str, str], str]:
    """Return the strings below the fields of a module's classes, by class and field."""
    classes = [
        each for each in ast.parse(inspect.getsource(sys.modules[module])).body if isinstance(each, ast.ClassDef)
    ]
    return {
        (each.name, item.target.id): ' '.join(below.value.value.split())
        for each in classes
        for item, below in pairwise(each.body)
        if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) and isinstance(below.value.value, str)
    }
