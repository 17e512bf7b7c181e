"""Damage: bytes in, other bytes out, by a generator alone."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

Damage = Callable[[bytes, np.random.Generator], bytes]
_Item = TypeVar('_Item')
_TOKEN = re.compile(rb'[-+]?\d+(\.\d+)?([eE][-+]?\d+)?|[A-Za-z_]\w*')
_VALUES = (
    *(b'0', b'-1', b'1e308', b'-1e-308', b'nan', b'inf', b'null', b'true', b'""', b'[]', b'{}', b'[[[[1]]]]'),
    *(b'x' * 600, b'1' + b'0' * 400, b'0x' + b'f' * 5_000, b'1:' * 300 + b'1', b'*', b'**' * 50, b'<<'),
    *(b'!!python/name:os', b'&a'),
)
NUMBERS = (0, 1, 2**31 - 1, 2**32 - 1, 2**40, 2**63, 2**64 - 1)


def one(choices: Sequence[_Item], generator: np.random.Generator) -> _Item:
    """Return one of some things."""
    return choices[int(generator.integers(0, len(choices)))]


def flipped(data: bytes, generator: np.random.Generator) -> bytes:
    """Return the bytes with some bits flipped."""
    array = np.frombuffer(data, dtype=np.uint8).copy()
    for place in generator.integers(0, len(array), generator.integers(1, 20)) if len(array) else ():
        array[place] ^= 1 << int(generator.integers(0, 8))
    return array.tobytes()


def cut(data: bytes, generator: np.random.Generator) -> bytes:
    """Return the beginning of the bytes."""
    return data[: int(generator.integers(0, len(data) + 1))]


def spliced(data: bytes, generator: np.random.Generator) -> bytes:
    """Return the bytes with one part put into another place, or taken out."""
    begin, end, place = sorted(int(x) for x in generator.integers(0, len(data) + 1, 3))
    if generator.random() < 0.5:
        return data[:begin] + data[end:]
    return data[:place] + data[begin:end] + data[place:]


def overwritten(data: bytes, generator: np.random.Generator) -> bytes:
    """Return the bytes with a number written over them: lengths that ask for gigabytes, zeros, ones."""
    value, size = one(NUMBERS, generator), one((4, 8), generator)
    place = int(generator.integers(0, max(1, len(data) - size)))
    return data[:place] + (value % 2 ** (8 * size)).to_bytes(size, 'little') + data[place + size :]


def replaced(data: bytes, generator: np.random.Generator) -> bytes:
    """Return the text with some numbers or words replaced."""
    for _ in range(int(generator.integers(1, 4))):
        tokens = list(_TOKEN.finditer(data))
        if tokens:
            chosen = one(tokens, generator)
            data = data[: chosen.start()] + one(_VALUES, generator) + data[chosen.end() :]
    return data


def shuffled(data: bytes, generator: np.random.Generator) -> bytes:
    """Return the lines with one moved, repeated many times, or taken out."""
    lines = data.splitlines(keepends=True)
    taken = lines.pop(int(generator.integers(0, len(lines))))
    lines.insert(int(generator.integers(0, len(lines) + 1)), taken * one((0, 1, 2, 1_000), generator))
    return b''.join(lines)


OF_BYTES: tuple[Damage, ...] = (flipped, cut, spliced, overwritten)
OF_TEXT: tuple[Damage, ...] = (*OF_BYTES, replaced, replaced, replaced, shuffled)


def of_bytes(data: bytes, generator: np.random.Generator) -> bytes:
    """Return any bytes damaged in one way."""
    return one(OF_BYTES, generator)(data, generator)


def of_text(data: bytes, generator: np.random.Generator) -> bytes:
    """Return a text damaged in one way."""
    return one(OF_TEXT, generator)(data, generator)
