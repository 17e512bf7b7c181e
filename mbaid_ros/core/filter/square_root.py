"""The square-root information filter over windows (Bierman 1977, chapter 5), in scaled variables.

R x = z with unit covariance. An update adds a window's rows to the triangle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.linalg.lapack import dtpqrt, dtrtri, dtrtrs

from mbaid_ros.core.filter.integrated_twist import TwistLink
from mbaid_ros.core.filter.joint_noise import no_bias
from mbaid_ros.core.filter.variables import OPEN_LENGTH, Variables
from mbaid_ros.core.filter.whitened import WhitenedWindow
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.status import Innovations

_BLOCK = 12  # columns that LAPACK reflects together: as many as a window has rows


@dataclass(frozen=True, eq=False)
class SquareRootInformation:
    """A Gaussian of the scaled variables: those of `Variables`, then those of a constant force where there is one."""

    # (v, v + 2), Fortran order: the triangle R, beside it z of the correction for noise that rows and values share, and
    # z of the least-squares mean: x = R^-1 (their sum)
    root: Array
    innovations: Innovations  # sensor by sensor
    bias_information: Array  # (b, b + 1) as of `WhitenedWindow`, summed over all windows
    # nis, measured: sum of the normalised innovations squared over all windows, and their number
    nis: float = 0.0
    measured: int = 0
    last_nis: float = 0.0  # the same of the last update
    last_measured: int = 0  # the same of the last update
    log_likelihood: float = 0.0  # of all measurements, up to a constant
    # (c, c + v + 2) rows above those of the root, of c numbers that the next window's twist is linked by (`TwistLink`),
    # or between an update and the step after it of its noise and these; None where nothing links it
    carried: Array | None = None

    @staticmethod
    def prior(variables: Variables, extra: int = 0, mass: float | None = None) -> SquareRootInformation:
        """Return the prior, with `extra` numbers of unit variance beside the variables, near a mass in kg if given."""
        mean, triangle, likelihood = variables.prior(mass)
        size = len(mean) + extra
        root = np.zeros((size, size + 2), order='F')
        root[: len(mean), : len(mean)] = triangle
        root[: len(mean), -1] = triangle @ mean
        root[len(mean) :, len(mean) : -2] = np.eye(extra)
        nothing = Innovations.none(variables.poses), no_bias(variables)
        return SquareRootInformation(root, *nothing, log_likelihood=likelihood)

    @property
    def misfit(self) -> float:
        """Log-likelihood lost by innovations larger than expected."""
        return 0.5 * (self.nis - self.measured)

    @property
    def size(self) -> int:
        """Number v of variables."""
        return len(self.root)

    def moments(self) -> tuple[Array, Array]:
        """Return the mean (v,), and the part of it that corrects for shared noise (v,).

        Raises LinAlgError: The information has a direction without any.
        """
        both, info = dtrtrs(self.root[:, :-2], self.root[:, -2:])
        if info:
            raise np.linalg.LinAlgError('a direction of the state has no information')
        return both[:, 0] + both[:, 1], both[:, 0]

    @property
    def factor(self) -> Array:
        """A factor of the covariance, (v, v)."""
        return np.asarray(dtrtri(self.root[:, :-2])[0])

    @property
    def least_squares(self) -> Array:
        """The mean without the correction for shared noise, (v,)."""
        return np.asarray(dtrtrs(self.root[:, :-2], self.root[:, -1])[0])

    def with_root(self, root: Array, carried: Array | None = None) -> SquareRootInformation:
        """Return the same measurements with another root (v, v + 2), and the carried rows."""
        return replace(self, root=root, carried=carried)


def update(gaussian: SquareRootInformation, window: WhitenedWindow) -> SquareRootInformation:
    """Return the Gaussian after a window's measurements.

    One factorisation of R above the rows H, beside 0 above 1, beside z above the values. It turns the 1 into a triangle
    U, U^T U the inverse of the innovations' covariance, and the values into U times the innovations: normalised, each
    given those after it. So the rows are taken in reverse.
    """
    before = gaussian.root if window.carried is None else _linked_before(gaussian, window.carried)
    size, (count, columns), link = len(before), window.rows.shape, len(before) - gaussian.size
    inner = size + count
    triangle = np.zeros((inner + 2, inner + 2), order='F')
    triangle[:size, :size], triangle[:size, inner:] = before[:, :size], before[:, size:]
    rows = np.zeros((count, inner + 2), order='F')
    rows[:, link : link + columns], rows[:, size:inner] = window.rows[::-1], identity(count)
    rows[:, -1] = window.value[::-1]
    if window.carried is not None:
        rows[:, :link] = np.concatenate((window.carried.by_noise, window.carried.by_carried), axis=1)[::-1]
    triangle = dtpqrt(0, _BLOCK, triangle, rows, overwrite_a=True, overwrite_b=True)[0]
    root = np.empty((gaussian.size, gaussian.size + 2), order='F')
    root[:, :-2], root[:, -2:] = triangle[link:size, link:size], triangle[link:size, inner:]
    carried = None
    if window.carried is not None:
        carried = np.concatenate((triangle[:link, :size], triangle[:link, inner:]), axis=1)
    score = np.zeros(gaussian.size)
    score[:columns] = window.shared
    root[:, -2] += dtrtrs(root[:, :-2], score, trans=1)[0]
    left, diagonal = triangle[-count - 2 : -2, -1], triangle.diagonal()[-count - 2 : -2]
    nis = float(left @ left)
    growth = -2.0 * float(np.add.reduce(np.log(np.abs(diagonal))))
    return SquareRootInformation(
        root,
        gaussian.innovations.after((left * np.sign(diagonal))[::-1], window.places),
        gaussian.bias_information + window.bias_information,
        gaussian.nis + nis,
        gaussian.measured + count,
        nis,
        count,
        gaussian.log_likelihood - 0.5 * (nis + window.log_noise + growth),  # trajectory.md, eq. 5
        carried,
    )


def _linked_before(gaussian: SquareRootInformation, carried: TwistLink) -> Array:
    """Return the root (2 k + v, 2 k + v + 2) before a window, with the noise q and c of the integrated twist on top.

    Where no c has been carried to it, that is as uncertain as a first pose.
    """
    count, size = carried.by_carried.shape[1], gaussian.size
    root = np.zeros((2 * count + size, 2 * count + size + 2), order='F')
    root[:count, :count] = identity(count)
    own = slice(count, 2 * count)
    if gaussian.carried is None:
        root[own, own] = identity(count) / OPEN_LENGTH
    else:
        root[own, count:] = gaussian.carried
    root[2 * count :, 2 * count :] = gaussian.root
    return root


@cache
def identity(size: int) -> Array:
    """Return the unit matrix."""
    return np.eye(size)


@cache
def upper_ones(size: int) -> Array:
    """Return an upper triangle of ones: LAPACK leaves other numbers below that of a factor."""
    return np.triu(np.ones((size, size)))
