"""Method `trajectory`: from windows of samples to estimates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from mbaid_ros.core.diagnosis.fault_isolation import with_findings
from mbaid_ros.core.filter.averaging import Averaged, KnotAveraging
from mbaid_ros.core.filter.initialisation import FIRST
from mbaid_ros.core.filter.prior_scale import PriorScaleFactors
from mbaid_ros.core.filter.run import FilterRun
from mbaid_ros.core.filter.square_root import MeanAndCovariance
from mbaid_ros.core.filter.state import BODY, BODY_PLACES, MOMENTUM, Layout, Point
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.results.estimate import Estimate, PassiveJoint
from mbaid_ros.core.results.reporting import Reporting, Solution
from mbaid_ros.core.results.status import Reason, Verdict, judge, notes
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.robot.momentum import momentum_change, standard
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.trajectory.posterior import End, Posterior, posterior
from mbaid_ros.core.trajectory.solution import (
    error_budget,
    estimates,
    forces,
    implausible_springs,
    joint_delay,
    joints_carrying_target,
    jumps,
    passive_joints,
    soft_grasp_warnings,
    thrusters,
)
from mbaid_ros.core.trajectory.target_runs import TargetRuns, TrajectorySettings
from mbaid_ros.core.unknowns.catalogue import underestimated_text
from mbaid_ros.core.unknowns.environment import Thrusters
from mbaid_ros.core.unknowns.flexible import SpringErrors

_AT_REST = 'no joint has moved yet: with joints at rest no single body is observable'
_TUMBLING = (
    'no joint has moved yet: tumbling determines only the ratios of the moments of inertia; calibrate reports them'
)
_FEWEST = 3  # samples of a window, whose knots are too far apart with fewer
_SPARSE = 'too few joint states for windows of {:g} s: read the joints more often, or set window to {:g} or more'
_REPORTED = np.concatenate((BODY_PLACES, np.arange(MOMENTUM.start, MOMENTUM.stop)))  # (body, momentum) of the state


class TrajectoryEstimator:
    """Identifies one link and the total momentum from how the base's pose moves."""

    method = 'trajectory'
    needs_rates = False

    def __init__(self, kernel: MomentumKernel, settings: TrajectorySettings, reporting: Reporting) -> None:
        self._kernel = kernel
        self._settings = settings
        self._reporting = reporting
        self._plane = PlaneDetector(kernel.model)
        self._soft = soft_grasp_warnings(kernel)
        self._averaging = KnotAveraging(
            settings.noise,
            settings.window,
            settings.gyro,
            orientation_measured=settings.orientation_measured,
            fastest=kernel.springs.highest_frequency,
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
        averaged = self._averaging.average(windows)  # to knots
        self._runs.expect(
            [window for each in averaged for window in (each.ready, each.still_open) if window is not None]
        )
        estimates = [self._filter(window, each, origin) for window, each in zip(windows, averaged, strict=True)]
        self._last = windows[-1] if windows else self._last
        return estimates

    def _filter(self, window: Samples, knots: Averaged, origin: int) -> Estimate:
        """Filter one window, and report the solution by then, or why there is none."""
        self._runs.finish_due_work()  # of the windows before
        self._plane.update(window)
        self._samples += len(window)
        run = self._runs.current_run(self._averaging.origin)  # a new one if motion or target have changed
        ready, still_open = (each and self._runs.usable_window(each) for each in (knots.ready, knots.still_open))
        # Predict the twist, linearise, update every hypothesis, choose.
        variables = self._runs.variables
        joints_moved = knots.joints_moved or variables.has_body_prior or variables.previous_bias is not None
        run.filter_windows(ready, still_open, joints_moved=joints_moved)
        self._runs.isolation.add_window(ready, window)
        time = float(window.time[-1])
        stamp = origin + round(time * 1e9)
        now = Estimate(self.method, 'waiting', time, stamp, samples=self._samples, innovations=run.innovations)
        if run.has_state and run.converged:
            return self._solution(run, now, window)
        return self._no_solution(run, now, window, joints_moved=joints_moved)

    def _solution(self, run: FilterRun, now: Estimate, window: Samples) -> Estimate:
        """Judge the solution of the best hypothesis, and report it with the history of its run."""
        layout, distribution = self._runs.layout, run.distribution()
        prior_scales = run.prior_scales(distribution)
        verdict = self._with_causes(run, judge(self._runs.evidence(run, prior_scales)))
        verdict = with_findings(verdict, distribution, layout)
        history = self._history(run, now, distribution, verdict)
        solution = self._solved(run, distribution, prior_scales, verdict, history.flexible)
        estimate = self._reporting.estimate(solution, history)
        known, declared = estimate.identifiable, self._settings.declared
        budget = error_budget(distribution, layout, declared, prior_scales, known) if known.any() else None
        estimate = replace(estimate, budget=budget, causes=history.causes)
        if not self._settings.located:  # the frame moves with the common centre of mass
            momentum, covariance = estimate.momentum.copy(), estimate.momentum_covariance.copy()
            momentum[:3] = covariance[:3] = covariance[:, :3] = np.nan
            estimate = replace(estimate, momentum=momentum, momentum_covariance=covariance)
        return estimate.after_thrust(self._momentum_change(window, distribution.mean))

    def _history(self, run: FilterRun, now: Estimate, distribution: MeanAndCovariance, verdict: Verdict) -> Estimate:
        """Return all that is known of a run by now, but for body and momentum."""
        filtered, layout = run.best, self._runs.layout
        delay, delay_std = joint_delay(distribution, layout)
        return replace(
            now,
            stage='trajectory',
            causes=tuple((cause.text, cause.gain) for cause in verdict.causes),
            events=(
                *forces(filtered, distribution),
                *self._runs.events(distribution),
                *jumps(filtered, distribution, self._averaging.origin),
            ),
            thrusters=thrusters(estimates(Thrusters, distribution, layout)),
            flexible=self._flexible(run, distribution) if layout.kernel.springs.count else (),
            time_offset=delay,
            time_offset_std=delay_std,
        )

    def _flexible(self, run: FilterRun, distribution: MeanAndCovariance) -> tuple[PassiveJoint, ...]:
        """Return the passive joints as estimated, those that carry the target as declared."""
        layout = self._runs.layout
        resolved = run.resolved & ~joints_carrying_target(layout.kernel)
        estimated = estimates(SpringErrors, distribution, layout)
        return passive_joints(estimated, layout.kernel, run.deflections, resolved)

    def _solved(
        self,
        run: FilterRun,
        distribution: MeanAndCovariance,
        prior_scales: PriorScaleFactors,
        verdict: Verdict,
        flexible: Sequence[PassiveJoint],
    ) -> Solution:
        """Return body and momentum with their covariance, and the reasons to read them with care."""
        filtered, layout = run.best, self._runs.layout
        # Where the data contradict the model, the verdict names the declarations that would have to be wrong.
        too_small = [underestimated_text(*each) for each in prior_scales.significant if verdict.adequate]
        acting = filtered.hypothesis.disturbed and filtered.hypothesis.physical
        estimated = [f'{filtered.hypothesis.name}; it is estimated as well, and widens the intervals'] if acting else []
        x, factor = distribution.published(prior_scales, layout, _REPORTED)
        outside = distribution.variables.covariance_outside[np.ix_(_REPORTED, _REPORTED)]
        covariance = (factor @ factor.T + outside) * verdict.widening
        return Solution(
            x=x,
            covariance=covariance,
            cautious_covariance=covariance,
            cost=filtered.gaussian.nis,
            redundancy=filtered.gaussian.measured,
            origin=self._averaging.origin,
            plane=self._plane.plane(self._kernel.target),
            curvatures=run.curvatures(consistent=verdict.adequate),
            reasons=(
                *notes((*self._runs.warnings, *too_small, *estimated, *self._soft)),
                *(Reason(text, 'contradiction') for text in verdict.reasons),
                *(implausible_springs(distribution.mean, layout, flexible, run.resolved) if flexible else ()),
            ),
        )

    def _with_causes(self, run: FilterRun, verdict: Verdict) -> Verdict:
        """Return the verdict with the causes that fault isolation has found, and let that follow the run."""
        isolation = self._runs.isolation
        isolation.begin_if_due(run, suspicious=not verdict.adequate or bool(verdict.causes))
        if not verdict.adequate and (causes := isolation.causes(run)):
            return replace(verdict, causes=causes)
        return verdict

    def _no_solution(self, run: FilterRun, now: Estimate, window: Samples, *, joints_moved: bool) -> Estimate:
        """Return why there is no solution after a window."""
        isolation = self._runs.isolation
        if run.has_state:
            reason = 'no convergent solution yet: more motion is needed'
        elif joints_moved:
            doing = 'looking for a start in' if run.searching else 'collecting'
            reason = f'{doing} the first {FIRST} windows'
        elif len(window) < _FEWEST:
            reason = _SPARSE.format(self._settings.window, _FEWEST * self._settings.window)
        else:
            reason = _AT_REST if self._settings.located else _TUMBLING
        if joints_moved:
            # A run that has lost its solution has not explained the contradiction.
            isolation.begin_if_due(run, suspicious=run.inconsistent or isolation.suspicious)
        return replace(
            now,
            status='waiting' if joints_moved and not run.has_state else 'not_identifiable',
            causes=tuple((cause.text, cause.gain) for cause in isolation.causes(run)),
            events=self._runs.events(None),
            warnings=(reason, *self._runs.warnings),
        ).after_thrust(window.impulse[-1])

    def _momentum_change(self, window: Samples, state: Array) -> Array:
        """Return how thrust and orbit have changed the momentum by the end of a window, (6,)."""
        if not window.tide.shape[1]:
            return window.impulse[-1]
        return momentum_change(window, self._runs.layout.point(state).side.kernel.body_parameters(state[BODY]))

    def run_slice(self) -> bool:
        """Run a slice of the background work; return whether more is due before the next window."""
        run = self._runs.run
        return run is not None and (run.run_slice() or self._runs.isolation.run_slice())

    def posterior(self) -> Posterior | None:
        """Return the posterior at the end of the run; None without a solution, or where nothing locates the base."""
        run, last = self._runs.run, self._last
        if run is None or last is None or not self.settled or not self._settings.located:
            return None
        distribution = run.distribution()
        settings, change = self._settings, self._momentum_change(last, distribution.mean)
        end = End.from_window(last, settings.noise, settings.window, self._averaging.origin, change)
        return posterior(self._runs.layout, run.best.hypothesis, distribution, run.prior_scales(distribution), end)

    @property
    def settled(self) -> bool:
        """Whether the run has a solution that has converged."""
        run = self._runs.run
        return run is not None and run.has_state and run.converged

    @property
    def disturbed(self) -> bool:
        """Whether the solution explains the data by an external force, or by joints that are stamped late."""
        run = self._runs.run
        if run is None or not run.has_state:
            return False
        return run.best.hypothesis.disturbed or len(run.best.jumps) > 0 or run.has_joint_delay

    @property
    def changed(self) -> bool:
        """Whether the target has changed since the run began, or the twist has been left out."""
        return self._runs.changed

    def offer(self, estimate: Estimate) -> None:
        """Take an estimate to start from."""
        if self._runs.run is not None:
            self._runs.run.offer(partial(_point_of, estimate, self._runs.layout, self._averaging.origin))

    def restart(self) -> None:
        """Give up the solution and search a start again."""
        if self._runs.run is not None:
            self._runs.run.restart()


def _point_of(estimate: Estimate, layout: Layout, origin: Array) -> Point:
    """Return the linearisation point of an estimate, for runs with an origin (3,) m.

    Parameters that a planar motion leaves open do not matter: moments of inertia are the largest known one.
    """
    body = np.where(estimate.identifiable, estimate.parameters, 0.0)
    diagonal = [4, 7, 9]
    body[diagonal] = np.where(estimate.identifiable[diagonal], body[diagonal], body[diagonal].max())
    momentum = np.nan_to_num(estimate.momentum - estimate.impulse)
    momentum[3:] -= cross(origin, momentum[:3])
    return layout.point(layout.state(standard(body), momentum))
