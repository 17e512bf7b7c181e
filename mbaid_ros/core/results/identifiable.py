"""Which parameters are identifiable and published."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, skew
from mbaid_ros.core.interval import PARAMETERS
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.verdict import (
    Reason,
    implausible_body,
    is_precise,
    residual_reason,
    status_of,
    with_reasons,
)
from mbaid_ros.core.robot.body import (
    LENGTH,
    body_size,
    is_physical,
    physical,
    physical_jacobian,
    project,
    project_planar,
)
from mbaid_ros.core.robot.model import Plane

# Standard deviations that a solution may move by: a bias of half of one costs a 95 % interval three of its
# hundredths. Of equations that are near linear it moves by some hundredths, where the mass is known to a seventh by
# up to .4, where products of unknowns lead by .5 to 1.2.
LARGEST_SHIFT = 0.5
# Ratio of variances, and distance in standard deviations, of solutions at two points up to which the data observe a
# number at first order. One that only the product with another unknown shows is known as much better as that is further
# from zero: on a planar arm it moves by up to thirty, and its variances have ratios up to nine.
_ALIKE, _NEAR = 1.6, 1.0
# Indices of I_ii and I_jj for each of the six elements of inertia.
_FIRST = np.array([4, 4, 4, 7, 7, 9])
_SECOND = np.array([4, 7, 9, 7, 9, 9])
# How much better the mass has to be known than others, for it and for a quotient with it to be believed. Its deviation
# grows and shrinks with it: of runs that know it to half of itself, those that err downwards look the surest.
_OF_THE_MASS = 0.2
IDENTIFIABLE_STD = 0.5  # relative standard deviation below which a parameter counts as identifiable
LARGEST_RESIDUAL = 2.0  # times the noise: noise that is declared half as large as it is, or a wrong model


@dataclass(frozen=True, eq=False)
class Nonlinearity:
    """The result of linearising elsewhere."""

    # shifts, covariance: (d, 10) by which standard parameters have moved at d other points; (10, 10) at the solution
    shifts: Array
    covariance: Array
    largest: float = LARGEST_SHIFT  # standard deviations that a near linear one moves by at most
    unknowns: Array | None = None  # (d, e) by which the unknowns' independent numbers have moved
    # (d, 10, 10) covariances at those points; none where not asked for
    covariances: Array = field(default_factory=lambda: np.zeros((0, 10, 10)))

    def is_linear(self, jacobian: Array) -> Flags:
        """Return of which numbers (m,), by their Jacobian (m, 10), the equations are near linear."""
        moved = np.max(np.abs(self.shifts @ jacobian.T), axis=0)
        variance = np.einsum('ij,jk,ik->i', jacobian, self.covariance, jacobian)
        return np.asarray(moved**2 <= self.largest**2 * variance)

    def first_order(self, jacobian: Array) -> Flags:
        """Return which numbers (m,) the data observe at first order: elsewhere near, and about as well known."""
        here, *others = (
            np.einsum('ij,jk,ik->i', jacobian, each, jacobian) for each in (self.covariance, *self.covariances)
        )
        if len(others) < len(self.shifts):
            return np.zeros(len(here), dtype=bool)
        ratio = np.array(others) / here
        alike = np.all((ratio < _ALIKE) & (ratio > 1.0 / _ALIKE), axis=0)
        return np.asarray(alike & np.all((self.shifts @ jacobian.T) ** 2 < _NEAR**2 * here, axis=0))

    @property
    def is_nonlinear(self) -> bool:
        """Whether any of the standard parameters moves too far."""
        return not bool(self.is_linear(np.eye(10)).all())


@dataclass(frozen=True)
class Solution:
    """The solution of a set of windows: numbers, covariance, and the reasons of the run beside them."""

    x: Array  # (16,) (m, h, I_o, P_0, L_0)
    covariance: Array  # (16, 16) of x
    # (16, 16) with twice the noise's own information taken off (core/difference); of `trajectory` the covariance
    covariance_for_identifiability: Array
    cost: float  # sum of the squared normalised residuals; of `trajectory` of the normalised innovations
    redundancy: int  # number of equations less that of unknowns; of `trajectory` that of the innovations
    origin: Array  # (3,) m, about which L_0 is taken, odometry frame
    plane: Plane | None  # of a planar motion, which leaves six of the ten parameters open; else None
    nonlinearities: tuple[Nonlinearity, ...] = ()  # of its equations, as far as they are known
    reasons: tuple[Reason, ...] = ()  # further ones of the run, in order


@dataclass(frozen=True, eq=False)
class Reporting:
    """The thresholds of publication."""

    scale: Array  # (10,) typical sizes of the standard parameters
    identifiable_std: float  # relative standard deviation, as the next one
    converged_std: float
    largest_residual: float  # RMS of the normalised residuals from which the data are inconsistent

    def estimate(self, solution: Solution, run: Estimate) -> Estimate:
        """Return the estimate of a solution, completed from all else that is known of its run by then.

        Parameters that the data do not identify are withheld: NaN, with their covariance.
        """
        body, covariance, plane, correction = solution.x[:10], solution.covariance[:10, :10], solution.plane, 0.0
        parameters, jacobian, linear, remainder, identifiable = self._observed(solution, body)
        if identifiable.any() and (plane is not None or not is_physical(body)):
            if plane is None:
                body, correction = project(body, covariance, self.scale)
            else:
                body, correction = project_planar(body, covariance, self.scale, plane)
            parameters, jacobian, linear, remainder, identifiable = self._observed(solution, body)
        published = jacobian @ covariance @ jacobian.T + remainder
        parameters[~identifiable] = np.nan
        published[~(identifiable[:, None] & identifiable)] = np.nan
        relative = relative_std(published, self.sizes(parameters))
        precise = is_precise(relative, identifiable, self.converged_std)
        residual = float(np.sqrt(max(solution.cost, 0.0) / max(solution.redundancy, 1)))
        shift = np.eye(6)
        shift[3:, :3] = skew(solution.origin)  # L = L_0 + origin x P
        estimate = replace(
            run,
            status=status_of(determined=bool(identifiable.any()), precise=precise),
            parameters=parameters,
            covariance=published,
            identifiable=identifiable,
            momentum=shift @ solution.x[10:],
            momentum_covariance=shift @ solution.covariance[10:, 10:] @ shift.T,
            residual=residual,
            consistency_correction=correction,
        )
        return with_reasons(
            estimate, [*self._reasons(identifiable, linear, residual, correction, solution), *solution.reasons]
        )

    def _observed(self, solution: Solution, body: Array) -> tuple[Array, Array, Flags, Array, Flags]:
        """Return what the data observe of a body (10,) at or near a solution, by its mass, CoM and inertia about it.

        These (10,), their Jacobian (10, 10), which are observed at first order, the covariance (10, 10) of the
        remainder, and which are identifiable.
        """
        parameters, jacobian = physical(body), physical_jacobian(body)
        linear, remainder = _nonlinearity(solution.nonlinearities, jacobian)
        covariance = jacobian @ solution.covariance_for_identifiability[:10, :10] @ jacobian.T + remainder
        relative = relative_std(covariance, self.sizes(parameters, LENGTH))
        known = (relative < self.identifiable_std) & (relative[0] < _OF_THE_MASS * self.identifiable_std)
        return parameters, jacobian, linear, remainder, known & linear

    def sizes(self, parameters: Array, length: float | None = None) -> Array:
        """Return the sizes that standard deviations of the (10,) physical parameters are relative to.

        That of the centre of mass is the body's own size, or a given length, m.
        """
        sizes = reference_sizes(parameters, length)
        # An element that vanishes is of the size that rounding leaves of a typical one.
        typical = np.concatenate((self.scale[:1], np.full(3, LENGTH), self.scale[4:]))
        return np.maximum(sizes, 1e-9 * typical)

    def _reasons(
        self, identifiable: Flags, linear: Flags, residual: float, correction: float, solution: Solution
    ) -> Iterator[Reason]:
        """Yield the findings of a solution by itself; contradictions count only if parameters are known."""
        if solution.plane is not None:
            yield Reason('planar motion: only mass, CoM in the plane and moment about its normal are observable')
        elif not identifiable.all():
            yield Reason(f'not determined by the data: {_names(~identifiable)}')
        if not linear.all() and identifiable.any():
            remedy = '' if linear[0] else '; known_links.total_mass helps: weigh the robot'
            yield Reason(f'observable only at second order: {_names(~linear)}{remedy}')
        if residual > self.largest_residual:
            yield residual_reason(residual, solution.redundancy, determined=bool(identifiable.any()))
        if identifiable.any():
            yield from implausible_body(correction)


def _names(which: Flags) -> str:
    return ', '.join(name for name, named in zip(PARAMETERS, which, strict=True) if named)


def reference_sizes(parameters: Array, length: float | None = None) -> Array:
    """Return the sizes (10,) of `Reporting.sizes`, without its lower bounds."""
    moments = np.sqrt(np.abs(parameters[_FIRST] * parameters[_SECOND]))
    lengths = np.full(3, body_size(parameters) if length is None else length)
    return np.concatenate((np.abs(parameters[:1]), lengths, moments))


def imprecise(estimate: Estimate, limit: float) -> list[str]:
    """Return the names of the identifiable parameters whose relative standard deviation is not below a limit."""
    with np.errstate(divide='ignore', invalid='ignore'):
        wide = ~(estimate.std / reference_sizes(estimate.parameters) < limit)
    return [name for name, known in zip(PARAMETERS, wide & estimate.identifiable, strict=True) if known]


def relative_std(covariance: Array, size: Array) -> Array:
    """Return the (..., 10) standard deviations relative to sizes (10,)."""
    return np.asarray(np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1)) / size)


def _nonlinearity(nonlinearities: Sequence[Nonlinearity], jacobian: Array) -> tuple[Flags, Array]:
    """Return which parameters, (10,), data observe at first order, and the covariance (10, 10) of the remainder.

    It counts for those alone that depend on where equations were linearised, and is at least as large as any shift.
    """
    observed, remainder = np.ones(10, dtype=bool), np.zeros((10, 10))
    for curvature in nonlinearities:
        straight = curvature.is_linear(jacobian)
        if not straight.all():
            observed &= straight | curvature.first_order(jacobian)
            shifts = np.where(straight, 0.0, curvature.shifts @ jacobian.T)
            remainder += shifts.T @ shifts
    return observed, remainder
