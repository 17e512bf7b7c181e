"""Bags that mean harm: each a small generator, every one of which hung, filled the memory or ended in a traceback."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import yaml
from backports import zstd

from fuzzing.plain_bags import BAG, TYPES, database, mcap

COUNT = 400  # messages of a whole bag


def changed_database(folder: Path, change: str) -> Path:
    """Write a bare sqlite3 bag that SQL has changed."""
    return database(folder / 'bag.db3', COUNT, change)


def metadata(files: list[str], storage: str = 'sqlite3', mode: str = '', **more: Any) -> dict[str, Any]:
    """Return what metadata.yaml says of a bag."""
    topics = [
        {'message_count': COUNT // 2, 'topic_metadata': {'name': name, 'type': kind, 'serialization_format': 'cdr'}}
        for name, kind in TYPES.items()
    ]
    told = {
        'version': 9,
        'storage_identifier': storage,
        'relative_file_paths': files,
        'duration': {'nanoseconds': 10**9},
        'starting_time': {'nanoseconds_since_epoch': 0},
        'message_count': COUNT,
        'topics_with_message_count': topics,
        'compression_format': 'zstd' if mode else '',
        'compression_mode': mode,
        **more,
    }
    return {'rosbag2_bagfile_information': told}


def folder_of(folder: Path, told: dict[str, Any] | str) -> Path:
    """Write metadata, as data or as text."""
    (folder / 'metadata.yaml').write_text(told if isinstance(told, str) else yaml.safe_dump(told))
    return folder


def zeros(size: int) -> bytes:
    """Return so many zeros, compressed."""
    packer, piece = zstd.ZstdCompressor(), bytes(1_000_000)
    parts = [packer.compress(piece) for _ in range(size // len(piece))]
    return b''.join((*parts, packer.flush()))


def message_bomb(folder: Path) -> Path:
    """Write a message that decompresses to 4 GB."""
    bomb = zeros(4_000_000_000)
    path = database(folder / 'bag.db3', COUNT, pack=zstd.compress)
    with closing(sqlite3.connect(path)) as connection:
        connection.execute('UPDATE messages SET data = ? WHERE id = 5', (bomb,))
        connection.commit()
    return folder_of(folder, metadata(['bag.db3'], mode='message'))


def many_bombs(folder: Path) -> Path:
    """Write messages that decompress to 50 MB each, 20 GB together."""
    bomb = zeros(50_000_000)
    database(folder / 'bag.db3', COUNT, pack=lambda _data: bomb)
    return folder_of(folder, metadata(['bag.db3'], mode='message'))


def file_bomb(folder: Path) -> Path:
    """Write a file that decompresses to 4 GB."""
    (folder / 'bag.db3.zstd').write_bytes(zeros(4_000_000_000))
    return folder_of(folder, metadata(['bag.db3.zstd'], mode='file'))


def chunk_bomb(folder: Path) -> Path:
    """Write an MCAP file one chunk of which decompresses to 4 GB."""
    content = mcap(COUNT)
    bomb = zeros(4_000_000_000)
    record = b'\0' * 16 + (4_000_000_000).to_bytes(8, 'little') + bytes(4) + b'\4\0\0\0zstd'
    record += len(bomb).to_bytes(8, 'little') + bomb
    begin = 8 + 9 + int.from_bytes(content[9:17], 'little')  # after the header
    path = folder / 'bag.mcap'
    path.write_bytes(content[:begin] + b'\x06' + len(record).to_bytes(8, 'little') + record + content[begin:-40])
    return path


def pipe_for(folder: Path, name: str) -> Path:
    """Make a folder with a pipe in the place of a file."""
    shutil.copytree(BAG, folder, dirs_exist_ok=True)
    (folder / name).unlink(missing_ok=True)
    os.mkfifo(folder / name)
    return folder


def described(folder: Path, text: Callable[[], dict[str, Any] | str]) -> Path:
    """Write a whole bag with other metadata."""
    database(folder / 'bag.db3', COUNT)
    return folder_of(folder, text())


ROWS = 'WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n WHERE x < 100000)'
COMPUTED = (
    'DROP TABLE messages; CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, '
    'data BLOB AS (zeroblob(900000000)) VIRTUAL);' + ROWS + 'INSERT INTO messages SELECT x, 1, x FROM n;'
)

# Refused: one line of error, exit code 2.
REFUSED: dict[str, Callable[[Path], Path]] = {
    'computed data': partial(changed_database, change=COMPUTED),
    'a topic whose type is a number': partial(changed_database, change="UPDATE topics SET type = x'00ff'"),
    'topics of no number': partial(
        changed_database,
        change="ALTER TABLE topics RENAME TO kept; CREATE TABLE topics AS SELECT 'a' || id AS id, name, type, "
        'serialization_format, offered_qos_profiles FROM kept;',
    ),
    'a message of 4 GB': message_bomb,
    'a file of 4 GB': file_bomb,
    'a chunk of 4 GB': chunk_bomb,
    'metadata that are a pipe': partial(pipe_for, name='metadata.yaml'),
    'a pipe as an MCAP file': partial(pipe_for, name='table1_live.mcap'),
    'a list of 2 MB': partial(described, text=lambda: 'rosbag2_bagfile_information: [' + '1,' * 1_000_000 + '1]'),
    'one file a thousand times': partial(described, text=lambda: metadata(['bag.db3'] * 1_000)),
    'many files': partial(described, text=lambda: metadata([f'{number}.db3' for number in range(20_000)])),
}
# Read as far as it goes, with a warning, and too little for an estimate: exit code 3.
DAMAGED: dict[str, Callable[[Path], Path]] = {
    'text as data': partial(changed_database, change="UPDATE messages SET data = 'abc' WHERE id > 10"),
    'text as times': partial(changed_database, change="UPDATE messages SET timestamp = 'abc' WHERE id > 10"),
    'empty data': partial(changed_database, change="UPDATE messages SET data = x'' WHERE id > 10"),
    'merge keys': partial(
        described,
        text=lambda: 'rosbag2_bagfile_information:\n  <<: [' + ', '.join('{a: 1}' for _ in range(50_000)) + ']\n',
    ),
    'deep metadata': partial(described, text=lambda: '[' * 500_000),
}
