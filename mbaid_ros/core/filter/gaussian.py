"""Mean and covariance of the state as published."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from scipy.linalg.lapack import dpotri, dtrtrs

from mbaid_ros.core.filter.joint_noise import InformationCorrection
from mbaid_ros.core.filter.prior_scale import PriorScaleFactors
from mbaid_ros.core.filter.square_root import SquareRootInformation
from mbaid_ros.core.filter.state import BODY, MOMENTUM, Layout
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.geometry import Array, Flags, Integers


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
        return np.where(_upper(count), upper, upper.T)

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


@cache
def _upper(size: int) -> Flags:
    """Return which places are those of an upper triangle."""
    return np.asarray(np.triu(np.ones((size, size), dtype=bool)))
