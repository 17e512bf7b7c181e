"""CSV of any kind: a YAML file maps its columns, with their units."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbaid_ros.config.parameter_files import read_yaml
from mbaid_ros.core.geometry import Array
from mbaid_ros.errors import DataError, ParameterError, listing
from mbaid_ros.parameters import check_sensor_names, shown
from mbaid_ros.recordings.recording import Recording, turned_about_z
from mbaid_ros.recordings.table_files import Table, read_table
from mbaid_ros.sensor_messages import Imu, Joints, NamedPoses, Poses, Thrust

_KEYS = ('separator', 'header', 'time', 'base', 'joints', 'thrust', 'gyros', 'poses')
_COLUMN_KEYS = ('column', 'scale', 'offset')


def read_csv(path: Path, columns: Path) -> Recording:
    """Return a log in CSV, whose columns a YAML file describes (docs/how-to/bench-logs.md).

    Raises DataError: The table cannot be used.
    Raises ParameterError: The YAML file cannot be used, or does not fit the table.
    """
    mapping = _Mapping(read_yaml(columns, 'column mapping'), str(columns), '', _KEYS)
    separator = mapping.text('separator', ',')
    if len(separator) != 1:
        raise ParameterError(f"{mapping.where('separator')} is '{separator}'; accepted: one character")
    table = read_table(path, separator, header=mapping.flag('header', default=True))
    reading = _Reading(table)
    time = reading.column(mapping.required('time'), mapping.where('time'))
    named: list[Imu | NamedPoses] = [*_gyros(mapping, reading, time), *_named_poses(mapping, reading, time)]
    check_sensor_names(mapping.name(), [each.topic for each in named if each.topic != Imu.topic])
    return Recording(
        _joints(mapping, reading, time),
        _poses(mapping, reading, time),
        _thrust(mapping, reading, time),
        named=tuple(named),
        notes=reading.notes(),
    )


def _poses(mapping: _Mapping, reading: _Reading, time: Array) -> Poses | None:
    keys = ('frame', 'missing', 'position', 'orientation', 'heading', 'linear_velocity', 'angular_velocity')
    base = mapping.part('base', keys)
    if base is None:
        return None
    position = reading.columns(base, 'position', (2, 3))
    if 'missing' in base.values:
        position[reading.all_are(base.values['position'], base.number('missing'), base.where('position'))] = np.nan
    if len(position[0]) == 2:
        position = np.column_stack((position, np.zeros(len(time))))
    if ('heading' in base.values) == ('orientation' in base.values):
        raise ParameterError(f'{base.name()} has heading and orientation both, or neither; accepted: one of them')
    if 'heading' in base.values:
        orientation = turned_about_z(reading.column(base.required('heading'), base.where('heading')))
    else:
        orientation = reading.columns(base, 'orientation', (4,))
    twist = np.full((len(time), 6), np.nan)
    for part, name in ((slice(0, 3), 'linear_velocity'), (slice(3, 6), 'angular_velocity')):
        if name in base.values:
            twist[:, part] = reading.columns(base, name, (3,))
    used = reading.used('poses', base, time, position, orientation)
    return Poses(time[used], position[used], orientation[used], twist[used], base.text('frame', 'base_link'))


def _joints(mapping: _Mapping, reading: _Reading, time: Array) -> Joints | None:
    joints = mapping.part('joints')
    if joints is None:
        return None
    names = tuple(joints.values)
    parts = [
        _Mapping(value, joints.file, f'joints.{name}', ('position', 'velocity'))
        for name, value in joints.values.items()
    ]
    position = np.column_stack([reading.column(part.required('position'), part.where('position')) for part in parts])
    without = [part for part in parts if 'velocity' not in part.values]
    if 0 < len(without) < len(parts):
        raise ParameterError(
            f'{without[0].name()} has no velocity, others have; accepted: one for every joint, or none'
        )
    velocity = None
    if not without:
        velocity = np.column_stack(
            [reading.column(part.required('velocity'), part.where('velocity')) for part in parts]
        )
    used = reading.used('joint states', joints, time, position)
    return Joints(names, time[used], position[used], None if velocity is None else velocity[used])


def _thrust(mapping: _Mapping, reading: _Reading, time: Array) -> Thrust | None:
    thrust = mapping.part('thrust', ('frame', 'force', 'torque'))
    if thrust is None:
        return None
    none = np.zeros((len(time), 3))
    parts = [reading.columns(thrust, name, (3,)) if name in thrust.values else none for name in ('force', 'torque')]
    wrench = np.concatenate(parts, axis=1)
    used = reading.used('thrust commands', thrust, time, wrench)
    return Thrust(time[used], wrench[used], thrust.text('frame', 'base_link'))


def _named(mapping: _Mapping, key: str, keys: Sequence[str]) -> dict[str, _Mapping]:
    """Return the mappings of sensors of a kind by their names."""
    group = mapping.part(key)
    if group is None:
        return {}
    check_sensor_names(group.name(), [name for name in group.values if name != Imu.topic or key != 'gyros'])
    return {name: _Mapping(each, mapping.file, f'{key}.{name}', keys) for name, each in group.values.items()}


def _gyros(mapping: _Mapping, reading: _Reading, time: Array) -> list[Imu]:
    found = []
    for name, each in _named(mapping, 'gyros', ('frame', 'angular_velocity')).items():
        rate = reading.columns(each, 'angular_velocity', (3,))
        used = reading.used(f'readings of {name}', each, time, rate)
        count, frame = int(np.sum(used)), each.text('frame', 'base_link')
        found.append(Imu(time[used], rate[used], np.zeros((count, 0)), frame, topic=name))
    return found


def _named_poses(mapping: _Mapping, reading: _Reading, time: Array) -> list[NamedPoses]:
    found = []
    for name, each in _named(mapping, 'poses', ('frame', 'position', 'orientation')).items():
        parts = [part for part in ('position', 'orientation') if part in each.values]
        if not parts:
            raise ParameterError(f'{each.name()} has no position and no orientation; accepted: one of them, or both')
        position: Array = np.zeros((len(time), 3))
        orientation: Array = np.tile([0.0, 0.0, 0.0, 1.0], (len(time), 1))
        if 'position' in parts:
            position = reading.columns(each, 'position', (3,))
        if 'orientation' in parts:
            orientation = reading.columns(each, 'orientation', (4,))
        used = reading.used(f'readings of {name}', each, time, position, orientation)
        measures = 'both' if len(parts) > 1 else parts[0]
        poses = time[used], position[used], orientation[used]
        found.append(NamedPoses(name, *poses, measures, each.text('frame', 'world')))
    return found


class _Reading:
    """Takes numbers from a table, and counts the rows that are left out."""

    def __init__(self, table: Table) -> None:
        self.table = table
        self._left_out: dict[str, int] = {}

    def columns(self, mapping: _Mapping, key: str, lengths: Sequence[int]) -> Array:
        """Return columns that belong together, (N, k)."""
        value = mapping.required(key)
        if not isinstance(value, list) or len(value) not in lengths:
            accepted = ' or '.join(map(str, lengths))
            raise ParameterError(f'{mapping.where(key)} is {shown(value)}; accepted: a list of {accepted} columns')
        return np.column_stack([self.column(each, mapping.where(key)) for each in value])

    def column(self, value: Any, where: str) -> Array:
        """Return a column (N,), in SI units; a number as {constant: 0.0} stands for one that always has it."""
        if isinstance(value, dict):
            if set(value) == {'constant'}:
                return np.full(len(self.table.values), _number(value['constant'], where))
            unknown = set(map(str, value)) - set(_COLUMN_KEYS)
            if unknown or 'column' not in value:
                raise ParameterError(f'{where} is {shown(value)}; accepted: {{column: NAME, scale: 1.0, offset: 0.0}}')
            scale, offset = _number(value.get('scale', 1.0), where), _number(value.get('offset', 0.0), where)
            with np.errstate(over='ignore'):
                values = self._raw(value['column'], where) * scale + offset
            return np.where(np.isinf(values), np.nan, values)
        return self._raw(value, where)

    def all_are(self, values: Sequence[Any], number: float, where: str) -> Array:
        """Return in which rows columns as they are logged all have a number, (N,)."""
        names = [each.get('column') if isinstance(each, dict) else each for each in values]
        return np.all([self._raw(name, where) == number for name in names if name is not None], axis=0)

    def used(self, what: str, group: _Mapping, time: Array, *parts: Array) -> Array:
        """Return which rows make messages (N,): those whose numbers are finite.

        Raises DataError: None does.
        """
        used = np.isfinite(time)
        for part in parts:
            used &= np.all(np.isfinite(part), axis=1)
        if not np.any(used):
            raise DataError(
                f"no row of log '{self.table.path}' has a number in the time and in every column of {group.name()}: "
                'their numbers are in different rows, or all of them are missing ones'
            )
        self._left_out[what] = int(np.sum(~used))
        return np.asarray(used)

    def notes(self) -> tuple[str, ...]:
        """Return a sentence about the rows left out."""
        return tuple(f'{count} {what} left out: no number there' for what, count in self._left_out.items() if count)

    def _raw(self, value: Any, where: str) -> Array:
        count = self.table.values.shape[1]
        if isinstance(value, int) and not isinstance(value, bool):
            if not 0 <= value < count:
                raise ParameterError(f'{where} is column {value}; accepted: 0 to {count - 1}')
            place = value
        elif isinstance(value, str):
            if value not in self.table.names:
                raise ParameterError(
                    f"{where} is column '{value}'; those of '{self.table.path}': {listing(self.table.names)}"
                )
            if (times := self.table.names.count(value)) > 1:
                raise ParameterError(
                    f"{where} is column '{value}', which '{self.table.path}' has {times} times; accepted: its number "
                    'from 0 on'
                )
            place = self.table.names.index(value)
        else:
            raise ParameterError(f'{where} is {shown(value)}; accepted: the name of a column, or its number from 0 on')
        values = self.table.values[:, place]
        if np.all(np.isnan(values)):
            raise DataError(f"column {value!r} of log '{self.table.path}', which is {where}, contains no number")
        return values


class _Mapping:
    """A mapping at a place (empty: the whole) of the YAML file, with the keys that it may have (none: any)."""

    def __init__(self, values: object, file: str, place: str, keys: Sequence[str] = ()) -> None:
        self.file, self._place = file, place
        if not isinstance(values, Mapping) or not values:
            raise ParameterError(
                f'{self.name()} is {shown(values)}; accepted: {listing(keys) if keys else "names"} with values'
            )
        self.values: dict[str, Any] = {str(key): value for key, value in values.items()}
        unknown = [key for key in self.values if keys and key not in keys]
        if unknown:
            raise ParameterError(f"{self.name()} has '{unknown[0][:40]}'; accepted: {listing(keys)}")

    def name(self) -> str:
        """Return the words for the mapping in an error."""
        return f"'{self._place}' of column mapping '{self.file}'" if self._place else f"column mapping '{self.file}'"

    def where(self, key: str) -> str:
        """Return the words for one of its values in an error."""
        place = f'{self._place}.{key}' if self._place else key
        return f"'{place}' of column mapping '{self.file}'"

    def required(self, key: str) -> Any:
        """Return a value that there has to be."""
        if key not in self.values:
            raise ParameterError(f"{self.name()} lacks '{key}'")
        return self.values[key]

    def part(self, key: str, keys: Sequence[str] = ()) -> _Mapping | None:
        """Return a mapping in this one, None where it is not there."""
        return _Mapping(self.values[key], self.file, key, keys) if key in self.values else None

    def text(self, key: str, default: str) -> str:
        """Return a text."""
        value = self.values.get(key, default)
        if not isinstance(value, str) or not value:
            raise ParameterError(f'{self.where(key)} is {shown(value)}; accepted: a text')
        return value

    def flag(self, key: str, *, default: bool) -> bool:
        """Return true or false."""
        value = self.values.get(key, default)
        if not isinstance(value, bool):
            raise ParameterError(f'{self.where(key)} is {shown(value)}; accepted: true or false')
        return value

    def number(self, key: str) -> float:
        """Return a number."""
        return _number(self.required(key), self.where(key))


def _number(value: object, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ParameterError(f'{where} has {shown(value)}; accepted: a number')
    return float(value)
