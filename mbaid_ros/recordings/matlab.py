"""MAT files of version 5, read within bounds: their size once decompressed is known before anything is made of them."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path
from typing import Any

from mbaid_ros import limits
from mbaid_ros.core.errors import DataError
from mbaid_ros.files import require_regular

_HEADER, _TAG, _COMPRESSED = 128, 8, 15


def read_matlab(path: Path, names: tuple[str, ...]) -> dict[str, Any]:
    """Return variables of a MAT file: arrays, and structures as objects with their fields.

    Parameters
    ----------
    path : the file
    names : of the variables

    Raises
    ------
    DataError
        The file cannot be read, is too large, or lacks one of them.
    """
    content = _content(path)
    from scipy.io import loadmat  # noqa: PLC0415 - takes a while, and only these logs need it
    from scipy.io.matlab import MatReadError  # noqa: PLC0415

    try:
        found = loadmat(io.BytesIO(content), variable_names=names, struct_as_record=False, squeeze_me=True)
    except (
        MatReadError,
        ValueError,
        TypeError,
        LookupError,
        OverflowError,
        MemoryError,
        NotImplementedError,
        OSError,
    ) as error:
        raise DataError(f"'{path}' is no MAT file that can be read: {error}; accepted: version 5 to 7") from error
    missing = [name for name in names if name not in found]
    if missing:
        raise DataError(f"'{path}' lacks the variable '{missing[0]}'; accepted: {', '.join(names)}")
    return found


def _content(path: Path) -> bytes:
    """Return the bytes of a file once it is known that they do not become too many."""
    require_regular(path, 'log')
    size = path.stat().st_size
    if size > limits.LOG_BYTES:
        raise DataError(f"log '{path}' has {size} bytes; at most {limits.LOG_BYTES} are accepted")
    content = path.read_bytes()
    if len(content) < _HEADER or content[126:128] not in {b'IM', b'MI'}:
        raise DataError(f"'{path}' is no MAT file; accepted: version 5 to 7")
    order = '<' if content[126:128] == b'IM' else '>'
    place, total = _HEADER, 0
    while place + _TAG <= len(content):
        kind, length = struct.unpack_from(f'{order}II', content, place)
        if kind == _COMPRESSED:
            total += _unpacked(content[place + _TAG : place + _TAG + length], limits.LOG_BYTES - total, path)
        place += _TAG + length
    return content


def _unpacked(part: bytes, limit: int, path: Path) -> int:
    """Return how many bytes a compressed part becomes."""
    unpacking = zlib.decompressobj()
    try:
        count = len(unpacking.decompress(part, limit + 1))
    except zlib.error as error:
        raise DataError(f"'{path}' is no MAT file that can be read: {error}") from error
    if count > limit:
        raise DataError(f"log '{path}' is larger than {limits.LOG_BYTES} bytes once decompressed, which is the limit")
    return count
