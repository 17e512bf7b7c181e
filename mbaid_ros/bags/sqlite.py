"""The messages of sqlite3 bags, by the reader of rosbags."""

from __future__ import annotations

import shlex
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import apsw
from rosbags.interfaces import Connection
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from mbaid_ros import limits
from mbaid_ros.bags.chunks import Block, Raw, in_blocks


class SqliteReader(Sqlite3Reader):
    """A sqlite3 file, opened for reading alone; sqlite keeps text where bytes are declared, so rows are checked."""

    def __init__(self, path: Path) -> None:
        super().__init__(Path(quote(str(path))))  # it becomes a part of an address

    def open(self) -> None:
        """Open the file and read its topics; raise a ReaderError if it is no bag."""
        super().open()
        if self.dbconn is not None:
            self.dbconn.limit(apsw.SQLITE_LIMIT_LENGTH, limits.MESSAGE_BYTES)
        for connection in self.connections:
            extension: Any = connection.ext
            texts = connection.topic, connection.msgtype, connection.msgdef.data, extension.serialization_format
            if not all(isinstance(text, str) for text in texts):
                self.close()
                raise ReaderError('a topic with a name, type, definition or encoding that is no text')

    def blocks(self, connections: Collection[Connection]) -> Iterator[Block]:
        """Yield the messages of connections in the order of their times."""
        yield from in_blocks(self._rows(connections))

    def _rows(self, connections: Collection[Connection]) -> Iterator[Raw]:
        for connection, time, data in self.messages(connections):
            if type(time) is not int or type(data) is not bytes:
                raise ReaderError(f'a message at {time!r:.40} is {data!r:.40}; accepted: whole ns, and bytes')
            yield connection.topic, data, time


def unread_log(file: Path) -> str:
    """Return a warning about the log that a killed writer leaves beside a database; empty where there is none."""
    log = file.with_name(f'{file.name}-wal')
    if not log.is_file() or not log.stat().st_size:
        return ''
    command = shlex.join(['sqlite3', str(file), 'PRAGMA wal_checkpoint(TRUNCATE)'])
    return f"'{log}' holds messages not yet written into its bag, and is not read: {command} writes them there"
