"""Messages of a bag as columns, a block at a time; MCAP files read chunk by chunk."""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt
from rosbags.interfaces import Connection
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.storage_mcap import ChunkInfo, McapReader

from mbaid_ros import limits
from mbaid_ros.bags.compression import unpacked_chunk
from mbaid_ros.core.samples import Stamps
from mbaid_ros.errors import DataError

Raw = tuple[str, bytes, int]  # topic, CDR bytes, and the time it was recorded at, ns

_AT_ONCE = 1_000
MCAP_MAGIC = b'\x89MCAP0\r\n'
LATEST = 2**63 - 1  # ns: later times, which are none, count as this


@dataclass(frozen=True)
class Block:
    """N messages in recorded order: topic, CDR bytes and time of each, (N,) ns."""

    topics: list[str]
    contents: list[bytes]
    times: Stamps

    def __len__(self) -> int:
        return len(self.topics)

    def __iter__(self) -> Iterator[Raw]:
        return zip(self.topics, self.contents, self.times.tolist(), strict=True)

    def part(self, begin: int, end: int | None = None) -> Block:
        """Return some that follow one another."""
        return Block(self.topics[begin:end], self.contents[begin:end], self.times[begin:end])

    def select(self, places: npt.NDArray[np.intp]) -> Block:
        """Return those at places, in that order."""
        chosen = places.tolist()
        return Block([self.topics[k] for k in chosen], [self.contents[k] for k in chosen], self.times[places])

    def extended(self, other: Block) -> Block:
        """Return these and the bytes after them."""
        times = np.concatenate((self.times, other.times))
        return Block(self.topics + other.topics, self.contents + other.contents, times)


def in_blocks(messages: Iterable[Raw]) -> Iterator[Block]:
    """Yield messages in blocks; where reading them fails, those before come first."""
    part: list[Raw] = []
    size = 0
    try:
        for message in messages:
            part.append(message)
            size += len(message[1])
            if len(part) == _AT_ONCE or size > limits.BLOCK_BYTES:
                yield _block(part)
                part, size = [], 0
    except Exception:
        yield _block(part)
        raise
    yield _block(part)


def _block(messages: Sequence[Raw]) -> Block:
    topics, contents, times = zip(*messages, strict=True) if messages else ((), (), ())
    return Block(list(topics), list(contents), np.array([min(time, LATEST) for time in times], dtype=np.int64))


Timed = tuple[str, Any, int]  # topic, message, and the time it was recorded at, ns


@dataclass(frozen=True)
class Batch:
    """N messages: the topic of each in recorded order; each topic's messages (a list, or `Packets`) and times, ns."""

    topics: Sequence[str]
    messages: Mapping[str, Sequence[Any]]
    times: Mapping[str, Stamps]

    def __len__(self) -> int:
        return len(self.topics)

    def __iter__(self) -> Iterator[Timed]:
        left = {topic: zip(self.on_topic(topic), self.times[topic].tolist(), strict=True) for topic in self.messages}
        return ((topic, *next(left[topic])) for topic in self.topics)

    def on_topic(self, topic: str) -> Sequence[Any]:
        """Return the messages of a topic."""
        return self.messages.get(topic, ())

    def runs(self, topic: str) -> Iterator[Batch]:
        """Yield the same messages in parts: those of a topic that follow one another, and those between them."""
        if topic not in self.messages:
            yield self
            return
        done = dict.fromkeys(self.messages, 0)
        for _, group in groupby(self.topics, key=topic.__eq__):
            names = list(group)
            some = {name: slice(done[name], done[name] + names.count(name)) for name in dict.fromkeys(names)}
            yield Batch(
                names,
                {name: self.messages[name][part] for name, part in some.items()},
                {name: self.times[name][part] for name, part in some.items()},
            )
            done.update({name: part.stop for name, part in some.items()})


_MESSAGE, _CHANNEL, _ENDS = 0x05, 0x04, (0x02, 0x0E)
_LENGTH = struct.Struct('<xQ').unpack_from  # of a record, after its opcode
_BEFORE = 9  # bytes of a record before its content
_HEAD = np.dtype([('opcode', 'u1'), ('length', '<u8'), ('channel', '<u2'), ('sequence', '<u4'), ('times', '<u8', 2)])
_OWN = _HEAD.itemsize - _BEFORE  # bytes of a message's content that are not data


class UnindexedError(ReaderError):
    """A file without an index of chunks: it may be whole, and can be read from its start."""


