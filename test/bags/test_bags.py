"""Bags: what is written is read back, by others too; what is no bag is said to be none."""

from __future__ import annotations

import shlex
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter

from fuzzing.plain_bags import SCHEMA
from mbaid_ros.bags import BagReader, BagWriter, message_types, serialize
from mbaid_ros.bags.types import definition
from mbaid_ros.errors import DataError
from recorded import COUNT, JOINT_STATE, STRING, everything, random_joint_state, string


@pytest.mark.parametrize('bare', [False, True], ids=['folder', 'file'])
def test_what_is_written_is_read_back(recorded: Path, mcap: Path, *, bare: bool) -> None:
    with BagReader(mcap if bare else recorded) as bag:
        assert {name: (topic.type, topic.count) for name, topic in bag.topics.items()} == {
            '/robot_description': (STRING, 1),
            '/joint_states': (JOINT_STATE, COUNT),
        }
        assert bag.topics['/robot_description'].latched
        assert not bag.topics['/joint_states'].latched
        assert not bag.topics['/joint_states'].reliable
        read = list(bag.read(['/robot_description', '/joint_states']))
        assert [topic for topic, _, _ in read] == ['/robot_description'] + ['/joint_states'] * COUNT
        assert [time for _, _, time in read] == [0, *(1 + index * 10_000_000 for index in range(COUNT))]
        assert read[0][1].data == '<robot/>'
        np.testing.assert_array_equal(read[7][1].position, random_joint_state(6).position)
        assert read[7][1].header.stamp.nanosec == 60_000_000
        assert bag.warnings == []


def test_other_readers_understand_the_bag(recorded: Path, mcap: Path) -> None:
    with AnyReader([recorded]) as reader:
        assert reader.message_count == COUNT + 1
    with mcap.open('rb') as stream:
        reader_of_mcap = make_reader(stream, validate_crcs=True)
        messages = list(reader_of_mcap.iter_messages(log_time_order=False))
        assert len(messages) == COUNT + 1
        summary = reader_of_mcap.get_summary()
        assert summary is not None
        assert {index.compression for index in summary.chunk_indexes} == {'zstd'}


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match='exists already'):
        BagWriter(tmp_path)
    (tmp_path / 'file').touch()
    with pytest.raises(DataError, match='cannot be made'):
        BagWriter(tmp_path / 'file' / 'bag')
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/a', STRING)
        bag.add_topic('/a', STRING)
        with pytest.raises(DataError, match='cannot also be'):
            bag.add_topic('/a', JOINT_STATE)
        with pytest.raises(DataError, match="'no_msgs/msg/Thing' is not known"):
            bag.add_topic('/thing', 'no_msgs/msg/Thing')


def test_parts_of_a_folder_are_read_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for number in (10, 9):
        with BagWriter(tmp_path / f'part_{number}') as bag:
            bag.add_topic('/a', STRING)
            bag.write('/a', string(str(number)), number)
        (tmp_path / f'part_{number}' / f'part_{number}.mcap').rename(tmp_path / f'bag_{number}.mcap')
    with BagReader(tmp_path) as bag_of_parts:
        assert [message.data for _, message, _ in bag_of_parts.read(['/a'])] == ['9', '10']


