"""From solutions to estimates: which parameters are published, projected to a body that can exist, with which status.

A solution of linear equations is the same wherever they are linearised. One that moves by a good part of its standard
deviation, where it is linearised at another point as likely, owes that deviation to the point: the data observe the
parameter at second order only, by products of two unknowns. So it is with the moments of inertia of a body that a
planar arm holds, which only the tilts of its own axes observe.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, skew
from mbaid_ros.core.linear_algebra import chi_square_limit
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.parameters import PARAMETERS
from mbaid_ros.core.results.physical_consistency import IMPOSSIBLE, are_physical, project, project_planar
from mbaid_ros.core.results.status import Reason, Severity, status_of, with_reasons
from mbaid_ros.core.robot.kinematics import Plane
from mbaid_ros.core.robot.momentum import physical, physical_jacobian

# Standard deviations that a solution may move by: a bias of half of one costs a 95 % interval three of its
# hundredths. Of equations that are near linear it moves by some hundredths, where the mass is known to a seventh by
# up to .4, where products of unknowns lead by .5 to 1.2.
LARGEST_SHIFT = 0.5


@dataclass(frozen=True, eq=False)
class Curvature:
    """The result of linearising elsewhere."""

    # shifts, covariance: (d, 10) by which standard parameters have moved at d other points; (10, 10) at the solution
    shifts: Array
    covariance: Array
    largest: float = LARGEST_SHIFT  # standard deviations that a near linear one moves by at most
    unknowns: Array | None = None  # (d, e) by which the unknowns' independent numbers have moved
    # (d, 10, 10) covariances at those points; none where not asked for
    elsewhere: Array = field(default_factory=lambda: np.zeros((0, 10, 10)))

    def straight(self, jacobian: Array) -> Flags:
        """Return of which numbers (m,), by their Jacobian (m, 10), the equations are near linear."""
        moved = np.max(np.abs(self.shifts @ jacobian.T), axis=0)
        variance = np.einsum('ij,jk,ik->i', jacobian, self.covariance, jacobian)
        return np.asarray(moved**2 <= self.largest**2 * variance)

    def first_order(self, jacobian: Array) -> Flags:
        """Return which numbers (m,) the data observe at first order: elsewhere near, and about as well known."""
        here, *others = (
            np.einsum('ij,jk,ik->i', jacobian, each, jacobian) for each in (self.covariance, *self.elsewhere)
        )
        if len(others) < len(self.shifts):
            return np.zeros(len(here), dtype=bool)
        ratio = np.array(others) / here
        alike = np.all((ratio < _ALIKE) & (ratio > 1.0 / _ALIKE), axis=0)
        return np.asarray(alike & np.all((self.shifts @ jacobian.T) ** 2 < _NEAR**2 * here, axis=0))

    @property
    def anywhere(self) -> bool:
        """Whether any of the standard parameters moves too far."""
        return not bool(self.straight(np.eye(10)).all())


LENGTH = 1.0  # m, that the standard deviation of the centre of mass is relative to, of a body that is not smaller
# Ratio of variances, and distance in standard deviations, of solutions at two points up to which the data observe a
# number at first order. One that only the product with another unknown shows is known as much better as that is further
# from zero: on a planar arm it moves by up to thirty, and its variances have ratios up to nine.
_ALIKE, _NEAR = 1.6, 1.0
# Standard deviations of an estimate from the nearest real body, from which a warning reports it.
_LARGE_CORRECTION = 3.0
_BY_CHANCE = 1e-6  # chance that so few equations leave as large a residual: asked once a window while a run is short
# Indices of I_ii and I_jj for each of the six elements of inertia.
_FIRST = np.array([4, 4, 4, 7, 7, 9])
_SECOND = np.array([4, 7, 9, 7, 9, 9])
# How much better the mass has to be known than others, for it and for a quotient with it to be believed. Its deviation
# grows and shrinks with it: of runs that know it to half of itself, those that err downwards look the surest.
_OF_THE_MASS = 0.2


@dataclass(frozen=True)
class Solution:
    """The solution of a set of windows: numbers, covariance, and the reasons of the run beside them."""

    x: Array  # (16,) (m, h, I_o, P_0, L_0)
    covariance: Array  # (16, 16) of x
    # (16, 16) with twice the noise's own information taken off (core/difference); of `trajectory` the covariance
    cautious_covariance: Array
    cost: float  # sum of the squared normalised residuals; of `trajectory` of the normalised innovations
    redundancy: int  # number of equations less that of unknowns; of `trajectory` that of the innovations
    origin: Array  # (3,) m, about which L_0 is taken, odometry frame
    plane: Plane | None  # of a planar motion, which leaves six of the ten parameters open; else None
    restarted: bool = False  # whether earlier windows had to be given up
    curvatures: tuple[Curvature, ...] = ()  # of its equations, as far as they are known
    reasons: tuple[Reason, ...] = ()  # further ones of the run, in order


@dataclass(frozen=True, eq=False)
class Reporting:
    """The thresholds of publication."""

    scale: Array  # (10,) typical sizes of the standard parameters
    identifiable_std: float  # relative standard deviation, as the next one
    converged_std: float
    largest_residual: float  # RMS of the normalised residuals from which the data are inconsistent

    def estimates(self, solutions: Sequence[Solution], runs: Sequence[Estimate]) -> list[Estimate]:
        """Return the estimates of N > 0 independent solutions, together, as that takes less time.

        Each is completed from all else that is known of its run by then.

        Parameters that the data do not identify are withheld: NaN, with their covariance.
        """
        bodies = np.array([one.x[:10] for one in solutions])
        covariance = np.array([one.covariance[:10, :10] for one in solutions])
        cautious = np.array([one.cautious_covariance[:10, :10] for one in solutions])
        momentum, momentum_covariance = _about_odometry_origin(solutions)
        parameters, jacobian = physical(bodies), physical_jacobian(bodies)
        linear, remainder = _nonlinearity(solutions, jacobian)
        identifiable = self._identifiable(parameters, jacobian, cautious, remainder) & linear
        planes = [one.plane for one in solutions]
        possible, corrections = self._possible(bodies, covariance, identifiable, planes)
        if possible is not bodies:
            parameters, jacobian = physical(possible), physical_jacobian(possible)
            linear, remainder = _nonlinearity(solutions, jacobian)
            identifiable = self._identifiable(parameters, jacobian, cautious, remainder) & linear
        published = jacobian @ covariance @ np.swapaxes(jacobian, 1, 2) + remainder
        parameters[~identifiable] = np.nan
        published[~(identifiable[:, :, None] & identifiable[:, None])] = np.nan
        precise = np.all((relative_std(published, self.sizes(parameters)) < self.converged_std) | ~identifiable, axis=1)
        estimates = []
        for k, (solution, run) in enumerate(zip(solutions, runs, strict=True)):
            residual = float(np.sqrt(max(solution.cost, 0.0) / max(solution.redundancy, 1)))
            known, correction = identifiable[k], float(corrections[k])
            estimate = replace(
                run,
                status=status_of(determined=bool(known.any()), precise=bool(precise[k])),
                parameters=parameters[k],
                covariance=published[k],
                identifiable=known,
                momentum=momentum[k],
                momentum_covariance=momentum_covariance[k],
                residual=residual,
                consistency_correction=correction,
            )
            reasons = [*self._reasons(known, linear[k], residual, correction, solution), *solution.reasons]
            estimates.append(with_reasons(estimate, reasons))
        return estimates

    def _possible(
        self, bodies: Array, covariance: Array, identifiable: Flags, planes: Sequence[Plane | None]
    ) -> tuple[Array, Array]:
        """Return (N, 10) bodies that can exist for those and how far off they were, (N,); itself if all can exist."""
        corrections = np.zeros(len(bodies))
        open_plane = np.array([plane is not None for plane in planes])
        asked = np.flatnonzero(identifiable.any(axis=1) & (open_plane | ~are_physical(bodies)))
        if not len(asked):
            return bodies, corrections
        possible = bodies.copy()
        for k in asked:
            plane = planes[k]
            if plane is None:
                possible[k], corrections[k] = project(bodies[k], covariance[k], self.scale)
            else:
                possible[k], corrections[k] = project_planar(bodies[k], covariance[k], self.scale, plane)
        return possible, corrections

    def _identifiable(self, parameters: Array, jacobian: Array, cautious_covariance: Array, remainder: Array) -> Flags:
        covariance = jacobian @ cautious_covariance @ np.swapaxes(jacobian, 1, 2) + remainder
        relative = relative_std(covariance, self.sizes(parameters, np.full(len(parameters), LENGTH)))
        of_the_mass = relative[:, :1] < _OF_THE_MASS * self.identifiable_std
        return np.asarray((relative < self.identifiable_std) & of_the_mass)

    def sizes(self, parameters: Array, length: Array | None = None) -> Array:
        """Return the sizes that standard deviations of the (..., 10) physical parameters are relative to.

        That of the centre of mass is the body's own size, or a given length (...), m.
        """
        moments = np.sqrt(np.abs(parameters[..., _FIRST] * parameters[..., _SECOND]))
        length = own_size(parameters) if length is None else length
        lengths = np.repeat(length[..., None], 3, axis=-1)
        size = np.concatenate((np.abs(parameters[..., :1]), lengths, moments), axis=-1)
        # An element that vanishes is of the size that rounding leaves of a typical one.
        typical = np.concatenate((self.scale[:1], np.full(3, LENGTH), self.scale[4:]))
        return np.maximum(size, 1e-9 * typical)

    def _reasons(
        self, identifiable: Flags, linear: Flags, residual: float, correction: float, solution: Solution
    ) -> Iterator[Reason]:
        """Yield the findings of a solution by itself; contradictions count only if parameters are known."""
        serious: Severity = 'contradiction' if identifiable.any() else 'note'
        if solution.plane is not None:
            yield Reason('planar motion: only mass, CoM in the plane and moment about its normal are observable')
        elif not identifiable.all():
            yield Reason(f'not determined by the data: {_names(~identifiable)}')
        if not linear.all() and identifiable.any():
            remedy = '' if linear[0] else '; known_links.total_mass helps: weigh the robot'
            yield Reason(f'observable only at second order: {_names(~linear)}{remedy}')
        if residual > self.largest_residual:
            text = f'residuals are {residual:.1f} times as large as the noise parameters explain'
            # Few equations leave large residuals by chance.
            square = residual**2 * solution.redundancy
            large = solution.redundancy > 0 and square > chi_square_limit(_BY_CHANCE, solution.redundancy)
            yield Reason(text, serious if large else 'note')
        if correction > _LARGE_CORRECTION and identifiable.any():
            text = f'the estimate was {correction:.1f} standard deviations away from any real body'
            yield Reason(text, serious if correction > IMPOSSIBLE else 'note')
        if solution.restarted:
            yield Reason('the motion is not planar: the planar solution was dropped')


def _names(which: Flags) -> str:
    return ', '.join(name for name, named in zip(PARAMETERS, which, strict=True) if named)


def own_size(parameters: Array) -> Array:
    """Return the size (...) of bodies, m, at most LENGTH: twice the radius of gyration about the CoM, a cube's side.

    Moments that are not known (NaN) count as the largest that is; without any, the size is LENGTH.

    Parameters
    ----------
    parameters : (..., 10) physical parameters
    """
    moments = np.nan_to_num(parameters[..., [4, 7, 9]])
    known = np.isfinite(parameters[..., [4, 7, 9]])
    trace = np.sum(np.where(known, moments, moments.max(axis=-1, keepdims=True)), axis=-1)
    square = 2.0 * trace / np.where(parameters[..., 0] > 0.0, parameters[..., 0], np.nan)
    return np.where(square > 0.0, np.minimum(np.sqrt(np.abs(square)), LENGTH), LENGTH)


def relative_std(covariance: Array, size: Array) -> Array:
    """Return the (..., 10) standard deviations relative to sizes."""
    return np.asarray(np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1)) / size)


def _nonlinearity(solutions: Sequence[Solution], jacobian: Array) -> tuple[Flags, Array]:
    """Return which parameters, (N, 10), data observe at first order, and the covariance (N, 10, 10) of the remainder.

    It counts for those alone that depend on where equations were linearised, and is at least as large as any shift.
    """
    observed, remainder = np.ones((len(solutions), 10), dtype=bool), np.zeros((len(solutions), 10, 10))
    for place, (one, each) in enumerate(zip(solutions, jacobian, strict=True)):
        for curvature in one.curvatures:
            straight = curvature.straight(each)
            if straight.all():
                continue
            observed[place] &= straight | curvature.first_order(each)
            shifts = np.where(straight, 0.0, curvature.shifts @ each.T)
            remainder[place] += shifts.T @ shifts
    return observed, remainder


def _about_odometry_origin(solutions: Sequence[Solution]) -> tuple[Array, Array]:
    """Return N (P, L) about the odometry frame's origin, and their covariances: L = L_0 + origin x P."""
    shift = np.zeros((len(solutions), 6, 6))
    shift[:] = np.eye(6)
    shift[:, 3:, :3] = skew(np.array([one.origin for one in solutions]))
    momentum = np.array([one.x[10:] for one in solutions])
    covariance = np.array([one.covariance[10:, 10:] for one in solutions])
    return (shift @ momentum[..., None])[..., 0], shift @ covariance @ np.swapaxes(shift, 1, 2)
