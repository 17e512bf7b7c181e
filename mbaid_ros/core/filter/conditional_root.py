"""The rows of the filter's variables given constant forces, which hypotheses of different forces have in common."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.linalg.lapack import dgeqrf, dtpmqrt, dtpqrt, dtrtrs

from mbaid_ros.core.filter.joint_noise import TwistLink
from mbaid_ros.core.filter.variables import OPEN_LENGTH
from mbaid_ros.core.filter.whitened import Axes, WhitenedWindow
from mbaid_ros.core.geometry import Array

_BLOCK = 12  # columns that LAPACK reflects together: as many as a window has rows


@cache
def identity(size: int) -> Array:
    """Return the unit matrix."""
    return np.eye(size)


@cache
def upper_ones(size: int) -> Array:
    """Return an upper triangle of ones: LAPACK leaves other numbers below that of a factor."""
    return np.triu(np.ones((size, size)))


@dataclass(frozen=True, eq=False)
class ConditionalRoot:
    """R x + S f = z: square-root information of the variables x given constant forces f (Friedland 1969).

    First among the variables may be l numbers that link windows (`TwistLink`): c, or between an update and the step
    after it the noise q of the window's way, and c.
    """

    triangle: Array  # (l + v, l + v) R, Fortran order
    # (l + v, 2 + g) z of the correction for noise that rows and values share, z of the least-squares mean, x = R^-1
    # (their sum) without a force; then S, the columns of one force after the other
    right: Array
    forces: tuple[Axes, ...] = ()  # axes of these
    links: int = 0  # l

    @staticmethod
    def from_rows(rows: Array, forces: tuple[Axes, ...], links: int = 0) -> ConditionalRoot:
        """Return that of rows (l + v, l + v + 2 + g): R, and beside it the right-hand sides."""
        size = len(rows)
        return ConditionalRoot(np.asfortranarray(rows[:, :size]), np.asfortranarray(rows[:, size:]), forces, links)

    def rows(self, count: int | None = None) -> Array:
        """Return the first `count` rows, or all, (r, l + v + 2 + g)."""
        return np.concatenate((self.triangle[:count], self.right[:count]), axis=1)

    def columns(self, axes: Axes) -> slice:
        """Return the columns of `right` that a force in some axes has; none without one."""
        count = 0 if axes == 'none' else (self.right.shape[1] - 2) // len(self.forces)
        start = 2 + (self.forces.index(axes) * count if count else 0)
        return slice(start, start + count)

    def with_first(self, first: Array, count: int, links: int = 0) -> ConditionalRoot:
        """Return r rows in place of the first `count`: the first `count` - r variables have been eliminated."""
        gone = count - len(first)
        triangle, right = self.triangle[gone:, gone:].copy(order='F'), self.right[gone:].copy(order='F')
        triangle[: len(first)], right[: len(first)] = first[:, : len(triangle)], first[:, len(triangle) :]
        return replace(self, triangle=triangle, right=right, links=links)

    @property
    def unlinked(self) -> ConditionalRoot:
        """The same without the numbers that link windows: the rows of the others are their marginal."""
        return self.with_first(self.rows(0)[:, self.links :], self.links) if self.links else self

    def linked(self, link: TwistLink) -> ConditionalRoot:
        """Return the same before a window that is linked: q comes first, c next, k numbers each.

        Where no c has been carried to the window, it is as uncertain as a first pose.
        """
        count = link.by_carried.shape[1]
        size, own = len(self.triangle) - self.links + 2 * count, slice(2 * count - self.links, None)
        triangle, right = np.zeros((size, size), order='F'), np.zeros((size, self.right.shape[1]), order='F')
        triangle[range(2 * count), range(2 * count)] = np.repeat((1.0, 1.0 / OPEN_LENGTH), count)
        triangle[own, own], right[own] = self.triangle, self.right
        return replace(self, triangle=triangle, right=right, links=2 * count)

    def updated(self, window: WhitenedWindow) -> tuple[ConditionalRoot, Array, Array]:
        """Return the same after a window's w rows H and values; the shift by their shared noise, and the remainder.

        One factorisation of R above H, beside it S above 0, z above the values, and 0 above 1. It turns the 1 into J,
        J^T J the inverse of the innovations' covariance; the values into J times the innovations; the 0 into their
        derivative by the forces. All of that is left, (w, w + 2 + g), J first and made a triangle: innovations are
        normalised, each given those after it. So the rows are taken in reverse.
        """
        link, count = window.twist_link, len(window.value)
        before = self.unlinked if link is None else self.linked(link)
        own, size, width = slice(before.links, None), len(before.triangle), before.right.shape[1]
        if not count:  # LAPACK accepts no empty rows
            return before, np.zeros(size), np.zeros((0, width))
        rows, left = np.zeros((count, size), order='F'), np.zeros((count, width + count), order='F')
        rows[:, own], left[:, 1], left[:, width:] = window.rows[::-1], window.value[::-1], identity(count)
        if link is not None:
            rows[:, : before.links] = np.concatenate((link.by_noise, link.by_carried), axis=1)[::-1]
        triangle, reflectors, factors, _ = dtpqrt(0, min(_BLOCK, size), before.triangle, rows, overwrite_b=True)
        right = np.concatenate((before.right, np.zeros((size, count), order='F')), axis=1)
        right, left, _ = dtpmqrt(0, reflectors, factors, right, left, trans='T', overwrite_a=True, overwrite_b=True)
        moved = dtrtrs(triangle, np.concatenate((np.zeros(before.links), window.shared)), trans=1)[0]
        right[:, 0] += moved
        after = replace(before, triangle=triangle, right=np.asfortranarray(right[:, :width]))
        return after, moved, dgeqrf(np.concatenate((left[:, width:], left[:, :width]), axis=1))[0]


def with_force(force: Array, left: Array, own: slice) -> tuple[Array, Array, Array]:
    """Return a force's triangle after a window, and the innovations as that explains and normalises them (w,).

    Third, the diagonal (w,) of the triangle that normalises them.

    Parameters
    ----------
    force, own : (f, f + 2) before, and its columns in the next
    left : (w, 2 + g) of the window, as of `ConditionalRoot.right`
    """
    size, count = len(force), len(left)
    wide = np.zeros((size + count, size + count + 2), order='F')
    wide[:size, :size], wide[:size, -2:] = force[:, :-2], force[:, -2:]
    wide[size:, :size], wide[size:, size:-2], wide[size:, -2:] = left[:, own], identity(count), left[:, :2]
    triangle = dgeqrf(wide, overwrite_a=True)[0]
    after = np.concatenate((upper_ones(size) * triangle[:size, :size], triangle[:size, -2:]), axis=1)
    return after, triangle[size:, -1], triangle.diagonal()[size:]
