"""One run of the filter: its phase, and the bank of hypotheses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum, auto

import numpy as np

from mbaid_ros.core.filter.bank import Bank, HypothesisFilter, leader, update_bank, update_hypotheses
from mbaid_ros.core.filter.batch import BatchIteration
from mbaid_ros.core.filter.initialisation import Initialisation, resolved_frequencies
from mbaid_ros.core.filter.linearisation_point import LinearisationPoint
from mbaid_ros.core.filter.prior_scale import PriorScaleFactors
from mbaid_ros.core.filter.square_root import MeanAndCovariance, SquareRootInformation
from mbaid_ros.core.filter.start import Start
from mbaid_ros.core.filter.state import Layout, Point
from mbaid_ros.core.filter.time_update import Hypothesis
from mbaid_ros.core.filter.variables import Variables
from mbaid_ros.core.filter.whitened import LinearisationCache
from mbaid_ros.core.filter.window import Window
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.results.reporting import Curvature
from mbaid_ros.core.results.status import LARGEST_NIS

_CONFIRMING = 8  # windows that show whether a jump was an impulse: if the target has moved, so many do not fit


class Phase(Enum):
    """Phase of a run."""

    COLLECTING = auto()  # windows are stored; there is no start yet
    INITIALISING = auto()  # there is a start; all windows are stored, and relinearised again and again
    TRACKING = auto()  # one step a window; each keeps the linearisation point it was first seen at


class FilterRun:
    """Estimates the state window by window, under several hypotheses of forces and drifts.

    Parameters
    ----------
    layout : of the state
    variables : of the filter
    hypotheses : the first is the one to beat
    kept : windows that are kept at most to be relinearised

    Attributes
    ----------
    phase : of the run
    planar : whether it takes the motion for planar
    """

    def __init__(self, layout: Layout, variables: Variables, hypotheses: tuple[Hypothesis, ...], kept: int) -> None:
        self._layout = layout
        self._variables = variables
        self._linearised = LinearisationCache(layout, variables)
        batch = BatchIteration(layout, variables, self._linearised)
        self._initialisation = Initialisation(batch, hypotheses, kept)
        self._point = LinearisationPoint(layout, variables)
        self._bank: Bank = ()  # after the latest window that has all its neighbours
        self._latest: HypothesisFilter | None = None  # the best hypothesis, with the window that is still open
        self._newest: Window | None = None  # the latest window that has been filtered
        self._offered: Callable[[], Point] | None = None  # a start that another method has found
        # Of passive joints: whose frequency was resolved when the linearisation was frozen; later data do not mend it.
        self._frozen_resolved: Flags = np.ones(layout.kernel.springs.count, dtype=bool)
        self.phase = Phase.COLLECTING
        self.planar = len(variables.measured) < 6

    @property
    def has_state(self) -> bool:
        """Whether there is a state."""
        return self._latest is not None

    @property
    def converged(self) -> bool:
        """Whether the batch iteration has converged, and the nonlinearity about its solution is known."""
        return self._initialisation.converged

    @property
    def searching(self) -> bool:
        """Whether a search is under way."""
        return self._initialisation.searching

    @property
    def best(self) -> HypothesisFilter:
        """The hypothesis to report: the first, unless another one explains the data far better."""
        assert self._latest is not None, 'there is a start'
        return self._latest

    @property
    def has_joint_delay(self) -> bool:
        """Whether the estimate has a delay of the joints' stamps."""
        return self._point.point is not None and self._point.point.side.delay != 0.0

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
        linearised = np.inf if self.phase is Phase.TRACKING else self._initialisation.linearised_until
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

    def curvatures(self, *, consistent: bool) -> tuple[Curvature, ...]:
        """Return the nonlinearity of the windows; about the present estimate only where the model explains the data."""
        return self._initialisation.curvatures(consistent=consistent)

    def distribution(self) -> MeanAndCovariance:
        """Return the latest state under the best hypothesis."""
        return MeanAndCovariance.from_gaussian(self.best.gaussian, self._variables)

    def distribution_of_first(self) -> MeanAndCovariance:
        """Return the state under the first hypothesis, which lets nothing drift."""
        return MeanAndCovariance.from_gaussian(self._bank[0].gaussian, self._variables)

    def prior_scales(self, distribution: MeanAndCovariance) -> PriorScaleFactors:
        """Return the scale factors of the unknowns' priors at a mean and covariance of this run."""
        known = self.curvatures(consistent=False)
        return distribution.prior_scales(self._layout, known[0].unknowns if known else None)

    def gaussian_before(self, time: float, slack: float) -> SquareRootInformation | None:
        """Return the information before a jump of the momentum near a time, s, if nothing drifts."""
        jumps = self._bank[0].jumps if self._bank else ()
        return next((jump.gaussian for jump in jumps if abs(jump.time - time) <= slack), None)

    def expect(self, windows: Sequence[Window]) -> None:
        """Set the coming windows, in order."""
        self._linearised.expect(windows)

    def filter_windows(self, ready: Window | None, still_open: Window | None, *, joints_moved: bool) -> None:
        """Filter the next window, and for the latest estimate the one after it.

        Parameters
        ----------
        ready : a window with all its neighbours; None where there is none
        still_open : the window after it, without its later neighbours
        joints_moved : whether a joint has moved so far; before, no start is searched
        """
        while self.run_slice():
            pass
        if ready is not None and self.phase is not Phase.TRACKING:
            points = [self._best_point] if self.converged else []
            points += [] if self._offered is None else [self._offered]
            lost = self.converged and self.inconsistent
            self._initialisation.add(ready, points, joints_moved=joints_moved, lost=lost)
        self._initialisation.allot()
        if self.phase is Phase.COLLECTING:
            return
        point = self._point.near_estimate(leader(self._bank).gaussian)  # for both windows: one window old is as good
        if ready is not None:
            self._bank = update_bank(self._bank, ready, self._linearised.whitened(ready, point), self._variables)
            if self.phase is Phase.INITIALISING:
                self._initialisation.check_displacement(leader(self._bank))
        self._latest = leader(self._bank)
        self._newest = still_open or ready or self._newest
        if still_open is not None:
            white = self._linearised.whitened(still_open, point)
            # Where nothing acts or drifts, the pose error alone goes on from its first knot.
            if self._latest.hypothesis.disturbed:
                (self._latest,) = update_bank((self._latest,), still_open, white, self._variables)
            else:
                (self._latest,) = update_hypotheses((self._latest,), still_open, white, self._variables)

    def offer(self, point: Callable[[], Point]) -> None:
        """Keep a point that the next search may begin at."""
        self._offered = point

    def restart(self) -> None:
        """Give up the solution; windows that are still kept are searched again."""
        self.phase, self._bank, self._latest = Phase.COLLECTING, (), None
        self._frozen_resolved[:] = True
        self._initialisation.restart()

    def run_slice(self) -> bool:
        """Run a slice of the background work; return whether more is due before the next window."""
        outcome = self._initialisation.run_slice(consistent=not self.inconsistent)
        if isinstance(outcome, Start):
            self._take_over(outcome)
        elif outcome is not None:
            self._freeze_if_possible()
        return self._initialisation.is_due

    def _take_over(self, start: Start) -> None:
        """Go on from a start."""
        self.phase, self._bank = Phase.INITIALISING, start.bank
        self._point.begin(start.point)
        self._initialisation.take_over(start, leader(start.bank))
        if not start.accepted:
            self._freeze_if_possible()

    def _freeze_if_possible(self) -> None:
        """Relinearise no window again where the initialisation allows it."""
        resolved = self.resolved
        if self._initialisation.may_freeze(leader(self._bank).gaussian):
            self.phase, self._frozen_resolved = Phase.TRACKING, resolved

    def _best_point(self) -> Point | None:
        if not self._bank:
            return None
        distribution = MeanAndCovariance.from_gaussian(leader(self._bank).gaussian, self._variables)
        return self._layout.point(distribution.mean, distribution.deviation)
