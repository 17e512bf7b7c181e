"""Parameters as fields of dataclasses: their specifications, and instances from values."""

from __future__ import annotations

import array
import ast
import difflib
import inspect
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any, Literal, TypeVar, cast, get_type_hints

from mbaid_ros import limits
from mbaid_ros.errors import ParameterError, listing

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
# Topics that the estimator subscribes to, beside those of named sensors.
INPUT_TOPICS = ('joint_states', 'odom', 'pose', 'imu', 'thrust', 'stored_momentum', 'target_pose', 'robot_description')
METHODS = ('trajectory', 'difference', 'paper_difference', 'paper_main')
T = TypeVar('T')
_METADATA, _BY_NAME = 'mbaid_ros.parameter', 'mbaid_ros.by_name'
# Every ROS node has these besides its own parameters: they may stand in a file, and ROS interprets them.
_OF_ROS = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')


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


def parameter(
    default: T,
    unit: str = '',
    minimum: float | None = None,
    maximum: float | None = None,
    *,
    exclusive_minimum: bool = False,
    choices: tuple[str, ...] = (),
    lengths: tuple[int, ...] = (),
) -> T:
    """Return a dataclass field that is a parameter, its description as a string below; arguments as of ParameterSpec.

    A time without a maximum gets one: stamps are whole nanoseconds, of which 64 bits hold a few centuries.
    """
    if unit == 's' and maximum is None:
        maximum = limits.TIME
    metadata = {
        'unit': unit,
        'minimum': minimum,
        'maximum': maximum,
        'exclusive_minimum': exclusive_minimum,
        'choices': choices,
        'lengths': lengths,
    }
    # A type checker sees the default; the dataclass decorator sees the field.
    return field(default=default, metadata={_METADATA: metadata})


def by_name(cls: type, word: str) -> Mapping[str, Mapping[str, float]]:
    """Return a dataclass field for the parameters (`cls`) of single links or joints (`word`), by their names.

    The dotted name has the link's or joint's: ``known_joints.elbow.zero_std``. The field holds only given values.
    """
    return field(default_factory=dict, metadata={_BY_NAME: (cls, word)})


def named_groups(cls: type[T], group: str, names: Sequence[str], each: Mapping[str, Mapping[str, Any]]) -> dict[str, T]:
    """Return the groups of parameters of named sensors, each with a topic of its name.

    Raises ParameterError: A name is taken, given twice or no topic's; or parameters are of none of the names.

    Parameters
    ----------
    cls, group : dataclass of the parameters of one, and the name of the group: ``gyros``
    names, each : the names, and the given values by them
    """
    check_sensor_names(f"parameter '{group}.names'", names)
    found = {name: _construct(cls, each.get(name, {}), '') for name in names}
    if foreign := [name for name in each if name not in names]:
        one = {'gyros': 'gyro', 'poses': 'pose'}.get(group, group)
        raise ParameterError(
            f"parameter '{group}.{foreign[0][:60]}' is of no {one} in '{group}.names'; accepted: "
            f'{listing(names) or "none"}'
        )
    return found


def check_sensor_names(where: str, names: Sequence[str]) -> None:
    """Raise a ParameterError if a name cannot be a sensor's and its topic's; `where` is where they are, in words."""
    taken = sorted((*INPUT_TOPICS, 'tf'))
    for name in names:
        if name in taken or names.count(name) > 1 or not re.fullmatch(r'[A-Za-z]\w*', name, re.ASCII):
            raise ParameterError(
                f"{where} has '{name[:60]}'; accepted: letters, digits and underscores, each name once, and none of "
                f'{listing(taken)}'
            )


def topic_of(name: str) -> str:
    """Return the topic of a named sensor by the name of its parameters: arm of gyros.arm."""
    return name.rpartition('.')[2]


@cache
def specifications(cls: type) -> Mapping[str, ParameterSpec]:
    """Return every parameter of a dataclass and of its groups, by dotted name, in the order of declaration."""
    return {spec.name: spec for spec in _walk(cls, '') if '<' not in spec.name}


@cache
def named_specifications(cls: type) -> Mapping[str, ParameterSpec]:
    """Return every parameter of single links or joints, by a name like ``known_joints.<joint>.zero_std``."""
    return {spec.name: spec for spec in _walk(cls, '') if '<' in spec.name}


