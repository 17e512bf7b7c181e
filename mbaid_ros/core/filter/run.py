"""One run of the trajectory filter: it collects windows, initialises, then tracks at a linearisation point."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto

import numpy as np

from mbaid_ros.core.contracts import Hypothesis, in_stacks
from mbaid_ros.core.filter.gauss_newton import HOPELESS, BatchIteration, MultiStart, Start, momentum_drift
from mbaid_ros.core.filter.gaussian import SquareRootInformation
from mbaid_ros.core.filter.hypotheses import Bank, HypothesisFilter, leader, update_bank
from mbaid_ros.core.filter.linearise import LinearisationCache
from mbaid_ros.core.filter.posterior import MeanAndCovariance, VarianceComponents
from mbaid_ros.core.geometry import Array, Flags, chi_square_limit
from mbaid_ros.core.passive import resolved_frequencies
from mbaid_ros.core.results.verdict import LARGEST_NIS, Nonlinearity
from mbaid_ros.core.robot.body import body_sizes
from mbaid_ros.core.state import (
    BODY,
    BODY_PLACES,
    MOMENTUM,
    Layout,
    MomentumDrift,
    Point,
    Variables,
    trust_region,
)
from mbaid_ros.core.windows import Window
from mbaid_ros.tasks import AT_ONCE, Kind, Tasks, outcome_or_none

# The point moves when the estimate is this far from its reference (squared Mahalanobis distance, of 20 to 200
# numbers): directions that nothing sees gain less information by that than their priors have. It moves along directions
# whose relative deviation is below the second number, and along those whose offset squared, the remainder of second
# order, exceeds a tenth of their deviation. An unknown's unit is about 1 % of its size.
_HELD, _WELL_KNOWN, _CURVED, _UNIT = 16.0, 1e-3, 0.1, 0.01
_CONFIRMING = 8  # windows that show whether a jump was an impulse: if the target has moved, so many do not fit
# Growth of the windows until the next search, so that all searches together cost three times the last; where the target
# has a prior, at which it is linear until the data move it, five times.
_GROWTH, _GROWTH_DESCRIBED = 1.5, 1.25
# The same where forces vary: windows since the search are not linearised at the momentum that these have brought.
_GROWTH_PUSHED = 1.1
FIRST = 10  # windows before the first search: 5 s of motion, from which a batch start converges
# The same of a target that was tracked before its capture, and windows up to which each is searched again: the arm may
# begin to move in any, and show an inertia far from the one that all before are linearised at.
_FIRST_TRACKED, _FEW_TRACKED = 1, 12
_AT_REST = 4  # windows before the first motion that are kept: noise alone is in their rows
# Windows after which a search that has not converged is repeated, and the least part of all that is: so the work of a
# window stays about the same.
_RETRY, _RETRY_PART = 2, 0.1
_FREEZE = 40  # windows above which the linearisation is frozen if it is good enough
# Ratio of standard deviations of the body, now and when its windows were linearised, below which they are checked anew.
_SHARPER = 0.7
# Relative deviation of the body, in all directions seen, below which the linearisation may be frozen: the remainder of
# second order is a tenth of it.
_KNOWN = 0.1
# Steps of the filter that each task may take between two windows: while there is an estimate, and before. Without limit
# where the target has a prior: windows are rare then, and each may leave the linear range.
_SHARE, _FIRST_SHARE = 300, 1200
_RARE = 1e-6  # chance that the motion of a tracked target contradicts a right model
_KINDS = Kind.NONLINEARITY, Kind.NEWTON_STEP, Kind.SEARCH


@dataclass(frozen=True, eq=False)
class LinearisationPoint:
    """The linearisation point of the windows to come (filter.md, eq. 3).

    Each window is blind along some directions, such as all masses and momenta growing together, or CoM and odometry
    mount displaced together. Linearised at another point these are others, and together the windows would seem to see
    them. So the point follows the estimate along the directions that are well known, and rests along the others unless
    the estimate is far.
    """

    point: Point  # at which windows are linearised at present
    reference: Array  # (s,) the estimate when the point moved last

    def near_estimate(
        self, gaussian: SquareRootInformation, layout: Layout, variables: Variables
    ) -> LinearisationPoint:
        """Return the same, or relinearised if the estimate is too far from its reference."""
        distribution = MeanAndCovariance.from_gaussian(gaussian, variables)
        gather, root = variables.from_state[variables.persistent], _known(gaussian.triangle, variables)
        distance = root @ (gather @ (distribution.mean - self.reference))
        return self._relinearised(distribution, root, layout) if distance @ distance > _HELD else self

    def carried(self, start: float, drift: MomentumDrift | None) -> LinearisationPoint:
        """Return it at the start of a window, s, with the momentum that forces have brought until then.

        `drift` is that by the forces as they are estimated now; None without one.
        """
        before, point, reference = self.point.drift, self.point, self.reference
        if before is None and drift is None:
            return self
        if before is not None:
            change, parameters, reference = before.at([start])[0], point.parameters.copy(), reference.copy()
            parameters[:6] += change
            reference[MOMENTUM] += change
            point = replace(point, parameters=parameters, drift=None)
        return LinearisationPoint(point if drift is None else point.drifting(drift.since(start)), reference)

    def _relinearised(self, distribution: MeanAndCovariance, root: Array, layout: Layout) -> LinearisationPoint:
        """Return it moved to the estimate, along eigenvectors of the information R^T R of the lasting variables."""
        variables, held = distribution.variables, self.point
        lasting, state = variables.persistent, held.state
        # A body heavier than the robot sets the typical size: its momentum at 1 m/s is the typical one.
        heavier = float(distribution.mean[BODY.start] / variables.typical_momentum[0])
        unit = np.full(root.shape[1], 1.0 / max(1.0, heavier))
        unit[np.arange(len(variables.scale))[lasting] >= variables.first_unknown] = _UNIT
        information, directions = np.linalg.eigh((root / unit).T @ (root / unit))
        deviation = 1.0 / np.sqrt(np.maximum(information, 1.0))
        offset = directions.T @ (unit * (variables.from_state[lasting] @ (distribution.mean - state)))
        moving = (deviation < _WELL_KNOWN) | (offset**2 > _CURVED * deviation)
        state += variables.to_state[:, lasting] @ (directions @ np.where(moving, offset, 0.0) / unit)
        step = state[layout.parameters] - held.parameters
        part = trust_region(held.parameters, step)
        state[layout.parameters] = held.parameters + part * step
        # The next window continues the error chain of the last: at the same readings.
        state[layout.nuisance] = held.nuisance
        point = layout.point(state).drifting(held.drift)
        return LinearisationPoint(point, distribution.mean.copy() if part == 1.0 else self.reference)


def _known(root: Array, variables: Variables) -> Array:
    """Return the square-root information R of `persistent` variables."""
    first, count = variables.pose_size, len(variables.scale)
    others = np.setdiff1d(np.arange(first, len(root)), np.arange(count)[variables.persistent])
    if not others.size:
        return root[first:, first:count]
    order = np.concatenate((others, np.arange(count)[variables.persistent]))
    triangle = np.asarray(np.linalg.qr(root[first:, order], mode='r'))
    return triangle[len(others) : len(order), len(others) :]


class Phase(Enum):
    """Phase of a run."""

    COLLECTING = auto()  # windows are stored; there is no start yet
    INITIALISING = auto()  # there is a start; all windows are stored, and relinearised again and again
    TRACKING = auto()  # one step a window; each keeps the linearisation point it was first seen at


class Run:
    """Estimates the state window by window, under several hypotheses of forces and drifts.

    Parameters
    ----------
    layout : of the state
    variables : of the filter
    hypotheses : the first is the one to beat
    kept : windows that are kept at most to be relinearised
    tasks : run its background work; that of a run before it is given up

    Attributes
    ----------
    phase : of the run
    planar : whether it takes the motion for planar
    """

    def __init__(
        self, layout: Layout, variables: Variables, hypotheses: tuple[Hypothesis, ...], kept: int, tasks: Tasks
    ) -> None:
        self._layout = layout
        self._variables = variables
        self._linearised = LinearisationCache(layout, variables)
        self._batch = BatchIteration(layout, variables, self._linearised)
        self._multi_start = MultiStart(self._batch, hypotheses)
        self._kept = kept
        self._tasks = tasks
        tasks.cancel(*_KINDS)
        self.phase = Phase.COLLECTING
        self.planar = len(variables.measured) < 6
        self._bank: Bank = ()  # after the latest window that has all its neighbours
        self._latest: HypothesisFilter | None = None  # the best hypothesis, with the window that is still open
        self._newest: Window | None = None  # the latest window that has been filtered
        self._point: LinearisationPoint | None = None  # None before there is a start
        # Of passive joints: whose frequency was resolved when the linearisation was frozen; later data do not mend it.
        self._frozen_resolved: Flags = np.ones(layout.kernel.springs.count, dtype=bool)
        self._windows: list[Window] = []  # to be relinearised, in order
        self._offered: Callable[[], Point] | None = None  # a start that another method has found
        # Whether a target was tracked whose motion shows where a search begins.
        self._grasp_known = variables.tracked is not None and variables.tracked.grasp_known
        self._first = _FIRST_TRACKED if self._grasp_known else FIRST
        self._due = self._first  # number of windows at which the next search begins
        self._searched = 0  # windows in the latest search
        self._linearised_until = -np.inf  # s, start of the last of these
        self._drift: MomentumDrift | None = None  # after the latest window, by forces
        self._accepted = self._confirmed = False  # whether the latest search has been, and then by the search after it
        self._consistent = True  # whether the latest search explains its windows
        self.contradicts_target = False  # whether the latest search contradicts the motion of a tracked target
        self._nonlinearity: Nonlinearity | None = None  # about the solution of a search
        self._newton_step: Nonlinearity | None = None  # of the solution from where its windows are linearised
        self._covariance: Array | None = None  # of the body when all windows were linearised last; None: not all are

    @property
    def has_state(self) -> bool:
        """Whether there is a state."""
        return self._latest is not None

    @property
    def converged(self) -> bool:
        """Whether the latest search has been accepted, and the nonlinearity about its solution is known."""
        return self._accepted and self._nonlinearity is not None

    @property
    def searching(self) -> bool:
        """Whether a search is under way."""
        return self._tasks.is_under_way(Kind.SEARCH)

    @property
    def relinearises(self) -> bool:
        """Whether a tracked target's inertia has turned out far from where the windows are linearised, as yet."""
        return self._grasp_known and self.phase is Phase.INITIALISING and self.inconsistent

    @property
    def best(self) -> HypothesisFilter:
        """The hypothesis to report: the first, unless another one explains the data far better."""
        assert self._latest is not None, 'there is a start'
        return self._latest

    @property
    def has_joint_delay(self) -> bool:
        """Whether the estimate has a delay of the joints' stamps."""
        return self._point is not None and self._point.point.nominal.delay != 0.0

    @property
    def log_likelihood_ratio(self) -> float:
        """Log-likelihood of the hypothesis to report over that of the first."""
        return leader(self._bank).gaussian.log_likelihood - self._bank[0].gaussian.log_likelihood if self._bank else 0.0

    @property
    def innovations(self) -> Array:
        """Misfit of each hypothesis with a mechanism over all windows, and number of its innovations, (k, 2)."""
        physical = [each for each in self._bank if each.hypothesis.physical]
        return np.array([(each.misfit, each.gaussian.measured) for each in physical]).reshape(-1, 2)

    @property
    def inconsistent(self) -> bool:
        """Whether there is no start, or its innovations contradict the model."""
        if self._latest is None:
            return True
        gaussian = self._latest.gaussian
        return gaussian.nis > LARGEST_NIS * gaussian.measured or len(self._latest.jumps) > 0

    @property
    def jump_times(self) -> tuple[float, ...]:
        """Times of the jumps of the momentum under the first hypothesis, s."""
        return tuple(jump.time for jump in self._bank[0].jumps) if self._bank else ()

    @property
    def unconfirmed_jumps(self) -> tuple[float, ...]:
        """When the momentum seems to have jumped, s, while the cause may be another.

        If the target has moved in the grasp, the next windows do not fit. And a window that moves a joint for the first
        time may only show that the others are linearised elsewhere, until they are relinearised.
        """
        linearised = np.inf if self.phase is Phase.TRACKING else self._linearised_until
        newest = self._newest
        since = -np.inf if newest is None else min(linearised, newest.start - _CONFIRMING * newest.length)
        return tuple(jump.time for jump in self.best.jumps if jump.time > since)

    @property
    def point(self) -> Point:
        """The point of the present estimate, if nothing drifts."""
        distribution = self.distribution_of_first()
        return self._layout.point(distribution.mean, distribution.deviation)

    @property
    def deflections(self) -> Array:
        """Largest deflections of passive joints so far, the least and highest in the latest window, (3, f) rad or m."""
        assert self._newest is not None, 'there is an estimate'
        return self._linearised.deflections(self._newest)

    @property
    def resolved(self) -> Flags:
        """Which passive joints' frequencies (f,) the data resolve."""
        seconds = 0.0 if self._newest is None else self._newest.start + self._newest.length
        deviation = self.distribution_of_first().deviation
        return self._frozen_resolved & resolved_frequencies(self._layout, deviation, seconds)

    def nonlinearities(self, *, consistent: bool) -> tuple[Nonlinearity, ...]:
        """Return the nonlinearity of the windows; about the present estimate only where the model explains the data."""
        known = (self._nonlinearity, self._newton_step if consistent else None)
        return tuple(each for each in known if each is not None)

    def distribution(self) -> MeanAndCovariance:
        """Return the latest state under the best hypothesis."""
        return MeanAndCovariance.from_gaussian(self.best.gaussian, self._variables)

    def distribution_of_first(self) -> MeanAndCovariance:
        """Return the state under the first hypothesis, which lets nothing drift."""
        return MeanAndCovariance.from_gaussian(self._bank[0].gaussian, self._variables)

    def prior_scales(self, distribution: MeanAndCovariance) -> VarianceComponents:
        """Return the scale factors of the unknowns' priors at a mean and covariance of this run."""
        known = self._nonlinearity
        return distribution.prior_scales(self._layout, known.unknowns if known else None)

    def gaussian_before(self, time: float, slack: float) -> SquareRootInformation | None:
        """Return the information before a jump of the momentum near a time, s, if nothing drifts."""
        jumps = self._bank[0].jumps if self._bank else ()
        return next((jump.gaussian for jump in jumps if abs(jump.time - time) <= slack), None)

    def misfit_of_target(self, distribution: MeanAndCovariance) -> tuple[float, int]:
        """Return how far the estimate is from the motion of the tracked target: chi-square, and its numbers."""
        tracked = self._variables.tracked
        if tracked is None:
            return 0.0, 0
        try:
            rows = tracked.at(self._layout.point(distribution.mean), self._variables)
        except np.linalg.LinAlgError:  # no body can be there: there is no solution yet
            return 0.0, 0
        misfit = rows[:, :-1] @ (self._variables.from_state @ distribution.mean) - rows[:, -1]
        return float(misfit @ misfit), len(rows)

    def expect(self, windows: Sequence[Window]) -> None:
        """Set the coming windows, in order."""
        self._linearised.expect(windows)

    def offer(self, point: Callable[[], Point]) -> None:
        """Keep a point that the next search may begin at."""
        self._offered = point

    def restart(self) -> None:
        """Give up the solution; windows that are still kept are searched again."""
        self.phase, self._bank, self._latest = Phase.COLLECTING, (), None
        self._frozen_resolved[:] = True
        self._tasks.cancel(*_KINDS)
        self._nonlinearity = self._newton_step = None
        self._accepted = False
        self._due = min(self._due, len(self._windows)) if self._windows else self._first

    def add(self, ready: Window | None, still_open: Window | None, *, joints_moved: bool) -> None:
        """Filter the next window, and for the latest estimate the one after it; finish the work that is due before.

        Parameters
        ----------
        ready : a window with all its neighbours; None where there is none
        still_open : the window after it, without its later neighbours
        joints_moved : whether a joint has moved so far; before, no start is searched
        """
        if ready is not None and self.phase is not Phase.TRACKING:
            self._store(ready, joints_moved=joints_moved)
        steps = _SHARE if self.converged and not self._is_displaced else _FIRST_SHARE
        self._tasks.allot_steps(AT_ONCE if self._variables.is_informed else steps, *_KINDS)
        if self.phase is Phase.COLLECTING:
            return
        assert self._point is not None, 'there is a start'
        # For both windows: one window old is as good.
        following = ready or still_open
        if following is not None:
            gaussian = leader(self._bank).gaussian
            carried = self._point.carried(following.start, self._drift)
            self._point = carried.near_estimate(gaussian, self._layout, self._variables)
        point = self._point.point
        if ready is not None:
            white = self._linearised.whitened(ready, point)
            self._bank = update_bank(self._bank, ready, white, self._variables)
            gaussian = leader(self._bank).gaussian
            course = [gaussian] if self._layout.has_varying_push else None
            self._drift = momentum_drift([(ready, white)], gaussian, self._variables, self._layout, course)
            if self.phase is Phase.INITIALISING:
                self._check_newton_step(leader(self._bank))
        self._latest = leader(self._bank)
        self._newest = still_open or ready or self._newest
        if still_open is not None:
            white = self._linearised.whitened(still_open, point)
            # Where nothing acts, drifts or walks, the pose error alone goes on from its first knot.
            moving = self._latest.hypothesis.disturbed or self._variables.random_walk.shape[1] > 0
            (self._latest,) = update_bank((self._latest,), still_open, white, self._variables, advancing=moving)

    def _store(self, window: Window, *, joints_moved: bool) -> None:
        """Store a window, and begin a search where one is due; none as long as no joint has moved.

        A search is due, too, where the solution of a target with a prior explains the windows no more.
        """
        self._windows.append(window)
        if self.searching:
            return
        lost = self.converged and self.inconsistent and self._consistent and self._variables.is_informed
        if not joints_moved:
            self._windows = self._windows[-_AT_REST:]
        elif len(self._windows) >= self._due or lost:
            self._searched = len(self._windows)
            points: list[Callable[[], Point | None]] = [self._best_point] if self.converged else []
            points += [] if self._offered is None else [self._offered]
            search = outcome_or_none(self._multi_start.search(self._windows, points), np.linalg.LinAlgError)
            self._tasks.begin(Kind.SEARCH, search, self._take_over, size=self._layout.size)
        elif not self.converged and len(self._windows) > self._kept:
            self._drop(len(self._windows) // 2)
            self._due = min(self._due, len(self._windows) + _RETRY)

    def _best_point(self) -> Point | None:
        if not self._bank:
            return None
        distribution = MeanAndCovariance.from_gaussian(leader(self._bank).gaussian, self._variables)
        return self._layout.point(distribution.mean, distribution.deviation)

    def _take_over(self, start: Start | None) -> None:
        """Go on from the outcome of a search; None where it has led to no robot that can exist."""
        if start is None:  # later windows may help
            self._due = self._searched + _RETRY
            return
        anew, filtered = not self.converged, leader(start.bank)
        self.phase, self._bank = Phase.INITIALISING, start.bank
        self._point, self._drift = LinearisationPoint(start.point, start.point.state), start.point.drift
        self._consistent = filtered.gaussian.nis < LARGEST_NIS * filtered.gaussian.measured
        distribution = MeanAndCovariance.from_gaussian(filtered.gaussian, self._variables)
        misfit, numbers = self.misfit_of_target(distribution)
        agrees = self._consistent and misfit < chi_square_limit(_RARE, max(numbers, 1))
        self.contradicts_target = numbers > 0 and start.accepted and not agrees
        self._accepted, self._confirmed = start.accepted, start.accepted and not anew
        self._linearised_until = self._windows[self._searched - 1].start
        self._due = self._next_search(self._searched, filtered.gaussian)
        self._nonlinearity = None if anew else self._nonlinearity
        self._tasks.cancel(Kind.NONLINEARITY, Kind.NEWTON_STEP)
        if start.nonlinearity is not None:
            steps, size = _FIRST_SHARE if anew else 0, self._layout.size
            self._tasks.begin(Kind.NONLINEARITY, start.nonlinearity, self._take_nonlinearity, size=size, steps=steps)
        self._covariance = start.covariance
        if not self._is_sharper(filtered):
            self._newton_step = None  # of windows as they were linearised before
        if not start.accepted:
            self._freeze_if_possible()

    def _take_nonlinearity(self, nonlinearity: Nonlinearity) -> None:
        self._nonlinearity = nonlinearity
        self._freeze_if_possible()

    def _check_newton_step(self, filtered: HypothesisFilter) -> None:
        """Begin to linearise the windows at the estimate where the body is known so much better than when they were."""
        if self._accepted and not self._tasks.is_under_way(Kind.NEWTON_STEP) and self._is_sharper(filtered):
            work = self._batch.newton_step(in_stacks(self._windows), filtered)
            self._tasks.begin(Kind.NEWTON_STEP, work, self._take_newton_step, size=self._layout.size)

    def _take_newton_step(self, step: Nonlinearity) -> None:
        self._newton_step = step
        self._covariance = None if self._covariance is None else step.covariance
        # Where the data contradict the model, no point is that where the windows are near linear.
        if step.is_nonlinear and not self.inconsistent:
            self._due = min(self._due, len(self._windows))

    def _freeze_if_possible(self) -> None:
        """Relinearise no window again if they are near linear; else drop those that lead nowhere together."""
        if self.searching or not (self._confirmed or not self._accepted):
            return
        gaussian = leader(self._bank).gaussian
        linear = self._accepted and self._is_linear(gaussian)
        if self._due <= (min(_FREEZE, self._kept) if linear else self._kept):
            return
        self._tasks.cancel(Kind.NEWTON_STEP)
        self._newton_step = None
        if self._accepted and gaussian.nis < LARGEST_NIS * gaussian.measured:
            self.phase, self._frozen_resolved, self._windows = Phase.TRACKING, self.resolved, []
        else:
            self._drop(self._searched // 2)
            self._due = self._next_search(len(self._windows), gaussian)

    @property
    def _is_displaced(self) -> bool:
        return self._newton_step is not None and self._newton_step.is_nonlinear

    def _is_linear(self, gaussian: SquareRootInformation) -> bool:
        """Return whether the remainder of second order is small, wherever the windows are linearised."""
        if self._nonlinearity is None or self._nonlinearity.is_nonlinear or self._is_displaced:
            return False
        distribution = MeanAndCovariance.from_gaussian(gaussian, self._variables)
        seconds = self._windows[-1].start - self._windows[0].start
        layout = self._layout
        if layout.kernel.springs.count and not resolved_frequencies(layout, distribution.deviation, seconds).all():
            return False
        factor = distribution.factor_of(self._variables.to_state[BODY])
        body, deviation = distribution.mean[BODY], np.sqrt(np.add.reduce(factor**2, axis=1))
        return bool(body[0] > 0.0 and np.all(deviation < _KNOWN * body_sizes(body)))

    def _is_sharper(self, filtered: HypothesisFilter) -> bool:
        if self._covariance is None:
            return False
        now = MeanAndCovariance.from_gaussian(filtered.gaussian, self._variables).covariance(BODY_PLACES)
        return bool(np.any(now.diagonal() < _SHARPER**2 * self._covariance.diagonal()))

    def _drop(self, first: int) -> None:
        self._windows, self._covariance = self._windows[first:], None

    def _next_search(self, windows: int, gaussian: SquareRootInformation) -> int:
        """Return at how many windows to search again: soon where that may yet be accepted."""
        if self._grasp_known and windows < _FEW_TRACKED:
            return windows + 1
        if self._variables.is_informed:
            return int(np.ceil(_GROWTH_DESCRIBED * windows))
        soon = not (self._accepted or gaussian.nis > HOPELESS * gaussian.measured)
        growth = _GROWTH_PUSHED if self._variables.pushed else _GROWTH
        return int(np.ceil(windows + max(_RETRY, _RETRY_PART * windows) if soon else growth * windows))
