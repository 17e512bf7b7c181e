"""Bags in sqlite3: a database is a program, so its tables are looked at before one row is read.

A view, a generated column or an index of expressions computes what it likes, and pages of a damaged file may form a
circle. Only plain tables and indices are read, in a number of steps that the size of the file bounds.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import apsw
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import ReaderError

from mbaid_ros import limits
from mbaid_ros.bags.chunks import Block, Raw, in_blocks
from mbaid_ros.bags.writer import parse_profiles
from mbaid_ros.errors import DataError

_NEEDED = {'topics': {'id', 'name', 'type'}, 'messages': {'topic_id', 'timestamp', 'data'}}
_FORMATS = {'ros2msg': MessageDefinitionFormat.MSG, 'ros2idl': MessageDefinitionFormat.IDL}
_AT_ONCE = 100_000  # steps of sqlite's machine between two looks at their number
_STEPS, _STEPS_OF_A_BYTE = 20_000_000, 20  # a message takes 15 steps to count, 30 to read, and has 30 bytes at least
_NAMES = 1_000_000  # bytes, of tables and columns, which are read several times
_OBJECTS = 1_000  # tables and indices: a bag has ten


class SqliteReader:
    """A sqlite3 file, opened for reading alone; sqlite keeps text where bytes are declared, so rows are checked.

    Attributes
    ----------
    connections : the topics, once it is open
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._database: apsw.Connection | None = None
        self._steps = self._read = 0  # and bytes
        self._size = path.stat().st_size
        self._most = _STEPS + _STEPS_OF_A_BYTE * self._size
        self.connections: list[Connection] = []

    def open(self) -> None:
        """Open the file and read its topics; raise a ReaderError if it is no bag, a DataError if it computes."""
        flags = apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI
        absolute = str(self._path.absolute()).lstrip('/')  # what follows two slashes in a URI is the name of a host
        self._database = apsw.Connection(f'file:/{quote(absolute)}?immutable=1', flags=flags)
        try:
            self._database.limit(apsw.SQLITE_LIMIT_LENGTH, limits.MESSAGE_BYTES)
            self._database.set_progress_handler(self._too_many_steps, _AT_ONCE)
            self._require_plain()
            self.connections = self._topics()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        if self._database is not None:
            self._database.close()
            self._database = None

    def blocks(self, connections: Collection[Connection]) -> Iterator[Block]:
        """Yield the messages of connections in the order of their times."""
        yield from in_blocks(self._rows({each.id: each.topic for each in connections}))

    def _rows(self, topics: dict[int, str]) -> Iterator[Raw]:
        some = ','.join('?' * len(topics))
        query = f'SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({some}) ORDER BY timestamp'
        for number, time, data in self._all(query, *topics):
            if type(time) is not int or type(data) is not bytes:
                raise ReaderError(f'a message at {time!r:.40} is {data!r:.40}; accepted: whole ns, and bytes')
            yield topics[number], data, time

    def _all(self, query: str, *values: Any) -> Iterator[tuple[Any, ...]]:
        """Yield the rows of a query; a DataError if they take more steps or bytes than the file has."""
        if self._database is None:
            raise ReaderError('the file is not open')
        try:
            for row in self._database.execute(query, values):
                self._read += sum(len(each) for each in row if isinstance(each, str | bytes))
                if self._read > self._size + _NAMES:
                    self._refuse(f'more bytes in its tables than its own {self._size}')
                yield row
        except apsw.InterruptError as error:
            raise DataError(
                f"bag '{self._path}' takes more than {self._most} steps to read, more than {self._size} bytes need; "
                'accepted: plain tables, as ROS 2 writes them'
            ) from error

    def _too_many_steps(self) -> bool:
        self._steps += _AT_ONCE
        return self._steps > self._most

    def _require_plain(self) -> None:
        """Refuse what computes: anything but tables and indices of plain columns."""
        objects = list(self._all(f'SELECT type, name, sql FROM sqlite_master LIMIT {_OBJECTS + 1}'))
        if len(objects) > _OBJECTS:
            self._refuse(f'more than {_OBJECTS} tables and indices')
        for kind, name, text in objects:
            if kind not in {'table', 'index'}:
                self._refuse(f'a {kind}, {name!r:.60}')
            if kind == 'table' and not str(text).upper().startswith('CREATE TABLE'):
                self._refuse(f'a virtual table, {name!r:.60}')
        columns: dict[str, set[str]] = {}
        for name, column, hidden in self._all(
            'SELECT t.name, c.name, c.hidden FROM sqlite_master AS t, pragma_table_xinfo(t.name) AS c '
            "WHERE t.type = 'table'"
        ):
            if hidden:
                self._refuse(f'a generated column, {column!r:.60} of table {name!r:.60}')
            columns.setdefault(name, set()).add(column)
        for (name,) in self._all(
            'SELECT DISTINCT i.name FROM sqlite_master AS t, pragma_index_list(t.name) AS i, '
            "pragma_index_xinfo(i.name) AS c WHERE t.type = 'table' AND (i.partial OR c.cid = -2)"
        ):
            self._refuse(f'an index of expressions, {name!r:.60}')
        for table, needed in _NEEDED.items():
            if not needed <= columns.get(table, set()):
                raise ReaderError(f'no table {table} with {", ".join(sorted(needed))}')
        self._columns = columns

    def _refuse(self, what: str) -> None:
        raise DataError(f"bag '{self._path}' is a database with {what}; accepted: plain tables, as ROS 2 writes them")

    def _topics(self) -> list[Connection]:
        definitions = {name: (form, text) for name, form, text in self._definitions()}
        counts = dict(self._all('SELECT topic_id, count(*) FROM messages GROUP BY topic_id LIMIT 1000000'))
        optional = {'serialization_format': "'cdr'", 'offered_qos_profiles': "''", 'type_description_hash': "''"}
        given = [name if name in self._columns['topics'] else other for name, other in optional.items()]
        found: dict[int, Connection] = {}
        profiles: dict[str, Any] = {}  # which most topics share
        for number, topic, kind, encoding, offered, digest in self._few(
            'id, name, type, ' + ', '.join(given), 'topics'
        ):
            form, text = definitions.get(kind, ('', ''))
            if type(number) is not int or not all(isinstance(each, str) for each in (topic, kind, encoding, text)):
                raise ReaderError('a topic with a name, type, definition or encoding that is no text')
            if number in found:
                raise ReaderError(f'two topics with the number {number}')
            if offered not in profiles:
                profiles[offered] = parse_profiles(offered) if isinstance(offered, str) else []
            extension = ConnectionExtRosbag2(encoding, profiles[offered])
            meaning = MessageDefinition(_FORMATS.get(form, MessageDefinitionFormat.NONE), text)
            count = counts.get(number, 0)
            found[number] = Connection(number, topic, kind, meaning, str(digest), count, extension, self)
        return [found[number] for number in sorted(found)]

    def _definitions(self) -> list[tuple[Any, ...]]:
        columns = ('topic_type', 'encoding', 'encoded_message_definition')
        if not set(columns) <= self._columns.get('message_definitions', set()):
            return []  # of a release that wrote none
        return self._few(', '.join(columns), 'message_definitions')

    def _few(self, columns: str, table: str) -> list[tuple[Any, ...]]:
        """Return the rows of a table that has at most as many as a bag has topics."""
        most = limits.TOPICS
        rows = list(self._all(f'SELECT {columns} FROM {table} LIMIT {most + 1}'))
        if len(rows) > most:
            raise DataError(f"bag '{self._path}' has more than {most} {table.replace('_', ' ')}, which is the limit")
        return rows
