"""The windows of the sliding window, whitened where all of them were last linearised.

In units of its noise, a window's residual and rows change little with x: while x is a small part of its standard
deviation away, the parabola of that linearisation is the likelihood, and only a new window has to be whitened.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.array_record import ArrayRecord, Queue
from mbaid_ros.core.equations import errors_in_variables as eiv
from mbaid_ros.core.equations.errors_in_variables import Blocks, Linearisation, White
from mbaid_ros.core.geometry import Array


@dataclass(frozen=True)
class WindowEquations(Blocks):
    """The equations of K windows.

    Attributes
    ----------
    columns : (K, r, e) how they depend on the consider parameters
    """

    columns: Array


@dataclass(frozen=True)
class _Own(ArrayRecord):
    """The information that noise alone brings to K windows, (K, u, u)."""

    information: Array


class LinearisedWindows:
    """Windows in the order of their time.

    Parameters
    ----------
    x : (u,) the linearisation point to begin with

    Attributes
    ----------
    x : the linearisation point
    """

    def __init__(self, x: Array) -> None:
        self._windows = Queue(WindowEquations(*np.zeros((5, 0))))
        self.linearise(x)

    def __len__(self) -> int:
        """Return their number."""
        return len(self._windows)

    @property
    def equations(self) -> WindowEquations:
        """Their equations."""
        return self._windows.entries

    @property
    def white(self) -> White:
        """All windows in units of their noise at the linearisation point.

        Raises
        ------
        FloatingPointError
            The covariance of a window is not positive definite there.
        """
        done = len(self._white)
        if done < len(self):
            self._white.append(eiv.whitened(self.equations[done:], self.x))
        return self._white.entries

    @property
    def columns(self) -> Array:
        """How they depend on the consider parameters in units of their noise, (K, r, e)."""
        return self.white.whitener @ self.equations.columns

    @property
    def noise_information(self) -> Array:
        """What noise alone brings to each window's information at the linearisation point, (K, u, u)."""
        done = len(self._own)
        if done < len(self):
            self._own.append(_Own(eiv.own_information(self.equations[done:], self.white[done:])))
        return self._own.entries.information

    def normal_equations(self) -> Linearisation:
        """Return the likelihood's quadratic form at the linearisation point."""
        return eiv.normal_equations(self.white)

    def at(self, x: Array) -> White | None:
        """Return the windows whitened at another x, (u,); None where that cannot be computed."""
        try:
            return eiv.whitened(self.equations, x)
        except FloatingPointError:
            return None

    def linearise(self, x: Array, white: White | None = None) -> None:
        """Move the linearisation point to x, (u,); `white` are the windows there, where that is known already."""
        self.x = x
        self._white = Queue(White.nothing() if white is None else white)
        self._own = Queue(_Own(np.zeros(0)))

    def append(self, window: WindowEquations) -> None:
        """Take the next window."""
        self._windows.append(window)

    def pop(self) -> None:
        """Give up the oldest window."""
        for queue in (self._windows, self._white, self._own):
            queue.drop(1)
