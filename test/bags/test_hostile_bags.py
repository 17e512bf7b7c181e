"""Bags that were cut off, damaged, on a full disk, or mean harm: read up to there, or refused in one line."""

from __future__ import annotations

import os
import resource
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from backports import zstd

from checked import answer
from fuzzing.plain_bags import BAG, TYPES, database, mcap
from mbaid_ros.bags import BagReader, BagWriter
from mbaid_ros.errors import DataError
from mbaid_ros.replay.arguments import replay as main
from recorded import COUNT, JOINT_STATE, everything, random_joint_state

MESSAGES = 400  # messages of a whole bag


def changed_database(folder: Path, change: str) -> Path:
    """Write a bare sqlite3 bag that SQL has changed."""
    return database(folder / 'bag.db3', MESSAGES, change)


def metadata(files: list[str], mode: str = '') -> dict[str, Any]:
    """Return what metadata.yaml says of a bag."""
    topics = [
        {'message_count': MESSAGES // 2, 'topic_metadata': {'name': name, 'type': kind, 'serialization_format': 'cdr'}}
        for name, kind in TYPES.items()
    ]
    metadata = {
        'version': 9,
        'storage_identifier': 'sqlite3',
        'relative_file_paths': files,
        'duration': {'nanoseconds': 10**9},
        'starting_time': {'nanoseconds_since_epoch': 0},
        'message_count': MESSAGES,
        'topics_with_message_count': topics,
        'compression_format': 'zstd' if mode else '',
        'compression_mode': mode,
    }
    return {'rosbag2_bagfile_information': metadata}


def folder_of(folder: Path, metadata: dict[str, Any] | str) -> Path:
    """Write metadata, as data or as text."""
    (folder / 'metadata.yaml').write_text(metadata if isinstance(metadata, str) else yaml.safe_dump(metadata))
    return folder


def zeros(size: int) -> bytes:
    """Return so many zeros, compressed."""
    packer, piece = zstd.ZstdCompressor(), bytes(1_000_000)
    parts = [packer.compress(piece) for _ in range(size // len(piece))]
    return b''.join((*parts, packer.flush()))


def message_bomb(folder: Path) -> Path:
    """Write a message that decompresses to 4 GB."""
    bomb = zeros(4_000_000_000)
    path = database(folder / 'bag.db3', MESSAGES, pack=zstd.compress)
    with closing(sqlite3.connect(path)) as connection:
        connection.execute('UPDATE messages SET data = ? WHERE id = 5', (bomb,))
        connection.commit()
    return folder_of(folder, metadata(['bag.db3'], mode='message'))


def many_bombs(folder: Path) -> Path:
    """Write messages that decompress to 50 MB each, 20 GB together."""
    bomb = zeros(50_000_000)
    database(folder / 'bag.db3', MESSAGES, pack=lambda _data: bomb)
    return folder_of(folder, metadata(['bag.db3'], mode='message'))


def file_bomb(folder: Path) -> Path:
    """Write a file that decompresses to 4 GB."""
    (folder / 'bag.db3.zstd').write_bytes(zeros(4_000_000_000))
    return folder_of(folder, metadata(['bag.db3.zstd'], mode='file'))


def chunk_bomb(folder: Path) -> Path:
    """Write an MCAP file one chunk of which decompresses to 4 GB."""
    content = mcap(MESSAGES)
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
    database(folder / 'bag.db3', MESSAGES)
    return folder_of(folder, text())


ROWS = 'WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n WHERE x < 100000)'
COMPUTED = (
    'DROP TABLE messages; CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, '
    'data BLOB AS (zeroblob(900000000)) VIRTUAL);' + ROWS + 'INSERT INTO messages SELECT x, 1, x FROM n;'
)

ENDLESS = 'WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n)'
TOPIC_ROW = "SELECT x, '/' || x, 'std_msgs/msg/String', 'cdr', '', '' FROM n;"
PROGRAMS = {
    'messages without an end': 'DROP TABLE messages; CREATE VIEW messages AS '
    f"{ENDLESS} SELECT 1 topic_id, x timestamp, x'00' data FROM n;",
    'a version without an end': 'DROP TABLE schema; CREATE VIEW schema AS '
    f'{ENDLESS} SELECT max(x) schema_version FROM n;',
    'a view that nothing reads': 'CREATE VIEW other AS SELECT 1 AS one;',
    'a generated column': 'ALTER TABLE messages ADD COLUMN size AS (length(hex(zeroblob(50000000))));',
    'an index of expressions': 'CREATE INDEX slow ON messages(hex(zeroblob(1000)), timestamp);',
    'a partial index': 'CREATE INDEX slow ON messages(timestamp) WHERE topic_id IN (1, 2);',
    'a trigger': 'CREATE TRIGGER other AFTER INSERT ON messages BEGIN DELETE FROM messages; END;',
    'a virtual table': 'DROP TABLE messages; CREATE VIRTUAL TABLE messages USING fts5(topic_id, timestamp, data);',
    'many topics': f'DELETE FROM topics; {ROWS} INSERT INTO topics {TOPIC_ROW}',
    'topics of one number': 'DROP TABLE topics; CREATE TABLE topics AS SELECT 1 AS id, topic_type AS name, '
    "topic_type AS type FROM message_definitions; INSERT INTO topics VALUES (1, '/a', 'std_msgs/msg/String');",
    'a forged column': "PRAGMA writable_schema = ON; UPDATE sqlite_master SET sql = 'CREATE TABLE messages(id INTEGER "
    "PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB AS (zeroblob(50000000)))' WHERE name = 'messages';",
}


def circle(folder: Path) -> Path:
    """Write a database of 0.5 MB whose pages refer to each other 300 times each, on 15 levels."""
    path = changed_database(
        folder, f'DROP INDEX timestamp_idx; {ROWS} INSERT INTO messages SELECT NULL, 1, x, 1 FROM n;'
    )
    with closing(sqlite3.connect(path)) as connection:
        (root,) = connection.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'").fetchone()
        (size,) = connection.execute('PRAGMA page_size').fetchone()
    content = bytearray(path.read_bytes())
    place = (root - 1) * size
    first = place + int.from_bytes(content[place + 12 : place + 14], 'big')
    leaf = int.from_bytes(content[first : first + 4], 'big')
    count = len(content) // size
    pages = [root, *range(count + 1, count + 15)]
    content.extend(bytes(14 * size))
    for number, following in zip(pages, [*pages[1:], leaf], strict=True):
        cells = [size - 6 * (cell + 1) for cell in range(300)]
        page = bytearray(size)
        page[:12] = (
            b'\5\0\0' + (300).to_bytes(2, 'big') + cells[-1].to_bytes(2, 'big') + b'\0' + following.to_bytes(4, 'big')
        )
        page[12:612] = b''.join(cell.to_bytes(2, 'big') for cell in cells)
        for cell in cells:
            page[cell : cell + 6] = following.to_bytes(4, 'big') + b'\x81\0'
        content[(number - 1) * size : number * size] = page
    content[28:32] = (len(content) // size).to_bytes(4, 'big')
    path.write_bytes(content)
    return path


# Refused: one line of error, exit code 2.
REFUSED: dict[str, Callable[[Path], Path]] = {
    **{name: partial(changed_database, change=change) for name, change in PROGRAMS.items()},
    'pages in a circle': circle,
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


def cuts(size: int) -> Iterator[int]:
    yield from (0, 1, 7, 8, 9, 20, 40, 60)
    yield from np.linspace(100, size - 1, 60).astype(int).tolist()
    yield from (size - 1, size - 8, size - 9, size - 37, size - 38)


def test_a_bag_cut_off_anywhere_is_read_up_to_the_cut(mcap: Path, tmp_path: Path) -> None:
    content = mcap.read_bytes()
    whole, _ = everything(mcap)
    path = tmp_path / 'cut.mcap'
    numbers = []
    for cut in cuts(len(content)):
        path.write_bytes(content[:cut])
        if cut < 100:
            with pytest.raises(DataError, match=r'contains no messages|is not a bag'):
                everything(path)
            continue
        try:
            read, warnings = everything(path)
        except DataError:
            assert cut < len(content) / 3  # before the first block of the first chunk
            continue
        assert read == whole[: len(read)]
        if cut < len(content) - 8:  # beyond, only the closing mark is missing
            assert len(warnings) == 1
            assert 'cut off' in warnings[0]
        numbers.append(len(read))
    assert sorted(numbers[:-5]) == numbers[:-5]
    assert numbers[-1] == COUNT + 1
    assert len(set(numbers)) > 6  # more than there are chunks: parts of chunks are read, too


@pytest.mark.parametrize('metadata', ['', ': [', 'rosbag2_bagfile_information: {version: 99}', 'a: 1'])
def test_a_folder_with_bad_metadata_is_read_by_its_files(recorded: Path, tmp_path: Path, metadata: str) -> None:
    (tmp_path / 'recorded.mcap').write_bytes((recorded / 'recorded.mcap').read_bytes())
    if metadata:
        (tmp_path / 'metadata.yaml').write_text(metadata)
    read, warnings = everything(tmp_path)
    assert len(read) == COUNT + 1
    assert 'metadata.yaml' in warnings[0]


# -- Bags on a disk that takes no more: one line, and a bag that can be read as far as it goes, or none.

TOPIC = '/joint_states'


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """Let the system refuse what goes beyond so many bytes of any file, as it does on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def write(path: Path, count: int, at_once: int) -> None:
    with BagWriter(path) as bag:
        bag.add_topic(TOPIC, JOINT_STATE)
        for index in range(count):
            bag.write(TOPIC, random_joint_state(index), index)
            if index % at_once == at_once - 1:
                bag.flush()


@pytest.mark.parametrize(
    ('size', 'at_once', 'held'), [(60_000, 100, 100), (150_000, 100, 200), (600_000, 10_000, 1000)]
)
def test_a_bag_that_a_full_disk_ends_can_be_read_up_to_the_last_flush(
    tmp_path: Path, size: int, at_once: int, held: int
) -> None:
    path = tmp_path / 'run'
    with files_of_at_most(size), pytest.raises(DataError) as error:
        write(path, 3000, at_once)
    said = str(error.value)
    assert said.startswith(f"bag '{path}' cannot be written: File too large; it contains ")
    with BagReader(path) as bag:
        assert f'it contains {bag.messages} of ' in said
        assert 'was cut off' in bag.warnings[0]
        read = [message.header.stamp.nanosec // 10_000_000 for _, message, _ in bag.read([TOPIC])]
    assert read == [index % 100 for index in range(bag.messages)]
    assert bag.messages >= held
    assert [each.name for each in path.iterdir()] == ['run.mcap']


# -- Bags that mean harm: one line of error or one warning, soon, in little memory.

CONFIG = Path(__file__).resolve().parents[2] / 'config'
MEMORY = 800_000_000  # bytes, more than before, for any of them
pytestmark = pytest.mark.usefixtures('_little_memory')


def replay(bag: Path) -> int:
    return main([str(bag), '--model', str(CONFIG / 'table1.urdf')])


@pytest.mark.timeout(30)
@pytest.mark.parametrize('name', REFUSED)
def test_refused_in_one_line(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    error = answer(main, capsys, str(REFUSED[name](tmp_path)), '--model', str(CONFIG / 'table1.urdf'), code=2)
    assert len(error) < 1_000


@pytest.mark.timeout(30)
@pytest.mark.parametrize('name', DAMAGED)
def test_read_as_far_as_it_goes(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert replay(DAMAGED[name](tmp_path)) in {2, 3}
    captured = capsys.readouterr()
    assert captured.err.count('\n') <= 1
    assert 'warning' in captured.out or 'no estimate' in captured.out or captured.err


@pytest.mark.timeout(60)
def test_messages_that_are_large_together(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert replay(many_bombs(tmp_path)) in {2, 3}
    assert capsys.readouterr().err.count('\n') <= 1
