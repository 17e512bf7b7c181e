"""Method `trajectory` as a whole: the weighted difference form from the first windows on, then the trajectory filter.

Stage 1 needs no start and has hardly a false solution; stage 2 is several times as accurate and follows disturbances.
Stage 1 gives the first estimates and the start of stage 2, which takes over when it has converged and agrees with them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.identifier import Estimator
from mbaid_ros.core.linear_algebra import chi_square_limit
from mbaid_ros.core.results.estimate import WITHHELD, Estimate
from mbaid_ros.core.results.parameters import PARAMETERS
from mbaid_ros.core.results.status import Reason, with_reasons
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.sensors.rates import FEWEST, with_rates
from mbaid_ros.core.tasks import AT_ONCE, Kind, Work
from mbaid_ros.core.trajectory.estimator import TrajectoryEstimator
from mbaid_ros.core.trajectory.posterior import Posterior

# Chance that two stages which are both right count as contradicting each other: asked a hundred times a run.
_UNLIKELY = 1e-6
# Stage 1 retires when it knows the mass as well as this (relative standard deviation) and
# has agreed in as many windows in a row; in any case after so many windows, unless it contradicts stage 2 by then.
_KNOWN, _AGREED, _LONGEST = 0.05, 20, 1200
# s since the first number: a model that is far off agrees with so short a motion, and makes a wrong body of it.
_FIRST_ESTIMATE_PERIOD = 6.0

# s since the first stage's first number, in which stage 2 starts where the model is right.
_ALONE = 10.0

FIRST_STAGE = 'first stage: its numbers are withheld until the trajectory filter starts, which knows late stamps, too'
FIRST_ESTIMATE = 'first estimate: a wrong URDF cannot be detected from so short a motion'
LATE = 'first stage: stamps that are late by some 10 ms, or velocities that lag, are not known yet'
DISAGREE = Reason(
    'the difference form and the trajectory filter contradict each other: the robot description, the noise values or '
    'the frames are wrong',
    'conflict',
)


_KEPT = 10.0  # s, that an estimate is compared with later ones
_FAR = 5.0  # of its standard deviations, by which none should move: one in millions does by chance


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


class TwoStageEstimator:
    """Identifies one link and the total momentum in two stages.

    Parameters
    ----------
    first : the weighted difference form
    second : the trajectory filter

    Attributes
    ----------
    tasks : background work, of the second stage and of the first beside it
    """

    needs_rates = False

    def __init__(self, first: Estimator, second: TrajectoryEstimator) -> None:
        self.method, self.tasks = second.method, second.tasks
        self._first: Estimator | None = first
        self._second = second
        self._windows = 0
        self._agreed = 0  # windows in a row
        self._began = np.inf  # s, of the first published number
        self._alone_since = np.inf  # s, of the first stage's first number
        self._doubted = False  # whether that stage's numbers have contradicted the data, or lack a twist
        self._restarted = False
        self._consistency = IntervalConsistency()

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Take closed windows and return one estimate a window.

        Parameters
        ----------
        windows : list of Samples
        origin : ns, stamp at time 0
        """
        estimates: list[Estimate] = []
        for place, window in enumerate(windows):
            self.tasks.finish_due()  # of the windows before: the first stage may go by that
            if self._first is None:
                estimates += self._second.update(windows[place:], origin)
                break
            self._windows += 1
            first, leading = self._first, self._agreed > 0
            early = None if leading else self._first_stage_estimate(first, window, origin)
            (late,) = self._second.update([window], origin)
            if leading and self._second.settled and not self._second.changed:
                self._compare_later(first, window, origin, late)
            else:
                early = self._first_stage_estimate(first, window, origin) if leading else early
                late = self._chosen(first, early, late)
            estimates.append(late)
        return [self._with_warnings(estimate) for estimate in estimates]

    def posterior(self) -> Posterior | None:
        """Return the posterior of the second stage."""
        return self._second.posterior()

    def _compare_later(self, first: Estimator, window: Samples, origin: int, late: Estimate) -> None:
        """Update the first stage in the background, where the second leads, and compare the two."""

        def updated() -> Work[Estimate | None]:
            yield 1
            return self._first_stage_estimate(first, window, origin)

        self.tasks.begin(Kind.FIRST_STAGE, updated(), lambda early: self._chosen(first, early, late), steps=AT_ONCE)

    def _chosen(self, first: Estimator, early: Estimate | None, late: Estimate) -> Estimate:
        """Return the estimate to publish after a window, of one of the stages."""
        if self._second.changed:
            self._first = None
            return late
        if self._windows >= _LONGEST and not self._contradicts:
            self._first = None
        if early is None:
            return late
        early = replace(
            early,
            method=self.method,
            stage=first.method,
            time_offset=late.time_offset,
            time_offset_std=late.time_offset_std,
            causes=late.causes,
            innovations=late.innovations,
        )
        if not self._second.settled:
            return with_reasons(early, [DISAGREE]) if self._contradicts else self._first_stage_only(early)
        if not early.identifiable[0] or early.status == 'inconsistent' or self._second.disturbed:
            return late
        if not np.any(early.identifiable & late.identifiable):
            return late  # nothing in which they could agree or contradict each other
        return self._compared(early, late)

    def _first_stage_only(self, early: Estimate) -> Estimate:
        """Return the first stage's estimate, at first without numbers if they contradict the data or lack a twist.

        Neither stamps that are late nor velocities that lag are among its unknowns: ten milliseconds of either move its
        numbers by many standard deviations. Poses alone come from a camera with a clock of its own.
        """
        self._doubted |= early.status == 'inconsistent'
        if not early.identifiable.any():
            return early
        self._alone_since = min(self._alone_since, early.time)
        if not self._doubted or early.time >= self._alone_since + _ALONE:
            return early
        return replace(
            early,
            status='not_identifiable',
            parameters=np.full(10, np.nan),
            covariance=np.full((10, 10), np.nan),
            identifiable=np.zeros(10, dtype=bool),
            warnings=(FIRST_STAGE, *([WITHHELD] if early.status == 'inconsistent' else []), *early.warnings),
        )

    @property
    def _contradicts(self) -> bool:
        """Whether the stages have contradicted each other, and not agreed since."""
        return self._restarted and not self._agreed

    def _with_warnings(self, estimate: Estimate) -> Estimate:
        """Return an estimate with a warning if it is one of the first, or has left the intervals before it."""
        if estimate.identifiable.any():
            self._began = min(self._began, estimate.time)
        young = estimate.time < self._began + _FIRST_ESTIMATE_PERIOD
        estimate = self._consistency.checked(estimate, early=young)
        if not young or not estimate.identifiable.any() or estimate.status == 'inconsistent':
            return estimate
        return with_reasons(
            estimate, [Reason(FIRST_ESTIMATE), *([Reason(LATE)] if estimate.stage not in {'', self.method} else [])]
        )

    def _compared(self, early: Estimate, late: Estimate) -> Estimate:
        """Return the second stage's estimate if the first's does not contradict it."""
        if _agree(early, late):
            self._agreed += 1
            known = early.std[0] < _KNOWN * early.parameters[0] and bool(
                np.all(early.identifiable | ~late.identifiable)
            )
            if known and self._agreed >= _AGREED:
                self._first = None
            return late
        self._agreed = 0
        if not self._restarted:
            # A solution that is not the data's: once more, from the first stage.
            self._restarted = True
            self._second.restart()
            return with_reasons(early, [DISAGREE])
        return with_reasons(late, [DISAGREE])

    def _first_stage_estimate(self, first: Estimator, window: Samples, origin: int) -> Estimate | None:
        """Return the first stage's estimate after a window, offered to the second; None where it cannot be used."""
        if any(window.missing_rates):
            self._doubted |= window.missing_rates[1]
            if len(window) < FEWEST:
                return None
            window = with_rates(window)
        found = first.update([window], origin)
        if found and found[-1].identifiable[0] and found[-1].status != 'inconsistent':
            self._second.offer(found[-1])
        return found[-1] if found else None


def _agree(first: Estimate, second: Estimate) -> bool:
    """Return whether two estimates of the same data are consistent.

    The covariance of their difference is at most the sum of theirs, even if they share data.
    """
    both = first.identifiable & second.identifiable
    difference = (first.parameters - second.parameters)[both]
    covariance = (first.covariance + second.covariance)[np.ix_(both, both)]
    size = np.sqrt(np.diag(covariance))
    distance = difference / size @ np.linalg.solve(covariance / size / size[:, None], difference / size)
    return bool(distance < chi_square_limit(_UNLIKELY, len(difference)))
