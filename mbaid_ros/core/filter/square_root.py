"""The square-root information filter over windows (Bierman 1977, chapter 5): R x = z, and the mean and covariance of x.

The variables x are scaled, the covariance of the noise is 1. An update adds a window's rows to the triangle R.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from scipy.linalg.lapack import dpotri, dtpqrt, dtrtri, dtrtrs

from mbaid_ros.core.filter.joint_noise import InformationCorrection, TwistLink
from mbaid_ros.core.filter.prior_scale import PriorScaleFactors
from mbaid_ros.core.filter.state import BODY, MOMENTUM, Layout
from mbaid_ros.core.filter.variables import OPEN_LENGTH, Variables
from mbaid_ros.core.filter.whitened import WhitenedWindow
from mbaid_ros.core.geometry import Array, Integers
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
        nothing = Innovations.none(variables.poses), variables.bias
        return SquareRootInformation(root, *nothing, log_likelihood=likelihood)

    @property
    def misfit(self) -> float:
        """Log-likelihood lost by innovations larger than expected."""
        return 0.5 * (self.nis - self.measured)

    @property
    def size(self) -> int:
        """Number v of variables."""
        return len(self.root)

    def mean_and_shift(self) -> tuple[Array, Array]:
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


@dataclass(frozen=True, eq=False)
class MeanAndCovariance:
    """Mean (s,) and covariance of the state, SI units.

    `shift` (s,) is the part of the mean that corrects for shared noise; `force` (6,) a constant force and torque.
    """

    gaussian: SquareRootInformation
    variables: Variables
    mean: Array
    shift: Array
    force: Array

    @staticmethod
    def of(gaussian: SquareRootInformation, variables: Variables) -> MeanAndCovariance:
        """Return them of a Gaussian in information form."""
        mean, shift = gaussian.mean_and_shift()
        count, spread = len(variables.scale), variables.spread
        force = variables.force[:, : gaussian.size - count] @ mean[count:]
        return MeanAndCovariance(gaussian, variables, spread @ mean[:count], spread @ shift[:count], force)

    @cached_property
    def factor(self) -> Array:
        """Factor of the covariance of the state, (s, v), without the parts outside the variables."""
        return self.variables.of_state(self.gaussian.factor[: len(self.variables.scale)])

    @property
    def force_factor(self) -> Array:
        """Factor of the covariance of the constant force, (6, v)."""
        count = len(self.variables.scale)
        return np.asarray(self.variables.force[:, : self.gaussian.size - count] @ self.gaussian.factor[count:])

    @cached_property
    def variance(self) -> Array:
        """Variances of the state, (s,)."""
        return np.add.reduce(self.factor**2, axis=1) + self.variables.outside.diagonal()

    @property
    def deviation(self) -> Array:
        """Standard deviations, (s,)."""
        return np.sqrt(self.variance)

    def factor_of(self, numbers: Array) -> Array:
        """Return a covariance factor (m, v) of numbers (m, w) that are linear in the first w variables."""
        right = np.zeros((self.gaussian.size, len(numbers)), order='F')
        right[: numbers.shape[1]] = numbers.T
        return np.asarray(dtrtrs(self.gaussian.root[:, :-2], right, trans=1, overwrite_b=True)[0]).T

    def by_force(self, pushed: Array) -> Array:
        """Return the (6,) change of the momentum by a constant force, of `pushed` (p, f) as of `HypothesisFilter`."""
        variables, count = self.variables, len(self.variables.scale)
        if self.gaussian.size == count:
            return np.zeros(6)
        numbers = self.gaussian.mean_and_shift()[0][count:]
        change = np.broadcast_to(pushed, (variables.head - variables.poses, len(numbers))) @ numbers
        return np.asarray(variables.spread[MOMENTUM, variables.poses : variables.head] @ change)

    def covariance(self, rows: Integers) -> Array:
        """Return the covariance (r, r) of some numbers of the state."""
        part = self.factor_of(self.variables.spread[rows])
        return np.asarray(part @ part.T + self.variables.outside[np.ix_(rows, rows)])

    def published(self, prior_scales: PriorScaleFactors, layout: Layout, rows: Integers) -> tuple[Array, Array]:
        """Return some numbers (r,) of the state, the body's among them, and a covariance factor (r, w), as published.

        With the correction for noise in the rows (trajectory.md, eq. 14), and the priors scaled (eq. 7).
        """
        body, attenuation = self._attenuated
        part = self.factor_of(self.variables.spread[rows])
        times = self.amplification(part, rows)
        columns = [times @ part, self.by_score(part)]
        if not prior_scales.as_declared:
            columns.append(times @ prior_scales.beside(self.contributions(part, layout)))
        return self.mean[rows] + part @ (body.T @ attenuation.shift), np.concatenate(columns, axis=1)

    def amplification(self, part: Array, rows: Integers) -> Array:
        """Return the (r, r) amplification of errors by noise in the rows, of numbers with a factor `part` (r, v)."""
        body, attenuation = self._attenuated
        more = part @ body.T @ attenuation.gain
        return np.asarray(np.eye(len(rows)) + more @ self.variables.gather[self.variables.body, rows])

    def by_score(self, part: Array) -> Array:
        """Return the columns (m, b) that the score of noise in the rows adds to a covariance factor (m, v)."""
        body, attenuation = self._attenuated
        return np.asarray(part @ body.T @ attenuation.score)

    @cached_property
    def _attenuated(self) -> tuple[Array, InformationCorrection]:
        """A covariance factor (b, v) of the body's variables, and their correction (trajectory.md, eq. 14)."""
        variables = self.variables
        body = self.factor_of(np.eye(variables.own)[variables.body])
        mean = variables.gather[variables.body, BODY] @ self.mean[BODY]
        return body, InformationCorrection.of(body @ body.T, self.gaussian.bias_information, mean)

    def with_variables(self, factor: Array) -> Array:
        """Return the covariance (v, m) of the variables with numbers of a covariance factor (m, v)."""
        return np.asarray(dtrtrs(self.gaussian.root[:, :-2], factor.T)[0])

    def unknowns(self, layout: Layout) -> tuple[Array, Array]:
        """Return the unknowns' numbers (e,), of unit variance about zero a priori, and their covariance (e, e).

        They come last, with a force: the lower rows of the triangle are the root of their marginal information.
        """
        known = layout.known
        values, covariance = self.mean[BODY.stop :] - known.mean, self.of_unknowns
        if known.independent:
            return values, covariance
        return known.whitening @ values, known.whitening @ covariance @ known.whitening.T

    @cached_property
    def of_unknowns(self) -> Array:
        """The covariance (e, e) of the unknowns in the state."""
        first = self.variables.own
        count = len(self.variables.scale) - first
        if not count:  # LAPACK complains of empty triangles, on the terminal
            return np.zeros((0, 0))
        upper = dpotri(self.gaussian.root[first:, first:-2])[0][:count, :count]
        return np.where(upper_ones(count), upper, upper.T)

    def prior_scales(self, layout: Layout, moved: Array | None = None) -> PriorScaleFactors:
        """Return the scale factors of the unknowns' priors; `moved` (d, e) as of `Curvature.unknowns`.

        Numbers that noise drives beyond these count as right.
        """
        values, covariance = self.unknowns(layout)
        if layout.driven.any():
            free = 1.0 - layout.driven
            values, covariance = values * free, covariance * np.outer(free, free) + np.diag(layout.driven)
        return PriorScaleFactors.of(values, covariance, layout.cause_of, layout.part_of, moved)

    def contributions(self, factor: Array, layout: Layout) -> Array:
        """Return the contributions (e, m) of the unknowns' independent numbers to the errors of m numbers.

        That of a number of unit variance is its covariance with the estimate. `factor` (m, v) is that of `factor_of`.
        """
        with_unknowns = self.with_variables(factor)[self.variables.own : len(self.variables.scale)]
        return with_unknowns if layout.known.independent else np.asarray(layout.known.whitening @ with_unknowns)
