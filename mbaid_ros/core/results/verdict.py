"""The verdict on a solution: which parameters are identifiable and published, the status, its reasons and warnings."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, chi_square_limit, skew
from mbaid_ros.core.repair import Repair, Setting
from mbaid_ros.core.results.estimate import PARAMETERS, WITHHELD, Estimate, Status
from mbaid_ros.core.results.innovations import BASE_SENSORS, SIGNIFICANT, Innovations, widening
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

Severity = Literal['note', 'contradiction', 'conflict']
# Parameters with which the noise found in the readings takes the place of the specified one.
FOUND_NOISE: Mapping[str, Setting] = {'noise.estimate': True}
# Mean normalised innovation squared, of all or of one sensor, from which the model is wrong, the run not just unlucky.
LARGEST_NIS = 1.5
# Correlation of neighbouring windows from which the noise is not white enough for the intervals.
_LARGEST_CORRELATION = 0.25
# A standard deviation is wrong if the data see a thing farther off than chance allows, as specified and at twice that;
# from the third chance on it is a cause, if anything is wrong.
_NEVER, _NOT_TWICE, _RARELY = 1e-7, 1e-4, 1e-5
# Standard deviations of an estimate from the nearest real body, of none from the first, with a warning from the second.
IMPOSSIBLE, _LARGE_CORRECTION = 4.0, 3.0
_BY_CHANCE = 1e-6  # chance that so few equations leave as large a residual: asked once a window while a run is short
_FOLLOWS = 0.5  # share of a reason's gain, from which it follows from a leading cause of which it is a part
_KEPT = 10.0  # s, that an estimate is compared with later ones
_FAR = 5.0  # of its standard deviations, by which none should move: one in millions does by chance
MOST_JUMPS = 3  # of the momentum: from more on the model is wrong rather than the run unlucky
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
LARGEST_RESIDUAL = 2.0  # times the noise: noise that is specified half as large as it is, or a wrong model


@dataclass(frozen=True)
class Reason:
    """Why an estimate is to be read with care, as a stage returns it."""

    text: str  # one line: the fault, the value, the remedy
    # 'note' is a warning alone. 'contradiction', of the data with the model, makes an estimate inconsistent; one
    # without parameters stays so, WITHHELD. 'conflict', of two stages or two sensors, makes any inconsistent
    severity: Severity = 'note'
    # log-likelihood, where the text is a cause as well: it comes first, that of a note only if anything is wrong
    gain: float | None = None
    repair: Repair | None = None  # how a run takes it into account, where it is a cause


def status_of(*, determined: bool, precise: bool) -> Status:
    """Return the status of a solution that nothing contradicts.

    Parameters
    ----------
    determined : whether the data determine any parameter
    precise : whether every determined parameter is as precise, or as steady, as the method's threshold asks
    """
    if not determined:
        return 'not_identifiable'
    return 'converged' if precise else 'estimating'


def is_precise(relative_std: Array, identifiable: Flags, limit: float) -> bool:
    """Return whether each identifiable parameter (10,) has a relative standard deviation (10,) below a limit."""
    return bool(np.all((relative_std < limit) | ~identifiable))


def residual_reason(residual: float, redundancy: int, *, determined: bool) -> Reason:
    """Return the finding of residuals (RMS, normalised) that are too large: a contradiction if not by chance.

    Parameters
    ----------
    redundancy : number of equations less that of unknowns: few leave large residuals by chance
    determined : whether the data determine any parameter
    """
    text = f'residuals are {residual:.1f} times as large as the noise parameters explain'
    large = redundancy > 0 and residual**2 * redundancy > chi_square_limit(_BY_CHANCE, redundancy)
    return Reason(text, 'contradiction' if determined and large else 'note')


def implausible_body(correction: float) -> Iterator[Reason]:
    """Yield the finding of a solution that is so many standard deviations away from any real body."""
    if correction > _LARGE_CORRECTION:
        text = f'the estimate was {correction:.1f} standard deviations away from any real body'
        yield Reason(text, 'contradiction' if correction > IMPOSSIBLE else 'note')


def with_reasons(estimate: Estimate, reasons: Sequence[Reason]) -> Estimate:
    """Return an estimate with the status, warnings and causes that further reasons lead to."""
    if not reasons:
        return estimate
    status, causes, warnings = estimate.status, estimate.causes, [*estimate.warnings]
    withheld, remedies = 0, dict(estimate.remedies)
    for reason in reasons:
        follows = _follows(reason, causes, remedies)
        warnings += [] if follows else [reason.text]
        if reason.severity == 'contradiction' and status == 'not_identifiable':
            withheld = len(warnings)
        elif reason.severity != 'note':
            status = 'inconsistent'
        if not follows and reason.gain is not None and (causes or withheld or status == 'inconsistent'):
            causes = ((reason.text, reason.gain), *(each for each in causes if each[0] != reason.text))
            remedies |= {} if reason.repair is None else {reason.text: reason.repair}
    if withheld:
        warnings.insert(withheld, WITHHELD)
    return replace(estimate, status=status, causes=causes, remedies=remedies, warnings=tuple(warnings))


def _follows(reason: Reason, causes: Sequence[tuple[str, float]], remedies: Mapping[str, Repair]) -> bool:
    """Return whether a reason follows from the leading cause.

    Wrong poses make a right twist look wrong, and a gyro that is right look turned: the data agree far better without
    the sensor of the poses than without the gyro then.
    """
    leading = remedies.get(causes[0][0]) if causes else None
    if leading is None or reason.repair is None or reason.gain is None:
        return False
    if leading.conversion is not None:
        return leading.corrects_twist(reason.repair) and causes[0][1] > _FOLLOWS * reason.gain
    own = reason.repair.parameters
    if not (own and leading.leaves_out and own != leading.parameters):
        return False
    same = (gain for text, gain in causes if text in remedies and remedies[text].parameters == own)
    return max(same, default=0.0) < _FOLLOWS * causes[0][1]


def notes(texts: Sequence[str]) -> list[Reason]:
    """Return reasons that are warnings alone."""
    return [Reason(text) for text in texts]


class Distance(NamedTuple):
    """How far from zero the data see numbers: chi-square as declared, and if twice as far off; degrees of freedom."""

    square: float
    twice: float
    degrees: int


@dataclass(frozen=True)
class Cause:
    """A candidate cause, and its gain in log-likelihood."""

    text: str
    gain: float
    repair: Repair | None = None  # how a run takes it into account; None where it cannot


@dataclass(frozen=True)
class Evidence:
    """The evidence of a run for its model."""

    nis: float  # normalised innovation squared, a mean over all numbers measured: 1 for noise as declared
    innovations: Innovations  # by sensor, and from window to window
    # by declared thing, in words, how far off the data see it beside its prior, if nothing drifts
    distances: Mapping[str, Distance]
    # jumps, unconfirmed: of the momentum: how many, and the times, s, of those that may be something else yet
    jumps: int
    unconfirmed: tuple[float, ...]
    # hypothesis, physical: the reported one, empty if undisturbed; whether it has a mechanism
    hypothesis: str
    physical: bool
    gain: float  # log-likelihood of that hypothesis over the first
    # the part of the robot that, further off than declared, gains most without a force; and its gain
    instead: tuple[str, float]
    # by declared thing, in words, how a run takes it into account that it is as far off as it is estimated
    repairs: Mapping[str, Repair] = field(default_factory=dict)
    noises: Mapping[str, Mapping[str, float]] = field(default_factory=dict)  # parameters of named sensors' noise


@dataclass(frozen=True)
class Verdict:
    """Whether the model explains the data."""

    adequate: bool  # whether it does
    reasons: tuple[str, ...]  # why not, one line each
    causes: tuple[Cause, ...]  # the likeliest first; also of a model that does, where something is suspicious
    widening: float  # factor for the published covariance

    def with_cause(self, cause: Cause) -> Verdict:
        """Return the same with one more cause in its place, which is a reason, too; one that is there counts once."""
        others = [each for each in self.causes if each.text != cause.text]
        causes = tuple(sorted((*others, cause), key=lambda each: -each.gain))
        return replace(self, causes=causes, reasons=(*self.reasons, cause.text))


def judge(evidence: Evidence) -> Verdict:
    """Return the verdict on a run."""
    innovations, reasons = evidence.innovations, []
    if evidence.nis > LARGEST_NIS or evidence.jumps > MOST_JUMPS:
        reasons.append(
            f'the model does not explain the data: innovations {np.sqrt(evidence.nis):.1f} times the noise, '
            f'{evidence.jumps} jumps of the momentum'
        )
    elif np.any((innovations.ratio > LARGEST_NIS) & (innovations.ratio_significance > SIGNIFICANT)):
        reasons.append('the noise of a sensor is not as specified')
    if evidence.unconfirmed:
        times = ', '.join(f'{time:.1f}' for time in evidence.unconfirmed)
        reasons.append(f'the momentum seems to jump at {times} s: the next windows show whether it was an impulse')
    if not evidence.physical:
        reasons.append(f'{evidence.hypothesis}: a random walk fits any data, so do not trust the numbers')
    what, gain = evidence.instead
    if evidence.hypothesis and evidence.physical and gain > evidence.gain:
        reasons.append(f'{evidence.hypothesis}, or {what} is set too precisely: so far the data agree with either')
    correlated = (innovations.correlation > _LARGEST_CORRELATION) & (innovations.correlation_significance > SIGNIFICANT)
    if np.any(correlated):
        reasons.append('the innovations of neighbouring windows are correlated: the intervals would be too narrow')
    far = [what for what, distance in evidence.distances.items() if _too_far(distance)]
    if far:
        reasons.append(f'the robot deviates from its description by more than specified: {", ".join(far)}')
    return Verdict(not reasons, tuple(reasons), _causes(evidence), widening(innovations, evidence.nis))


_ALL_OF_IT = 0.9  # of the distance of a kind of things, which one of them is then


def is_suspect(distance: Distance) -> bool:
    """Return whether data see a thing so far off that it is a cause, if anything is wrong."""
    return distance.degrees > 0 and distance.square > chi_square_limit(_RARELY, distance.degrees)


def _too_far(distance: Distance) -> bool:
    square, twice, degrees = distance
    return degrees > 0 and square > chi_square_limit(_NEVER, degrees) and twice > chi_square_limit(_NOT_TWICE, degrees)


def too_small(noise: Collection[str], times: float) -> str:
    """Return that parameters of a sensor's noise are so many times too small."""
    return f'{" and ".join(noise)} {"are" if len(noise) > 1 else "is"} {times:.1f} times too small'


