"""Records that hold one array a quantity, all with the same leading axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
import numpy.typing as npt

S = TypeVar('S', bound='ArrayRecord')
Index = int | slice | npt.NDArray[np.bool_] | npt.NDArray[np.intp]


class ArrayRecord:
    """A frozen dataclass of arrays whose first axes go together; the base of such classes."""

    __slots__ = ()
    __dataclass_fields__: ClassVar[dict[str, Any]]  # `fields` of it takes longer than to slice the arrays

    def __len__(self) -> int:
        """Return how many entries there are."""
        return len(getattr(self, next(iter(self.__dataclass_fields__))))

    def __getitem__(self: S, index: Index) -> S:
        """Return a slice of the entries, or those of a mask or of indices; a single one without the axis."""
        return type(self)(*[getattr(self, name)[index] for name in self.__dataclass_fields__])

    @classmethod
    def concatenate(cls: type[S], parts: Sequence[S]) -> S:
        """Return the entries of the parts, in order."""
        if len(parts) == 1:
            return parts[0]
        return cls(*[np.concatenate([getattr(part, name) for part in parts]) for name in cls.__dataclass_fields__])


class Queue(Generic[S]):
    """Entries that join at the end and leave at the front, in one piece of memory; `entries` is a read-only view."""

    def __init__(self, entries: S) -> None:
        self.entries = self._room = entries
        self._start, self._end = 0, len(entries)

    def __len__(self) -> int:
        """Return how many entries there are."""
        return self._end - self._start

    def append(self, more: S) -> None:
        """Add further entries."""
        if not len(self):
            self.entries = self._room = more
            self._start, self._end = 0, len(more)
            return
        end = self._end + len(more)
        if end <= len(self._room):
            for name in more.__dataclass_fields__:
                getattr(self._room, name)[self._end : end] = getattr(more, name)
            self._end = end
        else:
            # Room for twice as many: entries are copied seldom.
            both = type(more).concatenate([self.entries, more])
            self._room = type(more).concatenate([both, both])
            self._start, self._end = 0, len(both)
        self.entries = self._room[self._start : self._end]

    def drop(self, count: int) -> None:
        """Drop the first entries."""
        self._start = min(self._start + count, self._end)
        self.entries = self.entries[count:]
