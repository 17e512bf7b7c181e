"""The batch iteration: all windows relinearised at one point, a hypothesis filtered over them, the point moved, again.

Long computations are generators, for `Tasks`: they yield the cost of each piece, and return their outcome.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.filter.bank import LONGEST, MARGIN, Bank, HypothesisFilter, update_bank
from mbaid_ros.core.filter.square_root import MeanAndCovariance, SquareRootInformation
from mbaid_ros.core.filter.state import BODY, BODY_PLACES, LINEAR, Layout, Point, near_part
from mbaid_ros.core.filter.time_update import Hypothesis
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.filter.whitened import LINEARISED, LinearisationCache, WhitenedWindow
from mbaid_ros.core.filter.window import Stack, Window
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.linear_algebra import chi_square_limit
from mbaid_ros.core.results.physical_consistency import IMPOSSIBLE, project
from mbaid_ros.core.results.reporting import Curvature
from mbaid_ros.core.robot.kernel import unknown_scale
from mbaid_ros.core.robot.momentum import is_physical, physical_shift
from mbaid_ros.core.tasks import Work

WhitenedWindows = list[tuple[Window, WhitenedWindow]]  # in order, each as it is and linearised

MASS = BODY.start - LINEAR.start  # its index among the parameters
_ITERATIONS = 12  # at most: an iteration that has not converged by then seldom does
_MOST_ITERATIONS = 24  # the same where the target has a prior, from which the steps may be halved
# Mean normalised innovation squared above which an iteration stops after so many steps without improvement.
HOPELESS, _IDLE = 10.0, 3
_CONVERGED = 0.1  # standard deviations: smaller steps change nothing that is published
# Relative standard deviation of the mass below which a start is accepted: above, the centre of mass, a quotient, is far
# from Gaussian.
_MASS_KNOWN = 0.15
_APART = 3.0  # standard deviations between two distinct solutions
_UNLIKELY = 0.01  # chance of innovations above which a solution counts as consistent
# Points drawn from the posterior at which nonlinearity is checked: three miss a shift of one standard deviation once in
# five to eighteen times.
_DRAWS = 3
_DISPLACED = 0.25  # standard deviations by which a Newton step may move the body


def is_converged(step: Array, deviation: Array) -> bool:
    """Return whether a Gauss-Newton step is negligible beside the standard deviations: the one stopping rule."""
    return bool(np.all(np.abs(step) <= _CONVERGED * deviation))


_BACK = -0.5  # cosine of the angle between two steps, of which the second goes back: the first was too long


def turns_back(step: Array, before: Array, deviation: Array) -> bool:
    """Return whether a step reverses the one before, which was too long."""
    scaled, last = (each / np.where(deviation > 0.0, deviation, np.inf) for each in (step, before))
    return bool(scaled @ last < _BACK * np.linalg.norm(scaled) * np.linalg.norm(last))


@dataclass(frozen=True, eq=False)
class BatchResult:
    """The outcome of a batch iteration."""

    point: Point  # after the last step
    linearised_at: Point  # at which the windows of the last iteration are linearised
    windows: WhitenedWindows  # of that iteration
    filtered: HypothesisFilter  # the hypothesis filtered over them
    distribution: MeanAndCovariance  # its mean and covariance
    deviation: Array  # standard deviations of the parameters
    converged: bool  # whether the last step was negligible
    physical: bool  # whether the body is near enough to one that can exist
    mass_held: bool  # whether the prior held the mass

    @property
    def consistent(self) -> bool:
        """Whether the solution explains the windows."""
        gaussian = self.filtered.gaussian
        return self.converged and self.physical and gaussian.nis < chi_square_limit(_UNLIKELY, gaussian.measured)

    @property
    def acceptable(self) -> bool:
        """Whether it has converged to a physical body whose mass is known well enough for a linear model."""
        known = bool(self.deviation[MASS] < _MASS_KNOWN * self.point.parameters[MASS])
        return self.converged and self.physical and known

    @property
    def merit(self) -> tuple[bool, float]:
        """Order of results: a free mass first, then likelihood, with a penalty where it has not converged."""
        return not self.mass_held, self.filtered.gaussian.log_likelihood - (0.0 if self.converged else MARGIN)

    def is_rivalled_by(self, other: BatchResult) -> bool:
        """Return whether another result, at a distinct point, explains the windows about as well."""
        as_good = other.filtered.gaussian.log_likelihood > self.filtered.gaussian.log_likelihood - MARGIN
        apart = np.any(np.abs(other.point.parameters - self.point.parameters) > _APART * self.deviation)
        return bool(as_good and apart)


@dataclass(frozen=True)
class BatchIteration:
    """Gauss-Newton over stored windows."""

    layout: Layout  # of the state
    variables: Variables  # of the filter
    linearised: LinearisationCache  # linearises windows

    def prior(self, hypothesis: Hypothesis, longest: int = LONGEST, mass: float | None = None) -> HypothesisFilter:
        """Return a hypothesis before the first window: of any mass or near one, with jumps of so many windows.

        Of none where the target has a prior: what a first guess explains badly would pass for jumps.
        """
        return self.priors((hypothesis,), longest, mass)[0]

    def priors(self, hypotheses: Sequence[Hypothesis], longest: int, mass: float | None = None) -> Bank:
        """Return hypotheses before the first window, which share a root."""
        longest = 0 if self.variables.has_body_prior else longest
        gaussians = SquareRootInformation.priors(self.variables, [each.force for each in hypotheses], mass)
        pairs = zip(hypotheses, gaussians, strict=True)
        return tuple(HypothesisFilter(hypothesis, gaussian, longest_jump=longest) for hypothesis, gaussian in pairs)

    def relinearise(self, stacks: list[list[Stack]], point: Point) -> Work[WhitenedWindows]:
        """Return all windows linearised at one point."""
        windows: WhitenedWindows = []
        for part in stacks:
            more = self.linearised.all_whitened(part, point)
            yield LINEARISED * len(more)
            windows += more
        return windows

    def filter(self, windows: WhitenedWindows, bank: Bank) -> Work[Bank]:
        """Return hypotheses updated by all windows."""
        for window, white in windows:
            bank = update_bank(bank, window, white, self.variables)
            for _ in bank:
                yield 1
        return bank

    def converge(
        self, stacks: list[list[Stack]], point: Point, prior: HypothesisFilter, *, mass_held: bool = False
    ) -> Work[BatchResult | None]:
        """Iterate from a point until the solution moves no more, at most a dozen times; None where nothing is solved.

        Parameters
        ----------
        stacks : of the windows
        point : to begin at
        prior : a hypothesis before the first window
        mass_held : whether that prior holds the mass
        """
        result: BatchResult | None = None
        least, idle, pace = np.inf, 0, 1.0
        before: Array = np.zeros(0)
        for _ in range(_MOST_ITERATIONS if self.variables.has_body_prior else _ITERATIONS):
            try:
                windows = yield from self.relinearise(stacks, point)
                (filtered,) = yield from self.filter(windows, (prior,))
                result = self._step(point, windows, filtered, mass_held=mass_held)
            except np.linalg.LinAlgError:
                # The step has led to a robot that cannot exist.
                return None if result is None else replace(result, point=result.linearised_at, converged=False)
            point = result.point
            if self.variables.has_body_prior and not result.converged:
                step = point.parameters - result.linearised_at.parameters
                back = before.size > 0 and turns_back(step, before, result.deviation)
                pace, before = 0.5 * pace if back else min(1.0, 1.5 * pace), step
                held = result.linearised_at.state
                point = self.layout.point(held + pace * (point.state - held))
            misfit = result.filtered.misfit / max(result.filtered.gaussian.measured, 1)
            least, idle = min(misfit, least), 0 if misfit < least else idle + 1
            if result.converged or (least > HOPELESS and idle >= _IDLE):
                break
        return result

    def _step(
        self, held: Point, windows: WhitenedWindows, filtered: HypothesisFilter, *, mass_held: bool
    ) -> BatchResult:
        """Return the Gauss-Newton step from the point of linearisation, cut short where it leads far."""
        parameters = held.parameters
        distribution = MeanAndCovariance.from_gaussian(filtered.gaussian, self.variables)
        deviation = distribution.deviation[self.layout.parameters]
        state, correction = self._nearest_physical(distribution)
        state_there = self.layout.linearisation_state(state, distribution.deviation)
        step: Array = state_there[self.layout.parameters] - parameters
        converged = is_converged(step, deviation)
        step *= near_part(parameters, step)
        state[self.layout.parameters] = parameters + step
        point = self.layout.point(state, distribution.deviation)
        physical = correction < IMPOSSIBLE
        return BatchResult(point, held, windows, filtered, distribution, deviation, converged, physical, mass_held)

    def _nearest_physical(self, distribution: MeanAndCovariance) -> tuple[Array, float]:
        """Return the likeliest state (s,) whose body can exist, and its distance in standard deviations.

        A plane leaves most of the body open: there it is the mean.
        """
        body = distribution.mean[BODY]
        if self.layout.plane is not None or is_physical(body):
            return distribution.mean.copy(), 0.0
        scale = unknown_scale(self.layout.kernel)[:10]
        nearest, distance = project(body, distribution.covariance(BODY_PLACES), scale)
        # All other numbers follow the body as far as they are correlated with it.
        factor = distribution.factor[BODY] / scale[:, None]
        state = distribution.mean + distribution.factor @ np.linalg.lstsq(factor, (nearest - body) / scale)[0]
        return np.asarray(state), distance

    def nonlinearity(self, stacks: list[list[Stack]], filtered: HypothesisFilter) -> Work[Curvature]:
        """Return how far a converged solution moves where its windows are linearised at other points of its interval.

        Parameters
        ----------
        stacks : of the windows
        filtered : a hypothesis after them, linearised at its own solution
        """
        distribution = MeanAndCovariance.from_gaussian(filtered.gaussian, self.variables)
        draws = np.random.default_rng(0)
        shifts: list[Array] = []
        covariances: list[Array] = []
        for _ in range(_DRAWS):
            step = distribution.factor @ draws.standard_normal(distribution.factor.shape[1])
            part = near_part(distribution.mean[self.layout.parameters], step[self.layout.parameters])
            shift, covariance = yield from self._shift(stacks, filtered, distribution, part * step)
            covariances.append(covariance)
            shift[BODY] = physical_shift(distribution.mean[BODY], part * step[BODY], shift[BODY])
            shifts.append(shift / part**2)  # of second order in the step
        moved = np.array(shifts)
        unknowns = moved[:, BODY.stop :] @ self.layout.known.whitening.T
        return Curvature(
            moved[:, BODY], distribution.covariance(BODY_PLACES), unknowns=unknowns, covariances=np.array(covariances)
        )

    def newton_step(self, stacks: list[list[Stack]], filtered: HypothesisFilter) -> Work[Curvature]:
        """Return how far the solution moves where all windows are linearised at it: a Newton step.

        Parameters
        ----------
        stacks : of the windows
        filtered : a hypothesis after them, each linearised at an earlier estimate
        """
        distribution = MeanAndCovariance.from_gaussian(filtered.gaussian, self.variables)
        shift, _ = yield from self._shift(stacks, filtered, distribution, np.zeros(len(distribution.mean)))
        curvature = Curvature(shift[None, BODY], distribution.covariance(BODY_PLACES))
        return replace(curvature, largest=_DISPLACED) if curvature.is_nonlinear else curvature

    def _shift(
        self, stacks: list[list[Stack]], filtered: HypothesisFilter, distribution: MeanAndCovariance, step: Array
    ) -> Work[tuple[Array, Array]]:
        """Return how far the state (s,) moves where the windows are linearised a step (s,) from a solution.

        Second, the (10, 10) covariance of the body there.
        """
        try:
            point = self.layout.point(distribution.mean + step, distribution.deviation)
            windows = yield from self.relinearise(stacks, point)
            (moved,) = yield from self.filter(windows, (self.prior(filtered.hypothesis, filtered.longest_jump),))
            there = MeanAndCovariance.from_gaussian(moved.gaussian, self.variables)
        except np.linalg.LinAlgError:
            # No robot that can exist: it may be anywhere in its interval, and nothing is known there.
            return distribution.deviation, np.full((10, 10), np.nan)
        return there.mean - distribution.mean, there.covariance(BODY_PLACES)