def test_a_bag_in_sqlite3(tmp_path: Path) -> None:
    with RosbagsWriter(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection('/a', STRING, typestore=message_types())
        for index in range(20):
            writer.write(connection, index, serialize(string(str(index)), STRING))
    for path in (tmp_path / 'bag', tmp_path / 'bag' / 'bag.db3', f'/{tmp_path}/bag'):
        with BagReader(path) as bag:
            assert [message.data for _, message, _ in bag.read(['/a'])] == [str(index) for index in range(20)]
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    assert len(everything(tmp_path / 'bag')[0]) == 20


@pytest.mark.parametrize('compression', [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
@pytest.mark.parametrize('chunked', [True, False])
def test_mcap_files_of_other_writers(tmp_path: Path, compression: CompressionType, *, chunked: bool) -> None:
    path = tmp_path / 'other.mcap'
    with path.open('wb') as stream:
        writer: Any = Writer(stream, compression=compression, use_chunking=chunked, chunk_size=4000)
        writer.start(profile='', library='other')
        schema = writer.register_schema(STRING, 'ros2msg', b'string data')
        channel = writer.register_channel('/a', 'cdr', schema)
        for index in range(300):
            data = serialize(string(f'text {index}'), STRING)
            writer.add_message(channel, log_time=index, data=data, publish_time=index)
        writer.finish()
    with BagReader(path) as bag:
        assert [time for _, _, time in bag.read(['/a'])] == list(range(300))
        assert bag.warnings == []
    path.write_bytes(path.read_bytes()[: -200 if chunked else -600])
    with BagReader(path) as bag:
        times = [time for _, _, time in bag.read(['/a'])]
        assert times == list(range(len(times)))
        assert len(times) > 200
        assert 'cut off' in bag.warnings[0]


def of_two_types(path: Path) -> Path:
    """Write a file with ten texts on a topic, and two joint states on the same one."""
    with path.open('wb') as stream:
        writer: Any = Writer(stream, chunk_size=200)
        writer.start(profile='ros2')
        for kind, message, count in ((STRING, string('x'), 10), (JOINT_STATE, random_joint_state(0), 2)):
            schema = writer.register_schema(kind, 'ros2msg', definition(kind)[0].encode())
            channel = writer.register_channel('/a', 'cdr', schema)
            for _ in range(count):
                writer.add_message(channel, log_time=0, data=serialize(message, kind), publish_time=0)
        writer.finish()
    return path


def cut_off(path: Path) -> Path:
    path.write_bytes(path.read_bytes()[:-100])
    return path


def of_two_files(folder: Path) -> Path:
    of_two_types(folder / 'a_0.mcap')
    with BagWriter(folder / 'later') as bag:
        bag.add_topic('/a', JOINT_STATE)
        for _ in range(3):
            bag.write('/a', random_joint_state(0), 1)
    (folder / 'later' / 'later.mcap').rename(folder / 'a_1.mcap')
    return folder


@pytest.mark.parametrize(
    ('make', 'left_out'),
    [
        (lambda folder: of_two_types(folder / 'a.mcap'), 2),
        (lambda folder: cut_off(of_two_types(folder / 'a.mcap')), 2),
        (of_two_files, 5),
    ],
    ids=['whole', 'cut off', 'two files'],
)
def test_of_a_topic_with_two_types_the_first_is_read_and_the_rest_reported(
    tmp_path: Path, make: Any, left_out: int
) -> None:
    with BagReader(make(tmp_path)) as bag:
        assert (bag.messages, bag.topics['/a'].count, bag.topics['/a'].type) == (10, 10, STRING)
        assert [message.data for _, message, _ in bag.read(['/a'])] == ['x'] * 10
        (warning,) = [each for each in bag.warnings if each.endswith('left out')]
    assert f'is of type {STRING}, and {left_out} of its messages are of another: they are left out' in warning
    assert not any('damaged' in each for each in bag.warnings)


def killed(folder: Path, before: int) -> Path:
    """Return a database as its writer leaves it that is killed: some messages in it, 100 in the log beside it."""
    insert = 'INSERT INTO messages VALUES (NULL, 1, ?, ?)'
    (folder / 'killed').mkdir()
    with closing(sqlite3.connect(folder / 'x.db3')) as connection:
        connection.execute('PRAGMA journal_mode = WAL')
        connection.executescript(SCHEMA)
        connection.execute('INSERT INTO topics VALUES (1, ?, ?, ?, ?, ?)', ('/a', STRING, 'cdr', '', ''))
        rows = [(index, serialize(string(str(index)), STRING)) for index in range(before + 100)]
        if before:
            connection.executemany(insert, rows[:before])
            connection.commit()
            connection.execute('PRAGMA wal_checkpoint(TRUNCATE)').fetchall()
        connection.executemany(insert, rows[before:])
        connection.commit()
        for name in ('x.db3', 'x.db3-wal'):
            shutil.copyfile(folder / name, folder / 'killed' / name)
    return folder / 'killed' / 'x.db3'


@pytest.mark.parametrize('bare', [False, True], ids=['folder', 'file'])
def test_what_only_the_log_of_a_database_has_is_reported(tmp_path: Path, *, bare: bool) -> None:
    file = killed(tmp_path, 10)
    path = file if bare else file.parent
    read, warnings = everything(path)
    assert len(read) == 10
    (warning,) = [each for each in warnings if '-wal' in each]
    assert warning.startswith(f"'{file}-wal' contains messages not yet written into its bag, and is not read")
    words = shlex.split(warning.partition(': ')[2])
    assert words[:3] == ['sqlite3', str(file), 'PRAGMA wal_checkpoint(TRUNCATE)']
    with closing(sqlite3.connect(file)) as connection:
        connection.execute(words[2]).fetchall()
    read, warnings = everything(path)
    assert len(read) == 110
    assert not any('-wal' in each for each in warnings)


@pytest.mark.parametrize('ending', ['.mcap', '.db3'])
def test_parts_without_messages_are_left_out(tmp_path: Path, ending: str) -> None:
    bag, plugin = tmp_path / 'bag', StoragePlugin.MCAP if ending == '.mcap' else StoragePlugin.SQLITE3
    with RosbagsWriter(bag, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection('/a', STRING, typestore=message_types())
        writer.write(connection, 5, serialize(string('x'), STRING))
    (bag / 'metadata.yaml').unlink()
    (bag / f'bag_1{ending}').write_bytes(b'')
    (bag / f'bag_2{ending}').write_bytes(bytes(4_000))
    with BagReader(bag) as reader:
        assert reader.messages == 1
        assert 'a part of bag' in reader.warnings[0]
        assert (
            f"bag_1{ending}' contains no messages: it was cut off before the first one (and 1 others)"
            in reader.warnings[0]
        )


def schemaless(path: Path, schema: int) -> Path:
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start(profile='ros2')
        channel = writer.register_channel('/a', 'cdr', schema)
        writer.add_message(channel, 5, b'\0\1\0\0', 5)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


@pytest.mark.parametrize('schema', [0, 77])
def test_a_topic_without_a_schema_is_named(tmp_path: Path, schema: int) -> None:
    with BagReader(schemaless(tmp_path / 'x.mcap', schema)) as bag, pytest.raises(DataError, match='has no schema'):
        bag.require('/a', STRING)


@pytest.mark.parametrize(
    ('head', 'name'),
    [(b'\0\7', r'XCDR2 \(CDR2\)'), (b'\0\x0b', r'XCDR2 \(PL_CDR2'), (b'\0\3', 'PL_CDR'), (b'\0\4', 'XML')],
)
def test_an_encapsulation_is_named(tmp_path: Path, head: bytes, name: str) -> None:
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/a', STRING)
        bag.write_raw('/a', head + serialize(string('x'), STRING)[2:], 5)
    with BagReader(tmp_path / 'bag') as reader, pytest.raises(DataError, match=f'encapsulated as {name}.*plain CDR'):
        list(reader.read(['/a']))


def written(name: str, content: bytes) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / name).write_bytes(content)
        return folder / name

    return write


def other_database(folder: Path) -> Path:
    with sqlite3.connect(folder / 'x.db3') as database:
        database.execute('CREATE TABLE things (id INTEGER)')
    return folder / 'x.db3'


def bag_without_messages(folder: Path) -> Path:
    with BagWriter(folder / 'x') as bag:
        bag.add_topic('/a', STRING)
    return folder / 'x'


@pytest.mark.parametrize(
    ('make', 'text'),
    [
        (lambda folder: folder / 'absent', 'does not exist'),
        (lambda folder: folder, 'is not a bag'),
        (written('x.mcap', b'not a bag at all' * 100), 'is not a bag; accepted: a rosbag2 folder'),
        (written('x.mcap', b''), 'contains no messages: it was cut off'),
        (written('x.txt', b'hello'), 'is not a bag'),
        (other_database, 'is not a bag'),
        (bag_without_messages, 'contains no messages'),
    ],
)
def test_what_is_no_bag_is_said_to_be_none(tmp_path: Path, make: Callable[[Path], Path], text: str) -> None:
    path = make(tmp_path)
    with pytest.raises(DataError, match=text) as caught:
        BagReader(path)
    assert str(path) in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_message_that_is_not_of_its_type(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/a', JOINT_STATE)
        bag.write_raw('/a', b'\x00\x01\x00\x00\x01', 5)
    with (
        BagReader(tmp_path / 'bag') as reader,
        pytest.raises(DataError, match=r"on topic '/a' .* is not a sensor_msgs"),
    ):
        list(reader.read(['/a']))
