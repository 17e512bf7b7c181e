"""The messages of sqlite3 bags, read so that a database can do nothing but hold rows.

A database may define its tables as views, compute columns, or be laid out so that one page counts as thousands. Only
real tables with plain columns are read, by plain queries that an authorizer admits, and no query goes on for longer
than the size of the file explains. Every row is checked: sqlite keeps text where bytes are declared.
"""

from __future__ import annotations

import shlex
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

import apsw
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.metadata import ReaderMetadata
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from mbaid_ros import limits
from mbaid_ros.bags.chunks import Block, Raw, in_blocks
from mbaid_ros.bags.writer import parse_profiles
from mbaid_ros.core.errors import DataError

_STEPS = 10_000  # of the virtual machine between two looks at how many there were
_COLUMNS = {
    'topics': ('id', 'name', 'type', 'serialization_format'),
    'messages': ('topic_id', 'timestamp', 'data'),
    'message_definitions': ('topic_type', 'encoding', 'encoded_message_definition'),
}
_PROFILES = 'offered_qos_profiles'  # of topics, in all but the oldest bags
_FORMATS = {'ros2msg': MessageDefinitionFormat.MSG, 'ros2idl': MessageDefinitionFormat.IDL}
_LIMITS = {
    apsw.SQLITE_LIMIT_LENGTH: limits.MESSAGE_BYTES,
    apsw.SQLITE_LIMIT_SQL_LENGTH: 1_000_000,
    apsw.SQLITE_LIMIT_COLUMN: 100,
    apsw.SQLITE_LIMIT_EXPR_DEPTH: 50,
    apsw.SQLITE_LIMIT_COMPOUND_SELECT: 2,
    apsw.SQLITE_LIMIT_ATTACHED: 0,
}
_ADMITTED = {apsw.SQLITE_SELECT, apsw.SQLITE_READ, apsw.SQLITE_PRAGMA, apsw.SQLITE_FUNCTION}
_FUNCTIONS = {'count', 'lower'}
_PRAGMAS = {'table_xinfo'}


