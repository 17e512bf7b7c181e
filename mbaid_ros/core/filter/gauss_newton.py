"""Gauss-Newton iterations over stored windows, and the search for a start by several of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mbaid_ros.core.contracts import STACK, Axes, Hypothesis, Stack, in_stacks, stacked
from mbaid_ros.core.filter.gaussian import SquareRootInformation
from mbaid_ros.core.filter.hypotheses import (
    LONGEST,
    LONGEST_AT_A_GUESS,
    MARGIN,
    NO_JUMPS,
    Bank,
    HypothesisFilter,
    WhitenedWindows,
    cap_likelihood,
    far_likelier,
    joined,
    leader,
    update_bank,
)
from mbaid_ros.core.filter.linearise import LINEARISED, LinearisationCache, WhitenedWindow
from mbaid_ros.core.filter.posterior import MeanAndCovariance
from mbaid_ros.core.geometry import Array, Flags, chi_square_limit
from mbaid_ros.core.gyro import angular_momentum
from mbaid_ros.core.results.verdict import IMPOSSIBLE, Nonlinearity
from mbaid_ros.core.robot.body import is_physical, physical_shift, project
from mbaid_ros.core.robot.momentum import unknown_scale
from mbaid_ros.core.state import (
    BODY,
    BODY_PLACES,
    LINEAR,
    MOMENTUM,
    Layout,
    MomentumDrift,
    Point,
    Variables,
    numbers_of,
    trust_region,
)
from mbaid_ros.core.windows import Window
from mbaid_ros.tasks import Work

MASS = BODY.start - LINEAR.start  # its index among the parameters
_ITERATIONS = 12  # at most: an iteration that has not converged by then seldom does
_MOST_ITERATIONS = 24  # the same where the target has a prior or was tracked, from which the steps may be halved
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
_BACK = -0.5  # cosine of the angle between two steps, of which the second goes back: the first was too long
# Guessed bodies: balls of part of the known bodies' mass and size, at rest. The size is that of at most so many links:
# an unknown body is not the larger, the more joints lead to it.
_GUESSED_MASSES, _GUESSED_RADIUS, _LINKS = (0.3, 0.1, 1.0), 0.25, 7
_LARGEST_SHIFT = 1.0  # standard deviations that noise in the rows may move a result by: above, it may explain the gain
# Natural frequency (Hz) from which it is loose first: an iteration follows the three periods of the first 5 s only.
_FAST = 0.6
_LOOSE = (1.0, 0.1, 0.01)  # unmodelled excitation, in deviations of the swing at the start
_FEWEST, _LONGER = 3, 3  # first windows that a swing is followed over, and the part of them by which these then grow


def is_converged(step: Array, deviation: Array) -> bool:
    """Return whether a Gauss-Newton step is negligible beside the standard deviations: the one stopping rule."""
    return bool(np.all(np.abs(step) <= _CONVERGED * deviation))


def reverses(step: Array, before: Array, deviation: Array) -> bool:
    """Return whether a step reverses the one before, which was too long."""
    scaled, last = (each / np.where(deviation > 0.0, deviation, np.inf) for each in (step, before))
    return bool(scaled @ last < _BACK * np.linalg.norm(scaled) * np.linalg.norm(last))


PriorAt = Callable[[Point], HypothesisFilter]  # before the first window, at the point where that is linearised


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

    def prior(
        self,
        hypothesis: Hypothesis,
        longest: int = LONGEST,
        mass: float | None = None,
        point: Point | None = None,
    ) -> HypothesisFilter:
        """Return a hypothesis before the first window: of any mass or near one, with jumps of so many windows.

        Of none where the target is known beforehand: what a first guess explains badly would pass for jumps. The
        motion of a tracked target counts at a point only.
        """
        return self.priors((hypothesis,), longest, mass, point)[0]

    def prior_at(self, hypothesis: Hypothesis, longest: int = LONGEST, mass: float | None = None) -> PriorAt:
        """Return the same as a function of the point at which windows are linearised."""
        return partial(self.prior, hypothesis, longest, mass)

    def priors(
        self,
        hypotheses: Sequence[Hypothesis],
        longest: int,
        mass: float | None = None,
        point: Point | None = None,
    ) -> Bank:
        """Return hypotheses before the first window, which share a root."""
        longest = 0 if self.variables.is_informed else longest
        gaussians = SquareRootInformation.priors(self.variables, [each.force for each in hypotheses], mass, point)
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

    def filter(
        self, windows: WhitenedWindows, bank: Bank, course: list[SquareRootInformation] | None = None
    ) -> Work[Bank]:
        """Return hypotheses updated by all windows; their Gaussians after each go into a course, if any."""
        for window, white in windows:
            bank = update_bank(bank, window, white, self.variables)
            if course is not None:
                course.append(leader(bank).gaussian)
            for _ in bank:
                yield 1
        return bank

    def converge(
        self, stacks: list[list[Stack]], point: Point, prior: PriorAt, *, mass_held: bool = False
    ) -> Work[BatchResult | None]:
        """Iterate from a point until the solution moves no more, at most a dozen times; None where nothing is solved.

        Parameters
        ----------
        stacks : of the windows
        point : to begin at
        prior : makes a hypothesis before the first window
        mass_held : whether that prior holds the mass
        """
        result: BatchResult | None = None
        least, idle, pace = np.inf, 0, 1.0
        before: Array = np.zeros(0)
        damped = self.variables.is_informed
        for _ in range(_MOST_ITERATIONS if damped else _ITERATIONS):
            try:
                windows = yield from self.relinearise(stacks, point)
                filtered, drift = yield from self._followed(windows, prior(point))
                result = self._step(point, filtered, windows, drift, mass_held=mass_held)
            except np.linalg.LinAlgError:
                # The step has led to a robot that cannot exist.
                return None if result is None else replace(result, point=result.linearised_at, converged=False)
            point = result.point
            if damped and not result.converged:
                step = point.parameters - result.linearised_at.parameters
                back = before.size > 0 and reverses(step, before, result.deviation)
                pace, before = 0.5 * pace if back else min(1.0, 1.5 * pace), step
                held = result.linearised_at.state
                point = self.layout.point(held + pace * (point.state - held)).drifting(point.drift)
            misfit = result.filtered.misfit / max(result.filtered.gaussian.measured, 1)
            least, idle = min(misfit, least), 0 if misfit < least else idle + 1
            if result.converged or (least > HOPELESS and idle >= _IDLE):
                break
        return result

    def _followed(
        self, windows: WhitenedWindows, prior: HypothesisFilter
    ) -> Work[tuple[HypothesisFilter, MomentumDrift | None]]:
        """Return a hypothesis after all windows, and how forces change the momentum over them."""
        course: list[SquareRootInformation] | None = [] if self.layout.has_varying_push else None
        (filtered,) = yield from self.filter(windows, (prior,), course)
        return filtered, momentum_drift(windows, filtered.gaussian, self.variables, self.layout, course)

    def _step(
        self,
        held: Point,
        filtered: HypothesisFilter,
        windows: WhitenedWindows,
        drift: MomentumDrift | None,
        *,
        mass_held: bool,
    ) -> BatchResult:
        """Return the Gauss-Newton step from the point of linearisation, cut short where it leads far."""
        parameters = held.parameters
        distribution = MeanAndCovariance.from_gaussian(filtered.gaussian, self.variables)
        deviation = distribution.deviation[self.layout.parameters]
        state, correction = self._nearest_physical(distribution)
        state_there = self.layout.linearisation_state(state, distribution.deviation)
        step: Array = state_there[self.layout.parameters] - parameters
        converged = is_converged(step, deviation)
        step *= trust_region(parameters, step)
        state[self.layout.parameters] = parameters + step
        point = self.layout.point(state, distribution.deviation).drifting(drift)
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

    def nonlinearity(self, stacks: list[list[Stack]], filtered: HypothesisFilter) -> Work[Nonlinearity]:
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
            part = trust_region(distribution.mean[self.layout.parameters], step[self.layout.parameters])
            shift, covariance = yield from self._shift(stacks, filtered, distribution, part * step)
            covariances.append(covariance)
            shift[BODY] = physical_shift(distribution.mean[BODY], part * step[BODY], shift[BODY])
            shifts.append(shift / part**2)  # of second order in the step
        moved = np.array(shifts)
        unknowns = moved[:, BODY.stop :] @ self.layout.known.whitening.T
        return Nonlinearity(
            moved[:, BODY], distribution.covariance(BODY_PLACES), unknowns=unknowns, covariances=np.array(covariances)
        )

    def newton_step(self, stacks: list[list[Stack]], filtered: HypothesisFilter) -> Work[Nonlinearity]:
        """Return how far the solution moves where all windows are linearised at it: a Newton step.

        Parameters
        ----------
        stacks : of the windows
        filtered : a hypothesis after them, each linearised at an earlier estimate
        """
        distribution = MeanAndCovariance.from_gaussian(filtered.gaussian, self.variables)
        shift, _ = yield from self._shift(stacks, filtered, distribution, np.zeros(len(distribution.mean)))
        curvature = Nonlinearity(shift[None, BODY], distribution.covariance(BODY_PLACES))
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
            prior = self.prior(filtered.hypothesis, filtered.longest_jump, point=point)
            if self.layout.has_varying_push:
                _, drift = yield from self._followed(windows, prior)
            else:
                drift = momentum_drift(windows, filtered.gaussian, self.variables, self.layout)
            if drift is not None:
                windows = yield from self.relinearise(stacks, point.drifting(drift))
            (moved,) = yield from self.filter(windows, (prior,))
            there = MeanAndCovariance.from_gaussian(moved.gaussian, self.variables)
        except np.linalg.LinAlgError:
            # No robot that can exist: it may be anywhere in its interval, and nothing is known there.
            return distribution.deviation, np.full((10, 10), np.nan)
        return there.mean - distribution.mean, there.covariance(BODY_PLACES)


def momentum_drift(
    windows: WhitenedWindows,
    gaussian: SquareRootInformation,
    variables: Variables,
    layout: Layout,
    course: Sequence[SquareRootInformation] | None = None,
) -> MomentumDrift | None:
    """Return how forces change the momentum over windows, from after the last; None where none acts.

    Without it windows would be linearised at the momentum of another one, and seem to see the masses by that.

    Parameters
    ----------
    gaussian : after the last window
    course : Gaussians after each window, for the forces that vary; None to leave these out
    """
    axes, count = gaussian.axes, len(variables.scale)
    pushing = np.zeros(count, dtype=bool)
    pushing[variables.first_unknown :] = numbers_of(layout.unknowns, [each.pushes for each in layout.unknowns])
    pushing[variables.gauss_markov] &= course is not None
    if axes == 'none' and not pushing.any():
        return None
    numbers = gaussian.mean_and_shift()[0]
    values = np.tile(numbers, (len(windows), 1))
    if course is not None:
        free = np.concatenate((np.arange(variables.moving), variables.gauss_markov))
        values[:, free] = [each.given(numbers, free) for each in course]
    whites = [white for _, white in windows]
    impulses = _impulses(whites, values, pushing, axes, variables)
    if course is None:
        through = impulses.copy()
        for place, (window, white) in enumerate(windows[1:]):
            through[place] += white.over_gap(impulses[place + 1], window)
        offsets = -np.cumsum(through[::-1], axis=0)[::-1]
    else:
        momenta = values[:, variables.pose_size : variables.moving]
        offsets = momenta - impulses - momenta[-1]
    last, length = windows[-1][0], whites[-1].length
    to_momentum = variables.to_state[MOMENTUM, variables.pose_size : variables.moving]
    return MomentumDrift(
        starts=np.array([window.start for window, _ in windows]),
        offsets=offsets @ to_momentum.T,
        instant=last.start + last.length,
        rate=to_momentum @ impulses[-1] / length,
        mass=layout.point(variables.state_columns(numbers[:count, None])[:, 0]).total_mass,
        central=axes in {'none', 'inertial'},
    )


def _impulses(
    whites: Sequence[WhitenedWindow], values: Array, pushing: Flags, axes: Axes, variables: Variables
) -> Array:
    """Return the changes (W, p) of the momentum from each window to the next by forces.

    Parameters
    ----------
    values : (W, n) variables after each window, at the first knot of the next
    pushing, axes : (v,) which of them are forces or torques; of a constant force
    """
    count = len(variables.scale)
    at_begin, varying = values[:, :count].copy(), variables.gauss_markov
    if varying.size:  # from v / kept to v
        kept = variables.autocorrelation(whites[-1].length)
        at_begin[:, varying] *= 0.5 * (1.0 + kept) / kept
    pairs = zip(whites, at_begin[:, pushing], strict=True)
    impulses = np.array([white.momentum_change[:, pushing] @ value for white, value in pairs])
    if axes == 'none':
        return impulses
    forced = [white.force_impulse(axes) @ value for white, value in zip(whites, values[:, count:], strict=True)]
    return np.asarray(impulses + forced)


@dataclass(frozen=True)
class Start:
    """The outcome of a search."""

    bank: Bank  # of all hypotheses
    point: Point  # at which they are linearised
    accepted: bool  # whether the search has converged to one acceptable point
    covariance: Array  # (10, 10) of the body, of the windows that were searched
    # computes how near linear the windows are about the point; None where it is not accepted
    nonlinearity: Work[Nonlinearity] | None


@dataclass(frozen=True)
class MultiStart:
    """Searches the point that windows lead to."""

    batch: BatchIteration  # iterates over the windows
    hypotheses: tuple[Hypothesis, ...]  # the first is the one to beat

    def search(self, windows: list[Window], points: Sequence[Callable[[], Point | None]]) -> Work[Start]:
        """Return the start that batch iterations lead to, from earlier points or else from guesses.

        Raises LinAlgError: Neither points nor guesses lead to a robot that can exist.

        Parameters
        ----------
        windows : in order; those that are added during the search are only filtered
        points : make earlier solutions, or None; each is tried only where the one before leads nowhere
        """
        count, stacks = len(windows), in_stacks(windows)
        results: list[BatchResult] = []
        for make in points:
            point = make()
            if point is None or point.parameters[MASS] <= 0.0:
                continue
            result = yield from self.batch.converge(stacks, point, self.batch.prior_at(self.hypotheses[0]))
            if result is None:
                continue
            results.append(result)
            chosen, bank, other_leads = yield from self._choose_hypothesis(stacks, result)
            if result.consistent or other_leads:
                break
        else:
            results += yield from self._from_guesses(stacks, windows[:count])
            if not results:
                raise np.linalg.LinAlgError('no start leads to a robot that can be')
            result = max(results, key=lambda each: each.merit)
            chosen, bank, other_leads = yield from self._choose_hypothesis(stacks, result)
        accepted = other_leads or (result.acceptable and not any(result.is_rivalled_by(other) for other in results))
        distribution = MeanAndCovariance.from_gaussian(leader(bank).gaussian, self.batch.variables)
        covariance = distribution.covariance(BODY_PLACES)
        nonlinearity = self.batch.nonlinearity(stacks, leader(bank)) if accepted else None
        while count < len(windows):
            more = windows[count : count + STACK]
            linearised = yield from self.batch.relinearise([stacked(more)], chosen.linearised_at)
            count += len(more)
            bank = yield from self.batch.filter(linearised, bank)
        return Start(bank, chosen.linearised_at, accepted, covariance, nonlinearity)

    def _from_guesses(self, stacks: list[list[Stack]], windows: Sequence[Window]) -> Work[list[BatchResult]]:
        """Return the solutions with each guessed mass held, and from the best of these with any mass.

        Where the rows are as noisy as the motion is large, an iteration may converge with narrow intervals although
        bodies of quite another mass explain the windows as well: the results with the mass held show those.
        """
        if self.batch.variables.has_body_prior:
            guess = self.batch.layout.point(self._beginning(self.batch.variables.mean[BODY], stacks[0][0].windows))
            result = yield from self.batch.converge(stacks, guess, self.batch.prior_at(self.hypotheses[0]))
            return [] if result is None else [result]
        batch, *stages = from_loose_swing(self.batch)
        results = yield from self._from_masses(stacks, batch)
        for stage in stages:
            if not results:
                break
            point = max(results, key=lambda each: each.merit).point
            result = yield from stage.converge(stacks, point, self.batch.prior_at(self.hypotheses[0], NO_JUMPS))
            results = [] if result is None else [result]
        swinging = self.batch.layout.kernel.springs.count > 0
        if swinging and not any(each.consistent for each in results):
            results += yield from self._following_a_swing(stacks, windows)
        return results

    def _following_a_swing(self, stacks: list[list[Stack]], windows: Sequence[Window]) -> Work[list[BatchResult]]:
        """Return solutions from points that explain ever more of the first windows, with a guessed mass.

        A frequency off by a few percent puts a large swing out of phase by the last window, and no iteration leads
        back. In the first ones it is still in phase.
        """
        results: list[BatchResult] = []
        for guess in self._guesses([window for stack in stacks[0] for window in stack.windows], self.batch.layout):
            prior = self.batch.prior_at(self.hypotheses[0], NO_JUMPS, float(guess.parameters[MASS]))
            point, count = guess, _FEWEST
            while count < len(windows):
                result = yield from self.batch.converge(in_stacks(windows[:count]), point, prior, mass_held=True)
                if result is not None and result.filtered.gaussian.nis < HOPELESS * result.filtered.gaussian.measured:
                    point = result.point
                count += max(1, count // _LONGER)
            result = yield from self.batch.converge(stacks, point, self.batch.prior_at(self.hypotheses[0], NO_JUMPS))
            results += [] if result is None else [result]
            if result is not None and result.consistent:
                break
        return results

    def _from_masses(self, stacks: list[list[Stack]], batch: BatchIteration) -> Work[list[BatchResult]]:
        """Return these, by an iteration; with passive joints one guess is enough where its solution is sure."""
        held: list[BatchResult] = []
        free: list[BatchResult] = []
        of_any_mass = self.batch.prior_at(self.hypotheses[0], LONGEST_AT_A_GUESS)
        for guess in self._guesses([window for stack in stacks[0] for window in stack.windows], batch.layout):
            prior = self.batch.prior_at(self.hypotheses[0], LONGEST_AT_A_GUESS, float(guess.parameters[MASS]))
            result = yield from batch.converge(stacks, guess, prior, mass_held=True)
            held += [] if result is None else [result]
            if result is None or not (batch.layout.kernel.springs.count and result.consistent):
                continue
            result = yield from batch.converge(stacks, result.point, of_any_mass)
            if result is not None and result.acceptable and result.consistent and self._is_hardly_shifted(result):
                return [result, *held]
        for start in sorted(held, key=lambda each: each.merit, reverse=True):
            result = yield from batch.converge(stacks, start.point, of_any_mass)
            free += [] if result is None else [result]
            if result is not None and result.acceptable:
                break
        return free + held

    def _choose_hypothesis(
        self, stacks: list[list[Stack]], result: BatchResult
    ) -> Work[tuple[BatchResult, Bank, bool]]:
        """Return the result of the best hypothesis, all hypotheses there, and whether another one leads.

        Another hypothesis leads only if it explains the windows, and better, at its own solution: its gain is else the
        linearisation's. Where the first explains them too, the gain must not come from noise in the rows.
        """
        first, *others = self.hypotheses
        longest = result.filtered.longest_jump
        bank: Bank = (result.filtered,)
        if others:
            priors = self.batch.priors(others, longest, point=result.linearised_at)
            followed = yield from self.batch.filter(result.windows, priors)
            bank = (result.filtered, *followed)
            bank = bank if result.mass_held else joined(bank)
        leading = leader(bank).hypothesis
        if leading is first:
            return result, bank, False
        other = yield from self.batch.converge(stacks, result.point, self.batch.prior_at(leading, longest))
        if other is None:
            return result, cap_likelihood(bank), False
        needed = not result.consistent or self._is_hardly_shifted(other)
        if not (needed and other.acceptable and other.consistent and far_likelier(other.filtered, result.filtered)):
            return result, cap_likelihood(bank), False
        priors = self.batch.priors(self.hypotheses, longest, point=other.linearised_at)
        bank = yield from self.batch.filter(other.windows, priors)
        return other, bank, True

    def _is_hardly_shifted(self, result: BatchResult) -> bool:
        """Return whether the correction for noise in the rows is small."""
        shift = np.abs(result.distribution.shift[self.batch.layout.parameters])
        return bool(np.all(shift <= _LARGEST_SHIFT * result.deviation))

    def _guesses(self, windows: Sequence[Window], layout: Layout) -> list[Point]:
        """Return points with balls as target: of the declared mass, or of parts of the known mass.

        The robot is at rest, or turns as the gyro measures where no pose locates the base.
        """
        kernel = self.batch.layout.kernel
        declared = float(self.batch.variables.mean[BODY.start])
        known = float(np.sum(kernel.known[:, 0])) or float(self.batch.variables.typical_momentum[0])
        parts = [part * known for part in _GUESSED_MASSES]
        tracked = self.batch.variables.tracked
        if tracked is not None and tracked.grasp_known:
            return [tracked.point(mass) for mass in parts]
        lengths = np.linalg.norm(kernel.model.positions, axis=1)
        length = float(np.sum(lengths)) * min(1.0, _LINKS / max(len(lengths), 1))
        guesses: list[Point] = []
        for mass in [declared] if declared > 0.0 else parts:
            if not kernel.model.joints and kernel.target.parameters[0] > 0.0:  # nothing else shows its size
                body = kernel.target.parameters * mass / kernel.target.parameters[0]
                guesses.append(layout.point(self._beginning(body, windows)))
                continue
            ball = np.zeros(10)
            ball[0], ball[[4, 7, 9]] = mass, mass * (_GUESSED_RADIUS * max(length, 0.1)) ** 2
            guesses.append(layout.point(self._beginning(ball, windows)))
        return guesses

    def _beginning(self, body: Array, windows: Sequence[Window]) -> Array:
        """Return the state with a body (10,), as the windows begin."""
        angular = angular_momentum(self.batch.layout.kernel, body, windows)
        return self.batch.layout.state(body, np.concatenate((np.zeros(3), angular)))


def from_loose_swing(batch: BatchIteration) -> list[BatchIteration]:
    """Return iterations to run one after the other, the last as it is; alone where no passive joint is fast.

    A wrong body, or a frequency off by a few percent, puts the predicted swing out of phase in the first windows, and
    no iteration leads back. So the swing may first change from window to window as much as it may be at the start,
    then ever less.
    """
    layout = batch.layout
    if layout.kernel.springs.highest_frequency < _FAST:
        return [batch]
    stages: list[BatchIteration] = []
    for part in _LOOSE:
        eased = tuple(each.eased(part, layout.unknowns) for each in layout.unknowns)
        if all(each is own for each, own in zip(eased, layout.unknowns, strict=True)):
            return [batch]
        looser = replace(layout, unknowns=eased)
        stages.append(replace(batch, layout=looser, linearised=LinearisationCache(looser, batch.variables)))
    return [*stages, batch]