class ChunkReader(McapReader):
    """An MCAP file with an index of its chunks."""

    def blocks(self, connections: Collection[Connection]) -> Iterator[Block]:
        """Yield the messages of connections in the order of their times."""
        if self.bio is None:
            raise ReaderError('the file is not open')
        topics = {connection.id: connection.topic for connection in connections}
        chunks = [chunk for chunk in self.chunks if any(chunk.channel_count.get(number, 0) for number in topics)]
        yield from _in_order(self.bio, chunks, topics)

    def open(self) -> None:
        """Open the file and read its index; raise an UnindexedError if it has none, or none of its messages."""
        super().open()
        if not self.chunks or not all(chunk.channel_count for chunk in self.chunks):
            self.close()
            raise UnindexedError('no index of chunks, or none of their messages')

    def meta_scan(self) -> None:
        """Refuse to search for entries that the index lacks: that decompresses without a bound."""
        raise UnindexedError('no index')

    def read_index(self) -> None:
        """Read the index, after a look at how much there is to parse in it."""
        if self.bio is None:
            raise ReaderError('the file is not open')
        place, total = self.data_end, 0
        while True:
            self.bio.seek(place)
            head = self.bio.read(_BEFORE)
            if len(head) < _BEFORE or head[0] in _ENDS:
                break
            length = _LENGTH(head)[0]
            total += length if head[0] == _CHANNEL else 0
            if total > limits.CHANNEL_BYTES:
                most = f'{limits.CHANNEL_BYTES} bytes, which is the limit'
                raise DataError(f"bag '{self.path}' describes its channels in more than {most}")
            place += _BEFORE + length
        super().read_index()


def _in_order(stream: BinaryIO, chunks: Collection[ChunkInfo], topics: Mapping[int, str]) -> Iterator[Block]:
    """Yield the messages of chunks by time; of one time, by their place in the file."""
    waiting: dict[int, Block] = {}  # by the place of the chunk in the file
    for chunk in sorted(chunks, key=lambda chunk: chunk.message_start_time):
        # Those of a chunk are no earlier than its start: earlier ones can go.
        yield _popped_before(waiting, chunk.message_start_time)
        if sum(len(data) for block in waiting.values() for data in block.contents) > limits.OVERLAP_BYTES:
            raise DataError(
                f'chunks that overlap in time contain more than {limits.OVERLAP_BYTES} bytes, which is the limit'
            )
        waiting[chunk.chunk_start_offset] = _content(stream, chunk, topics)
    yield _popped_before(waiting, np.inf)


def _popped_before(waiting: dict[int, Block], end: float) -> Block:
    """Take the messages before a time (ns) out of chunks, and return them in order."""
    ready = _block([])
    for place, block in sorted(waiting.items()):
        early = block.times < end
        ready = ready.extended(block.select(np.flatnonzero(early)))
        waiting[place] = block.select(np.flatnonzero(~early))
        if not len(waiting[place]):
            del waiting[place]
    return ready.select(np.argsort(ready.times, kind='stable'))


def _content(stream: BinaryIO, chunk: ChunkInfo, topics: Mapping[int, str]) -> Block:
    """Return the messages of some channels in a chunk, in their order; raise one of DAMAGE if it is damaged."""
    if chunk.compressed_size > limits.CHUNK_BYTES:
        raise DataError(f'a chunk of {chunk.compressed_size} bytes; at most {limits.CHUNK_BYTES} are accepted')
    stream.seek(chunk.chunk_start_offset + 9 + 24)
    checksum = int.from_bytes(_exactly(stream, 4), 'little')
    stream.seek(chunk.chunk_start_offset + 9 + 40 + len(chunk.compression))
    packed = _exactly(stream, chunk.compressed_size)
    data = unpacked_chunk(packed, chunk.compression, chunk.uncompressed_size, checksum)
    begin, head = _heads(data)
    first, last = chunk.message_start_time, chunk.message_end_time
    time = head['times'][:, 0]
    chosen = np.isin(head['channel'], list(topics)) & (time >= first) & (time <= last)
    begin, head, time = begin[chosen], head[chosen], time[chosen]
    end = begin + _BEFORE + head['length'].astype(np.intp)
    contents = [data[i:j] for i, j in zip((begin + _HEAD.itemsize).tolist(), end.tolist(), strict=True)]
    names = [topics[channel] for channel in head['channel'].tolist()]
    return Block(names, contents, np.minimum(time, LATEST).astype(np.int64))


def _heads(data: bytes) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.void]]:
    """Return the begins of the message records in the content of a chunk, (N,), and the bytes before their data."""
    size, place = len(data), 0
    places = []
    while place < size:
        places.append(place)
        place += _BEFORE + _LENGTH(data, place)[0]
    begin = np.array(places, dtype=np.intp)
    content = np.frombuffer(data, np.uint8)
    is_message = content[begin] == _MESSAGE
    length = np.diff(begin, append=place) - _BEFORE
    wrong = is_message & ((length < _OWN) | (begin + _BEFORE + length > size))
    if np.any(wrong):
        at = int(np.argmax(wrong))
        raise ReaderError(f'Message record of {length[at]} bytes at {begin[at]} of a chunk of {size}.')
    begin = begin[is_message]
    return begin, content[begin[:, None] + np.arange(_HEAD.itemsize)].view(_HEAD)[:, 0]


def _exactly(stream: BinaryIO, size: int) -> bytes:
    data = stream.read(size)
    if len(data) != size:
        raise ReaderError(f'Truncated record: expected {size} bytes, got {len(data)}.')
    return data
