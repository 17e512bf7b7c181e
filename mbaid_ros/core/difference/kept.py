"""The windows that are solved again, and what each says where all were last linearised.

In units of its noise, a window's residual and rows change little with x: while x is a small part of its standard
deviation away, the parabola of that linearisation is the likelihood, and only a window that is new has to be looked at.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.difference import errors_in_variables as eiv
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
class _Told(Stacked):
    """What else is said of K windows where they are linearised.

    Attributes
    ----------
    effects : (K, r, e) how they depend on the effects, in units of their noise
    own : (K, u, u) the information that noise brings to each
    """

    effects: Array
    own: Array


@dataclass(frozen=True)
class OldWindow:
    """A window that is given up.

    Attributes
    ----------
    block : its equations
    columns : (1, r, e) how they depend on the effects
    white : it at the x where it was linearised
    effects : the columns in units of its noise there
    own : (u, u) the information that noise has brought to it
    """

    block: Blocks
    columns: Array
    white: White
    effects: Array
    own: Array


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
    def white(self) -> White:
        """The windows at x.

        Raises
        ------
        FloatingPointError
            The covariance of a window is not positive definite there.
        """
        return self._white_of(len(self))

    @property
    def effects(self) -> Array:
        """How they depend on the effects, (K, r, e), in units of their noise at x."""
        return self._told_of(len(self)).effects

    @property
    def noise_information(self) -> Array:
        """The (u, u) part of the information at x that noise alone has brought, in expectation."""
        return np.asarray(self._told_of(len(self)).own.sum(axis=0))

    def linearise(self, x: Array, white: White | None = None) -> None:
        """Linearise all windows at another place; `white` are they there, where that is known already."""
        self.x = x
        # Of the first windows; of the others as soon as it is asked for.
        self._white = Queue(White.nothing() if white is None else white)
        self._told = Queue(_Told(*np.zeros((2, 0))))

    def at(self, x: Array) -> White:
        """Return the windows at a place close by, by the linearisation."""
        white = self.white
        return replace(white, residual=white.residual + white.rows @ (x - self.x))

    def append(self, block: Blocks, columns: Array) -> None:
        """Take the next window and how it depends on the effects, (1, r, e)."""
        self._windows.append(_Windows(block.rows, block.offset, block.noise, block.noise_rows, columns))

    def pop(self) -> OldWindow:
        """Give up the oldest window and return it."""
        window, white, told = self._windows.entries[:1], self._white_of(1)[:1], self._told_of(1)[:1]
        self.drop(0, 1)
        return OldWindow(window, window.columns, white, told.effects, told.own[0])

    def drop(self, first: int, last: int) -> None:
        """Give up windows first, ..., last - 1."""
        self._windows.drop(first, last)
        # What has been looked at are the first windows: behind a gap, it will be looked at again.
        self._white.drop(first, last if first == 0 else len(self._white))
        self._told.drop(first, last if first == 0 else len(self._told))

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

    def _told_of(self, count: int) -> _Told:
        """Return what else is said of the first windows, or more."""
        done = len(self._told)
        if done < count:
            new, white = self._windows.entries[done:count], self._white_of(count)[done:count]
            self._told.append(_Told(white.whitener @ new.columns, eiv.own_information(new, white)))
        return self._told.entries