def _suspects(evidence: Evidence) -> dict[str, Distance]:
    """Return things that are far off, and kinds of them; of several sensors not the kind, if it is one that is."""
    found = {what: distance for what, distance in evidence.distances.items() if is_suspect(distance)}
    for sensor in evidence.noises:
        ending = f' of {sensor.rpartition(".")[2]}'
        for what in [each for each in found if each.endswith(ending)]:
            kind = what.removeprefix('the ').removesuffix(ending)
            if kind in found and found[what].square > _ALL_OF_IT * found[kind].square:
                del found[kind]
    return found


def _causes(evidence: Evidence) -> tuple[Cause, ...]:
    """Return the candidate causes, the likeliest first."""
    causes = [
        Cause(
            f'{what} is further off than specified: check it, or raise its standard deviation',
            0.5 * distance.square,
            evidence.repairs.get(what),
        )
        for what, distance in _suspects(evidence).items()
    ]
    innovations = evidence.innovations
    for place, sensor in enumerate(innovations.sensors):
        ratio, count = float(innovations.ratio[place]), float(innovations.count[place])
        if innovations.ratio_significance[place] > SIGNIFICANT:
            gain = 0.5 * count * (ratio - 1.0 - np.log(ratio))
            of_base = sensor in BASE_SENSORS
            noise = {f'noise.{sensor}': 0.0} if of_base else evidence.noises.get(sensor, {sensor: 0.0})
            times = float(np.sqrt(ratio))
            text = too_small(noise, times)
            wider = {name: times * value for name, value in noise.items() if value > 0.0}
            noisy = Repair(text, FOUND_NOISE if of_base else wider, value=times) if of_base or wider else None
            causes.append(Cause(f'{text}, or the model is wrong', gain, noisy))
        correlation = float(innovations.correlation[place])
        if innovations.correlation_significance[place] > SIGNIFICANT:
            relative = correlation / max(ratio, 1.0)
            gain = -0.5 * float(innovations.pairs[place]) * np.log(max(1.0 - relative**2, 1e-3))
            remedy = 'set noise.base_correlation_time' if sensor in BASE_SENSORS else 'look at its driver'
            text = f'the noise of {sensor} is correlated over more than a window: {remedy}'
            causes.append(Cause(text, gain))
    if evidence.hypothesis and evidence.physical:
        causes.append(Cause(evidence.hypothesis, evidence.gain))
    causes.sort(key=lambda cause: -cause.gain)
    # A walk gains more than anything else could, and names nothing: it comes last.
    walk = [Cause(evidence.hypothesis, evidence.gain)] if evidence.hypothesis and not evidence.physical else []
    return (*causes, *walk)


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
    # (16, 16) with twice the noise's own information taken off (core/difference.py); of `trajectory` the covariance
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
        residual = float(np.sqrt(max(solution.cost, 0.0) / max(solution.redundancy, 1)))
        published = jacobian @ covariance @ jacobian.T + remainder
        reasons = [*self._reasons(identifiable, linear, residual, correction, solution)]
        if not identifiable.any() and parameters[0] != 0.0:  # zero in readings of nothing that moves
            reasons += self._uncertain_mass(float(np.sqrt(published[0, 0]) / abs(parameters[0])))
        parameters[~identifiable] = np.nan
        published[~(identifiable[:, None] & identifiable)] = np.nan
        relative = relative_std(published, self.sizes(parameters))
        precise = is_precise(relative, identifiable, self.converged_std)
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
        return with_reasons(estimate, [*reasons, *solution.reasons])

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

    def _uncertain_mass(self, relative: float) -> Iterator[Reason]:
        """Yield why nothing is published of a body whose mass has a relative standard deviation, if it is near that."""
        limit = _OF_THE_MASS * self.identifiable_std
        if relative < self.identifiable_std:
            why = (
                f'known to {100.0 * relative:.3g} % (standard deviation), and numbers are published from '
                f'{100.0 * limit:.3g} % on'
            )
            yield Reason(
                f'the mass is {why if relative >= limit else "observable only at second order"}: weigh the robot '
                '(known_links.total_mass), or move more'
            )

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
