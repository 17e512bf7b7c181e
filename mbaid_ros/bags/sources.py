"""Sources of a bag's messages: a complete file, or the readable part of a file that was cut off."""

from __future__ import annotations

import io
import struct
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import apsw
import zstandard
from backports.zstd import ZstdError
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from rosbags.interfaces import Connection, MessageDefinitionFormat, Qos, QosDurability, QosReliability
from rosbags.rosbag2 import ReaderError

from mbaid_ros import limits
from mbaid_ros.bags.chunks import Block, ChunkReader, Raw, in_blocks
from mbaid_ros.bags.compression import beginning, unpacked_chunk
from mbaid_ros.bags.sqlite import SqliteReader
from mbaid_ros.bags.writer import parse_profiles

_LARGEST_RECORD = limits.CHUNK_BYTES + 1_000  # bytes: a chunk and its header

# Exceptions of the libraries on damaged files: their own, and all those of parsing wrong bytes.
DAMAGE = (
    *(ReaderError, McapError, apsw.Error, ZstdError, zstandard.ZstdError),
    *(struct.error, ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, MemoryError),
    *(RuntimeError, SyntaxError, TypeError, ValueError),
)


@dataclass(frozen=True)
class Topic:
    """A topic of a bag."""

    name: str
    type: str
    count: int
    definition: str  # text of the message's definition, OMG IDL if `idl`, else .msg; empty where the bag has none
    idl: bool
    latched: bool  # True if the publisher offered transient local
    reliable: bool  # True unless every publisher offered best effort only
    encoding: str = 'cdr'


def by_name(found: Iterable[Topic]) -> tuple[dict[str, Topic], Counter[str]]:
    """Return topics by name, and of those that have several types how many messages are not of the first."""
    topics: dict[str, Topic] = {}
    left_out: Counter[str] = Counter()
    for topic in found:
        first = topics.setdefault(topic.name, replace(topic, count=0))
        if topic.type == first.type:
            topics[topic.name] = replace(topic, count=first.count + topic.count)
        else:
            left_out[topic.name] += topic.count
    return topics, left_out


class IndexedSource:
    """A complete file, read through its index and open only meanwhile; another raises one of DAMAGE, or an OSError."""

    def __init__(self, path: Path) -> None:
        self.complete = True
        self._path = path
        with _opened(path) as reader:
            self.topics, self.left_out = by_name(map(_topic, reader.connections))

    def blocks(self, topics: Collection[str]) -> Iterator[Block]:
        """Yield the messages."""
        with _opened(self._path) as reader:
            connections = (each for each in reader.connections if each.topic in topics)
            chosen = [each for each in connections if self.topics[each.topic].type == each.msgtype]
            if chosen:  # the reader takes an empty selection for all
                yield from reader.blocks(chosen)


@contextmanager
def _opened(path: Path) -> Iterator[ChunkReader | SqliteReader]:
    kinds: dict[str, type[ChunkReader | SqliteReader]] = {'.mcap': ChunkReader, '.db3': SqliteReader}
    if path.suffix not in kinds:
        raise ReaderError(f'{path.suffix!r:.40} is no bag')
    reader = kinds[path.suffix](path)
    reader.open()
    with closing(reader):
        yield reader


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
                self._channels[record.id] = _channel_topic(record, schemas.get(record.schema_id))
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


Source = IndexedSource | SalvagedSource  # one file; `left_out` counts messages of another type by topic


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


def _topic(connection: Connection) -> Topic:
    extension: Any = connection.ext
    latched, reliable = _offered(extension.offered_qos_profiles)
    return Topic(
        name=connection.topic,
        type=connection.msgtype,
        count=connection.msgcount,
        definition=connection.msgdef.data,
        idl=connection.msgdef.format == MessageDefinitionFormat.IDL,
        latched=latched,
        reliable=reliable,
        encoding=extension.serialization_format,
    )


def _channel_topic(channel: Channel, schema: Schema | None) -> Topic:
    try:
        latched, reliable = _offered(parse_profiles(channel.metadata.get('offered_qos_profiles', '')))
    except DAMAGE:
        latched, reliable = False, True  # as most publishers offer
    return Topic(
        name=channel.topic,
        type='' if schema is None else schema.name,
        count=0,
        definition='' if schema is None else schema.data.decode('utf-8', 'replace'),
        idl=schema is not None and schema.encoding != 'ros2msg',
        latched=latched,
        reliable=reliable,
        encoding=channel.message_encoding,
    )


def _offered(profiles: list[Qos]) -> tuple[bool, bool]:
    """Return whether publishers with these profiles latched, and whether any was reliable."""
    latched = any(profile.durability == QosDurability.TRANSIENT_LOCAL for profile in profiles)
    best_effort = bool(profiles) and all(profile.reliability == QosReliability.BEST_EFFORT for profile in profiles)
    return latched, not best_effort
