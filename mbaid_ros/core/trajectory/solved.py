"""What a run of the filter has led to by an instant, and what of it goes with an estimate."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.budget import ErrorBudget
from mbaid_ros.core.results.estimate import Estimate, Event, Thruster
from mbaid_ros.core.results.reporting import Instant, Solution
from mbaid_ros.core.trajectory.filter.belief import Moments
from mbaid_ros.core.trajectory.state import Layout
from mbaid_ros.core.unknowns.hypotheses import Hypothesis
from mbaid_ros.core.unknowns.thrusters import Thrusters
from mbaid_ros.core.unknowns.time_offset import TimeOffset
from mbaid_ros.core.verdict.judgement import Judgement


@dataclass(frozen=True)
class Solved:
    """Solution of the best hypothesis, and what its run says beside it.

    Attributes
    ----------
    mean : of the state
    solution : body and momentum, as they are reported
    instant : when
    hypothesis : the best one
    judgement : of the run
    events : what has acted or changed
    budget : parts of the variance
    thrusters : how far they are off their commands
    delay : value and standard deviation of the joints' delay, s; NaN where it is no unknown
    warnings : of the run, and of declarations that are too small
    """

    mean: Array
    solution: Solution
    instant: Instant
    hypothesis: Hypothesis
    judgement: Judgement
    events: tuple[Event, ...]
    budget: ErrorBudget
    thrusters: tuple[Thruster, ...]
    delay: tuple[float, float]
    warnings: tuple[str, ...]

    def judged(self, estimate: Estimate) -> Estimate:
        """Return the estimate of this solution with what its run says against it."""
        judgement = self.judgement
        warnings = [*estimate.warnings, *self.warnings]
        if self.hypothesis.disturbed and self.hypothesis.physical:
            warnings.append(f'{self.hypothesis.name}; estimated along, which widens the intervals')
        known = estimate.status != 'not_identifiable'
        shares = np.where(estimate.identifiable[:, None], self.budget.shares, np.nan)
        return replace(
            replace(estimate, warnings=tuple(warnings)).contradicted_by(judgement.reasons),
            stage='trajectory',
            budget=replace(self.budget, shares=shares) if known else None,
            causes=tuple((cause.text, cause.gain) for cause in judgement.causes),
            events=self.events,
            thrusters=self.thrusters,
            time_offset=self.delay[0],
            time_offset_std=self.delay[1],
        )


def joint_delay(moments: Moments, layout: Layout) -> tuple[float, float]:
    """Return the joints' delay and its standard deviation, s; NaN where it is no unknown."""
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        if isinstance(unknown, TimeOffset):
            value = unknown.factor @ moments.mean[place]
            deviation = np.abs(unknown.factor @ _deviation(moments, place))
            return float(value[0]), float(deviation[0])
    return np.nan, np.nan


def thrusters(moments: Moments, layout: Layout) -> tuple[Thruster, ...]:
    """Return by how much thrusters have turned out to be off their commands."""
    found: list[Thruster] = []
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        if isinstance(unknown, Thrusters):
            # Each number of the state is one of these, in units of its prior.
            stds = np.abs(unknown.factor @ _deviation(moments, place))
            found += Thruster.all_of(unknown.frames, unknown.factor @ moments.mean[place], stds)
    return tuple(found)


def with_linear_momentum_unknown(estimate: Estimate) -> Estimate:
    """Return an estimate of a base that nothing locates: the frame moves with the common centre of mass."""
    momentum, covariance = estimate.momentum.copy(), estimate.momentum_covariance.copy()
    momentum[:3] = covariance[:3] = covariance[:, :3] = np.nan
    return replace(estimate, momentum=momentum, momentum_covariance=covariance)


def _deviation(moments: Moments, place: slice) -> Array:
    """Return the standard deviations of a part of the state."""
    return np.sqrt(moments.covariance(np.arange(place.start, place.stop)).diagonal())
