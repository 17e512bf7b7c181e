"""rosbags' reader of MCAP files, with a chunk's messages taken out of its bytes in one go.

rosbags makes a stream of each record to read it, and a record of each message to sort it: several times what the bytes
themselves cost. The messages, their order and what is refused are the same.
"""

from __future__ import annotations

import struct
from bisect import bisect_left
from collections.abc import Collection, Generator, Iterator, Mapping
from operator import itemgetter
from typing import Any, BinaryIO

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader, ReaderError
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.storage_mcap import ChunkInfo, McapReader, decompress

_MESSAGE = 0x05
_HEAD, _MESSAGE_HEAD = struct.Struct('<BQ'), struct.Struct('<BQHIQQ')  # opcode, length; and those of a message
_OWN = _MESSAGE_HEAD.size - _HEAD.size  # bytes of a message's record that are not data

_Timed = tuple[int, int, Connection, bytes]  # log time (ns), place of the chunk in the file, connection, data


class ChunkReader(McapReader):
    """An MCAP file."""

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Yield (connection, log time in ns, data) in the order of the times."""
        if not self.chunks or start is not None or stop is not None or self.bio is None:
            yield from super().messages(connections, start, stop)
            return
        wanted = {connection.id: connection for connection in connections}
        chunks = [chunk for chunk in self.chunks if any(chunk.channel_count.get(number, 0) for number in wanted)]
        for time, _, connection, data in _in_order(self.bio, chunks, wanted):
            yield connection, time, data


class FolderReader(DirectoryReader):
    """A folder of files and their metadata."""

    STORAGE_PLUGINS: Mapping[str, type[Any]] = {**DirectoryReader.STORAGE_PLUGINS, 'mcap': ChunkReader}


class FastReader(Reader):
    """A file or a folder."""

    STORAGE_PLUGINS: Mapping[str, type[Any]] = {
        **Reader.STORAGE_PLUGINS,
        'dir': FolderReader,
        '.mcap': ChunkReader,
    }


def _in_order(stream: BinaryIO, chunks: Collection[ChunkInfo], wanted: Mapping[int, Connection]) -> Iterator[_Timed]:
    """Yield the messages of chunks by time; of one time, by their place in the file."""
    waiting: list[_Timed] = []
    for chunk in sorted(chunks, key=lambda chunk: chunk.message_start_time):
        # Those of a chunk are no earlier than it says: what is before that can go.
        ready = bisect_left(waiting, chunk.message_start_time, key=itemgetter(0))
        yield from waiting[:ready]
        waiting = sorted([*waiting[ready:], *_content(stream, chunk, wanted)], key=itemgetter(0, 1))
    yield from waiting


def _content(stream: BinaryIO, chunk: ChunkInfo, wanted: Mapping[int, Connection]) -> list[_Timed]:
    """Return the wanted messages of a chunk, as they stand in it.

    Raises
    ------
    ReaderError, struct.error, and what decompression raises
        The chunk is damaged.
    """
    stream.seek(chunk.chunk_start_offset + 9 + 24)
    checksum = int.from_bytes(_exactly(stream, 4), 'little')
    stream.seek(chunk.chunk_start_offset + 9 + 40 + len(chunk.compression))
    packed = _exactly(stream, chunk.compressed_size)
    data = decompress(packed, chunk.compression, chunk.uncompressed_size, checksum)
    begin, end, number = chunk.message_start_time, chunk.message_end_time, chunk.chunk_start_offset
    size, place = len(data), 0
    messages: list[_Timed] = []
    while place < size:
        if data[place] == _MESSAGE:
            _, length, channel, _, time, _ = _MESSAGE_HEAD.unpack_from(data, place)
            after = place + _HEAD.size + length
            if length < _OWN or after > size:
                raise ReaderError(f'Message record of {length} bytes at {place} of a chunk of {size}.')
            if channel in wanted and begin <= time <= end:
                messages.append((time, number, wanted[channel], data[place + _MESSAGE_HEAD.size : after]))
        else:
            after = place + _HEAD.size + _HEAD.unpack_from(data, place)[1]
        place = after
    return messages


def _exactly(stream: BinaryIO, size: int) -> bytes:
    data = stream.read(size)
    if len(data) != size:
        raise ReaderError(f'Truncated record: expected {size} bytes, got {len(data)}.')
    return data
