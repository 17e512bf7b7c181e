"""The messages of MCAP files, in the order of rosbags: as objects, packets and blocks, of several topics together."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from backports import zstd
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer

from mbaid_ros.bags import BagReader, message_types
from mbaid_ros.bags.chunks import Block, Raw, in_blocks
from mbaid_ros.bags.types import definition
from mbaid_ros.core.joints.stream import joint_state_shape
from mbaid_ros.core.samples import JOINT_STATE_TYPE, Packets
from recorded import COUNT, as_bytes, everything, joint_state

ONE = np.ones(1)


def disordered(path: Path, seed: int, compression: CompressionType) -> Path:
    """Write messages in an order that is not that of their times: chunks overlap, and times are equal."""
    random = np.random.default_rng(seed)
    with path.open('wb') as stream:
        writer = McapWriter(stream, chunk_size=3_000, compression=compression)
        writer.start(profile='ros2')
        channels = []
        for topic in ('/a', '/b', '/c'):
            schema = writer.register_schema(JOINT_STATE_TYPE, 'ros2msg', definition(JOINT_STATE_TYPE)[0].encode())
            channels.append(writer.register_channel(topic, 'cdr', schema))
        for count in range(400):
            time = max(0, count // 4 + int(random.integers(-15, 15)))
            data = as_bytes(joint_state([f'{count}'], ONE, ONE, stamp=time))
            writer.add_message(channels[random.integers(3)], time, data, time, count)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


@pytest.mark.parametrize('compression', [CompressionType.NONE, CompressionType.ZSTD, CompressionType.LZ4])
@pytest.mark.parametrize('seed', range(3))
def test_messages_come_as_from_rosbags(tmp_path: Path, seed: int, compression: CompressionType) -> None:
    path = disordered(tmp_path / 'bag.mcap', seed, compression)
    for topics in (['/a'], ['/a', '/c'], ['/a', '/b', '/c']):
        with Reader(path) as reader, BagReader(path) as bag:
            chosen = [connection for connection in reader.connections if connection.topic in topics]
            expected = [(connection.topic, data, time) for connection, time, data in reader.messages(chosen)]
            assert list(bag.raw(topics)) == expected
            assert bag.warnings == []
        stamps = [int.from_bytes(data[8:12], 'little') for _, data, _ in expected]
        assert stamps == sorted(stamps)


def test_a_folder_comes_as_from_rosbags(recorded: Path) -> None:
    with Reader(recorded) as reader:
        expected = [(connection.topic, bytes(data), time) for connection, time, data in reader.messages()]
    assert everything(recorded) == (expected, [])


COMPRESSED = set(product(StoragePlugin, CompressionMode)) - {(StoragePlugin.SQLITE3, CompressionMode.STORAGE)}


@pytest.mark.parametrize(('storage', 'compression'), sorted(COMPRESSED))
def test_compressed_folders_come_as_from_rosbags(
    tmp_path: Path, storage: StoragePlugin, compression: CompressionMode
) -> None:
    path = tmp_path / 'bag'
    writer = Writer(path, version=9, storage_plugin=storage)
    if compression != CompressionMode.NONE:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        topics = [writer.add_connection(name, JOINT_STATE_TYPE, typestore=message_types()) for name in ('/a', '/b')]
        for time in range(300):
            writer.write(topics[time % 3 % 2], time // 2, as_bytes(joint_state([f'{time}'], ONE, ONE, stamp=time)))
    with Reader(path) as reader:
        expected = [(connection.topic, bytes(data), time) for connection, time, data in reader.messages()]
    assert len(expected) == 300
    assert everything(path) == (expected, [])


@pytest.mark.parametrize('at_once', [1, 7, COUNT, 10 * COUNT])
def test_packets_are_the_messages(recorded: Path, at_once: int) -> None:
    topics = ['/joint_states', '/robot_description']
    with BagReader(recorded) as bag:
        parts = list(bag.read_packed(topics, at_once))
        objects = list(bag.read(topics))
    assert all(0 < len(part) <= at_once for part in parts)
    packed = [message for part in parts for message in part]
    assert [(topic, time) for topic, _, time in packed] == [(topic, time) for topic, _, time in objects]
    for (topic, packet, _), (_, message, _) in zip(packed, objects, strict=True):
        assert isinstance(packet, Packets) == (topic == '/joint_states')
        if topic == '/joint_states':
            columns, expected = (joint_state_shape(x).columns([x]) for x in (packet, message))
            assert [column.tobytes() for column in columns] == [column.tobytes() for column in expected]
        else:
            assert packet.data == message.data


@pytest.mark.parametrize(
    ('change', 'packed', 'extra'),
    [
        (lambda text: text, True, 0),
        (lambda _text: '', True, 0),
        (lambda text: text.replace('float64[] effort', 'float64[] effort\nfloat64 more'), False, 8),
        (lambda text: text.replace('float64[] position', 'float32[] position'), False, 0),
        # What cannot be a definition is left aside, for objects as for packets.
        (lambda text: text.replace('int32 sec', 'uint32 sec'), True, 0),
    ],
)
def test_a_type_that_the_bag_defines_in_another_way_is_not_packed(
    tmp_path: Path, change: Callable[[str], str], extra: int, *, packed: bool
) -> None:
    path = tmp_path / 'bag.mcap'
    with path.open('wb') as stream:
        writer = McapWriter(stream)
        writer.start(profile='ros2')
        text = definition(JOINT_STATE_TYPE)[0]
        schema = writer.register_schema(JOINT_STATE_TYPE, 'ros2msg', change(text).encode())
        channel = writer.register_channel('/a', 'cdr', schema)
        data = as_bytes(joint_state([], ONE[:0], ONE[:0]))
        writer.add_message(channel, 1, data + bytes(0 if packed else extra), 1, 1)
        writer.finish()  # type: ignore[no-untyped-call]
    with BagReader(path) as bag:
        ((_, message, _),) = (each for part in bag.read_packed(['/a'], 10) for each in part)
    assert isinstance(message, Packets) == packed


# -- Messages of a bag in blocks: whatever their lengths, the messages are the same.


def messages(count: int) -> list[Raw]:
    return [(f'/{"ab"[k % 3 % 2]}', bytes([k % 251]), 10 * k) for k in range(count)]


def content(blocks: list[Block]) -> list[Raw]:
    return [message for block in blocks for message in block]


@pytest.mark.parametrize('count', [0, 1, 999, 1000, 1001, 2500])
def test_blocks_hold_the_messages(count: int) -> None:
    assert content(list(in_blocks(messages(count)))) == messages(count)


# -- As other recorders leave them: no index of messages, compressed parts without metadata, thousands of files.


def copied(source: Path, target: Path, *, compressed: bool = False) -> Path:
    """Copy an MCAP file, without the index of the messages in its chunks, or with each message compressed."""
    with source.open('rb') as file, target.open('wb') as out:
        reader, writer = (
            make_reader(file),
            McapWriter(out, index_types=IndexType.ALL if compressed else IndexType.CHUNK),
        )
        writer.start('ros2')
        channels: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, 'cdr', number, channel.metadata)
            data = zstd.compress(message.data) if compressed else message.data
            writer.add_message(channels[channel.id], message.log_time, data, message.publish_time)
        writer.finish()  # type: ignore[no-untyped-call]
    return target


def read(bag: Path) -> list[tuple[str, bytes, int]]:
    with BagReader(bag) as reader:
        return list(reader.raw())


def test_chunks_without_an_index_of_their_messages(mcap: Path, tmp_path: Path) -> None:
    assert read(copied(mcap, tmp_path / 'chunks.mcap')) == read(mcap)


def test_compressed_parts_without_metadata(mcap: Path, tmp_path: Path) -> None:
    folder = tmp_path / 'parts'
    folder.mkdir()
    for part in range(3):
        (folder / f'part_{part}.mcap.zstd').write_bytes(zstd.compress(mcap.read_bytes()))
    assert read(folder) == 3 * read(mcap)
    assert read(folder / 'part_1.mcap.zstd') == read(mcap)