class SqliteReader(Sqlite3Reader):
    """A sqlite3 file."""

    def open(self) -> None:
        """Open the file and read its topics; raise a ReaderError if it is no bag."""
        path = Path(str(self.path))
        self._steps = 0
        self._most = limits.QUERY_STEPS + limits.QUERY_STEPS_PER_BYTE * path.stat().st_size
        try:
            self.dbconn = apsw.Connection(
                f'file:{quote(str(path))}?immutable=1', flags=apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI
            )
            self._restrict(self.dbconn)
            self._read_topics()
        except BaseException as error:
            if self.dbconn is not None:
                self.close()
            if isinstance(error, apsw.Error):
                raise ReaderError(f'Cannot open database {path}: {error}') from error
            raise

    def blocks(self, connections: Collection[Connection]) -> Iterator[Block]:
        """Yield the messages of connections in the order of their times."""
        yield from in_blocks(self._rows({connection.id: connection.topic for connection in connections}))

    def _rows(self, wanted: Mapping[int, str]) -> Iterator[Raw]:
        """Yield the messages of topics by their numbers."""
        rows = self._query(
            'SELECT topic_id, timestamp, data FROM messages '
            f'WHERE topic_id IN ({",".join("?" for _ in wanted)}) ORDER BY timestamp',
            tuple(wanted),
        )
        for number, time, data in rows:
            if not isinstance(number, int) or number not in wanted:
                raise ReaderError(f'a message is of topic {number!r:.40}, which is no number of a topic')
            if not isinstance(time, int):
                raise ReaderError(f'a message has the time {time!r:.40}, which is no whole number')
            if not isinstance(data, bytes):
                raise ReaderError(f'a message at {time} ns is {data!r:.40}, which is not bytes')
            yield wanted[number], data, time

    def _restrict(self, connection: apsw.Connection) -> None:
        """Keep queries from doing anything but reading tables, and from going on for ever."""
        for number, value in _LIMITS.items():
            connection.limit(number, value)
        connection.config(apsw.SQLITE_DBCONFIG_ENABLE_VIEW, 0)
        connection.config(apsw.SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0)
        connection.config(apsw.SQLITE_DBCONFIG_DEFENSIVE, 1)
        connection.authorizer = _authorize
        connection.set_progress_handler(self._is_too_long, _STEPS)

    def _is_too_long(self) -> bool:
        self._steps += _STEPS
        return self._steps > self._most

    def _query(self, text: str, values: tuple[int | str, ...] = ()) -> Iterator[tuple[Any, ...]]:
        """Yield the rows of a query; raise a DataError if it takes more steps than the size of the file explains."""
        if self.dbconn is None:
            raise ReaderError('the database is not open')
        self._steps = 0
        try:
            yield from self.dbconn.execute(text, values)
        except apsw.InterruptError as error:
            raise DataError(f"bag '{self.path}' takes longer to read than the size of the file explains") from error

    def _read_topics(self) -> None:
        columns = {table: self._columns(table) for table in _COLUMNS}
        for table in ('topics', 'messages'):
            missing = set(_COLUMNS[table]) - columns[table]
            if missing:
                raise ReaderError(f"no table '{table}' with a plain column '{min(missing)}'")
        definitions = self._definitions() if columns['message_definitions'] else {}
        counts = self._counts()
        nothing = MessageDefinition(MessageDefinitionFormat.NONE, '')
        profiles = _PROFILES if _PROFILES in columns['topics'] else "''"
        self.connections = []
        for row in self._query(f'SELECT id, name, type, serialization_format, {profiles} FROM topics ORDER BY id'):
            number, *texts = row
            if not isinstance(number, int) or not all(isinstance(text, str) for text in texts):
                raise ReaderError(f'a topic is {row!r:.200}; accepted: a number and texts')
            name, kind, encoding, profile = texts
            definition, count = definitions.get(kind, nothing), counts.get(number, 0)
            extension = ConnectionExtRosbag2(encoding, parse_profiles(profile))
            self.connections.append(Connection(number, name, kind, definition, '', count, extension, self))
            if len(self.connections) > limits.TOPICS:
                raise ReaderError(f'more than {limits.TOPICS} topics')
        if len({connection.id for connection in self.connections}) < len(self.connections):
            raise ReaderError('two topics have the same number')
        self.metadata = ReaderMetadata(0, 0, 0, sum(counts.values()), None, None, None, None)

    def _columns(self, table: str) -> set[str]:
        """Return the names of the plain columns of a table, none where there is no such table."""
        query = 'SELECT type, rootpage FROM sqlite_master WHERE lower(name) = ? AND type != ?'
        found = list(self._query(query, (table, 'index')))
        if not found:
            return set()
        # A virtual table has no page of its own, a view is none.
        if len(found) > 1 or found[0][0] != 'table' or not found[0][1]:
            raise DataError(f"'{table}' of bag '{self.path}' is no table that holds rows")
        described = list(self._query(f'PRAGMA table_xinfo({table})'))
        return {str(name) for _, name, _, _, _, _, hidden in described if not hidden}

    def _definitions(self) -> dict[str, MessageDefinition]:
        """Return the definitions of types that are there and can be understood."""
        found: dict[str, MessageDefinition] = {}
        query = 'SELECT topic_type, encoding, encoded_message_definition FROM message_definitions'
        for kind, encoding, text in self._query(query):
            if isinstance(kind, str) and isinstance(text, str) and encoding in _FORMATS:
                found.setdefault(kind, MessageDefinition(_FORMATS[encoding], text))
            if len(found) > limits.TOPICS:
                raise ReaderError(f'more than {limits.TOPICS} definitions of types')
        return found

    def _counts(self) -> dict[int, int]:
        """Return the numbers of messages by the number of their topic."""
        rows = self._query('SELECT topic_id, count(*) FROM messages GROUP BY topic_id')
        return {number: count for number, count in rows if isinstance(number, int)}


def unread_log(file: Path) -> str:
    """Return a warning about the log that a killed writer leaves beside a database; empty where there is none."""
    log = file.with_name(f'{file.name}-wal')
    if not log.is_file() or not log.stat().st_size:
        return ''
    command = shlex.join(['sqlite3', str(file), 'PRAGMA wal_checkpoint(TRUNCATE)'])
    return f"'{log}' holds messages not yet written into its bag, and is not read: {command} writes them there"


def _authorize(action: int, first: str | None, second: str | None, database: str | None, origin: str | None) -> int:
    """Admit the actions of the queries here; `origin` is the view or trigger that asks, if one does."""
    asked = {apsw.SQLITE_FUNCTION: (second, _FUNCTIONS), apsw.SQLITE_PRAGMA: (first, _PRAGMAS)}.get(action)
    admitted = action in _ADMITTED and origin is None and (asked is None or (asked[0] or '').lower() in asked[1])
    return apsw.SQLITE_OK if admitted and database in {None, 'main'} else apsw.SQLITE_DENY
