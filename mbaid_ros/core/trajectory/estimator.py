"""Method `trajectory`: from windows of samples to estimates."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from mbaid_ros.core.diagnosis.undeclared_orbit import with_undeclared_orbit
from mbaid_ros.core.filter.averaging import KnotAveraging, Taken
from mbaid_ros.core.filter.run import FilterRun
from mbaid_ros.core.filter.state import (
    BODY,
    BODY_PLACES,
    MOMENTUM,
    Point,
)
from mbaid_ros.core.filter.window import Window
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.results.estimate import Estimate, Status
from mbaid_ros.core.results.reporting import Instant, Reporting, Solution
from mbaid_ros.core.results.verdict import judge
from mbaid_ros.core.robot.inertia import standard
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.orbit import brought
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.trajectory.posterior import End, Posterior, posterior
from mbaid_ros.core.trajectory.solution import (
    Solved,
    error_budget,
    forces,
    joint_delay,
    jumps,
    thrusters,
    with_linear_momentum_unknown,
)
from mbaid_ros.core.trajectory.target_runs import TargetRuns, TrajectorySettings
from mbaid_ros.core.unknowns.words import of_size

_AT_REST = 'no joint has moved yet: joints at rest tell nothing of one body alone'
_TUMBLING = (
    'no joint has moved yet: how a body tumbles tells its moments of inertia but for a common factor; calibrate gives '
    'their ratios'
)
# (body, momentum) of the state.
_ORDER = np.concatenate((BODY_PLACES, np.arange(MOMENTUM.start, MOMENTUM.stop)))


class TrajectoryEstimator:
    """Identifies one link and the total momentum from how the base's pose moves."""

    method = 'trajectory'
    needs_rates = False

    def __init__(self, kernel: MomentumKernel, settings: TrajectorySettings, reporting: Reporting) -> None:
        self._kernel = kernel
        self._settings = settings
        self._reporting = reporting
        self._plane = PlaneDetector(kernel.model)
        self._averaging = KnotAveraging(
            kernel.model.joints,
            settings.noise,
            settings.window,
            settings.gyro,
            orientation_measured=settings.orientation_measured,
        )
        self._runs = TargetRuns(kernel, settings, self._plane)
        self._samples = 0
        self._last: Samples | None = None

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Take closed windows and return one estimate a window.

        Parameters
        ----------
        windows : list of Samples
        origin : ns, stamp at time 0
        """
        taken = self._averaging.take(windows)
        coming = [window for each in taken for window in (each.ready, each.still_open) if window is not None]
        found = [self._follow(window, each, coming, origin) for window, each in zip(windows, taken, strict=True)]
        solved = [one for one in found if isinstance(one, Solved)]
        self._last = windows[-1] if windows else self._last
        estimates = iter(self._reported(solved))
        return [
            next(estimates).after_thrust(self._brought(window, one.mean))
            if isinstance(one, Solved)
            else one.after_thrust(window.impulse[-1])
            for window, one in zip(windows, found, strict=True)
        ]

    def _brought(self, window: Samples, state: Array) -> Array:
        """Return what thrust and orbit have changed the momentum by until the end of a window, (6,)."""
        kernel = self._kernel
        if window.tide.shape[1]:
            kernel = self._runs.layout.point(state).side.kernel
        return brought(window, kernel.with_target(state[BODY]))

    def work_off(self) -> bool:
        """Do a part of what is to be done before the next window; return whether some is left."""
        run = self._runs.run
        return run is not None and (run.work_off() or self._runs.inquiries.work_off())

    def knowledge(self) -> Posterior | None:
        """Return what the run has come to know, for what is to come; None while there is no solution that stays.

        Nor is there any where nothing locates the base: it is not known where that is.
        """
        run, last = self._runs.run, self._last
        if run is None or last is None or not run.started or not run.settled or not self._settings.located:
            return None
        moments = run.moments()
        at_end = End.of(last, self._settings.noise, self._settings.window, self._averaging.origin, self._plane.normal)
        brought = self._brought(last, moments.mean)
        return posterior(self._runs.layout, run.best.hypothesis, moments, at_end.after(brought))

    @property
    def settled(self) -> bool:
        """Whether the run has come to a solution that stays."""
        return self._runs.run is not None and self._runs.run.started and self._runs.run.settled

    @property
    def disturbed(self) -> bool:
        """Whether the solution explains the data by what acts from outside, or by joints that are stamped late."""
        if self._runs.run is None or not self._runs.run.started:
            return False
        best = self._runs.run.best
        return best.hypothesis.disturbed or len(best.jumps) > 0 or self._runs.run.delayed

    @property
    def changed(self) -> bool:
        """Whether the target has changed since the run began, or the twist has been left out."""
        return self._runs.changed

    def offer(self, estimate: Estimate) -> None:
        """Take an estimate to start from."""
        if self._runs.run is not None:
            self._runs.run.offer(partial(self._point_of, estimate))

    def restart(self) -> None:
        """Give up the solution and look for a start again."""
        if self._runs.run is not None:
            self._runs.run.restart()

    def _point_of(self, estimate: Estimate) -> Point:
        """Return where an estimate would have windows linearised; what a planar motion leaves open matters nowhere."""
        body = np.where(estimate.identifiable, estimate.parameters, 0.0)
        moments = [4, 7, 9]
        body[moments] = np.where(estimate.identifiable[moments], body[moments], body[moments].max())
        momentum = np.nan_to_num(estimate.momentum - estimate.impulse)
        momentum[3:] -= cross(self._averaging.origin, momentum[:3])
        state = np.concatenate((np.zeros(BODY.stop), self._runs.layout.known.mean))
        state[MOMENTUM], state[BODY] = momentum, standard(body)
        return self._runs.layout.point(state)

    def _follow(self, window: Samples, taken: Taken, coming: list[Window], origin: int) -> Solved | Estimate:
        """Take a window, and return what the run has led to by then: a solution, or an estimate that says why none."""
        while self.work_off():
            pass
        self._plane.update(window)
        self._samples += len(window)
        run = self._runs.present(self._averaging.origin)
        run.expect(self._runs.expected(coming))
        ready, still_open = (each and self._runs.taken(each) for each in (taken.ready, taken.still_open))
        run.take(ready, still_open, moved=taken.moved)
        self._runs.inquiries.take(ready, window)
        time = float(window.time[-1])
        instant = Instant(time, origin + round(time * 1e9), self._samples)
        return self._waiting(run, taken, instant) or self._solved(run, instant, window)

    def _waiting(self, run: FilterRun, taken: Taken, now: Instant) -> Estimate | None:
        """Return an estimate that says why there is no solution; None where there is one."""
        status: Status = 'not_identifiable'
        if not run.started and taken.moved:
            status = 'waiting'
            done = 'looking for a start in' if run.searching else 'collecting'
            warning = f'{done} the first {self._settings.start} windows'
        elif not run.started:
            warning = _AT_REST if self._settings.located else _TUMBLING
        elif not run.settled:
            warning = 'the motion so far leads to no solution that stays: more of it is needed'
        else:
            return None
        if taken.moved:
            # What has left its solution for none that stays has not explained what was suspicious about it.
            inquiries = self._runs.inquiries
            inquiries.follow(run, suspicious=run.unexplained or inquiries.suspicious)
        causes = tuple((cause.text, cause.gain) for cause in self._runs.inquiries.causes(run))
        return Estimate(
            self.method,
            status,
            now.time,
            now.stamp,
            samples=now.samples,
            causes=causes,
            events=self._runs.past(None),
            warnings=(warning, *self._runs.notes),
        )

    def _solved(self, run: FilterRun, now: Instant, latest: Samples) -> Solved:
        """Return the solution of the best hypothesis, and what its run says beside it."""
        track, origin = run.best, self._averaging.origin
        moments = run.moments()
        layout = self._runs.layout
        sizes = moments.sizes(layout)
        judgement = judge(self._runs.evidence(run, sizes, latest))
        self._runs.inquiries.follow(run, suspicious=not judgement.adequate or bool(judgement.causes))
        if not judgement.adequate and (causes := self._runs.inquiries.causes(run)):
            judgement = replace(judgement, causes=causes)
        judgement = with_undeclared_orbit(judgement, moments, layout)
        numbers, factor = moments.published(sizes, layout, _ORDER)
        covariance = (factor @ factor.T + moments.variables.outside[np.ix_(_ORDER, _ORDER)]) * judgement.widening
        solution = Solution(
            x=numbers,
            covariance=covariance,
            cautious_covariance=covariance,
            cost=track.belief.nis,
            redundancy=track.belief.measured,
            origin=origin,
            plane=self._plane.plane(self._kernel.target),
            curvatures=run.curvatures(explained=judgement.adequate),
        )
        found = (*forces(track, moments), *self._runs.past(moments), *jumps(track, moments, origin))
        return Solved(
            moments.mean,
            solution,
            now,
            track.hypothesis,
            judgement,
            found,
            error_budget(moments, layout, self._settings.uncertainty, sizes),
            thrusters(moments, layout),
            joint_delay(moments, layout),
            # Where the data contradict the model, the judgement names what would have to be further off.
            (*self._runs.notes, *(of_size(*each) for each in sizes.sure if judgement.adequate)),
        )

    def _reported(self, solved: list[Solved]) -> list[Estimate]:
        """Return the estimates of solutions."""
        if not solved:
            return []
        estimates = self._reporting.estimates(
            self.method, [one.solution for one in solved], [one.instant for one in solved]
        )
        judged = [one.judged(estimate) for estimate, one in zip(estimates, solved, strict=True)]
        return judged if self._settings.located else [with_linear_momentum_unknown(estimate) for estimate in judged]
