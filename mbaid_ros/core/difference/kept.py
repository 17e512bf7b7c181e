"""The windows that are solved again, and what each says where all were last linearised.

In units of its noise, a window's residual and rows change little with x: while x is a small part of its standard
deviation away, the parabola of that linearisation is the likelihood, and only a window that is new has to be looked at.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.difference import errors_in_variables as eiv
from mbaid_ros.core.difference.coupling import bordered
from mbaid_ros.core.difference.errors_in_variables import Blocks, White
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.stacked import Queue, Stacked


@dataclass(frozen=True)
class _Windows(Blocks):
    """The equations of K windows.

    Attributes
    ----------
    columns : (K, r, e) how they depend on the effects
    """

    columns: Array


@dataclass(frozen=True)
class _Bordered(Stacked):
    """The bordered rows of K windows, (K, r, u + 1 + e), as `bordered` of coupling.py has them."""

    rows: Array


@dataclass(frozen=True)
class _Own(Stacked):
    """The information that noise brings to K windows, (K, u, u)."""

    information: Array


@dataclass(frozen=True)
class OldWindow:
    """A window that is given up.

    Attributes
    ----------
    block : its equations
    columns : (1, r, e) how they depend on the effects
    bordered : (1, r, u + 1 + e) its bordered rows at the x where it was linearised
    own : (u, u) the information that noise has brought to it
    """

    block: Blocks
    columns: Array
    bordered: Array
    own: Array


class KeptWindows:
    """Windows in the order of their time.

    Parameters
    ----------
    x : (u,) where they are linearised to begin with

    Attributes
    ----------
    x : where they are linearised now
    forms : how often what they say has changed otherwise than by windows that come or leave in their order
    """

    def __init__(self, x: Array) -> None:
        self.forms = 0
        self._windows = Queue(_Windows(*np.zeros((5, 0))))
        self.linearise(x)

    def __len__(self) -> int:
        """Return their number."""
        return len(self._windows)

    @property
    def blocks(self) -> Blocks:
        """Their equations."""
        return self._windows.entries

    @property
    def newest(self) -> Blocks:
        """The equations of the latest one."""
        return self.blocks[-1:]

    @property
    def bordered(self) -> Array:
        """The bordered rows of each at x, (K, r, u + 1 + e), as `bordered` of coupling.py has them.

        Raises
        ------
        FloatingPointError
            The covariance of a window is not positive definite there.
        """
        return self._bordered_of(len(self))

    @property
    def noise_information(self) -> Array:
        """The (u, u) part of the information at x that noise alone has brought, in expectation."""
        return np.asarray(self._own_of(len(self)).sum(axis=0))

    def at(self, x: Array) -> White | None:
        """Return the windows at another place, None where that cannot be computed."""
        try:
            return eiv.whitened(self.blocks, x)
        except FloatingPointError:
            return None

    def linearise(self, x: Array, white: White | None = None) -> None:
        """Linearise all windows at another place; `white` are they there, where that is known already."""
        self.x = x
        self.forms += 1
        # Of the first windows; of the others as soon as it is asked for.
        self._white = Queue(White.nothing() if white is None else white)
        self._bordered = Queue(_Bordered(np.zeros(0)))
        self._own = Queue(_Own(np.zeros(0)))

    def append(self, block: Blocks, columns: Array) -> None:
        """Take the next window and how it depends on the effects, (1, r, e)."""
        self._windows.append(_Windows(block.rows, block.offset, block.noise, block.noise_rows, columns))

    def pop(self) -> OldWindow:
        """Give up the oldest window and return it."""
        oldest = OldWindow(
            self.blocks[:1], self._windows.entries.columns[:1], self._bordered_of(1)[:1], self._own_of(1)[0]
        )
        self.drop(0, 1)
        return oldest

    def drop(self, first: int, last: int) -> None:
        """Give up windows first, ..., last - 1."""
        self.forms += first > 0
        self._windows.drop(first, last)
        # What has been looked at are the first windows: behind a gap, it will be looked at again.
        self._white.drop(first, last if first == 0 else len(self._white))
        self._bordered.drop(first, last if first == 0 else len(self._bordered))
        self._own.drop(first, last if first == 0 else len(self._own))

    def replace(self, blocks: Blocks, x: Array) -> None:
        """Go over to equations in other unknowns, with x in these."""
        self._go_over(blocks, self._windows.entries.columns, x)

    def solve_for(self, effects: slice, weight: Array, x: Array) -> None:
        """Go over to equations with combinations of effects among the unknowns, after the others; they are gone.

        Parameters
        ----------
        effects : which
        weight : (n, w) the effects are weight times the new unknowns
        x : (u + w,)
        """
        columns = self._windows.entries.columns.copy()
        blocks = self.blocks.widened(columns[..., effects] @ weight)
        columns[..., effects] = 0.0
        self._go_over(blocks, columns, x)

    def _go_over(self, blocks: Blocks, columns: Array, x: Array) -> None:
        self._windows = Queue(_Windows(blocks.rows, blocks.offset, blocks.noise, blocks.noise_rows, columns))
        self.linearise(x)

    def _white_of(self, count: int) -> White:
        """Return the first windows, or more, at x."""
        done = len(self._white)
        if done < count:
            self._white.append(eiv.whitened(self.blocks[done:count], self.x))
        return self._white.entries

    def _bordered_of(self, count: int) -> Array:
        """Return the bordered rows of the first windows, or more, at x."""
        done = len(self._bordered)
        if done < count:
            new = self._white_of(count)[done:count]
            self._bordered.append(_Bordered(bordered(new, new.whitener @ self._windows.entries.columns[done:count])))
        return self._bordered.entries.rows

    def _own_of(self, count: int) -> Array:
        """Return the information that noise brings to the first windows, or more, at x."""
        done = len(self._own)
        if done < count:
            new = eiv.own_information(self.blocks[done:count], self._white_of(count)[done:count])
            self._own.append(_Own(new))
        return self._own.entries.information
