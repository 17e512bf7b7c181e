"""Small checks that many tests make."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import TypeVar

import numpy as np

Thing = TypeVar('Thing')


def some(thing: Thing | None) -> Thing:
    """Return what must not be None."""
    assert thing is not None
    return thing


def same(one: object, other: object) -> bool:
    """Return whether two records, or sequences of them, hold the same numbers to the last bit; NaN equals NaN."""
    if isinstance(one, np.ndarray):
        return np.array_equal(one, np.asarray(other), equal_nan=one.dtype.kind == 'f')
    if is_dataclass(one):
        return all(same(getattr(one, item.name), getattr(other, item.name)) for item in fields(one))
    if isinstance(one, tuple | list) and isinstance(other, tuple | list):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other or (isinstance(one, float) and isinstance(other, float) and np.isnan(one) and np.isnan(other))
