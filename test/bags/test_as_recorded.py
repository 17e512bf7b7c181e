"""Bags as other recorders leave them: no index of messages, compressed parts without metadata, thousands of files."""

from __future__ import annotations

from pathlib import Path

from backports import zstd
from mcap.reader import make_reader
from mcap.writer import IndexType, Writer

from mbaid_ros.bags import BagReader


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


def test_compressed_parts_without_metadata(mcap: Path, tmp_path: Path) -> None:
    folder = tmp_path / 'parts'
    folder.mkdir()
    for part in range(3):
        (folder / f'part_{part}.mcap.zstd').write_bytes(zstd.compress(mcap.read_bytes()))
    assert read(folder) == 3 * read(mcap)
    assert read(folder / 'part_1.mcap.zstd') == read(mcap)
