"""What is known of one parameter without a value for it, and the one set of rules that values are checked with."""

from __future__ import annotations

import array
import difflib
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, Literal, TypeVar, cast, get_type_hints

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


T = TypeVar('T')

_METADATA, _NAMED = 'mbaid_ros.parameter', 'mbaid_ros.by_name'

# What every ROS node understands besides its own parameters: may stand in a file, is not ours to interpret.
_OF_ROS = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')


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


def by_name(cls: type, word: str) -> Mapping[str, Mapping[str, float]]:
    """Return a dataclass field for parameters of single things, by the names that a user gives them.

    The group's name, a thing's and a parameter's make the dotted name: ``known_joints.elbow.zero_std``. The value of
    the field holds by thing what is given, without any defaults.

    Parameters
    ----------
    cls : dataclass of the parameters of one thing
    word : what the things are, for documents and errors: ``joint``
    """
    return field(default_factory=dict, metadata={_NAMED: (cls, word)})


def specifications(cls: type) -> dict[str, ParameterSpec]:
    """Return every parameter of a dataclass and of its groups, by dotted name, in the order of declaration."""
    return {spec.name: spec for spec in _walk(cls, '')}


def named_specifications(cls: type) -> dict[str, ParameterSpec]:
    """Return every parameter of single things, by a name like ``known_joints.<joint>.zero_std``."""
    return {spec.name: spec for spec in _walk(cls, '', named=True)}


def specification(name: str, known: Mapping[str, ParameterSpec], of_things: Iterable[ParameterSpec]) -> ParameterSpec:
    """Return what is known of a parameter by its full name, that of a single thing too.

    Parameters
    ----------
    name : dotted name
    known, of_things : `specifications` of a dataclass, and the values of its `named_specifications`

    Raises
    ------
    ParameterError
        No parameter has that name.
    """
    found = specification_of(name, known, of_things)
    if found is None:
        raise unknown_parameter(name, {**known, **{spec.name: spec for spec in of_things}})
    return found


def specification_of(
    name: str, known: Mapping[str, ParameterSpec], of_things: Iterable[ParameterSpec]
) -> ParameterSpec | None:
    """Return what `specification` does, None where no parameter has that name."""
    if name in known:
        return known[name]
    return next((replace(spec, name=name) for spec in of_things if _fits(name, spec.name)), None)


def _fits(name: str, pattern: str) -> bool:
    """Tell whether a name is that of a single thing's parameter, ``known_joints.<joint>.zero_std``."""
    group, _, rest = pattern.partition('<')
    short = rest.partition('>')[2]
    return name.startswith(group) and name.endswith(short) and len(name) > len(group) + len(short)


def _walk(cls: type, prefix: str, *, named: bool = False) -> Iterator[ParameterSpec]:
    types = get_type_hints(cls)
    for item in fields(cls):
        declared = types[item.name]
        if _NAMED in item.metadata:
            things, word = item.metadata[_NAMED]
            yield from _walk(things, f'{prefix}<{word}>.') if named else ()
        elif is_dataclass(declared):
            yield from _walk(cast('type', declared), f'{prefix}{item.name}.', named=named)
        elif not named:
            yield ParameterSpec(
                prefix + item.name, KINDS[declared], cast('Value', item.default), **item.metadata[_METADATA]
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
    known, of_things = specifications(cls), tuple(named_specifications(cls).values())
    checked: dict[str, Value] = {}
    for name, value in _flatten(values, ''):
        if name not in known and name.startswith(_OF_ROS):
            continue
        spec = specification(name, known, of_things)
        if name in checked:
            raise ParameterError(f"parameter '{name}' is given twice, nested and dotted")
        checked[name] = spec.check(value)
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
        if _NAMED in item.metadata:
            arguments[item.name] = _things(cast('Any', cls), values, prefix)
        elif is_dataclass(types[item.name]):
            arguments[item.name] = _construct(types[item.name], values, f'{name}.')
        elif name in values:
            arguments[item.name] = values[name]
    return cls(**arguments)


def _things(cls: type, values: Mapping[str, Value], prefix: str) -> dict[str, dict[str, Value]]:
    """Return what is given of single things, by their names, of a group with a prefix."""
    patterns = [prefix + spec.name for spec in _walk(cls, '', named=True)]
    found: dict[str, dict[str, Value]] = {}
    for name, value in values.items():
        if any(_fits(name, pattern) for pattern in patterns):
            thing, _, short = name.removeprefix(prefix).rpartition('.')
            found.setdefault(thing, {})[short] = value
    return found


def values_of(instance: object) -> dict[str, Value]:
    """Return the values of a parameter dataclass by dotted name: the inverse of `build`."""
    return dict(_values(instance, ''))


def _values(instance: object, prefix: str) -> Iterator[tuple[str, Value]]:
    for item in fields(cast('Any', instance)):
        value = getattr(instance, item.name)
        if _NAMED in item.metadata:
            yield from ((f'{prefix}{thing}.{short}', one) for thing, own in value.items() for short, one in own.items())
        elif is_dataclass(value):
            yield from _values(value, f'{prefix}{item.name}.')
        else:
            yield prefix + item.name, value


def unknown_parameter(name: str, known: Mapping[str, ParameterSpec]) -> ParameterError:
    """Return the error for a name that is no parameter; it lists the known ones, the most similar first."""
    beginning = name[: 2 * max(map(len, known), default=0)]  # comparing takes the square of the length
    by_similarity = sorted(known, key=lambda other: -difflib.SequenceMatcher(None, beginning, other).ratio())
    return ParameterError(f'unknown parameter {shown(name)}; known: {listing(by_similarity, limit=len(known))}')
