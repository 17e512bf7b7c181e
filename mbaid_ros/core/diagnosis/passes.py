"""Passes of the filter over stored windows with a suspected cause, and the fit that is left."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from mbaid_ros.core.contracts import Convention, Hypothesis, Stack, belongs, in_stacks, stacked, together
from mbaid_ros.core.filter.gauss_newton import BatchIteration
from mbaid_ros.core.filter.gaussian import SquareRootInformation, update
from mbaid_ros.core.filter.hypotheses import HypothesisFilter, WhitenedWindows, rare_event_likelihood
from mbaid_ros.core.filter.linearise import LinearisationCache
from mbaid_ros.core.filter.posterior import MeanAndCovariance, PriorComparison
from mbaid_ros.core.geometry import Array, Integers, skew
from mbaid_ros.core.repair import Repair
from mbaid_ros.core.results.verdict import Cause
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.robot.momentum import MomentumKernel, inertia_matrix
from mbaid_ros.core.state import BODY, MOMENTUM, Declared, Layout, Point, UnknownsPrior, Variables, variables
from mbaid_ros.core.target import another_body
from mbaid_ros.core.windows import Window
from mbaid_ros.tasks import Work

FITTED = 30  # work of fitting all windows, in steps of the filter
_LIGHTEST = -0.05  # times the known mass, that a fitted one is at least: noise may make that of an empty hand negative
_RIDGE = 1e-9  # relative, of the fit: unobservable numbers stay near zero
# Passes, each linearised nearer to the solution: the rest is far below the gains that decide between causes.
_REFINEMENTS = 3
_MOST = (30.0, 1000.0)  # times as uncertain as declared: declared unknowns, and suspects
SLIPPING = 2  # windows that a slip may take
T = TypeVar('T')


@dataclass(frozen=True)
class Fit:
    """The body and momentum that explain windows best under a convention, by linear least squares."""

    convention: Convention
    parameters: Array  # (16,) (P, L, phi), L about the run's origin
    misfit: float  # mean squared velocity of the base that is not explained, angular ones times the robot's size

    @property
    def exists(self) -> bool:
        """Whether the target may have the fitted mass."""
        least = self.convention.least_mass or _LIGHTEST * np.sum(self.convention.kernel.known[:, 0])
        return bool(self.parameters[6] > least)

    def point(self, layout: Layout) -> Point:
        """Return where windows are linearised."""
        state = np.concatenate((np.zeros(BODY.stop), layout.known.mean))
        state[MOMENTUM.start : BODY.stop] = self.parameters
        return layout.point(state)


def fitted(windows: Sequence[Window], convention: Convention, every: int = 1) -> Fit:
    """Return the fit of one in so many windows under a convention."""
    parts = [_equations(convention.kernel, stack) for stack in stacked(convention.windows(windows)[::every])]
    matrix, right = (np.concatenate(each) for each in zip(*parts, strict=True))
    size = np.sqrt(np.sum(matrix**2, axis=0))
    size[size == 0.0] = 1.0
    scaled = matrix / size
    normal = scaled.T @ scaled + _RIDGE * np.eye(len(size))
    parameters = np.linalg.solve(normal, scaled.T @ right) / size
    return Fit(convention, parameters, float(np.mean((matrix @ parameters - right) ** 2)))


def point_as_described(layout: Layout, windows: Sequence[Window]) -> Point:
    """Return where the fit of the robot as it is described would have windows linearised."""
    return fitted(windows, Convention('', layout.kernel)).point(layout)


def _equations(kernel: MomentumKernel, stack: Stack) -> tuple[Array, Array]:
    """Return T h - Y phi = momentum of the known bodies, means over each window, in velocities of the base."""
    middle, inside = stack.middle, stack.windows[0].inside
    motion, spacing = middle[inside], stack.windows[0].spacing
    shape, flat = motion.turn.shape[:2], motion.flat
    twist = np.concatenate((flat.step, flat.turn), axis=1) / spacing
    states = kernel.states_of(flat.base_rotation, flat.joint_position, flat.joint_velocity, twist)
    total = np.zeros((len(twist), 6, 16))
    total[:, :, :6] = np.eye(6)
    total[:, 3:, :3] = -skew(flat.base_position)
    total[:, :, 6:] = -states.regressor
    value = states.known_momentum - (total[:, :, :6] @ flat.impulse[..., None])[..., 0]
    back = np.linalg.inv(np.mean(np.sum(inertia_matrix(states.known), axis=1), axis=0))
    size = np.sqrt(back[0, 0] / max(back[3, 3], 1e-30))  # m: turns as displacements
    weigh = back * np.repeat((1.0, size), 3)[:, None]
    rows = np.mean((weigh @ total).reshape(*shape, 6, 16), axis=0)
    return rows.reshape(-1, 16), np.mean((value @ weigh.T).reshape(*shape, 6), axis=0).ravel()


@dataclass(frozen=True)
class FilterPasses:
    """Passes windows through the filter, with the unknowns of a layout."""

    layout: Layout
    plane: PlaneDetector
    declared: Declared

    @cached_property
    def variables(self) -> Variables:
        """Of the filter."""
        return variables(self.layout, self.plane, self.declared)

    @property
    def _batch(self) -> BatchIteration:
        return BatchIteration(self.layout, self.variables, LinearisationCache(self.layout, self.variables))

    def linearised(self, windows: Sequence[Window], point: Point) -> Work[WhitenedWindows]:
        """Return windows linearised at a point of this layout, or of the one that it extends."""
        own = self.layout
        lengths = own.parameters.stop - own.parameters.start, own.size - own.nuisance.start
        parameters, readings = (
            np.concatenate((values, np.zeros(length - len(values))))
            for values, length in zip((point.parameters, point.nuisance), lengths, strict=True)
        )
        at = replace(point, parameters=parameters, nuisance=readings)
        return (yield from self._batch.relinearise(in_stacks(windows), at))

    def filtered(
        self, passed: WhitenedWindows, hypothesis: Hypothesis, longest: int = 0, begin: HypothesisFilter | None = None
    ) -> Work[HypothesisFilter]:
        """Return a hypothesis, from `begin` on or the prior, after windows; its jumps may take up to `longest`."""
        (filtered,) = yield from self._batch.filter(passed, (begin or self._batch.prior(hypothesis, longest),))
        return filtered

    def filtered_once(self, windows: Sequence[Window], point: Point, hypothesis: Hypothesis) -> Work[HypothesisFilter]:
        """Return a hypothesis after windows linearised at a point."""
        passed = yield from self.linearised(windows, point)
        return (yield from self.filtered(passed, hypothesis))

    def refined(self, windows: Sequence[Window], point: Point, hypothesis: Hypothesis) -> Work[HypothesisFilter]:
        """Return the best of some passes, each linearised at the estimate of the one before.

        Raises LinAlgError: The first point is of no robot that can be.
        """
        best: HypothesisFilter | None = None
        for _ in range(_REFINEMENTS):
            try:
                filtered = yield from self.filtered_once(windows, point, hypothesis)
                point = self._point(filtered.gaussian)
            except np.linalg.LinAlgError:
                break  # it has led to a robot that cannot be
            best = _better(best, filtered)
        if best is None:
            raise np.linalg.LinAlgError('the first point is of no robot that can be')
        return best

    def target_changes(
        self,
        windows: Sequence[Window],
        place: int,
        points: tuple[Point, Point],
        hypothesis: Hypothesis,
        *,
        exchanged: bool,
    ) -> Work[HypothesisFilter]:
        """Return the best of some passes in which the target is another one, or elsewhere, from a window on.

        Parameters
        ----------
        windows : in order
        place : of the first window in which the target changes: nothing is predicted of the next `SLIPPING`
        points : at which windows before and after are linearised first
        hypothesis : that is followed
        exchanged : whether it is another target
        """
        end, (before, after) = place + SLIPPING, points
        best: HypothesisFilter | None = None
        for _ in range(_REFINEMENTS):
            passed = yield from self.linearised(windows[:end], before)
            filtered = yield from self.filtered(passed[:place], hypothesis)
            gaussian = filtered.gaussian
            before = self._point(gaussian)
            updated = (update(gaussian, white) for _, white in passed[place:])
            skipped = sum(rare_event_likelihood(after) - gaussian.log_likelihood for after in updated)
            changed = another_body(gaussian, self.variables, exchanged=exchanged)
            filtered = replace(filtered, gaussian=replace(changed, log_likelihood=gaussian.log_likelihood + skipped))
            passed = yield from self.linearised(windows[end:], after)
            filtered = yield from self.filtered(passed, hypothesis, begin=filtered)
            best = _better(best, filtered)
            after = self._point(filtered.gaussian)
        assert best is not None, 'there is a first pass'
        return best

    def _point(self, gaussian: SquareRootInformation) -> Point:
        distribution = MeanAndCovariance.from_gaussian(gaussian, self.variables)
        return self.layout.point(distribution.mean, distribution.deviation)

    def unpredicted(self, passed: WhitenedWindows, gaussian: SquareRootInformation, hypothesis: Hypothesis) -> Array:
        """Return by how much each window's way is not as predicted, (W, p), in units of pose errors.

        Parameters
        ----------
        passed : the windows
        gaussian : after the last of them
        hypothesis : that they were passed under: a force that acts has changed the momentum until then
        """
        own = self.variables
        mean, force = np.split(gaussian.least_squares, [len(own.scale)])
        mean[: own.pose_size] = 0.0
        found = []
        momentum = mean[own.pose_size : own.moving]  # a view
        for window, white in reversed(passed):
            changes = [white.momentum_change @ mean]
            if hypothesis.force != 'none':
                changes.insert(0, white.force_impulse(hypothesis.force) @ force)
            for change in changes:
                momentum -= change
            found.append(white.drift + white.transition @ mean)
            for change in changes:
                momentum -= white.over_gap(change, window)
        return np.array(found[::-1])

    def gains(self, base: SquareRootInformation, declared: Collection[str]) -> dict[str, tuple[float, float]]:
        """Return the gain of each cause by a wider prior, and the factor of its width; some have been declared."""
        values, covariance = MeanAndCovariance.from_gaussian(base, self.variables).unknowns(self.layout)
        found = {}
        kinds = (cause.partition(':')[0] for cause in self.layout.causes if together(cause))
        for cause in (*self.layout.causes, *dict.fromkeys(kinds)):
            own = self._numbers_of(cause)
            numbers = PriorComparison.from_posterior(values[own], covariance[np.ix_(own, own)])
            gain, times = numbers.gain(_MOST[not any(belongs(each, cause) for each in declared)])
            found[cause] = float(gain), float(times)
        return found

    def contradicting(self, gaussian: SquareRootInformation) -> float:
        """Return the gain of all unknowns that contradict the model by themselves."""
        found = contradicting_unknowns(MeanAndCovariance.from_gaussian(gaussian, self.variables), self.layout)
        return sum(each.gain for each in found)

    def with_inflated_prior(self, cause: str, factor: float) -> FilterPasses:
        """Return the same with the prior of one cause so many times as wide."""
        known, wider = self.layout.known, np.ones(len(self.layout.cause_of))
        wider[self._numbers_of(cause)] = factor
        prior = UnknownsPrior(known.mean, wider[:, None] * known.factor)
        return replace(self, layout=replace(self.layout, known=prior))

    def _numbers_of(self, cause: str) -> Integers:
        return np.flatnonzero([belongs(each, cause) for each in self.layout.cause_of])

    def value(self, filtered: HypothesisFilter, cause: str) -> Array:
        """Return the numbers (k,) of a cause as they are estimated, SI units."""
        mean = MeanAndCovariance.from_gaussian(filtered.gaussian, self.variables).mean
        found: list[Array] = []
        for unknown, place in zip(self.layout.unknowns, self.layout.places, strict=True):
            numbers = unknown.factor @ mean[place]
            found += [numbers[row : row + 1] for row, label in enumerate(unknown.labels) if belongs(label, cause)]
        return np.concatenate(found) if found else np.zeros(0)

    def repair(self, filtered: HypothesisFilter, cause: str) -> Repair | None:
        """Return how a run takes a cause into account that is as large as it is estimated; None where it cannot."""
        return estimated_repair(MeanAndCovariance.from_gaussian(filtered.gaussian, self.variables), self.layout, cause)


def contradicting_unknowns(distribution: MeanAndCovariance, layout: Layout) -> Iterator[Cause]:
    """Yield each unknown whose estimate contradicts the model by itself, as a cause."""
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        own = slice(place.start - BODY.stop, place.stop - BODY.stop)
        found = unknown.finding(distribution.mean[place], distribution.unknowns_covariance[own, own])
        if found is not None:
            yield Cause(found.text, found.gain or 0.0, found.repair)


def estimated_repair(distribution: MeanAndCovariance, layout: Layout, cause: str, wider: float = 1.0) -> Repair | None:
    """Return how a run takes a cause into account that is as large as it is estimated; None where it cannot.

    It is estimated with a prior so many times wider: with D = 1 - 1 / wider^2, mean m and covariance P of unit numbers
    become (1 - D P)^-1 m and (1 - D P)^-1 P.
    """
    placed = list(zip(layout.unknowns, layout.places, strict=True))
    # What thrusters share is a cause by itself, and the name of their kind.
    exactly = [each for each in placed if cause in each[0].labels]
    for unknown, place in exactly or placed:
        rows = np.flatnonzero([belongs(label, cause) for label in unknown.labels])
        if len(rows):
            own = np.flatnonzero(np.any(unknown.factor[rows] != 0.0, axis=0))
            factor, places = unknown.factor[np.ix_(rows, own)], place.start + own
            mean, inner = distribution.mean[places], places - BODY.stop
            covariance = distribution.unknowns_covariance[inner[:, None], inner]
            less = np.eye(len(own)) - (1.0 - wider**-2) * covariance
            mean, covariance = np.linalg.solve(less, mean), np.linalg.solve(less, covariance)
            std = np.sqrt(np.maximum(np.diag(factor @ covariance @ factor.T), 0.0))
            return unknown.repair(cause, factor @ mean, std, layout.kernel)
    return None


def attempted(passes: Work[T]) -> Work[T | None]:
    """Return the result of the passes; None if they start at a robot that cannot exist."""
    try:
        return (yield from passes)
    except np.linalg.LinAlgError:
        return None


def _better(best: HypothesisFilter | None, filtered: HypothesisFilter) -> HypothesisFilter:
    return filtered if best is None or filtered.gaussian.log_likelihood > best.gaussian.log_likelihood else best
