"""Parameters declared as the fields of frozen dataclasses, checked with one set of rules wherever they come from.

A field made by `parameter` is one parameter; a field whose type is itself such a dataclass is a group, whose
name and a dot come before the names of its parameters: ``noise.joint_position``.
"""

from __future__ import annotations

import array
import difflib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, Literal, TypeVar, cast, get_type_hints

from mbaid_ros import limits
from mbaid_ros.core.errors import ParameterError, listing

T = TypeVar('T')

# Named like rclpy's Parameter.Type, in lower case.
Kind = Literal['bool', 'integer', 'double', 'string', 'double_array', 'string_array']
Value = bool | int | float | str | tuple[float, ...] | tuple[str, ...]

_KINDS: dict[object, Kind] = {
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
_METADATA = 'mbaid_ros.parameter'

# What every ROS node understands besides its own parameters: may stand in a file, is not ours to interpret.
_OF_ROS = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')


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
        return above and (self.maximum is None or number <= self.maximum)

    def _refused(self, value: object) -> ParameterError:
        shown = _shown(value)
        if self.unit and isinstance(value, int | float) and not isinstance(value, bool):
            shown += f' {self.unit}'
        return ParameterError(f"parameter '{self.name}' is {shown}; accepted: {self.accepted}")


def parameter(  # noqa: PLR0913 - one for each attribute of a ParameterSpec
    default: T,
    description: str,
    unit: str = '',
    minimum: float | None = None,
    maximum: float | None = None,
    *,
    exclusive_minimum: bool = False,
    choices: tuple[str, ...] = (),
    lengths: tuple[int, ...] = (),
    read_only: bool = True,
) -> T:
    """Return a dataclass field that is a parameter; the arguments are those of ParameterSpec.

    A time without a maximum gets one: stamps are whole nanoseconds, of which 64 bits hold a few centuries.
    """
    if unit == 's' and maximum is None:
        maximum = limits.TIME
    metadata = {
        'description': description,
        'unit': unit,
        'minimum': minimum,
        'maximum': maximum,
        'exclusive_minimum': exclusive_minimum,
        'choices': choices,
        'lengths': lengths,
        'read_only': read_only,
    }
    # A type checker sees the default; the dataclass decorator sees the field.
    return field(default=default, metadata={_METADATA: metadata})


def specifications(cls: type) -> dict[str, ParameterSpec]:
    """Return every parameter of a dataclass and of its groups, by dotted name, in the order of declaration."""
    return {spec.name: spec for spec in _walk(cls, '')}


def _walk(cls: type, prefix: str) -> Iterator[ParameterSpec]:
    types = get_type_hints(cls)
    for item in fields(cls):
        declared = types[item.name]
        if is_dataclass(declared):
            yield from _walk(cast('type', declared), f'{prefix}{item.name}.')
        else:
            yield ParameterSpec(
                prefix + item.name, _KINDS[declared], cast('Value', item.default), **item.metadata[_METADATA]
            )


def build(cls: type[T], values: Mapping[str, object]) -> T:
    """Return an instance of a parameter dataclass.

    Parameters
    ----------
    cls : the dataclass
    values : values by dotted name or as nested mappings; a parameter that is not there keeps its default

    Raises
    ------
    ParameterError
        An unknown name, or a value that is not accepted.
    """
    known = specifications(cls)
    checked: dict[str, Value] = {}
    for name, value in _flatten(values, ''):
        if name not in known:
            if not name.startswith(_OF_ROS):
                raise unknown_parameter(name, known)
        elif name in checked:
            raise ParameterError(f"parameter '{name}' is given twice, nested and dotted")
        else:
            checked[name] = known[name].check(value)
    return _construct(cls, checked, '')


def _flatten(values: Mapping[str, object], prefix: str) -> Iterator[tuple[str, object]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flatten(value, f'{prefix}{name}.')
        else:
            yield f'{prefix}{name}', value


def _construct(cls: type[T], values: Mapping[str, Value], prefix: str) -> T:
    types = get_type_hints(cls)
    arguments: dict[str, Any] = {}
    for item in fields(cast('Any', cls)):
        name = prefix + item.name
        if is_dataclass(types[item.name]):
            arguments[item.name] = _construct(types[item.name], values, f'{name}.')
        elif name in values:
            arguments[item.name] = values[name]
    return cls(**arguments)


def values_of(instance: object) -> dict[str, Value]:
    """Return the values of a parameter dataclass by dotted name: the inverse of `build`."""
    result: dict[str, Value] = {}
    for name in specifications(type(instance)):
        value: Any = instance
        for part in name.split('.'):
            value = getattr(value, part)
        result[name] = value
    return result


def unknown_parameter(name: str, known: Mapping[str, ParameterSpec]) -> ParameterError:
    """Return the error for a name that is no parameter; it lists the known ones, the most similar first."""
    beginning = name[: 2 * max(map(len, known), default=0)]  # comparing takes the square of the length
    by_similarity = sorted(known, key=lambda other: -difflib.SequenceMatcher(None, beginning, other).ratio())
    return ParameterError(f'unknown parameter {_shown(name)}; known: {listing(by_similarity, limit=len(known))}')


def _shown(value: object) -> str:
    """Return a value as an error shows it: one short line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, array.array):
        value = value.tolist()
    text = ' '.join((str(list(value)) if isinstance(value, tuple) else repr(value)).split())
    return text if len(text) <= 80 else f'{text[:77]}...'
