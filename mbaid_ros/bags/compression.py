"""Decompression that ends at a bound, regardless of the size that the compressed bytes claim."""

from __future__ import annotations

from pathlib import Path
from zlib import crc32

import lz4.frame
from backports import zstd
from rosbags.rosbag2 import ReaderError

from mbaid_ros import limits
from mbaid_ros.errors import DataError

_PIECE = 1_000_000  # bytes
_ZSTD = b'\x28\xb5\x2f\xfd'  # beginning of a zstd frame, but of no message in CDR


def unpacked(data: bytes, most: int, what: str) -> bytes:
    """Return the content of zstd frames; raise a DataError about `what` if it is longer than `most` bytes.

    Damaged data raise a ReaderError or ZstdError.
    """
    parts: list[bytes] = []
    size = 0
    while data:
        frame = zstd.ZstdDecompressor()
        parts.append(frame.decompress(data, max_length=most - size + 1))
        size += len(parts[-1])
        if size > most:
            raise DataError(f'{what} has more than {most} bytes when decompressed, which is the limit')
        if not frame.eof:
            raise ReaderError('compressed data end early')
        data = frame.unused_data
    return b''.join(parts)


def is_compressed(message: bytes) -> bool:
    """Return whether a message was compressed by itself."""
    return message.startswith(_ZSTD)


def unpacked_chunk(data: bytes, compression: str, size: int, checksum: int) -> bytes:
    """Return the records of a chunk, of the size and checksum that it claims; raise a DataError if it is too large.

    Damaged data raise a ReaderError, ZstdError or RuntimeError.
    """
    if max(size, len(data)) > limits.CHUNK_BYTES:
        raise DataError(f'a chunk of {max(size, len(data))} bytes; at most {limits.CHUNK_BYTES} are accepted')
    if compression == 'zstd':
        data = unpacked(data, limits.CHUNK_BYTES, 'a chunk')
    elif compression == 'lz4':
        data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    elif compression:
        raise ReaderError(f'chunks are compressed as {compression!r:.40}; accepted: zstd, lz4')
    if len(data) != size:
        raise ReaderError(f'a chunk has {len(data)} bytes, not the {size} of its header')
    if checksum and crc32(data) != checksum:
        raise ReaderError('the checksum of a chunk is wrong')
    return data


def beginning(data: bytes) -> bytes:
    """Return the readable beginning of a chunk that zstd compressed and whose end is missing."""
    return zstd.ZstdDecompressor().decompress(data, max_length=limits.CHUNK_BYTES)


def unpack_file(source: Path, target: Path) -> None:
    """Decompress a file into another; raise a DataError if it holds far more than a recording of its size."""
    most = max(limits.UNPACKED_BYTES, limits.UNPACKED_RATIO * source.stat().st_size)
    written = 0
    with zstd.open(source, 'rb') as packed, target.open('wb') as file:
        while piece := packed.read(_PIECE):
            written += len(piece)
            if written > most:
                raise DataError(f"'{source}' has more than {most} bytes when decompressed, which is the limit")
            file.write(piece)
