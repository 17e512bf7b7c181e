"""Which parameters are identifiable and published, and the nearest body that can exist."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, chi_square_limit, inverse_factor, skew, solve_definite, unvec, vec
from mbaid_ros.core.results.budget import PARAMETERS
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.verdict import Reason, Severity, status_of, with_reasons
from mbaid_ros.core.robot.model import Plane
from mbaid_ros.core.robot.momentum import is_physical, physical, physical_jacobian, pseudo_inertia, standard

# Standard deviations of an estimate from the nearest real body, from which it is of none.
IMPOSSIBLE = 4.0
# Smallest eigenvalue of a projected pseudo-inertia (in a plane: mass and moment), in units of `scale`: a boundary body
# would be flat, and no simulator accepts it.
_FLOOR = 1e-9
# Inverse variance, in typical sizes, below which data leave a direction open (ten sizes): it is drawn, with next to
# no weight, towards a ball of the same mass.
_OPEN = 1e-2
_DRAW = 1e-3  # standard deviations that a typical size is worth where the data leave a direction open: next to none
_SMALLEST = 1e-24  # variance, in units of `scale` squared, that stands for none: a quotient by it stays finite
# Of the weight of the boundary: at the last, an estimate is within a hundredth of a standard deviation of the nearest.
_LEAST_WEIGHT = 1e-6
_FALL = 0.03  # of the weight of the boundary, from one minimum to the next: a few steps of Newton's each
_INTERIOR = 0.9  # of the way to the boundary that a step may go: beyond it there is no logarithm
_STEPS = 100  # at most, of Newton's: a few for each weight
_PSEUDO_INERTIAS = np.array([pseudo_inertia(parameters) for parameters in np.eye(10)])
_TRACE = np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0])  # of (ixx, ixy, ixz, iyy, iyz, izz)
_CLEARER = 5.0  # times as well known as the scale, from which ratios are known where the moments are not
# Standard deviations that a solution may move by: a bias of half of one costs a 95 % interval three of its
# hundredths. Of equations that are near linear it moves by some hundredths, where the mass is known to a seventh by
# up to .4, where products of unknowns lead by .5 to 1.2.
LARGEST_SHIFT = 0.5
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
_KEPT = 10.0  # s, that an estimate is compared with later ones
_FAR = 5.0  # of its standard deviations, by which none should move: one in millions does by chance
IDENTIFIABLE_STD = 0.5  # relative standard deviation below which a parameter counts as identifiable
LARGEST_RESIDUAL = 2.0  # times the noise: noise that is declared half as large as it is, or a wrong model


def project(standard_parameters: Array, covariance: Array, scale: Array) -> tuple[Array, float]:
    """Return the real body nearest to (10,) standard parameters, and its distance in standard deviations, 0 if itself.

    Parameters
    ----------
    standard_parameters, covariance : (10,), (10, 10) positive definite: its inverse is the metric
    scale : (10,) typical size of each parameter, to condition the search
    """
    if is_physical(standard_parameters):
        return standard_parameters, 0.0
    return _projected(
        standard_parameters, covariance, scale, _PSEUDO_INERTIAS, _units(scale, 3), _ball(standard_parameters, scale)
    )


def project_planar(standard_parameters: Array, covariance: Array, scale: Array, plane: Plane) -> tuple[Array, float]:
    """Return the same as `project` for planar motion, in a plane in the link's frame, which leaves six directions open.

    The parameters of a planar motion, (m, h in the plane, the moment I about its normal), belong to a real body exactly
    when its planar pseudo-inertia [[I 1, h], [h^T, m]] is positive definite: mass and the moment about the CoM are
    positive. The open directions are filled in like a ball's.
    """
    basis, across = plane.basis, plane.axes.T
    about = float(np.linalg.norm(vec(plane.normal[:, None] * plane.normal)))
    found: Array = basis.T @ standard_parameters
    distance = 0.0
    if not _moment(found, about) > 0.0:
        matrices = np.zeros((4, 3, 3))
        matrices[0, 2, 2] = matrices[1, 0, 2] = matrices[1, 2, 0] = matrices[2, 1, 2] = matrices[2, 2, 1] = 1.0
        matrices[3, :2, :2] = np.eye(2) / about
        planar, size = basis.T @ covariance @ basis, np.abs(basis.T) @ scale
        start = basis.T @ _ball(standard_parameters, scale)
        found, distance = _projected(found, planar, size, matrices, _units(scale, 2), start)
    moment = _moment(found, about)
    ball = np.array([moment, 0.0, 0.0, moment, 0.0, moment])
    return standard(np.concatenate((found[:1], across @ found[1:3] / found[0], ball))), distance


def _moment(planar: Array, about: float) -> float:
    """Return the moment about the CoM of (4,) planar parameters, negative for a mass that is none."""
    mass, moment, first = planar[0], planar[3] / about, planar[1:3]
    return float(moment - first @ first / mass) if mass > 0.0 else -1.0


def _units(scale: Array, dimensions: int) -> Array:
    """Return the units of the rows of a pseudo-inertia, in which mass and second moment are of the same size."""
    return np.sqrt(scale[0]) * np.array([np.sqrt(scale[4] / scale[0])] * dimensions + [1.0])


def _projected(
    parameters: Array, covariance: Array, size: Array, matrices: Array, unit: Array, start: Array
) -> tuple[Array, float]:
    """Return the nearest (k,) parameters of a positive definite pseudo-inertia, and their distance.

    Parameters
    ----------
    parameters, covariance, size, start : (k,), (k, k), typical sizes (k,), a body (k,)
    matrices : (k, d, d) pseudo-inertias of unit parameters
    unit : (d,) of their rows
    """
    metric, draw = _metric(covariance, size), _DRAW / size
    rows, offset = np.concatenate((metric, np.diag(draw))), np.concatenate((metric @ parameters, draw * start))
    units = matrices * size[:, None, None] / (unit * unit[:, None])
    nearest = size * _nearest(rows * size, offset, units, start / size)
    return nearest, float(np.linalg.norm(metric @ (nearest - parameters)))


def _nearest(rows: Array, offset: Array, units: Array, start: Array) -> Array:
    """Return the x with the least |A x - b| for which the pseudo-inertia, linear in x, exceeds the floor.

    Newton's steps on 1/2 |A x - b|^2 - w ln det(pseudo-inertia - floor), with w falling to next to nothing (Boyd,
    Vandenberghe, Convex Optimization, 2004, chapter 11). There is one minimum only, mostly on the boundary, where
    coordinates that cannot leave the cone would never arrive. (r, k) rows A of full rank, (r,) offset b, (k, d, d)
    pseudo-inertias of unit x, a start inside the cone.
    """
    orthonormal, triangle = np.linalg.qr(rows)
    back = np.linalg.inv(triangle)  # z = R x, in which |A x - b| is the distance from a point
    target = orthonormal.T @ offset
    inside = x = start
    weight = max(0.25 * float(np.sum((target - triangle @ x) ** 2)), _LEAST_WEIGHT)
    side = units.shape[-1]
    identity, floor, flat = np.eye(len(x)), _FLOOR * np.eye(side), units.reshape(len(x), -1)
    for _ in range(_STEPS):
        whiten = inverse_factor((x @ flat).reshape(side, side) - floor)
        if whiten is None:  # the boundary is nearer than rounding
            return inside
        inside = x
        barrier = back.T @ (whiten @ units @ whiten.T).reshape(len(x), -1)
        slope = target - triangle @ x + weight * barrier[:, :: side + 1].sum(axis=1)
        step = solve_definite(identity + weight * (barrier @ barrier.T), slope)
        change = step @ barrier
        size = float(change @ change)
        # No eigenvalue of the change is larger than its norm.
        shrinking = 0.0 if size <= _INTERIOR**2 else -float(np.linalg.eigvalsh(change.reshape(side, side))[0])
        x = x + min(1.0, _INTERIOR / max(shrinking, 1e-300)) * (back @ step)
        if float(step @ step) / weight + size < 1.0:  # close to this weight's minimum
            if weight == _LEAST_WEIGHT:
                break
            weight = max(_FALL * weight, _LEAST_WEIGHT)
    return inside


def _ball(standard_parameters: Array, scale: Array) -> Array:
    """Return a ball with the estimate's mass, CoM and mean moment of inertia, as far as those are physical."""
    mass = max(standard_parameters[0], 1e-3 * scale[0])
    com = standard_parameters[1:4] / mass
    com = com * min(1.0, scale[1] / scale[0] / max(float(np.linalg.norm(com)), 1e-300))
    inertia = standard_parameters[[4, 7, 9]].sum() / 3.0 - 2.0 / 3.0 * mass * float(com @ com)
    moment = max(inertia, 1e-3 * mass * scale[4] / scale[0])
    about_com = np.array([moment, 0.0, 0.0, moment, 0.0, moment])
    return standard(np.concatenate(([mass], com, about_com)))


