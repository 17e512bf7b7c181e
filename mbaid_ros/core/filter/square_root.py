"""The square-root information filter over windows (Bierman 1977, chapter 5): R x = z, and the mean and covariance of x.

The variables x are scaled, the covariance of the noise is 1. An update adds a window's rows to the triangle R.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dpotri, dtrtri, dtrtrs

from mbaid_ros.core.filter.conditional_root import ConditionalRoot, upper_ones, with_force
from mbaid_ros.core.filter.joint_noise import InformationCorrection
from mbaid_ros.core.filter.prior_scale import PriorScaleFactors
from mbaid_ros.core.filter.state import BODY, MOMENTUM, Layout
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.filter.whitened import Axes, WhitenedWindow
from mbaid_ros.core.geometry import Array, Integers
from mbaid_ros.core.results.status import Innovations


@dataclass(frozen=True, eq=False)
class SquareRootInformation:
    """A Gaussian of the scaled variables: those of `Variables`, then those of a constant force where there is one."""

    conditional: ConditionalRoot  # of the variables; the same object in hypotheses that share it
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
        shared, nothing = ConditionalRoot(np.asfortranarray(triangle), right, acting), Innovations.none(variables.poses)
        own = [np.eye(size, size + 2) for size in np.where(np.array(forces) == 'none', 0, count)]
        return [
            SquareRootInformation(shared, axes, force, nothing, variables.bias, log_likelihood=likelihood)
            for axes, force in zip(forces, own, strict=True)
        ]

    @staticmethod
    def priors(variables: Variables, forces: Sequence[Axes], mass: float | None = None) -> list[SquareRootInformation]:
        """Return the prior for a force in each of some axes, near a mass in kg if given."""
        mean, triangle, likelihood = variables.prior(mass)
        return SquareRootInformation.from_root(triangle, triangle @ mean, forces, variables, likelihood)

    @staticmethod
    def prior(variables: Variables, force: Axes = 'none', mass: float | None = None) -> SquareRootInformation:
        """Return the prior for a force in some axes, or none."""
        return SquareRootInformation.priors(variables, (force,), mass)[0]

    @property
    def equations(self) -> tuple[Array, Array]:
        """R x = z of variables and force, (n, n) and (n, 2), z as of `ConditionalRoot`; without a force no copies."""
        shared, size = self.conditional.unlinked, self.size
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
        return len(self.conditional.triangle) - self.conditional.links + len(self.force)

    def mean_and_shift(self) -> tuple[Array, Array]:
        """Return the mean (n,), and the part of it that corrects for shared noise (n,).

        Raises LinAlgError: The information has a direction without any.
        """
        both, info = dtrtrs(*self.equations)
        if info:
            raise np.linalg.LinAlgError('a direction of the state has no information')
        return both[:, 0] + both[:, 1], both[:, 0]

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
        growth = -2.0 * float(np.add.reduce(np.log(np.abs(diagonal))))
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
                gaussian.log_likelihood - 0.5 * (nis + window.log_noise + growth),  # trajectory.md, eq. 5
            )
        )
    return updated


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
    def from_gaussian(gaussian: SquareRootInformation, variables: Variables) -> MeanAndCovariance:
        """Return them of a Gaussian in information form."""
        both, count = np.column_stack(gaussian.mean_and_shift()), len(variables.scale)
        force = variables.force[:, : gaussian.size - count] @ both[count:, 0]
        mean, shift = variables.state_columns(both[:count]).T
        return MeanAndCovariance(gaussian, variables, mean, shift, force)

    @cached_property
    def factor(self) -> Array:
        """Factor of the covariance of the state, (s, v), without the parts outside the variables."""
        return self.variables.state_columns(self.gaussian.factor[: len(self.variables.scale)])

    @property
    def force_factor(self) -> Array:
        """Factor of the covariance of the constant force, (6, v)."""
        count = len(self.variables.scale)
        return np.asarray(self.variables.force[:, : self.gaussian.size - count] @ self.gaussian.factor[count:])

    @cached_property
    def variance(self) -> Array:
        """Variances of the state, (s,)."""
        return np.add.reduce(self.factor**2, axis=1) + self.variables.covariance_outside.diagonal()

    @property
    def deviation(self) -> Array:
        """Standard deviations, (s,)."""
        return np.sqrt(self.variance)

    def factor_of(self, numbers: Array) -> Array:
        """Return a covariance factor (m, v) of numbers (m, w) that are linear in the first w variables."""
        right = np.zeros((self.gaussian.size, len(numbers)), order='F')
        right[: numbers.shape[1]] = numbers.T
        return np.asarray(dtrtrs(self.gaussian.triangle, right, trans=1, overwrite_b=True)[0]).T

    def impulse_of_force(self, impulse: Array) -> Array:
        """Return the (6,) change of the momentum by a constant force, of `impulse` as of `HypothesisFilter`."""
        variables, count = self.variables, len(self.variables.scale)
        if self.gaussian.size == count:
            return np.zeros(6)
        numbers = self.gaussian.mean_and_shift()[0][count:]
        change = np.broadcast_to(impulse, (variables.head - variables.poses, len(numbers))) @ numbers
        return np.asarray(variables.to_state[MOMENTUM, variables.poses : variables.head] @ change)

    def covariance(self, rows: Integers) -> Array:
        """Return the covariance (r, r) of some numbers of the state."""
        part = self.factor_of(self.variables.to_state[rows])
        return np.asarray(part @ part.T + self.variables.covariance_outside[np.ix_(rows, rows)])

    def published(self, prior_scales: PriorScaleFactors, layout: Layout, rows: Integers) -> tuple[Array, Array]:
        """Return some numbers (r,) of the state, the body's among them, and a covariance factor (r, w), as published.

        With the correction for noise in the rows (trajectory.md, eq. 14), and the priors scaled (eq. 7).
        """
        part = self.factor_of(self.variables.to_state[rows])
        body, attenuation = self._attenuated
        times = self.error_amplification(part, rows)
        columns = [times @ part, self.by_score(part)]
        if not prior_scales.as_declared:
            columns.append(times @ prior_scales.added_columns(self.contributions(part, layout)))
        return self.mean[rows] + part @ (body.T @ attenuation.shift), np.concatenate(columns, axis=1)

    def error_amplification(self, part: Array, rows: Integers) -> Array:
        """Return the (r, r) amplification of errors by noise in the rows, of numbers with a factor `part` (r, v)."""
        body, attenuation = self._attenuated
        more = part @ body.T @ attenuation.gain
        return np.asarray(np.eye(len(rows)) + more @ self.variables.from_state[self.variables.body, rows])

    def by_score(self, part: Array) -> Array:
        """Return the columns (m, b) that the score of noise in the rows adds to a covariance factor (m, v)."""
        body, attenuation = self._attenuated
        return np.asarray(part @ body.T @ attenuation.score)

    @cached_property
    def _attenuated(self) -> tuple[Array, InformationCorrection]:
        """A covariance factor (b, v) of the body's variables, and their correction (trajectory.md, eq. 14)."""
        variables = self.variables
        body = self.factor_of(np.eye(variables.first_unknown)[variables.body])
        mean = variables.from_state[variables.body, BODY] @ self.mean[BODY]
        return body, InformationCorrection.from_information(body @ body.T, self.gaussian.bias_information, mean)

    def with_variables(self, factor: Array) -> Array:
        """Return the covariance (v, m) of the variables with numbers of a covariance factor (m, v)."""
        return np.asarray(dtrtrs(self.gaussian.triangle, factor.T)[0])

    def unknowns(self, layout: Layout) -> tuple[Array, Array]:
        """Return the unknowns' numbers (e,), of unit variance about zero a priori, and their covariance (e, e).

        They come last, with a force: the lower rows of the triangle are the root of their marginal information.
        """
        known = layout.known
        values, covariance = self.mean[BODY.stop :] - known.mean, self.unknowns_covariance
        if known.independent:
            return values, covariance
        return known.whitening @ values, known.whitening @ covariance @ known.whitening.T

    @cached_property
    def unknowns_covariance(self) -> Array:
        """The covariance (e, e) of the unknowns in the state."""
        first = self.variables.first_unknown
        count = len(self.variables.scale) - first
        if not count:  # LAPACK complains of empty triangles, on the terminal
            return np.zeros((0, 0))
        upper = dpotri(self.gaussian.triangle[first:, first:])[0][:count, :count]
        return np.where(upper_ones(count), upper, upper.T)

    def unknowns_as_declared(self, layout: Layout) -> tuple[Array, Array]:
        """Return the same where numbers that noise drives beyond their priors count as right."""
        values, covariance = self.unknowns(layout)
        if layout.noise_driven.any():
            free = 1.0 - layout.noise_driven
            values, covariance = values * free, covariance * np.outer(free, free) + np.diag(layout.noise_driven)
        return values, covariance

    def prior_scales(self, layout: Layout, moved: Array | None = None) -> PriorScaleFactors:
        """Return the scale factors of the unknowns' priors; `moved` (d, e) as of `Curvature.unknowns`."""
        numbers = self.unknowns_as_declared(layout)
        return PriorScaleFactors.from_posterior(*numbers, layout.cause_of, layout.part_of, moved)

    def contributions(self, factor: Array, layout: Layout) -> Array:
        """Return the contributions (e, m) of the unknowns' independent numbers to the errors of m numbers.

        That of a number of unit variance is its covariance with the estimate. `factor` (m, v) is that of `factor_of`.
        """
        with_unknowns = self.with_variables(factor)[self.variables.first_unknown : len(self.variables.scale)]
        return with_unknowns if layout.known.independent else np.asarray(layout.known.whitening @ with_unknowns)