def specification(name: str, cls: type) -> ParameterSpec:
    """Return the specification of a parameter by its full name.

    Raises ParameterError: The dataclass has none of that name; the text lists the known ones, the most similar first.
    """
    if name in specifications(cls):
        return specifications(cls)[name]
    for spec in named_specifications(cls).values():
        if _fits(name, spec.name):
            return replace(spec, name=name)
    known = [*specifications(cls), *named_specifications(cls)]
    beginning = name[: 2 * max(map(len, known), default=0)]  # comparing takes the square of the length
    known.sort(key=lambda other: -difflib.SequenceMatcher(None, beginning, other).ratio())
    raise ParameterError(f'unknown parameter {shown(name)}; known: {listing(known)}')


def _fits(name: str, pattern: str) -> bool:
    """Return whether a name has the pattern ``known_joints.<joint>.zero_std``."""
    group, _, rest = pattern.partition('<')
    short = rest.partition('>')[2]
    return name.startswith(group) and name.endswith(short) and len(name) > len(group) + len(short)


def _walk(cls: type, prefix: str) -> Iterator[ParameterSpec]:
    types = get_type_hints(cls)
    for item in fields(cls):
        declared = types[item.name]
        if _BY_NAME in item.metadata:
            things, word = item.metadata[_BY_NAME]
            yield from _walk(things, f'{prefix}<{word}>.')
        elif is_dataclass(declared):
            yield from _walk(cast('type', declared), f'{prefix}{item.name}.')
        else:
            own = {**item.metadata[_METADATA], 'field': (cls, item.name)}
            yield ParameterSpec(prefix + item.name, KINDS[declared], cast('Value', item.default), **own)


def build(cls: type[T], values: Mapping[str, object]) -> T:
    """Return an instance of a parameter dataclass; a parameter without a value keeps its default.

    Raises ParameterError: An unknown name, or a value that is not accepted.

    Parameters
    ----------
    cls : the dataclass
    values : by dotted name or as nested mappings
    """
    checked: dict[str, Value] = {}
    for name, value in dotted(values).items():
        if name not in specifications(cls) and name.startswith(_OF_ROS):  # type: ignore[arg-type] # mypy takes type[T] for unhashable
            continue
        spec = specification(name, cls)
        checked[name] = spec.check(value)
    return _construct(cls, checked, '')


def dotted(values: Mapping[Any, object], prefix: str = '') -> dict[str, object]:
    """Return the values of nested mappings by dotted name.

    Raises ParameterError: A name has two values.
    """
    flat: dict[str, object] = {}
    for key, value in values.items():
        below = dotted(value, f'{prefix}{key}.') if isinstance(value, Mapping) else {f'{prefix}{key}': value}
        if twice := flat.keys() & below.keys():
            raise ParameterError(f"parameter '{min(twice)}' is given twice, nested and dotted")
        flat.update(below)
    return flat


def _construct(cls: type[T], values: Mapping[str, Value], prefix: str) -> T:
    types = get_type_hints(cls)
    arguments: dict[str, Any] = {}
    for item in fields(cast('Any', cls)):
        name = prefix + item.name
        if _BY_NAME in item.metadata:
            arguments[item.name] = _values_by_name(cast('Any', cls), values, prefix)
        elif is_dataclass(types[item.name]):
            arguments[item.name] = _construct(types[item.name], values, f'{name}.')
        elif name in values:
            arguments[item.name] = values[name]
    return cls(**arguments)


def _values_by_name(cls: type, values: Mapping[str, Value], prefix: str) -> dict[str, dict[str, Value]]:
    """Return the values of single links or joints, by their names, of a group with a prefix."""
    endings = sorted((name.partition('>.')[2] for name in named_specifications(cls)), key=len, reverse=True)
    found: dict[str, dict[str, Value]] = {}
    for name, value in values.items():
        short = next((end for end in endings if _fits(name, f'{prefix}<>.{end}')), '')
        if short:
            found.setdefault(name.removeprefix(prefix).removesuffix(f'.{short}'), {})[short] = value
    return found


def values_of(instance: object) -> dict[str, Value]:
    """Return the values of a parameter dataclass by dotted name: the inverse of `build`."""
    return dict(_values(instance, ''))


def _values(instance: object, prefix: str) -> Iterator[tuple[str, Value]]:
    for item in fields(cast('Any', instance)):
        value = getattr(instance, item.name)
        if _BY_NAME in item.metadata:
            yield from ((f'{prefix}{thing}.{short}', one) for thing, own in value.items() for short, one in own.items())
        elif is_dataclass(value):
            yield from _values(value, f'{prefix}{item.name}.')
        else:
            yield prefix + item.name, value
