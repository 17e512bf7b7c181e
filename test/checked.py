"""Small checks that many tests make."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from typing import TypeVar

import numpy as np
import pytest

from mbaid_ros.core.geometry import Array
from mbaid_ros.tasks import Work

Thing = TypeVar('Thing')


def some(thing: Thing | None) -> Thing:
    """Return what must not be None."""
    assert thing is not None
    return thing


def returned(bits: Work[Thing]) -> Thing:
    """Return what work comes to."""
    found: list[Thing] = []

    def whole() -> Iterator[int]:
        found.append((yield from bits))

    assert all(steps >= 0 for steps in whole())
    return found[0]


def answer(
    command: Callable[[list[str]], int], capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0
) -> str:
    """Return all that a command says: its output, or with another exit code than 0 its one line of error."""
    assert command(list(arguments)) == code
    captured = capsys.readouterr()
    if not code:
        assert not captured.err
        return captured.out
    assert not captured.out
    first = getattr(command, 'args', ('',))[0]  # of the commands in replay.start their name
    name = first if isinstance(first, str) and first else '[a-z_]+'
    assert re.fullmatch(rf'mbaid_ros {name}: [^\n]+\n', captured.err)
    return captured.err


def same(one: object, other: object) -> bool:
    """Return whether two records, or sequences of them, hold the same numbers to the last bit; NaN equals NaN."""
    if isinstance(one, np.ndarray):
        return np.array_equal(one, np.asarray(other), equal_nan=one.dtype.kind == 'f')
    if is_dataclass(one):
        return all(same(getattr(one, item.name), getattr(other, item.name)) for item in fields(one))
    if isinstance(one, tuple | list) and isinstance(other, tuple | list):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other or (isinstance(one, float) and isinstance(other, float) and np.isnan(one) and np.isnan(other))


def central_difference(function: Callable[[Array], Array], point: Array, step: float | Array) -> Array:
    """Return d function / d point by central differences, (..., n) with the function's own axes first.

    Parameters
    ----------
    function : of an (n,) array
    point : (n,)
    step : of every coordinate, or (n,) of each: the error is of the order step^2, and of rounding / step
    """
    steps = np.broadcast_to(step, point.shape)
    columns = []
    for index, size in enumerate(steps):
        change = np.zeros(len(point))
        change[index] = size
        columns.append((np.asarray(function(point + change)) - np.asarray(function(point - change))) / (2.0 * size))
    return np.stack(columns, axis=-1)


def generic(seed: int, *shape: int) -> Array:
    """Return numbers of either sign: none is near zero, and no two vectors along the last axis are parallel.

    A wrong sign, factor or index changes whatever is computed at such a point.
    """
    rng = np.random.default_rng(seed)
    while True:
        point = rng.uniform(0.3, 1.0, shape) * rng.choice([-1.0, 1.0], shape)
        vectors = point.reshape(-1, shape[-1])
        cosines = np.triu(vectors @ vectors.T / np.outer(*(np.linalg.norm(vectors, axis=1),) * 2), 1)
        if shape[-1] < 2 or np.abs(cosines).max() < 0.95:
            return point


def assert_derivative(found: Array, function: Callable[[Array], Array], point: Array, *, step: float = 1e-5) -> None:
    """Compare a derivative (..., n) with central differences of a function at a point (n,), and require its change.

    Each coordinate has to change the function: a derivative of zero would be no test.
    """
    expected = central_difference(function, point, step)
    size = np.abs(expected).max(axis=tuple(range(expected.ndim - 1)))
    assert np.all(size > 0.0), 'the function does not depend on some coordinates at this point'
    assert found == pytest.approx(expected, abs=1e-7 * float(size.max()))
