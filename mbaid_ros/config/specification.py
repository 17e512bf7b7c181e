"""What is known of one parameter without a value for it, and the one set of rules that values are checked with."""

from __future__ import annotations

import array
import math
from dataclasses import dataclass
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
_INTEGER_LIMIT = 2**63  # a ROS integer has 64 bits


@dataclass(frozen=True)
class ParameterSpec:
    """What is known of one parameter without a value for it.

    Attributes
    ----------
    name : dotted name
    type : one of Kind; upper-cased it names a member of rclpy's Parameter.Type
    default : the value where none is given
    description : one sentence, as `ros2 param describe` prints it
    unit : SI unit, empty where there is none
    minimum, maximum : limits of a number, or of each number of a list; None is no limit
    exclusive_minimum : True where the minimum itself is not accepted
    choices : the accepted strings; empty is any
    lengths : the accepted lengths of a list; empty is any
    read_only : True where the value cannot change while the node runs
    """

    name: str
    type: Kind
    default: Value
    description: str
    unit: str = ''
    minimum: float | None = None
    maximum: float | None = None
    exclusive_minimum: bool = False
    choices: tuple[str, ...] = ()
    lengths: tuple[int, ...] = ()
    read_only: bool = True

    @property
    def accepted(self) -> str:
        """What is accepted, in words: ``a number > 0 s``."""
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

        Raises
        ------
        ParameterError
            Wrong type, not finite, or outside the range or the choices.
        """
        if self.type in ('double_array', 'string_array'):
            if value is None:  # what ROS makes of an empty list in a file
                value = ()
            if not isinstance(value, list | tuple | array.array) or (self.lengths and len(value) not in self.lengths):
                raise self._refused(value)
            return cast('Value', tuple(self._element(item, value) for item in value))
        return self._element(value, value)

    def _element(self, item: object, value: object) -> bool | int | float | str:
        """Return one entry of a list, or the value of a scalar, in its type; `value` is what an error shows."""
        kind = self.type.removesuffix('_array')
        if kind == 'bool' and isinstance(item, bool):
            return item
        if kind == 'string' and isinstance(item, str) and (not self.choices or item in self.choices):
            return item
        # Python's bool is an int, a parameter's is not.
        if isinstance(item, bool) or not isinstance(item, int | float):
            raise self._refused(value)
        if kind == 'integer' and isinstance(item, int) and abs(item) < _INTEGER_LIMIT and self._in_range(item):
            return item
        if kind == 'double' and abs(item) < math.inf and self._in_range(item):
            try:
                return float(item)
            except OverflowError as error:
                raise self._refused(value) from error
        raise self._refused(value)

    def _in_range(self, number: float) -> bool:
        above = self.minimum is None or number > self.minimum or (number == self.minimum and not self.exclusive_minimum)
        return above and (self.maximum is None or number <= self.maximum) and self._has_a_size(number)

    @property
    def _smallest(self) -> float:
        return limits.SHORTEST if self.unit == 's' else limits.SMALLEST

    def _has_a_size(self, number: float) -> bool:
        """Tell whether a number is 0 or one whose square, times another's, can still be computed with."""
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
