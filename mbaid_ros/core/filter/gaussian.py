"""Gaussians in square-root information form: measurement update, mean and covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.linalg.lapack import dgeqrf, dtpmqrt, dtpqrt, dtrtri, dtrtrs

from mbaid_ros.core.contracts import Axes
from mbaid_ros.core.filter.linearise import WhitenedWindow
from mbaid_ros.core.geometry import Array, Integers
from mbaid_ros.core.odometry.model import BorderNoise
from mbaid_ros.core.results.innovations import Innovations
from mbaid_ros.core.state import OPEN_LENGTH, Point, Variables

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
class BiasSeparatedRoot:
    """R x + S f = z: square-root information of the variables x given constant forces f (Friedland 1969).

    First among the variables may be l numbers that link windows (`BorderNoise`): c, or between an update and the step
    after it the noise q of the window's way, and c.
    """

    triangle: Array  # (l + v, l + v) R, Fortran order
    # (l + v, 2 + g) z of the correction for noise that rows and values share, z of the least-squares mean, x = R^-1
    # (their sum) without a force; then S, the columns of one force after the other
    right: Array
    forces: tuple[Axes, ...] = ()  # axes of these
    augmented: int = 0  # l

    @staticmethod
    def from_rows(rows: Array, forces: tuple[Axes, ...], augmented: int = 0) -> BiasSeparatedRoot:
        """Return that of rows (l + v, l + v + 2 + g): R, and beside it the right-hand sides."""
        size = len(rows)
        return BiasSeparatedRoot(
            np.asfortranarray(rows[:, :size]), np.asfortranarray(rows[:, size:]), forces, augmented
        )

    def rows(self, count: int | None = None) -> Array:
        """Return the first `count` rows, or all, (r, l + v + 2 + g)."""
        return np.concatenate((self.triangle[:count], self.right[:count]), axis=1)

    def columns(self, axes: Axes) -> slice:
        """Return the columns of `right` that a force in some axes has; none without one."""
        count = 0 if axes == 'none' else (self.right.shape[1] - 2) // len(self.forces)
        start = 2 + (self.forces.index(axes) * count if count else 0)
        return slice(start, start + count)

    def with_first(self, first: Array, count: int, augmented: int = 0) -> BiasSeparatedRoot:
        """Return r rows in place of the first `count`: the first `count` - r variables have been eliminated."""
        gone = count - len(first)
        triangle, right = self.triangle[gone:, gone:].copy(order='F'), self.right[gone:].copy(order='F')
        triangle[: len(first)], right[: len(first)] = first[:, : len(triangle)], first[:, len(triangle) :]
        return replace(self, triangle=triangle, right=right, augmented=augmented)

    @property
    def marginal(self) -> BiasSeparatedRoot:
        """The same without the numbers that link windows: their marginal has been taken."""
        return self.with_first(self.rows(0)[:, self.augmented :], self.augmented) if self.augmented else self

    def augmented_by(self, link: BorderNoise) -> BiasSeparatedRoot:
        """Return the same before a window with noise at its border, augmented: q comes first, c next, k numbers each.

        Where no c has been carried to the window, it is as uncertain as a first pose.
        """
        count = link.by_carried.shape[1]
        size, own = len(self.triangle) - self.augmented + 2 * count, slice(2 * count - self.augmented, None)
        triangle, right = np.zeros((size, size), order='F'), np.zeros((size, self.right.shape[1]), order='F')
        triangle[range(2 * count), range(2 * count)] = np.repeat((1.0, 1.0 / OPEN_LENGTH), count)
        triangle[own, own], right[own] = self.triangle, self.right
        return replace(self, triangle=triangle, right=right, augmented=2 * count)

    def updated(self, window: WhitenedWindow) -> tuple[BiasSeparatedRoot, Array, Array]:
        """Return the same after a window's w rows H and values; the shift by their shared noise, and the remainder.

        One factorisation of R above H, beside it S above 0, z above the values, and 0 above 1. It turns the 1 into J,
        J^T J the inverse of the innovations' covariance; the values into J times the innovations; the 0 into their
        derivative by the forces. All of that is left, (w, w + 2 + g), J first and made a triangle: innovations are
        normalised, each given those after it. So the rows are taken in reverse.
        """
        link, count = window.border_noise, len(window.value)
        before = self.marginal if link is None else self.augmented_by(link)
        own, size, width = slice(before.augmented, None), len(before.triangle), before.right.shape[1]
        if not count:  # LAPACK accepts no empty rows
            return before, np.zeros(size), np.zeros((0, width))
        rows, left = np.zeros((count, size), order='F'), np.zeros((count, width + count), order='F')
        rows[:, own], left[:, 1], left[:, width:] = window.rows[::-1], window.value[::-1], identity(count)
        if link is not None:
            rows[:, : before.augmented] = np.concatenate((link.by_noise, link.by_carried), axis=1)[::-1]
        triangle, reflectors, factors, _ = dtpqrt(0, min(_BLOCK, size), before.triangle, rows, overwrite_b=True)
        right = np.concatenate((before.right, np.zeros((size, count), order='F')), axis=1)
        right, left, _ = dtpmqrt(0, reflectors, factors, right, left, trans='T', overwrite_a=True, overwrite_b=True)
        moved = dtrtrs(triangle, np.concatenate((np.zeros(before.augmented), window.shared)), trans=1)[0]
        right[:, 0] += moved
        after = replace(before, triangle=triangle, right=np.asfortranarray(right[:, :width]))
        return after, moved, dgeqrf(np.concatenate((left[:, width:], left[:, :width]), axis=1))[0]


def with_force(force: Array, left: Array, own: slice) -> tuple[Array, Array, Array]:
    """Return a force's triangle after a window, and the innovations as that explains and normalises them (w,).

    Third, the diagonal (w,) of the triangle that normalises them.

    Parameters
    ----------
    force, own : (f, f + 2) before, and its columns in the next
    left : (w, 2 + g) of the window, as of `BiasSeparatedRoot.right`
    """
    size, count = len(force), len(left)
    wide = np.zeros((size + count, size + count + 2), order='F')
    wide[:size, :size], wide[:size, -2:] = force[:, :-2], force[:, -2:]
    wide[size:, :size], wide[size:, size:-2], wide[size:, -2:] = left[:, own], identity(count), left[:, :2]
    triangle = dgeqrf(wide, overwrite_a=True)[0]
    after = np.concatenate((upper_ones(size) * triangle[:size, :size], triangle[:size, -2:]), axis=1)
    return after, triangle[size:, -1], triangle.diagonal()[size:]


@dataclass(frozen=True, eq=False)
class SquareRootInformation:
    """A Gaussian of the scaled variables: those of `Variables`, then those of a constant force where there is one."""

    conditional: BiasSeparatedRoot  # of the variables; the same object in hypotheses that share it
    axes: Axes  # of the constant force
    force: Array  # (f, f + 2) its triangle T, and beside it what is on the right of the variables' rows
    innovations: Innovations  # sensor by sensor
    bias_information: Array  # (b, b + 1) as of `WhitenedWindow`, summed over all windows
    # nis, measured: sum of the normalised innovations squared over all windows, and their number
    nis: float = 0.0
    measured: int = 0
    last_nis: float = 0.0  # the same of the last update
    last_measured: int = 0  # the same of the last update
    log_likelihood: float = 0.0  # of all measurements, up to a constant

    @staticmethod
    def from_root(
        triangle: Array, value: Array, forces: Sequence[Axes], variables: Variables, likelihood: float = 0.0
    ) -> list[SquareRootInformation]:
        """Return R x = z, (v, v) and (v,), at first, with a force of unit variance in each of some axes."""
        acting, count = tuple(axes for axes in forces if axes != 'none'), variables.force.shape[1]
        right = np.zeros((len(value), 2 + len(acting) * count), order='F')
        right[:, 1] = value
        shared, nothing = (
            BiasSeparatedRoot(np.asfortranarray(triangle), right, acting),
            Innovations.none(variables.sources),
        )
        own = [np.eye(size, size + 2) for size in np.where(np.array(forces) == 'none', 0, count)]
        return [
            SquareRootInformation(shared, axes, force, nothing, variables.bias, log_likelihood=likelihood)
            for axes, force in zip(forces, own, strict=True)
        ]

    @staticmethod
    def priors(
        variables: Variables, forces: Sequence[Axes], mass: float | None = None, point: Point | None = None
    ) -> list[SquareRootInformation]:
        """Return the prior for a force in each of some axes, near a mass in kg and as of `Variables.prior` if given."""
        mean, triangle, likelihood = variables.prior(mass, point)
        return SquareRootInformation.from_root(triangle, triangle @ mean, forces, variables, likelihood)

    @staticmethod
    def prior(variables: Variables, force: Axes = 'none', mass: float | None = None) -> SquareRootInformation:
        """Return the prior for a force in some axes, or none."""
        return SquareRootInformation.priors(variables, (force,), mass)[0]

    @property
    def equations(self) -> tuple[Array, Array]:
        """R x = z of variables and force, (n, n) and (n, 2), z as of `BiasSeparatedRoot`; without a force no copies."""
        shared, size = self.conditional.marginal, self.size
        if not len(self.force):
            return shared.triangle, shared.right[:, :2]
        triangle, own = np.zeros((size, size), order='F'), len(shared.triangle)
        triangle[:own, :own], triangle[:own, own:] = shared.triangle, shared.right[:, shared.columns(self.axes)]
        triangle[own:, own:] = self.force[:, :-2]
        return triangle, np.asfortranarray(np.concatenate((shared.right[:, :2], self.force[:, -2:])))

    @property
    def triangle(self) -> Array:
        """The triangle R of variables and force, (n, n)."""
        return self.equations[0]

    @property
    def root(self) -> Array:
        """R, and beside it z, (n, n + 2)."""
        return np.concatenate(self.equations, axis=1)

    @property
    def misfit(self) -> float:
        """Log-likelihood lost by innovations larger than expected."""
        return 0.5 * (self.nis - self.measured)

    @property
    def size(self) -> int:
        """Number n of variables, with those of the force."""
        return len(self.conditional.triangle) - self.conditional.augmented + len(self.force)

    def mean_and_shift(self) -> tuple[Array, Array]:
        """Return the mean (n,), and the part of it that corrects for shared noise (n,).

        Raises LinAlgError: The information has a direction without any.
        """
        both, info = dtrtrs(*self.equations)
        if info:
            raise np.linalg.LinAlgError('a direction of the state has no information')
        return both[:, 0] + both[:, 1], both[:, 0]

    def given(self, numbers: Array, free: Integers) -> Array:
        """Return the mean of some variables where all others have given values (n,)."""
        triangle, right = self.equations
        others = np.ones(len(numbers), dtype=bool)
        others[free] = False
        left = right.sum(axis=1) - triangle[:, others] @ numbers[others]
        return np.asarray(np.linalg.lstsq(triangle[:, free], left)[0])

    @property
    def factor(self) -> Array:
        """A factor of the covariance, (n, n)."""
        return np.asarray(dtrtri(self.triangle)[0])

    @property
    def least_squares(self) -> Array:
        """The mean without the correction for shared noise, (n,)."""
        triangle, right = self.equations
        return np.asarray(dtrtrs(triangle, right[:, -1])[0])

    def sharing(self, other: SquareRootInformation) -> SquareRootInformation:
        """Return the same measurements with the variables' root of another Gaussian."""
        same = other.conditional is self.conditional
        return self if same else replace(self, conditional=other.conditional)


