"""Monte Carlo runs, spread over processes, that a file keeps: those that it holds are not made again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from mbaid_ros.core.array_record import ArrayRecord
from mbaid_ros.core.geometry import Array

_KEPT_EVERY = 10  # runs

Outcome = TypeVar('Outcome', bound='Runs')
Work = TypeVar('Work')


@dataclass(frozen=True)
class Runs(ArrayRecord):
    """What runs said: each field of a subclass is an array with the runs as its leading axis."""

    @classmethod
    def of(cls: type[Outcome], array: Callable[[str], Array]) -> Outcome:
        """Return runs by what gives the array of each field's name."""
        arrays: dict[str, Any] = {item.name: array(item.name) for item in fields(cls)}
        return cls(**arrays)

    @classmethod
    def stack(cls: type[Outcome], runs: Sequence[object]) -> Outcome:
        """Return several runs, each of which has the fields without the leading axis."""
        return cls.of(lambda name: np.array([getattr(run, name) for run in runs]))


def completed(
    kind: type[Outcome],
    file: Path | None,
    work: Sequence[Work],
    run: Callable[[Work], object],
    pool: Executor,
    bar: Any,
) -> Outcome:
    """Return all of some runs: those that a file holds, and those that it lacks, which it is given.

    Parameters
    ----------
    kind : of what is returned
    file : .npz of the first runs, of fewer or more than are wanted; None keeps nothing
    work : what each run is given, one at least
    run : makes one and returns an object with the fields of `kind`
    pool : in which it works
    bar : of tqdm, told of every run
    """
    parts = []
    if file is not None and file.is_file():
        with np.load(file) as arrays:
            parts.append(kind.of(arrays.__getitem__))
    done = min(len(parts[0]), len(work)) if parts else 0
    bar.update(done)
    missing = _counted(pool.map(run, work[done:]), bar)
    while found := list(islice(missing, _KEPT_EVERY)):
        parts.append(kind.stack(found))
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
            np.savez(file, **vars(kind.concatenate(parts)))
    return kind.concatenate(parts)[: len(work)]


def _counted(runs: Iterable[object], bar: Any) -> Iterator[object]:
    for run in runs:
        yield run
        bar.update(1)
