"""When fault isolation runs: while a run contradicts its model, in time slices, ever more rarely."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from mbaid_ros.core.diagnosis.candidates import FEWEST, CandidateCauses
from mbaid_ros.core.diagnosis.filter_passes import SLIPPING
from mbaid_ros.core.diagnosis.ranking import CandidateCause, Change, IsolationResult, ranked
from mbaid_ros.core.diagnosis.rate_checks import twist_check
from mbaid_ros.core.diagnosis.readings import joint_noise_factor
from mbaid_ros.core.filter.run import Run
from mbaid_ros.core.filter.square_root import MeanAndCovariance
from mbaid_ros.core.filter.state import BODY, Layout
from mbaid_ros.core.filter.window import Window
from mbaid_ros.core.results.status import Cause, Verdict
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.tasks import AT_ONCE, Kind, Tasks, outcome_or_none

_FIRST = 24  # windows before the first search: fewer do not discriminate causes
_AFTER_A_JUMP = 1 + SLIPPING + FEWEST  # windows since a jump that may be a change of the target: enough to see it
# Windows, at most, that a jump is left open while a search is under way: by then its result is there.
_OPEN = 16
_APART = 16  # minimum windows from one search to the next: fewer new ones add less than the noise
# Windows of one search: a fault has seldom begun earlier, and work and memory stay bounded.
_KEPT = 80
_LATEST = 8  # windows whose samples show how noisy the sensors are: as noisy as they are now
# A search over so many windows is due one window later: its work, up to some seconds, fits between their messages.
_PACE = 5


class FaultIsolation:
    """Searches repeatedly for the causes of a contradiction, over the latest windows of a run.

    Attributes
    ----------
    suspicious : whether the run was, when it was last followed

    Parameters
    ----------
    candidates : the candidate causes
    noise : as declared
    tasks : run its searches; that of a run before it is given up
    """

    def __init__(self, candidates: CandidateCauses, noise: SensorNoise, tasks: Tasks) -> None:
        self._candidates = candidates
        self._noise = noise
        self._samples: deque[Samples] = deque(maxlen=_LATEST)
        self._twist = twist_check()
        self._windows: deque[Window] = deque(maxlen=_KEPT)
        self._seen = 0
        self._onset, self._next = 0, _FIRST  # windows until the run was suspicious, and until the next search
        self.suspicious = False
        self._tasks = tasks
        tasks.cancel(Kind.CAUSES)
        self._due: int | None = None  # number of windows at which the result of a search is
        self._found: IsolationResult | None = None
        self._over = False  # whether the contradiction has ended since
        self._about: tuple[float, ...] = ()  # s, of the jumps that the latest search was begun for

    def add_window(self, window: Window | None, samples: Samples) -> None:
        """Add the next window for the following searches, and the samples of the one after it."""
        self._samples.append(samples)
        if self.suspicious or self._seen < _FIRST:  # only a search needs it
            self._twist.add(samples)
        if window is not None:
            self._windows.append(window)
            self._seen += 1
            if self._seen == self._due:
                self._tasks.require(Kind.CAUSES)

    def begin_if_due(self, run: Run, *, suspicious: bool) -> None:
        """Begin a search for the causes in a suspicious run, if one is due."""
        self.suspicious = suspicious
        if not suspicious:
            self._over = True
            self._onset, self._next = self._seen, max(_FIRST, self._seen)
        early = run.has_state and bool(run.unconfirmed_jumps) and self._seen < self._onset + _AFTER_A_JUMP
        # A walk that leads has taken the jump up: it is there all the same.
        walks = run.has_state and not run.best.hypothesis.physical
        early = early or (walks and self._since_a_jump(run) < _AFTER_A_JUMP)
        if self._due is None and suspicious and self._seen >= self._next and not early:
            self._next = self._seen + max(_APART, self._seen - self._onset)  # when twice as much contradicts it
            point = run.point if run.has_state else None
            since = self._windows[max(self._onset - self._seen, -len(self._windows))].start
            self._about = tuple(time for time in run.jump_times if time >= since)
            wrong_twist = self._twist.reason()
            text = wrong_twist.text if wrong_twist else ''
            isolated = self._candidates.isolate(list(self._windows), point, run.jump_times, text)
            # The point may be of no robot that can be: a later one may be.
            work, size = outcome_or_none(isolated, np.linalg.LinAlgError), self._candidates.layout.size
            self._tasks.begin(Kind.CAUSES, work, self._accept, size=size, steps=AT_ONCE, due=False)
            self._due = self._seen + -(-len(self._windows) // _PACE)

    def _accept(self, found: IsolationResult | None) -> None:
        """Accept the result of a search."""
        self._due = None
        # The cause of a contradiction may have died down: it is not in the latest windows any more.
        if found is not None and (found.causes or self._over or self._found is None):
            self._found, self._over = found, False

    def open_jumps(self, run: Run) -> tuple[float, ...]:
        """Return when the momentum of a run seems to have jumped, s, where a search for the cause is under way.

        A leading constant force explains changes that are jumps without it.
        """
        if self._due is None:
            return ()
        latest = self._windows[-1]
        since = latest.start - _OPEN * latest.length
        left = {jump.time for jump in run.best.jumps} if run.best.hypothesis.physical else set(run.jump_times)
        return tuple(time for time in run.jump_times if time in self._about and time > since and time in left)

    def _since_a_jump(self, run: Run) -> float:
        """Return how many windows there have been since the first jump, if nothing drifts; infinitely many without."""
        if not run.jump_times or not self._windows:
            return np.inf
        return (self._windows[-1].start - run.jump_times[0]) / self._windows[-1].length

    @property
    def _leading(self) -> CandidateCause | None:
        return None if self._found is None else self._found.leading

    @property
    def change(self) -> Change | None:
        """The change of the target, if the latest search found it as the cause."""
        return self._leading.change if self._leading else None

    @property
    def wrong_twist(self) -> str:
        """The error of the base's twist, if the latest search found it as the cause; else empty."""
        return self._leading.text if self._leading and self._leading.of_twist else ''

    def windows_since(self, time: float) -> list[Window]:
        """Return the windows that begin at a time, s, or later."""
        return [window for window in self._windows if window.start >= time]

    def causes(self, run: Run) -> tuple[Cause, ...]:
        """Return the causes found by the latest search, the likeliest first; none before one."""
        found = self._found
        if found is None:
            return ()
        gains = {cause.text: (cause.gain, cause.physical) for cause in found.causes}
        leading = run.best.hypothesis if run.has_state else None
        if leading is not None and leading.disturbed:  # the run may have more windows by now
            # Over all of the run, not its latest windows alone: a hypothesis that fits anything gains nothing then.
            least = min((cause.gain for cause in found.causes), default=run.log_likelihood_ratio)
            lead = run.log_likelihood_ratio if leading.physical else min(run.log_likelihood_ratio, least)
            gains.setdefault(leading.cause, (lead, leading.physical))
        latest = self._noise.for_window(self._samples[-1])
        return ranked(gains, found.innovations, joint_noise_factor(self._samples, latest.joint_position))


def with_findings(judgement: Verdict, distribution: MeanAndCovariance, layout: Layout) -> Verdict:
    """Return a verdict on a run with each unknown's estimate that contradicts the model by itself as a cause."""
    for unknown, place in zip(layout.unknowns, layout.places, strict=True):
        own = slice(place.start - BODY.stop, place.stop - BODY.stop)
        found = unknown.finding(distribution.mean[place], distribution.unknowns_covariance[own, own])
        if found is not None:
            judgement = replace(judgement.with_cause(Cause(found.text, found.gain or 0.0)), adequate=False)
    return judgement
