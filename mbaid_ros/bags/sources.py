"""The topics and messages of a complete bag file; `salvage.py` has those of a file that was cut off."""

from __future__ import annotations

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
from mcap.records import Channel, Schema
from rosbags.interfaces import Connection, MessageDefinitionFormat, Qos, QosDurability, QosReliability
from rosbags.rosbag2 import ReaderError

from mbaid_ros.bags.chunks import Block, ChunkReader
from mbaid_ros.bags.sqlite import SqliteReader
from mbaid_ros.bags.writer import parse_profiles

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


def channel_topic(channel: Channel, schema: Schema | None) -> Topic:
    """Return the topic of a channel in an MCAP file; one without a schema has no definition."""
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