def update(gaussian: SquareRootInformation, window: WhitenedWindow) -> SquareRootInformation:
    """Return the Gaussian after a window's measurements."""
    return update_together(gaussian, (gaussian,), window)[0]


def update_together(
    before: SquareRootInformation, gaussians: Sequence[SquareRootInformation], window: WhitenedWindow
) -> list[SquareRootInformation]:
    """Return Gaussians from the variables' root of one before a window, after its measurements; they share the next."""
    after, moved, left = before.conditional.updated(window)
    updated, count = list[SquareRootInformation](), len(left)
    for gaussian in gaussians:
        force, residual, diagonal = gaussian.force, left[:, count + 1], left.diagonal()
        if len(force):
            own = after.columns(gaussian.axes)
            force, residual, by_force = with_force(force, left[:, count:], own)
            force[:, -2] -= dtrtrs(force[:, :-2], after.right[:, own].T @ moved, trans=1)[0]
            diagonal = diagonal * by_force
        nis = float(residual @ residual)
        # Zero is lost to rounding, at a robot far off: infinitely unlikely.
        logarithms = np.log(np.abs(diagonal), out=np.full(count, -np.inf), where=diagonal != 0.0)
        growth = -2.0 * float(np.add.reduce(logarithms))
        updated.append(
            SquareRootInformation(
                after,
                gaussian.axes,
                force,
                gaussian.innovations.with_window((residual * np.sign(diagonal))[::-1], window.places),
                gaussian.bias_information + window.bias_information,
                gaussian.nis + nis,
                gaussian.measured + count,
                nis,
                count,
                gaussian.log_likelihood - 0.5 * (nis + window.log_noise + growth),  # filter.md, eq. 2
            )
        )
    return updated
