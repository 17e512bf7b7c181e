"""The readable part of a bag file that was cut off while it was written."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path

from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from mbaid_ros import limits
from mbaid_ros.bags.chunks import Block, Raw, in_blocks
from mbaid_ros.bags.compression import beginning, unpacked_chunk
from mbaid_ros.bags.sources import DAMAGE, Topic, by_name, channel_topic

_LARGEST_RECORD = limits.CHUNK_BYTES + 1_000  # bytes: a chunk and its header


class SalvagedSource:
    """An MCAP file without a usable index: read from the start, chunk by chunk, up to where it ends."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._channels: dict[int, Topic] = {}
        self.complete = False
        counts: Counter[int] = Counter()
        schemas: dict[int, Schema] = {}
        for record in self._records():
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                self._channels[record.id] = channel_topic(record, schemas.get(record.schema_id))
            elif isinstance(record, Message):
                counts[record.channel_id] += 1
            elif isinstance(record, Footer):
                self.complete = True
        counted = (replace(topic, count=counts[number]) for number, topic in self._channels.items())
        self.topics, self.left_out = by_name(counted)

    def blocks(self, topics: Collection[str]) -> Iterator[Block]:
        """Yield the messages."""
        yield from in_blocks(self._raw(topics))

    def _raw(self, topics: Collection[str]) -> Iterator[Raw]:
        for record in self._records():
            if isinstance(record, Message) and record.channel_id in self._channels:
                topic = self._channels[record.channel_id]
                if topic.name in topics and topic.type == self.topics[topic.name].type:
                    yield topic.name, record.data, record.log_time

    def _records(self) -> Iterator[McapRecord]:
        """Yield the records, those within chunks included, up to the end or the cut."""
        with self._path.open('rb') as stream:
            size = self._path.stat().st_size
            good = 0
            try:
                most = min(size, _LARGEST_RECORD)
                for record in StreamReader(stream, emit_chunks=True, record_size_limit=most).records:
                    inner = breakup_chunk(_unpacked(record)) if isinstance(record, Chunk) else [record]
                    good = stream.tell()
                    yield from inner
            except DAMAGE:
                stream.seek(good)
                yield from _cut_chunk(stream, size - good)


def _unpacked(chunk: Chunk) -> Chunk:
    """Return a chunk without its compression."""
    data = unpacked_chunk(chunk.data, chunk.compression, chunk.uncompressed_size, chunk.uncompressed_crc)
    return replace(chunk, data=data, compression='')


def _cut_chunk(stream: io.BufferedReader, left: int) -> Iterator[McapRecord]:
    """Yield the records that can still be read from a chunk whose end is missing."""
    head = stream.read(9 + 32)
    if len(head) < 9 + 32 or head[0] != 6 or int.from_bytes(head[1:9], 'little') + 9 <= left:
        return  # not a chunk, or a whole one: then its content is wrong, and there is nothing to trust in it
    name_length = int.from_bytes(head[37:41], 'little')
    if name_length > 16:
        return
    compression = stream.read(name_length)
    stream.read(8)
    data = stream.read(limits.CHUNK_BYTES)
    try:
        if compression == b'zstd':
            data = beginning(data)
        elif compression:
            return  # by another compression, what precedes the cut is lost with the rest of the chunk
        yield from StreamReader(io.BytesIO(data), skip_magic=True, record_size_limit=len(data)).records
    except DAMAGE:
        return  # the cut
