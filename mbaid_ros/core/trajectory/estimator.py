"""Method `trajectory`: from windows of samples to estimates, by one run of the filter after another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from mbaid_ros.core.diagnosis.candidates import CandidateCauses
from mbaid_ros.core.diagnosis.fault_isolation import FaultIsolation, with_findings
from mbaid_ros.core.diagnosis.filter_passes import another_body
from mbaid_ros.core.diagnosis.ranking import Change
from mbaid_ros.core.filter.averaging import KnotAveraging
from mbaid_ros.core.filter.prior_scale import PriorScaleFactors
from mbaid_ros.core.filter.run import FIRST, Run
from mbaid_ros.core.filter.square_root import MeanAndCovariance
from mbaid_ros.core.filter.state import BODY, BODY_PLACES, MOMENTUM, Layout, Point, layout_of
from mbaid_ros.core.filter.variables import Variables, variables
from mbaid_ros.core.filter.window import Window, without_twist
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.results.estimate import Estimate, Event, PassiveJoint
from mbaid_ros.core.results.reporting import Reporting, Solution
from mbaid_ros.core.results.status import Evidence, Reason, Verdict, judge, notes
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.robot.momentum import momentum_change, standard
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.tasks import Tasks
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
from mbaid_ros.core.trajectory.target_runs import ChangedTarget, TrajectorySettings
from mbaid_ros.core.unknowns.catalogue import kind_in_words, target_changed_text, underestimated_text
from mbaid_ros.core.unknowns.environment import Thrusters
from mbaid_ros.core.unknowns.flexible import SpringErrors
from mbaid_ros.core.unknowns.priors import UnknownsPrior

_AT_REST = 'no joint has moved yet: with joints at rest no single body is observable'
_TUMBLING = (
    'no joint has moved yet: tumbling determines only the ratios of the moments of inertia; calibrate reports them'
)
_SETTLING = 2  # windows that a changing target may take: the next run begins as many later
_FEWEST = 3  # samples of a window, whose knots are too far apart with fewer
_SPARSE = 'too few joint states for windows of {:g} s: read the joints more often, or set window to {:g} or more'
_REPORTED = np.concatenate((BODY_PLACES, np.arange(MOMENTUM.start, MOMENTUM.stop)))  # (body, momentum) of the state


class TrajectoryEstimator:
    """Identifies one link and the total momentum from how the base's pose moves.

    Another run of the filter begins where the motion is no longer planar, the target changes, or the twist is wrong.

    Attributes
    ----------
    tasks : its background work
    run : the present one; None before the first window
    """

    method = 'trajectory'
    needs_rates = False

    def __init__(self, kernel: MomentumKernel, settings: TrajectorySettings, reporting: Reporting) -> None:
        self._kernel = kernel
        self._settings = settings
        self._reporting = reporting
        self._plane = PlaneDetector(kernel.model)
        before = settings.before  # in space a planar motion counts as well
        self._plane.planar = self._plane.planar and (before is None or before.planar)
        self._soft = soft_grasp_warnings(kernel)
        self._averaging = KnotAveraging(
            settings.noise,
            settings.window,
            settings.gyro,
            orientation_measured=settings.orientation_measured,
            fastest=kernel.springs.highest_frequency,
        )
        self.tasks = Tasks()
        self.run: Run | None = None
        self._layout: Layout  # of its state
        self._variables: Variables  # of its filter
        self._isolation: FaultIsolation  # of its faults
        self._earlier: tuple[Event, ...] = ()  # before the target changed last
        self._change: ChangedTarget | None = None
        self._wrong_twist = ''  # why the twist has been left out
        self._coming: list[Window] = []
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
        self._expect([window for each in averaged for window in (each.ready, each.still_open) if window is not None])
        estimates: list[Estimate] = []
        for window, knots in zip(windows, averaged, strict=True):
            self.tasks.finish_due()  # of the windows before
            self._plane.update(window)
            self._samples += len(window)
            run = self._current_run()  # a new one if motion or target have changed
            ready, still_open = (each and self._usable_part(each) for each in (knots.ready, knots.still_open))
            # Predict the twist, linearise, update every hypothesis, choose.
            has_prior = self._variables.has_body_prior or self._variables.previous_bias is not None
            joints_moved = knots.joints_moved or has_prior
            run.add(ready, still_open, joints_moved=joints_moved)
            self._isolation.add_window(ready, window)
            self._last = window
            estimates.append(self._estimate(run, window, origin, joints_moved=joints_moved))
        return estimates

    def _usable_part(self, window: Window) -> Window:
        """Return the part of a window that the run uses."""
        return without_twist(window) if self._wrong_twist else window

    def _expect(self, windows: list[Window]) -> None:
        """Take the windows that are going to come, in order."""
        self._coming = windows
        if self.run is not None:
            self.run.expect([self._usable_part(window) for window in windows])

    def _current_run(self) -> Run:
        """Return the run for the next window: a new one if the motion is not planar, target or twist have changed."""
        if self.run is None or self.run.planar != self._plane.planar:
            self._layout = layout_of(self._kernel, self._settings.declared, self._plane)
            self._variables = variables(self._layout, self._plane, self._settings.declared)
            before = self._settings.before
            if before is not None and before.planar == self._plane.planar:
                self._variables = self._variables.for_continued_run(before.root, before.bias)
            self.run = self._new_run([])
            if self._variables.previous_bias is not None:  # of the run that this one continues
                self.run.offer(partial(self._layout.point, self._variables.to_state @ self._variables.prior()[0]))
        elif (change := self._isolation.change) is not None:
            self.run = self._run_after(self.run, change)
        elif (wrong := self._isolation.wrong_twist) and not self._wrong_twist:
            self._wrong_twist = wrong
            self.run = self._new_run([self._usable_part(window) for window in self._isolation.windows_since(-np.inf)])
        return self.run

    def _new_run(self, windows: list[Window]) -> Run:
        """Return a run over some windows."""
        settings, bank = self._settings, self._settings.hypotheses
        candidates = CandidateCauses(
            self._layout, self._plane, settings.declared, bank, settings.suspects, settings.conventions
        )
        self._isolation = FaultIsolation(candidates, settings.noise, self.tasks)
        run = Run(self._layout, self._variables, bank, settings.kept, self.tasks)
        run.expect(windows)
        for window in windows:
            run.add(window, None, joints_moved=True)
            self.tasks.finish_due()
        run.expect([self._usable_part(window) for window in self._coming])
        return run

    def _run_after(self, run: Run, change: Change) -> Run:
        """Return a run over the windows since a change of the target: the posterior of the robot carries over."""
        slack = _SETTLING * self._settings.window
        windows = self._isolation.windows_since(change.time + slack)
        gaussian = run.gaussian_before(change.time, slack)
        before = None if gaussian is None else MeanAndCovariance.from_gaussian(gaussian, self._variables)
        jumped = jumps(run.best, run.distribution(), self._averaging.origin) if run.has_state else ()
        self._earlier = (*self._events(before), *(jump for jump in jumped if jump.time < change.time - slack))
        text = target_changed_text(change.time, exchanged=change.exchanged)
        self._change = ChangedTarget(change.time, text, change.exchanged, before)
        if gaussian is not None:
            after = another_body(gaussian, self._variables, exchanged=change.exchanged)
            distribution = MeanAndCovariance.from_gaussian(after, self._variables)
            prior = UnknownsPrior(distribution.mean[BODY.stop :], distribution.factor[BODY.stop :])
            self._layout = replace(self._layout, known=prior)
            self._variables = self._variables.for_new_target(after.root, distribution.mean, exchanged=change.exchanged)
        return self._new_run(windows)

    def _events(self, now: MeanAndCovariance | None) -> tuple[Event, ...]:
        """Return the events of earlier runs, and the change of target that ended them.

        Parameters
        ----------
        now : state of the present run; None where there is none yet
        """
        return self._earlier if self._change is None else (*self._earlier, self._change.event(now))

    @property
    def _warnings(self) -> tuple[str, ...]:
        """Warnings about the present run."""
        before, found = self._settings.before, []
        if self._wrong_twist:
            found.append(f'the twist is not used, because it contradicts the poses: {self._wrong_twist}')
        if before is not None and self.run is not None and before.planar and not self.run.planar:
            found.append('the run before, which was planar, does not count: this motion is not')
        return tuple(found)

    def _estimate(self, run: Run, window: Samples, origin: int, *, joints_moved: bool) -> Estimate:
        """Return the solution by the end of a window, or why there is none."""
        time = float(window.time[-1])
        stamp = origin + round(time * 1e9)
        now = Estimate(self.method, 'waiting', time, stamp, samples=self._samples, innovations=run.innovations)
        if run.has_state and run.converged:
            return self._solution(run, now, window)
        return self._no_solution(run, now, window, joints_moved=joints_moved)

    def _solution(self, run: Run, now: Estimate, window: Samples) -> Estimate:
        """Judge the solution of the best hypothesis, and report it with the history of its run."""
        layout, distribution = self._layout, run.distribution()
        prior_scales = run.prior_scales(distribution)
        verdict = self._with_causes(run, judge(self._evidence(run, prior_scales)))
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

    def _evidence(self, run: Run, prior_scales: PriorScaleFactors) -> Evidence:
        """Return the evidence for and against the model of a run that has started."""
        gaussian, hypothesis = run.best.gaussian, run.best.hypothesis
        # A force or drift would absorb the errors of a wrong robot.
        undisturbed = run.prior_scales(run.distribution_of_first()) if hypothesis.disturbed else prior_scales
        beside_prior = prior_scales if hypothesis.physical else undisturbed
        # A declared force has no rival: nothing was estimated without it.
        declared = self._settings.hypotheses[0].force != 'none'
        instead, gain = ('', 0.0) if declared else undisturbed.likeliest
        return Evidence(
            nis=gaussian.nis / max(gaussian.measured, 1),
            innovations=gaussian.innovations,
            distances={kind_in_words(cause): value for cause, value in beside_prior.distances.items()},
            jumps=len(run.best.jumps),
            unconfirmed=run.unconfirmed_jumps or self._isolation.open_jumps(run),
            hypothesis=hypothesis.name if hypothesis.disturbed else '',
            physical=hypothesis.physical,
            gain=run.log_likelihood_ratio,
            instead=(kind_in_words(instead), gain),
        )

    def _history(self, run: Run, now: Estimate, distribution: MeanAndCovariance, verdict: Verdict) -> Estimate:
        """Return all that is known of a run by now, but for body and momentum."""
        filtered, layout = run.best, self._layout
        delay, delay_std = joint_delay(distribution, layout)
        return replace(
            now,
            stage='trajectory',
            causes=tuple((cause.text, cause.gain) for cause in verdict.causes),
            events=(
                *forces(filtered, distribution),
                *self._events(distribution),
                *jumps(filtered, distribution, self._averaging.origin),
            ),
            thrusters=thrusters(estimates(Thrusters, distribution, layout)),
            flexible=self._flexible(run, distribution) if layout.kernel.springs.count else (),
            time_offset=delay,
            time_offset_std=delay_std,
        )

    def _flexible(self, run: Run, distribution: MeanAndCovariance) -> tuple[PassiveJoint, ...]:
        """Return the passive joints as estimated, those that carry the target as declared."""
        layout = self._layout
        resolved = run.resolved & ~joints_carrying_target(layout.kernel)
        estimated = estimates(SpringErrors, distribution, layout)
        return passive_joints(estimated, layout.kernel, run.deflections, resolved)

    def _solved(
        self,
        run: Run,
        distribution: MeanAndCovariance,
        prior_scales: PriorScaleFactors,
        verdict: Verdict,
        flexible: Sequence[PassiveJoint],
    ) -> Solution:
        """Return body and momentum with their covariance, and the reasons to read them with care."""
        filtered, layout = run.best, self._layout
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
            curvatures=run.nonlinearities(consistent=verdict.adequate),
            reasons=(
                *notes((*self._warnings, *too_small, *estimated, *self._soft)),
                *(Reason(text, 'contradiction') for text in verdict.reasons),
                *(implausible_springs(distribution.mean, layout, flexible, run.resolved) if flexible else ()),
            ),
        )

    def _with_causes(self, run: Run, verdict: Verdict) -> Verdict:
        """Return the verdict with the causes that fault isolation has found, and let that follow the run."""
        isolation = self._isolation
        isolation.begin_if_due(run, suspicious=not verdict.adequate or bool(verdict.causes))
        if not verdict.adequate and (causes := isolation.causes(run)):
            return replace(verdict, causes=causes)
        return verdict

    def _no_solution(self, run: Run, now: Estimate, window: Samples, *, joints_moved: bool) -> Estimate:
        """Return why there is no solution after a window."""
        isolation = self._isolation
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
            events=self._events(None),
            warnings=(reason, *self._warnings),
        ).after_thrust(window.impulse[-1])

    def _momentum_change(self, window: Samples, state: Array) -> Array:
        """Return how thrust and orbit have changed the momentum by the end of a window, (6,)."""
        if not window.tide.shape[1]:
            return window.impulse[-1]
        return momentum_change(window, self._layout.point(state).side.kernel.body_parameters(state[BODY]))

    def posterior(self) -> Posterior | None:
        """Return the posterior at the end of the run; None without a solution, or where nothing locates the base."""
        run, last = self.run, self._last
        if run is None or last is None or not self.settled or not self._settings.located:
            return None
        distribution = run.distribution()
        settings, change = self._settings, self._momentum_change(last, distribution.mean)
        end = End.from_window(last, settings.noise, settings.window, self._averaging.origin, change)
        return posterior(self._layout, run.best.hypothesis, distribution, run.prior_scales(distribution), end)

    @property
    def settled(self) -> bool:
        """Whether the run has a solution that has converged."""
        return self.run is not None and self.run.has_state and self.run.converged

    @property
    def disturbed(self) -> bool:
        """Whether the solution explains the data by an external force, or by joints that are stamped late."""
        run = self.run
        if run is None or not run.has_state:
            return False
        return run.best.hypothesis.disturbed or len(run.best.jumps) > 0 or run.has_joint_delay

    @property
    def changed(self) -> bool:
        """Whether the target has changed since the run began, or the twist has been left out."""
        return self._change is not None or bool(self._wrong_twist)

    def offer(self, estimate: Estimate) -> None:
        """Take an estimate to start from."""
        if self.run is not None:
            self.run.offer(partial(_point_of, estimate, self._layout, self._averaging.origin))

    def restart(self) -> None:
        """Give up the solution and search a start again."""
        if self.run is not None:
            self.run.restart()


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
