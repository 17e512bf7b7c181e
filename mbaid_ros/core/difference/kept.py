"""The windows that are solved again, and what each says where all were last linearised.

In units of its noise, a window's residual and rows change little with x: while x is a small part of its standard
deviation away, the parabola of that linearisation is the likelihood, and only a window that is new has to be looked at.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mbaid_ros.core.difference import errors_in_variables as eiv
from mbaid_ros.core.difference.errors_in_variables import Blocks, White
from mbaid_ros.core.geometry import Array


class KeptWindows:
    """Windows in the order of their time.

    Parameters
    ----------
    x : (u,) where they are linearised to begin with

    Attributes
    ----------
    x : where they are linearised now
    """

    def __init__(self, x: Array) -> None:
        self._blocks: list[Blocks] = []
        self._columns: list[Array] = []
        self.x = x
        self._white = White.nothing()  # of the first windows; of the others as soon as it is asked for
        self._own: Array = np.zeros((0, len(x), len(x)))  # likewise: the information that noise brings to each

    def __len__(self) -> int:
        """Return their number."""
        return len(self._blocks)

    @property
    def blocks(self) -> Blocks:
        """Their equations."""
        return Blocks.concatenate(self._blocks)

    @property
    def newest(self) -> Blocks:
        """The equations of the latest one."""
        return self._blocks[-1]

    @property
    def columns(self) -> Array:
        """How their equations depend on the effects, (K, r, e)."""
        return np.concatenate(self._columns)

    @property
    def white(self) -> White:
        """The windows at x.

        Raises
        ------
        FloatingPointError
            The covariance of a window is not positive definite there.
        """
        done = len(self._white)
        if done < len(self):
            new = eiv.whitened(Blocks.concatenate(self._blocks[done:]), self.x)
            self._white = White.concatenate([self._white, new]) if done else new
        return self._white

    @property
    def noise_information(self) -> Array:
        """The (u, u) part of the information at x that noise alone has brought, in expectation."""
        done = len(self._own)
        if done < len(self):
            new = eiv.own_information(Blocks.concatenate(self._blocks[done:]), self.white[done:])
            self._own = np.concatenate((self._own, new))
        return np.asarray(np.sum(self._own, axis=0))

    def linearise(self, x: Array, white: White | None = None) -> None:
        """Linearise all windows at another place; `white` are they there, where that is known already."""
        self.x = x
        self._white = White.nothing() if white is None else white
        self._own = np.zeros((0, len(x), len(x)))

    def at(self, x: Array) -> White:
        """Return the windows at a place close by, by the linearisation."""
        white = self.white
        return replace(white, residual=white.residual + white.rows @ (x - self.x))

    def append(self, block: Blocks, columns: Array) -> None:
        """Take the next window and how it depends on the effects, (1, r, e)."""
        self._blocks.append(block)
        self._columns.append(columns)

    def pop(self) -> KeptWindows:
        """Give up the oldest window and return it, linearised as it is."""
        oldest = KeptWindows(self.x)
        oldest._blocks, oldest._columns = self._blocks[:1], self._columns[:1]
        oldest._white, oldest._own = self._white[:1], self._own[:1]
        self.drop(0, 1)
        return oldest

    def drop(self, first: int, last: int) -> None:
        """Give up windows first, ..., last - 1."""
        del self._blocks[first:last], self._columns[first:last]
        # What has been looked at are the first windows: behind a gap, it will be looked at again.
        left = slice(last, None) if first == 0 else slice(first)
        self._white, self._own = self._white[left], self._own[left]

    def replace(self, blocks: Sequence[Blocks], x: Array) -> None:
        """Go over to equations in other unknowns, with x in these."""
        self._blocks = list(blocks)
        self.linearise(x)

    def each(self) -> list[tuple[Blocks, Array]]:
        """Return each window's equations and how they depend on the effects."""
        return list(zip(self._blocks, self._columns, strict=True))
