"""Bags as other recorders leave them: no index of messages, compressed parts without metadata, thousands of files."""

from __future__ import annotations

import resource
from pathlib import Path

import pytest
import yaml
from backports import zstd
from mcap.reader import make_reader
from mcap.writer import IndexType, Writer

from mbaid_ros.bags import BagReader
from mbaid_ros.core.errors import DataError
from small_bags import COUNT


def copied(source: Path, target: Path, *, compressed: bool = False) -> Path:
    """Copy an MCAP file, without the index of the messages in its chunks, or with each message compressed."""
    with source.open('rb') as file, target.open('wb') as out:
        reader, writer = make_reader(file), Writer(out, index_types=IndexType.ALL if compressed else IndexType.CHUNK)
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


def test_messages_that_are_compressed_one_by_one_without_metadata(mcap: Path, tmp_path: Path) -> None:
    assert read(copied(mcap, tmp_path / 'messages.mcap', compressed=True)) == read(mcap)


def test_compressed_parts_without_metadata(mcap: Path, tmp_path: Path) -> None:
    folder = tmp_path / 'parts'
    folder.mkdir()
    for part in range(3):
        (folder / f'part_{part}.mcap.zstd').write_bytes(zstd.compress(mcap.read_bytes()))
    assert read(folder) == 3 * read(mcap)
    assert read(folder / 'part_1.mcap.zstd') == read(mcap)


def test_a_compressed_part_that_is_damaged(mcap: Path, tmp_path: Path) -> None:
    part = tmp_path / 'part.mcap.zstd'
    part.write_bytes(zstd.compress(mcap.read_bytes())[:-20])
    with pytest.raises(DataError, match=r'part\.mcap\.zstd. cannot be decompressed'):
        read(part)


def test_a_bag_of_ros_1_is_named(tmp_path: Path) -> None:
    bag = tmp_path / 'old.bag'
    bag.write_bytes(b'#ROSBAG V2.0\n' + bytes(100))
    with pytest.raises(DataError, match=r'ROS 1; accepted: .* rosbags-convert --src old\.bag'):
        read(bag)


def test_more_files_than_a_process_may_have_open(recorded: Path, mcap: Path, tmp_path: Path) -> None:
    folder = tmp_path / 'many'
    folder.mkdir()
    names = [f'part_{number}.mcap' for number in range(200)]
    for name in names:
        (folder / name).hardlink_to(mcap)
    told = yaml.safe_load((recorded / 'metadata.yaml').read_text(encoding='utf-8'))
    told['rosbag2_bagfile_information']['relative_file_paths'] = names
    (folder / 'metadata.yaml').write_text(yaml.safe_dump(told), encoding='utf-8')
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (150, hard))
    try:
        found = read(folder)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert len(found) == len(names) * (COUNT + 1)
