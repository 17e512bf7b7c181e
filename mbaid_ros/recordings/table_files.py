"""Tables: text, and MAT files of version 5, whose size once decompressed is bounded before they are parsed."""

from __future__ import annotations

import csv
import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from mbaid_ros import limits
from mbaid_ros.core.geometry import Array
from mbaid_ros.errors import DataError
from mbaid_ros.files import read_text, require_regular

_HEADER, _TAG, _COMPRESSED = 128, 8, 15
_SEPARATORS = 10 * limits.LOG_COLUMNS  # of a line, those in quotes included
_SHOWN = 40  # characters of a value that an error shows
# Errors that SciPy raises on damaged files, beside its own.
_DAMAGE = (ValueError, TypeError, LookupError, OverflowError, MemoryError, NotImplementedError, OSError)


def read_matlab(path: Path, names: tuple[str, ...]) -> dict[str, Any]:
    """Return variables of a MAT file by name: arrays, and structures as objects with their fields.

    Raises DataError: The file cannot be read, is too large, or lacks one of them.
    """
    content = _content(path)
    from scipy.io import loadmat  # noqa: PLC0415 - takes a while, and only these logs need it
    from scipy.io.matlab import MatReadError  # noqa: PLC0415

    try:
        found = loadmat(io.BytesIO(content), variable_names=names, struct_as_record=False, squeeze_me=True)
    except (MatReadError, *_DAMAGE) as error:
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


@dataclass(frozen=True)
class Table:
    """N rows of k numbers."""

    path: Path
    names: tuple[str, ...]  # of its columns; empty where the file has none
    values: Array  # (N, k); NaN where a field is empty, NaN or infinite


def read_table(path: Path, separator: str = ',', *, header: bool) -> Table:
    """Return a table of text; with a header, the first line has the names of the columns.

    Raises DataError: The file cannot be read, a row has another length than the first, or a field is no number.
    """
    text = read_text(path, 'log', limits.LOG_BYTES, 'accepted: a table of text', DataError)
    rows = _rows(text, separator, path)
    names = tuple(name.strip() for name in next(rows, (0, []))[1]) if header else ()
    first = next(rows, None)
    if first is None:
        raise DataError(f"log '{path}' has no rows of numbers")
    count = len(names) or len(first[1])
    values = np.array([_numbers(fields, count, number, path) for number, fields in chain((first,), rows)])
    values[np.isinf(values)] = np.nan
    return Table(path, names, values)


def _rows(text: str, separator: str, path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of each line that is not empty, and its fields; quoted ones without their quotes."""
    spaced = not separator.isspace()
    lines = text.splitlines()
    many = next((number for number, line in enumerate(lines, 1) if line.count(separator) > _SEPARATORS), 0)
    if many:
        raise DataError(f"log '{path}' has more than {_SEPARATORS} separators in line {many}, which is the limit")
    number = 0
    try:
        reader = csv.reader((f'{line}\n' for line in lines), delimiter=separator, skipinitialspace=spaced)
        for fields in reader:
            number, begin = reader.line_num, number + 1
            if any(map(str.strip, fields)) or (spaced and len(fields) > 1):
                if len(fields) > limits.LOG_COLUMNS:
                    most = f'at most {limits.LOG_COLUMNS} are accepted'
                    raise DataError(f"log '{path}' has {len(fields)} columns; {most}")
                yield begin, fields
    except (csv.Error, TypeError, ValueError) as error:
        raise DataError(f"log '{path}' cannot be read from line {number + 1} on: {error}") from error


def _numbers(fields: list[str], count: int, number: int, path: Path) -> list[float]:
    if len(fields) != count:
        raise DataError(f"log '{path}' has {len(fields)} fields in line {number}; accepted: {count}, as in the first")
    try:
        return [float(field) if field.strip() else np.nan for field in fields]
    except ValueError:
        bad = next(field for field in fields if field.strip() and not _is_number(field))
        shown = ' '.join(bad.split())[:_SHOWN]
        raise DataError(f"log '{path}' has '{shown}' in line {number}; accepted: a number") from None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
