"""Damaged bags of sqlite3: in their bytes, or in their rows."""

from __future__ import annotations

import contextlib
import sqlite3
from pathlib import Path

import numpy as np

from fuzzing.damage import of_bytes, one
from fuzzing.meanings import TYPES
from mbaid_ros.bags import BagReader
from mbaid_ros.bags.types import definition

_CELLS = ('NULL', "'text'", "x'00ff'", '1.5e300', '-1', '9223372036854775807', "''", 'zeroblob(100000)')
_TABLES = ('topics', 'messages', 'message_definitions')
_SCHEMA = """
CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT);
INSERT INTO schema VALUES (4, 'jazzy');
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,
  offered_qos_profiles TEXT, type_description_hash TEXT);
CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT, encoding TEXT,
  encoded_message_definition TEXT, type_description_hash TEXT);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
"""


def database(path: Path, recorded: Path, count: int) -> bytes:
    """Write the first messages of a bag as a bag of sqlite3; return its bytes."""
    with contextlib.closing(sqlite3.connect(path)) as connection, BagReader(recorded) as bag:
        connection.executescript(_SCHEMA)
        numbers = {}
        for number, (topic, kind) in enumerate(TYPES.items(), start=1):
            numbers[f'/{topic}'] = number
            row = (number, f'/{topic}', kind, 'cdr', '', '')
            connection.execute('INSERT INTO topics VALUES (?, ?, ?, ?, ?, ?)', row)
            meaning = (number, kind, 'ros2msg', definition(kind)[0], '')
            connection.execute('INSERT INTO message_definitions VALUES (?, ?, ?, ?, ?)', meaning)
        rows = [
            (None, numbers[topic], when, data)
            for _, (topic, data, when) in zip(range(count), bag.raw(numbers), strict=False)
        ]
        connection.executemany('INSERT INTO messages VALUES (?, ?, ?, ?)', rows)
        connection.commit()
    return path.read_bytes()


def in_database(data: bytes, generator: np.random.Generator) -> bytes:
    """Return a database with damaged bytes, or with some cells of another type or size."""
    if generator.random() < 0.5:
        return of_bytes(data, generator)
    with contextlib.closing(sqlite3.connect(':memory:')) as connection:
        connection.deserialize(data)
        for _ in range(int(generator.integers(1, 4))):
            table = one(_TABLES, generator)
            columns = [row[1] for row in connection.execute(f'PRAGMA table_info({table})')]
            column, cell = one(columns, generator), one(_CELLS, generator)
            some = f'(rowid * {int(generator.integers(1, 10**6))}) % {one((1, 2, 50), generator)} = 0'
            with contextlib.suppress(sqlite3.Error):  # not every column takes every value
                connection.execute(f'UPDATE {table} SET {column} = {cell} WHERE {some}')
        connection.commit()
        return connection.serialize()
