"""Records that hold one array a quantity, all with the same leading axis."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, TypeVar

import numpy as np
import numpy.typing as npt

S = TypeVar('S', bound='Stacked')
Index = int | slice | npt.NDArray[np.bool_] | npt.NDArray[np.intp]


class Stacked:
    """A frozen dataclass of arrays whose first axes go together; the base of such classes."""

    __slots__ = ()
    __dataclass_fields__: ClassVar[dict[str, Any]]  # `fields` of it takes longer than to slice the arrays

    def __len__(self) -> int:
        """Return how many entries there are."""
        return len(getattr(self, next(iter(self.__dataclass_fields__))))

    def __getitem__(self: S, index: Index) -> S:
        """Return some of the entries: a slice, or those that a mask or indices choose; one, without the axis."""
        return type(self)(*[getattr(self, name)[index] for name in self.__dataclass_fields__])

    def each(self: S) -> Iterator[S]:
        """Yield the entries one by one, each with a leading axis of one."""
        return (self[k : k + 1] for k in range(len(self)))

    @classmethod
    def concatenate(cls: type[S], parts: Sequence[S]) -> S:
        """Return the entries of the parts, in order."""
        if len(parts) == 1:
            return parts[0]
        return cls(*[np.concatenate([getattr(part, name) for part in parts]) for name in cls.__dataclass_fields__])