def _metric(covariance: Array, scale: Array) -> Array:
    """Return M with M^T M the inverse of the covariance, without the directions that are open."""
    values, vectors = np.linalg.eigh(covariance / scale / scale[:, None])
    # Beside variances that are far larger, small ones are rounding, of either sign.
    least = max(float(np.finfo(float).eps * values[-1]), _SMALLEST)
    weight = np.where(values < 1.0 / _OPEN, 1.0 / np.sqrt(np.maximum(values, least)), 0.0)
    return np.asarray(weight[:, None] * vectors.T / scale)


@dataclass(frozen=True)
class InertiaRatios:
    """Inertia about the centre of mass over its trace, with one standard deviation each."""

    elements: Array  # (6,) (ixx, ixy, ixz, iyy, iyz, izz)
    std: Array  # (6,) (ixx, ixy, ixz, iyy, iyz, izz)
    principal: Array  # (3,) principal moments, the smallest first
    principal_std: Array  # (3,) principal moments, the smallest first
    scale_std: float  # relative, of the trace

    @property
    def clearer(self) -> bool:
        """Whether the ratios are known far better than the scale is."""
        return bool(self.scale_std > _CLEARER * float(np.max(self.principal_std / self.principal)))


def inertia_ratios(parameters: Array, covariance: Array) -> InertiaRatios:
    """Return the ratios of (10,) physical parameters with their covariance, to first order."""
    inertia, of_inertia = parameters[4:], covariance[4:, 4:]
    trace = float(_TRACE @ inertia)
    elements = inertia / trace
    slope = (np.eye(6) - np.outer(elements, _TRACE)) / trace
    ratios = slope @ of_inertia @ slope.T
    principal, axes = np.linalg.eigh(unvec(elements))
    # A principal moment changes by the change along its axis: v^T dI v.
    x, y, z = axes
    along = np.stack((x * x, 2.0 * x * y, 2.0 * x * z, y * y, 2.0 * y * z, z * z), axis=1)
    variance = np.diag(along @ ratios @ along.T)
    return InertiaRatios(
        elements=elements,
        std=np.sqrt(np.maximum(np.diag(ratios), 0.0)),
        principal=principal,
        principal_std=np.sqrt(np.maximum(variance, 0.0)),
        scale_std=float(np.sqrt(max(_TRACE @ of_inertia @ _TRACE, 0.0))) / trace,
    )


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
        precise = np.all((relative_std(published, self.sizes(parameters)) < self.converged_std) | ~identifiable)
        residual = float(np.sqrt(max(solution.cost, 0.0) / max(solution.redundancy, 1)))
        shift = np.eye(6)
        shift[3:, :3] = skew(solution.origin)  # L = L_0 + origin x P
        estimate = replace(
            run,
            status=status_of(determined=bool(identifiable.any()), precise=bool(precise)),
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
        moments = np.sqrt(np.abs(parameters[_FIRST] * parameters[_SECOND]))
        lengths = np.full(3, body_size(parameters) if length is None else length)
        # An element that vanishes is of the size that rounding leaves of a typical one.
        typical = np.concatenate((self.scale[:1], np.full(3, LENGTH), self.scale[4:]))
        return np.maximum(np.concatenate((np.abs(parameters[:1]), lengths, moments)), 1e-9 * typical)

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


def _names(which: Flags) -> str:
    return ', '.join(name for name, named in zip(PARAMETERS, which, strict=True) if named)


def body_size(parameters: Array) -> float:
    """Return the size of a body, m, at most LENGTH: twice the radius of gyration about the CoM, a cube's side.

    Moments that are not known (NaN) count as the largest that is; without any, the size is LENGTH.

    Parameters
    ----------
    parameters : (10,) physical parameters
    """
    moments = parameters[[4, 7, 9]]
    trace = np.sum(np.where(np.isfinite(moments), moments, np.nan_to_num(moments).max()))
    square = 2.0 * trace / parameters[0] if parameters[0] > 0.0 else 0.0
    return min(float(np.sqrt(square)), LENGTH) if square > 0.0 else LENGTH


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


class IntervalConsistency:
    """Compares each estimate of a run with those of the latest seconds before it."""

    def __init__(self) -> None:
        self._earlier: deque[tuple[float, Array, Array]] = deque()  # s, (10,) parameters, (10,) standard deviations
        self._changes = 0  # of the target

    def checked(self, estimate: Estimate, *, early: bool) -> Estimate:
        """Return an estimate, inconsistent where it has left the interval of one before it that was not early."""
        changes = sum(event.kind == 'target_changed' for event in estimate.events)
        if changes != self._changes:
            self._earlier.clear()
            self._changes = changes
        while self._earlier and self._earlier[0][0] < estimate.time - _KEPT:
            self._earlier.popleft()
        if not estimate.identifiable.any() or estimate.status == 'inconsistent':
            return estimate
        reasons = [Reason(text, 'conflict') for text in self._moved(estimate)]
        if not early:
            self._earlier.append((estimate.time, estimate.parameters, estimate.std))
        return with_reasons(estimate, reasons)

    def _moved(self, estimate: Estimate) -> Iterator[str]:
        if not self._earlier:
            return
        times, parameters, stds = (np.array(each) for each in zip(*self._earlier, strict=True))
        distance = np.nan_to_num(np.abs(estimate.parameters - parameters) / stds)
        place, which = np.unravel_index(int(np.argmax(distance)), distance.shape)
        if distance[place, which] >= _FAR:
            yield (
                f'{PARAMETERS[which]} has moved by {distance[place, which]:.1f} of its standard deviations since '
                f'{times[place]:.1f} s: one of the two is wrong'
            )
