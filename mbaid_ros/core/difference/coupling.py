"""Effects that are looked at, but not solved for: their information, and what ties it to that of the unknowns.

An effect adds E e to the equations, with known columns E: a constant force that may act, the errors of bodies that
count as known. Beside the normal equations of the unknowns x, three sums then tell everything about e: how much better
the data would be explained with it, what it would do to x, and how far x is off if e is only known to be small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mbaid_ros.core.difference.errors_in_variables import Linearisation, White
from mbaid_ros.core.geometry import Array

Places = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Coupling:
    """The parts of the normal equations that effects bring: gradient by e at (x, 0) is offset + cross^T x.

    Attributes
    ----------
    cross : (u, e)
    own : (e, e)
    offset : (e,)
    """

    cross: Array
    own: Array
    offset: Array

    @staticmethod
    def nothing(unknowns: int, effects: int) -> Coupling:
        """Return what no data say."""
        return Coupling(np.zeros((unknowns, effects)), np.zeros((effects, effects)), np.zeros(effects))

    @staticmethod
    def of(squares: Array, x: Array) -> Coupling:
        """Return the sums over equations whose residuals were taken at x.

        Parameters
        ----------
        squares : (u + 1 + e, u + 1 + e) of their bordered rows
        x : (u,)
        """
        count = len(x)
        cross = squares[:count, count + 1 :]
        return Coupling(cross, squares[count + 1 :, count + 1 :], squares[count, count + 1 :] - x @ cross)

    def __add__(self, other: Coupling) -> Coupling:
        """Return the sums over the blocks of both."""
        return Coupling(self.cross + other.cross, self.own + other.own, self.offset + other.offset)

    def gradient(self, x: Array) -> Array:
        """Return half the derivative of the cost by e at (x, 0)."""
        return self.offset + self.cross.T @ x

    def substitute(self, basis: Array) -> Coupling:
        """Return the same in unknowns x' with x = basis x'."""
        return Coupling(basis.T @ self.cross, self.own, self.offset)

    def mixed(self, effects: slice, weight: Array) -> Coupling:
        """Return the same for combinations of some of the effects: e = weight e', weight (n, k)."""
        own = self.own[effects, effects]
        return Coupling(self.cross[:, effects] @ weight, weight.T @ own @ weight, weight.T @ self.offset[effects])

    def solve_for(self, effects: slice, weight: Array) -> Coupling:
        """Return the same once combinations of some effects are unknowns, after the others, and these effects gone."""
        cross = np.concatenate((self.cross, weight.T @ self.own[effects]))
        own, offset = self.own.copy(), self.offset.copy()
        cross[:, effects] = own[effects] = own[:, effects] = offset[effects] = 0.0
        return Coupling(cross, own, offset)

    def forget(self, root: Array, factor: float) -> Coupling:
        """Return the past discounted like an information N that becomes root^T N root, by up to a factor."""
        return Coupling(np.sqrt(factor) * root.T @ self.cross, factor * self.own, factor * self.offset)

    def eliminate(self, information: Array, right_side: Array, keep: Places, gone: Places) -> Coupling:
        """Return the same once some unknowns of a cost x^T N x - 2 r^T x + ... have been minimised over.

        Parameters
        ----------
        information, right_side : (u, u) N, (u,) r
        keep, gone : indices of the unknowns
        """
        lost = self.cross[gone]
        known = np.column_stack((information[np.ix_(gone, keep)], lost, right_side[gone]))
        solved = np.linalg.solve(information[np.ix_(gone, gone)], known)
        by_kept, by_effects, best = np.split(solved, [len(keep), len(keep) + lost.shape[1]], axis=1)
        return Coupling(
            self.cross[keep] - by_kept.T @ lost,
            self.own - lost.T @ by_effects,
            self.offset + lost.T @ best[:, 0],
        )


def bordered(white: White, effects: Array) -> Array:
    """Return rows, residuals and effects of K blocks beside each other, (K, r, u + 1 + e).

    Their squares, summed over the equations, hold the information, the gradient, the cost and what ties the effects to
    them.

    Parameters
    ----------
    white : K blocks
    effects : (K, r, e) E, in units of the blocks' noise like them
    """
    return np.concatenate((white.rows, white.residual[..., None], effects), axis=2)


def normal_equations(squares: Array, unknowns: int, equations: int) -> Linearisation:
    """Return the normal equations of blocks where they were linearised.

    Parameters
    ----------
    squares : (u + 1 + e, u + 1 + e) of their bordered rows
    unknowns, equations : numbers u, and of the equations
    """
    return Linearisation(
        cost=float(squares[unknowns, unknowns]),
        gradient=squares[:unknowns, unknowns],
        information=squares[:unknowns, :unknowns],
        equations=equations,
    )
