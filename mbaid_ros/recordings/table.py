"""Tables of numbers as loggers write them: rows of text with a separator, a line of names or none."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mbaid_ros import limits
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.geometry import Array
from mbaid_ros.files import read_text

_TEXT = 40  # characters of a value that an error shows


@dataclass(frozen=True)
class Table:
    """N rows of k numbers.

    Attributes
    ----------
    path : of the file
    names : of its columns; empty where the file does not say
    values : (N, k); NaN where a field is empty or says so, or is infinite
    """

    path: Path
    names: tuple[str, ...]
    values: Array


def read_table(path: Path, separator: str = ',', *, header: bool) -> Table:
    """Return a table of text.

    Parameters
    ----------
    path : the file
    separator : one character
    header : whether the first line has the names of the columns

    Raises
    ------
    DataError
        The file cannot be read, a row has another length than the first, or a field is no number.
    """
    text = read_text(path, 'log', limits.LOG_BYTES, 'accepted: a table of text', DataError)
    lines = text.splitlines()
    names: tuple[str, ...] = ()
    if header and lines:
        names = tuple(name.strip() for name in next(csv.reader(lines[:1], delimiter=separator)))
    rows = [(number, line) for number, line in enumerate(lines[bool(names) :], 1 + bool(names)) if line.strip()]
    if not rows:
        raise DataError(f"log '{path}' has no rows of numbers")
    count = len(names) or rows[0][1].count(separator) + 1
    if count > limits.LOG_COLUMNS:
        raise DataError(f"log '{path}' has {count} columns; at most {limits.LOG_COLUMNS} are accepted")
    values = np.array([_row(line, separator, count, number, path) for number, line in rows])
    values[np.isinf(values)] = np.nan
    return Table(path, names, values)


def _row(line: str, separator: str, count: int, number: int, path: Path) -> list[float]:
    fields = line.split(separator)
    if len(fields) != count:
        raise DataError(f"log '{path}' has {len(fields)} fields in line {number}; accepted: {count}, as in the first")
    try:
        return [float(field) if field.strip() else np.nan for field in fields]
    except ValueError:
        bad = next(field for field in fields if field.strip() and not _is_number(field))
        raise DataError(f"log '{path}' has '{bad.strip()[:_TEXT]}' in line {number}; accepted: a number") from None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
