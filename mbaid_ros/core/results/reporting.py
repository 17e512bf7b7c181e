"""How far equations linearised at a solution are from those linearised anywhere else within its interval.

A solution of linear equations is the same wherever they are linearised. One that moves by a good part of its standard
deviation, where it is linearised at another point as likely, owes that deviation to the point: what tells of the
parameter is of second order, a product of two unknowns. So it is with the moments of inertia of a body that a planar
arm holds, of which only the tilts of its own axes tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.geometry import Array, Flags, skew
from mbaid_ros.core.linear_algebra import are_doubtful, inverse_factors
from mbaid_ros.core.results.estimate import Estimate, Status
from mbaid_ros.core.results.parameters import PARAMETERS
from mbaid_ros.core.results.physical_consistency import (
    IMPOSSIBLE,
    are_physical,
    project,
    project_planar,
)
from mbaid_ros.core.robot.kinematics import Plane
from mbaid_ros.core.robot.momentum import physical, physical_jacobian

# Standard deviations that a solution may move by: a bias of half of one costs a 95 % interval three of its
# hundredths. Of equations that are near linear it moves by some hundredths, where the mass is known to a seventh by
# up to .4, where products of unknowns lead by .5 to 1.2.
_LARGEST = 0.5


@dataclass(frozen=True, eq=False)
class Curvature:
    """What has come of linearising elsewhere.

    Attributes
    ----------
    shifts : (d, 10) by which the standard parameters have moved, at each of d other points
    covariance : (10, 10) of them at the solution
    largest : standard deviations that a near linear one moves by at most
    """

    shifts: Array
    covariance: Array
    largest: float = _LARGEST

    def straight(self, jacobian: Array) -> Flags:
        """Return of which numbers (m,) the equations are near linear.

        Parameters
        ----------
        jacobian : (m, 10) of the numbers with respect to the standard parameters
        """
        moved = np.max(np.abs(self.shifts @ jacobian.T), axis=0)
        variance = np.einsum('ij,jk,ik->i', jacobian, self.covariance, jacobian)
        return np.asarray(moved**2 <= self.largest**2 * variance)

    @property
    def anywhere(self) -> bool:
        """Whether any of the standard parameters moves too far."""
        return not bool(self.straight(np.eye(10)).all())


# Standard deviations of an estimate from the nearest real body, from which that is told.
_LARGE_CORRECTION = 3.0
_BY_CHANCE = 1e-6  # chance that so few equations leave as large a residual: asked once a window while a run is short
# Indices of I_ii and I_jj for each of the six elements of inertia.
_FIRST = np.array([4, 4, 4, 7, 7, 9])
_SECOND = np.array([4, 7, 9, 7, 9, 9])
# The noise's own information fluctuates: what is less than twice it is not signal.
NOISE_MARGIN = 2.0
# How much better the mass has to be known than others, for it and for what is a quotient with it to be believed. Its
# deviation grows and shrinks with it: of runs that know it to half of itself, those that err downwards look the surest.
_OF_THE_MASS = 0.2
_LEAST = 1e-12  # information in units of a reference, which stands for none


@dataclass(frozen=True)
class Solution:
    """The solution of a set of windows.

    Attributes
    ----------
    x : (16,) (m, h, I_o, P_0, L_0)
    covariance : (16, 16) of x
    cautious_covariance : (16, 16) the same with NOISE_MARGIN times the noise's own information taken off; of
        `trajectory` the same as the covariance
    cost : sum of the squared normalised residuals; of `trajectory` of the normalised innovations
    redundancy : number of equations less that of unknowns; of `trajectory` that of the innovations
    origin : (3,) m, about which L_0 is taken, odometry frame
    plane : of a planar motion, which leaves six of the ten parameters open; else None
    restarted : whether earlier windows had to be given up
    curvatures : how near linear what it is of is, as far as that is known
    """

    x: Array
    covariance: Array
    cautious_covariance: Array
    cost: float
    redundancy: int
    origin: Array
    plane: Plane | None
    restarted: bool = False
    curvatures: tuple[Curvature, ...] = ()


@dataclass(frozen=True)
class Instant:
    """Where in a run a solution belongs.

    Attributes
    ----------
    time, stamp : s, ns of the last sample
    samples : number used by then
    """

    time: float
    stamp: int
    samples: int


@dataclass
class Reporting:
    """The thresholds of what is published; they may change between two windows.

    Attributes
    ----------
    scale : (10,) typical sizes of the standard parameters
    identifiable_std, converged_std : relative standard deviations
    length : m, that the centre of mass is taken relative to
    largest_residual : RMS of the normalised residuals from which the data are inconsistent
    """

    scale: Array
    identifiable_std: float
    converged_std: float
    length: float
    largest_residual: float

    def estimates(self, method: str, solutions: Sequence[Solution], instants: Sequence[Instant]) -> list[Estimate]:
        """Return what is published of N solutions, none of which depends on the others: together they take less time.

        Parameters
        ----------
        method : name
        solutions, instants : N of each, N > 0
        """
        bodies = np.array([one.x[:10] for one in solutions])
        covariance = np.array([one.covariance[:10, :10] for one in solutions])
        cautious = np.array([one.cautious_covariance[:10, :10] for one in solutions])
        momentum, momentum_covariance = _about_odometry_origin(solutions)
        parameters, jacobian = physical(bodies), physical_jacobian(bodies)
        straight = _straight(solutions, jacobian)
        identifiable = self._identifiable(parameters, jacobian, cautious) & straight
        planes = [one.plane for one in solutions]
        possible, corrections = self._possible(bodies, covariance, identifiable, planes)
        if possible is not bodies:
            parameters, jacobian = physical(possible), physical_jacobian(possible)
            straight = _straight(solutions, jacobian)
            identifiable = self._identifiable(parameters, jacobian, cautious) & straight
        published = jacobian @ covariance @ np.swapaxes(jacobian, 1, 2)
        parameters[~identifiable] = np.nan
        published[~(identifiable[:, :, None] & identifiable[:, None])] = np.nan
        relative = relative_std(published, self.sizes(parameters))
        settled = np.all((relative < self.converged_std) | ~identifiable, axis=1)
        estimates = []
        for k, (solution, instant) in enumerate(zip(solutions, instants, strict=True)):
            residual = float(np.sqrt(max(solution.cost, 0.0) / max(solution.redundancy, 1)))
            known, correction = identifiable[k], float(corrections[k])
            estimate = Estimate(
                method=method,
                status=self._status(known, residual, correction, solution.redundancy, settled=bool(settled[k])),
                time=instant.time,
                stamp=instant.stamp,
                parameters=parameters[k],
                covariance=published[k],
                identifiable=known,
                momentum=momentum[k],
                momentum_covariance=momentum_covariance[k],
                residual=residual,
                consistency_correction=correction,
                samples=instant.samples,
                warnings=self._warnings(known, straight[k], residual, correction, solution),
            )
            estimates.append(estimate)
        return estimates

    def _possible(
        self, bodies: Array, covariance: Array, identifiable: Flags, planes: Sequence[Plane | None]
    ) -> tuple[Array, Array]:
        """Return (N, 10) bodies that can exist for those of which anything is known, and how far off they were, (N,).

        The very array that was given where it needs no change.
        """
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

    def _identifiable(self, parameters: Array, jacobian: Array, cautious_covariance: Array) -> Flags:
        covariance = jacobian @ cautious_covariance @ np.swapaxes(jacobian, 1, 2)
        relative = relative_std(covariance, self.sizes(parameters))
        of_the_mass = relative[:, :1] < _OF_THE_MASS * self.identifiable_std
        return np.asarray((relative < self.identifiable_std) & of_the_mass)

    def sizes(self, parameters: Array) -> Array:
        """Return what the standard deviation of each of the (..., 10) physical parameters is taken relative to."""
        moments = np.sqrt(np.abs(parameters[..., _FIRST] * parameters[..., _SECOND]))
        length = np.full((*parameters.shape[:-1], 3), self.length)
        size = np.concatenate((np.abs(parameters[..., :1]), length, moments), axis=-1)
        # An element that vanishes is of the size that rounding leaves of a typical one.
        typical = np.concatenate((self.scale[:1], np.full(3, self.length), self.scale[4:]))
        return np.maximum(size, 1e-9 * typical)

    def _status(
        self, identifiable: Flags, residual: float, correction: float, redundancy: int, *, settled: bool
    ) -> Status:
        if not identifiable.any():
            return 'not_identifiable'
        if correction > IMPOSSIBLE or self._contradicted(residual, redundancy):
            return 'inconsistent'
        return 'converged' if settled else 'estimating'

    def _contradicted(self, residual: float, redundancy: int) -> bool:
        """Tell whether residuals are too large, and not because there are few of them."""
        if redundancy <= 0 or residual <= self.largest_residual:
            return False
        return residual**2 * redundancy > chi_square.limit(_BY_CHANCE, redundancy)

    def _warnings(
        self, identifiable: Flags, straight: Flags, residual: float, correction: float, solution: Solution
    ) -> tuple[str, ...]:
        warnings = []
        if solution.plane is not None:
            warnings.append('planar motion: only mass, CoM in the plane and moment about its normal can be found')
        elif not identifiable.all():
            names = ', '.join(name for name, known in zip(PARAMETERS, identifiable, strict=True) if not known)
            warnings.append(f'not determined by the data: {names}')
        if not straight.all() and identifiable.any():
            names = ', '.join(name for name, known in zip(PARAMETERS, straight, strict=True) if not known)
            warnings.append(f'the data tell only by products of unknowns of: {names}')
        if residual > self.largest_residual:
            warnings.append(f'residuals are {residual:.1f} times what the noise parameters explain')
        if correction > _LARGE_CORRECTION and identifiable.any():
            warnings.append(f'the estimate was {correction:.1f} standard deviations away from any real body')
        if solution.restarted:
            warnings.append('the motion turned out not to be planar: what was learnt before was given up')
        return tuple(warnings)


def inverses(references: Array, matrices: Array) -> Array:
    """Return the inverses of symmetric (N, u, u) matrices, conditioned by the diagonals of definite references.

    Directions in which a matrix is not positive (noise was all there was) get a variance of 1e12 times what the
    reference's diagonal says.
    """
    size = 1.0 / np.sqrt(references.diagonal(axis1=1, axis2=2))
    factors = inverse_factors(matrices)
    if factors is None:
        if len(matrices) > 1:  # one of them: each by itself
            pairs = zip(references, matrices, strict=True)
            return np.concatenate([inverses(reference[None], matrix[None]) for reference, matrix in pairs])
        return _inverse_of_positive_part(matrices[0], size[0])[None]
    found = np.asarray(np.swapaxes(factors, 1, 2) @ factors)
    # No direction has as much variance where the sum of all has less.
    large = ((factors / size[:, None]) ** 2).sum(axis=(1, 2)) >= 1.0 / _LEAST
    for k in np.flatnonzero(large | are_doubtful(matrices, factors)):
        found[k] = _inverse_of_positive_part(matrices[k], size[k])
    return found


def _inverse_of_positive_part(matrix: Array, size: Array) -> Array:
    values, vectors = np.linalg.eigh(matrix * size * size[:, None])
    inverted = (vectors / np.maximum(values, _LEAST)) @ vectors.T
    return np.asarray(0.5 * (inverted + inverted.T) * size * size[:, None])


def relative_std(covariance: Array, size: Array) -> Array:
    """Return the (..., 10) standard deviations relative to sizes."""
    return np.asarray(np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1)) / size)


def _straight(solutions: Sequence[Solution], jacobian: Array) -> Flags:
    """Return of which parameters, (N, 10), the solutions depend little on where equations were linearised."""
    return np.array(
        [
            np.all([np.ones(10, dtype=bool), *(curvature.straight(each) for curvature in one.curvatures)], axis=0)
            for one, each in zip(solutions, jacobian, strict=True)
        ]
    )


def _about_odometry_origin(solutions: Sequence[Solution]) -> tuple[Array, Array]:
    """Return N (P, L) about the odometry frame's origin, and their covariances: L = L_0 + origin x P."""
    shift = np.zeros((len(solutions), 6, 6))
    shift[:] = np.eye(6)
    shift[:, 3:, :3] = skew(np.array([one.origin for one in solutions]))
    momentum = np.array([one.x[10:] for one in solutions])
    covariance = np.array([one.covariance[10:, 10:] for one in solutions])
    return (shift @ momentum[..., None])[..., 0], shift @ covariance @ np.swapaxes(shift, 1, 2)
