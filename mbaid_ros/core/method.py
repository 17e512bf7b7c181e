"""Method `trajectory`, one window to one estimate: the first stage, the filter, and the choice between them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mbaid_ros.core.clocks import TimeOffset
from mbaid_ros.core.contracts import ConventionFactory, Hypothesis, Unknown, kind_in_words, underestimated_text
from mbaid_ros.core.diagnosis.isolation import CandidateCauses, Change, FaultIsolation
from mbaid_ros.core.diagnosis.passes import contradicting_unknowns, estimated_repair
from mbaid_ros.core.filter.hypotheses import HypothesisFilter
from mbaid_ros.core.filter.posterior import (
    Continuation,
    End,
    MeanAndCovariance,
    Posterior,
    U,
    VarianceComponents,
    error_budget,
    posterior,
)
from mbaid_ros.core.filter.run import FIRST, Run
from mbaid_ros.core.forces import Thrusters, constant_force
from mbaid_ros.core.geometry import Array, chi_square_limit, cross
from mbaid_ros.core.passive import (
    SpringErrors,
    implausible_springs,
    joints_carrying_target,
    passive_joints,
    soft_grasp_warnings,
)
from mbaid_ros.core.pipeline import Estimator
from mbaid_ros.core.repair import Repair
from mbaid_ros.core.results.estimate import PULSE, SYMPTOM, WITHHELD, Estimate, Event, PassiveJoint, Thruster
from mbaid_ros.core.results.verdict import (
    MOST_JUMPS,
    Cause,
    Evidence,
    IntervalConsistency,
    Reason,
    Reporting,
    Solution,
    Verdict,
    is_suspect,
    judge,
    notes,
    with_reasons,
)
from mbaid_ros.core.robot.body import standard
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.robot.momentum import MomentumKernel, momentum_change
from mbaid_ros.core.samples import FEWEST, Samples, SensorNoise, with_rates
from mbaid_ros.core.state import (
    BODY,
    BODY_PLACES,
    MOMENTUM,
    Declared,
    Layout,
    Point,
    UnknownsPrior,
    Variables,
    layout_of,
    variables,
)
from mbaid_ros.core.target import CaptureRows, ChangedTarget, TargetAtCapture, another_body, target_changed_text
from mbaid_ros.core.windows import KnotAveraging, Window, without_twist
from mbaid_ros.tasks import AT_ONCE, Kind, Tasks, Work

_NOTHING = 1e-6  # chance that noise looks like a constant force as large: one less sure is not reported
_AT_REST = 'no joint has moved yet: with joints at rest no single body is observable'
_TUMBLING = (
    'no joint has moved yet: tumbling determines only the ratios of the moments of inertia; calibrate reports them'
)
_WIDER = 30.0  # times the specified deviation, with which a thing that is further off is estimated for its repair
_SETTLING = 2  # windows that a changing target may take: the next run begins as many later
_PULSES = 1e3  # Hz
_FEWEST = 3  # samples of a window, whose knots are too far apart with fewer
_SPARSE = 'too few joint states for windows of {:g} s: read the joints more often, or set window to {:g} or more'
_REPORTED = np.concatenate((BODY_PLACES, np.arange(MOMENTUM.start, MOMENTUM.stop)))  # (body, momentum) of the state
# Chance that two stages which are both right count as contradicting each other: asked a hundred times a run.
_UNLIKELY = 1e-6
# Stage 1 retires when it knows the mass as well as this (relative standard deviation) and
# has agreed in as many windows in a row; in any case after so many windows, unless it contradicts stage 2 by then.
_KNOWN, _AGREED, _LONGEST = 0.05, 20, 1200
# Windows with a motion of the arm, until which a cause is sought why the motion of a tracked target is left out.
_NAMED_BY = 80
# s since the first number: a model that is far off agrees with so short a motion, and makes a wrong body of it.
_FIRST_ESTIMATE_PERIOD = 6.0
# s since the first stage's first number, in which stage 2 starts where the model is right.
_ALONE = 10.0
FIRST_STAGE = 'first stage: its numbers are withheld until the trajectory filter starts, which knows late stamps, too'
FIRST_ESTIMATE = 'first estimate: a wrong URDF cannot be detected from so short a motion'
LATE = 'first stage: stamps that are late by some 10 ms, or velocities that lag, are not known yet'
TARGET_CONTRADICTS = 'the motion of the tracked target is left out, because it contradicts that since the capture: '
ANY_CAUSE = 'another frame or scale of its poses, late stamps, or contact with something else'
ON_POSES = (
    'by the poses of the tracked target: a wrong scale of them, late stamps, or contact with something else show only '
    'when the arm moves'
)
DISAGREE = Reason(
    'the difference form and the trajectory filter contradict each other: the robot description, the noise values or '
    'the frames are wrong',
    'conflict',
)
UNSOLVED = Reason('the trajectory filter finds no solution that agrees with the data', 'contradiction')
_STRONG = 100.0  # log-likelihood of a cause, from which a run without a solution counts as contradicted


@dataclass(frozen=True)
class TrajectorySettings:
    """Settings of the trajectory-level estimator."""

    noise: SensorNoise  # of the joint sensors, and of the base where the samples carry none
    window: float  # s
    kept: int  # windows that are relinearised in the initialisation
    declared: Declared  # unknowns, and priors of all else
    hypotheses: tuple[Hypothesis, ...]  # that are followed; the first is the one to beat
    suspects: tuple[Unknown, ...] = ()  # that a contradicted run is tried with, each nearly exact
    conventions: tuple[ConventionFactory, ...] = ()  # that a contradicted run may have mistaken
    located: bool = True  # whether anything locates the base; linear momentum means nothing where not
    orientation_measured: bool = True  # whether anything but a gyro measures the orientation
    before: Continuation | None = None  # the run that this one continues
    tracked: TargetAtCapture | None = None  # the target before its capture, where it was tracked


def forces(filtered: HypothesisFilter, distribution: MeanAndCovariance) -> tuple[Event, ...]:
    """Return the constant force and torque as an event, if it is significant."""
    axes = filtered.hypothesis.force
    if axes == 'none':
        return ()
    value, factor = distribution.force, distribution.force_factor
    significance = float(value @ np.linalg.pinv(factor @ factor.T, hermitian=True) @ value)
    degrees = distribution.gaussian.size - len(distribution.variables.scale)  # 3 in a plane
    if significance < chi_square_limit(_NOTHING, degrees):
        return ()
    return (Event(0.0, 'ramp', value[:3], value[3:], constant_force(axes)),)


def jumps(filtered: HypothesisFilter, distribution: MeanAndCovariance, origin: Array) -> tuple[Event, ...]:
    """Return the jumps of the momentum, without the effect of a constant force; origin (3,) m of the run."""
    levels = [(jump.before, jump.force_impulse) for jump in filtered.jumps]
    levels.append((distribution.mean[MOMENTUM], filtered.force_impulse))
    events, cause = [], PULSE if len(filtered.jumps) <= MOST_JUMPS else SYMPTOM
    for jump, (after, impulse) in zip(filtered.jumps, levels[1:], strict=True):
        change = after - jump.before - distribution.impulse_of_force(impulse - jump.force_impulse)
        angular = change[3:] + cross(origin, change[:3])
        events.append(Event(jump.time, 'step', change[:3], angular, cause))
    return tuple(events)


def estimates_of(
    kind: type[U], unknowns: Iterable[tuple[Unknown, slice]], mean: Array, deviation: Array
) -> Iterator[tuple[U, Array, Array]]:
    """Yield the unknowns of a kind with their values and standard deviations, SI units.

    Parameters
    ----------
    unknowns : each with the place of its independent numbers; an SI number takes at most one of them
    mean, deviation : of the numbers, in units of their priors
    """
    for unknown, place in unknowns:
        if isinstance(unknown, kind):
            yield unknown, unknown.factor @ mean[place], np.abs(unknown.factor @ deviation[place])


def estimates(kind: type[U], distribution: MeanAndCovariance, layout: Layout) -> Iterator[tuple[U, Array, Array]]:
    """Yield the unknowns of a kind with their values and standard deviations, SI units."""
    deviation = np.concatenate((np.zeros(BODY.stop), np.sqrt(distribution.unknowns_covariance.diagonal())))
    return estimates_of(kind, zip(layout.unknowns, layout.places, strict=True), distribution.mean, deviation)


def joint_delay(distribution: MeanAndCovariance, layout: Layout) -> tuple[float, float]:
    """Return the joints' delay and its standard deviation, s; NaN where it is no unknown."""
    found = ((float(value[0]), float(std[0])) for _, value, std in estimates(TimeOffset, distribution, layout))
    return next(found, (np.nan, np.nan))


def thrusters(estimated: Iterable[tuple[Thrusters, Array, Array]]) -> tuple[Thruster, ...]:
    """Return the estimated deviations of thrusters from their commands."""
    parts = (Thruster.all_of(unknown.frames, value, std) for unknown, value, std in estimated)
    return tuple(thruster for part in parts for thruster in part)


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
        self._plane = PlaneDetector(kernel.model, max((each.tilt for each in settings.declared.unknowns), default=0.0))
        before = settings.before  # in space a planar motion counts as well
        self._plane.planar = self._plane.planar and (before is None or before.planar)
        self._soft = soft_grasp_warnings(kernel)
        self._averaging = KnotAveraging(
            settings.noise,
            settings.window,
            orientation_measured=settings.orientation_measured,
            # Pulses of thrust that move a body without joints are as short as the time between two samples.
            fastest=kernel.springs.highest_frequency if kernel.model.joints else _PULSES,
        )
        self.tasks = Tasks()
        self.run: Run | None = None
        self._layout: Layout  # of its state
        self._variables: Variables  # of its filter
        self._isolation: FaultIsolation  # of its faults
        self._earlier: tuple[Event, ...] = ()  # before the target changed last
        self._change: ChangedTarget | None = None
        self._wrong_twist = ''  # why the twist has been left out
        self._left_out = ''  # why the motion of the tracked target has been
        self._moved = 0  # windows since the joints moved first
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
            self._moved += knots.joints_moved
            joints_moved |= self._variables.tracked is not None and self._variables.tracked.grasp_known
            # Known thrust moves a body without joints: its impulse over the change of the velocity is the mass.
            joints_moved |= not self._kernel.model.joints and bool(np.any(window.impulse))
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
            tracked = None if self._left_out else self._settings.tracked
            if tracked is not None:
                known = CaptureRows(tracked, self._layout, self._averaging.origin)
                self._variables = replace(self._variables, tracked=known)
            self.run = self._new_run([])
            if self._variables.previous_bias is not None:  # of the run that this one continues
                self.run.offer(partial(self._layout.point, self._variables.to_state @ self._variables.prior()[0]))
        elif (rows := self._variables.tracked) is not None and (
            self.run.contradicts_target
            or (self._moved >= (1 if rows.grasp_known else 2) * FIRST and not self.run.converged)
        ):
            self._left_out = ANY_CAUSE
            self._variables = replace(self._variables, tracked=None)
            self.run = self._new_run(self._isolation.windows_since(-np.inf))
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
        if self._left_out:
            found.append(TARGET_CONTRADICTS + self._left_out)
        if self._variables.tracked is not None and self._moved < FIRST:
            found.append(ON_POSES)
        if before is not None and self.run is not None and before.planar and not self.run.planar:
            found.append('the run before, which was planar, does not count: this motion is not')
        return tuple(found)

    def _estimate(self, run: Run, window: Samples, origin: int, *, joints_moved: bool) -> Estimate:
        """Return the solution by the end of a window, or why there is none."""
        time = float(window.time[-1])
        stamp = origin + round(time * 1e9)
        now = Estimate(self.method, 'waiting', time, stamp, samples=self._samples, innovations=run.innovations)
        if run.has_state and run.converged and not run.relinearises:
            return self._solution(run, now, window)
        return self._no_solution(run, now, window, joints_moved=joints_moved)

    def _solution(self, run: Run, now: Estimate, window: Samples) -> Estimate:
        """Judge the solution of the best hypothesis, and report it with the history of its run."""
        layout, distribution = self._layout, run.distribution()
        now = replace(now, target_misfit=run.misfit_of_target(distribution))
        tracked = self._settings.tracked
        if tracked is not None and self._left_out == ANY_CAUSE and self._moved < _NAMED_BY:
            rows = CaptureRows(tracked, layout, self._averaging.origin)
            with suppress(np.linalg.LinAlgError):  # no body can be there
                self._left_out = rows.pose_error(distribution.mean, distribution.factor) or ANY_CAUSE
        prior_scales = run.prior_scales(distribution)
        verdict = judge(self._evidence(run, prior_scales))
        contradicting = tuple(contradicting_unknowns(distribution, layout))
        verdict = self._with_causes(run, replace(verdict, adequate=verdict.adequate and not contradicting))
        for cause in contradicting:
            # A run linearised where a wrong robot has led it may see what a search does not.
            seen = self._isolation.contradicting > 0.0 or not verdict.causes
            verdict = verdict.with_cause(cause if seen else verdict.causes[0])
        history = self._history(run, now, distribution, verdict)
        solution = self._solved(run, distribution, prior_scales, verdict, history.flexible)
        estimate = self._reporting.estimate(solution, history)
        known, declared = estimate.identifiable, self._settings.declared
        budget = error_budget(distribution, layout, declared, prior_scales, known) if known.any() else None
        estimate = replace(estimate, budget=budget, causes=history.causes, remedies=history.remedies)
        if not self._settings.located:  # the frame moves with the common centre of mass
            momentum, covariance = estimate.momentum.copy(), estimate.momentum_covariance.copy()
            momentum[:3] = covariance[:3] = covariance[:, :3] = np.nan
            estimate = replace(estimate, momentum=momentum, momentum_covariance=covariance)
        return estimate.after_thrust(self._momentum_change(window, distribution.mean))

    def _evidence(self, run: Run, prior_scales: VarianceComponents) -> Evidence:
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
            repairs=self._repairs(run, beside_prior),
            noises={sensor.name: sensor.noise for sensor in self._layout.sensors},
        )

    def _repairs(self, run: Run, beside_prior: VarianceComponents) -> dict[str, Repair]:
        """Return how to take into account each thing that is further off than declared, by its name in words."""
        far = [cause for cause, value in beside_prior.distances.items() if is_suspect(value)]
        if not far:
            return {}
        distribution = run.distribution()
        found = {kind_in_words(cause): estimated_repair(distribution, self._layout, cause, _WIDER) for cause in far}
        return {what: repair for what, repair in found.items() if repair is not None}

    def _history(self, run: Run, now: Estimate, distribution: MeanAndCovariance, verdict: Verdict) -> Estimate:
        """Return all that is known of a run by now, but for body and momentum."""
        filtered, layout = run.best, self._layout
        delay, delay_std = joint_delay(distribution, layout)
        return replace(
            now,
            stage='trajectory',
            sensors=filtered.gaussian.innovations.fits,
            causes=tuple((cause.text, cause.gain) for cause in verdict.causes),
            remedies=_remedies(verdict.causes),
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
        prior_scales: VarianceComponents,
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
            covariance_for_identifiability=covariance,
            cost=filtered.gaussian.nis,
            redundancy=filtered.gaussian.measured,
            origin=self._averaging.origin,
            plane=self._plane.plane(self._kernel.target),
            nonlinearities=run.nonlinearities(consistent=verdict.adequate),
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
        if not isolation.searched:  # a cause that is tried may explain more
            return replace(verdict, causes=tuple(replace(cause, repair=None) for cause in verdict.causes))
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
        causes = isolation.causes(run)
        contradicted = bool(causes) and causes[0].gain > _STRONG
        return replace(
            now,
            status='waiting' if joints_moved and not run.has_state and not contradicted else 'not_identifiable',
            causes=tuple((cause.text, cause.gain) for cause in causes),
            remedies=_remedies(causes),
            events=self._events(None),
            warnings=(*((UNSOLVED.text, WITHHELD) if contradicted else (reason,)), *self._warnings),
        ).after_thrust(window.impulse[-1])

    def _momentum_change(self, window: Samples, state: Array) -> Array:
        """Return how thrust and orbit have changed the momentum by the end of a window, (6,)."""
        if not window.gravity_columns.shape[1]:
            return window.impulse[-1]
        return momentum_change(window, self._layout.point(state).nominal.kernel.body_parameters(state[BODY]))

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


def _remedies(causes: Sequence[Cause]) -> dict[str, Repair]:
    """Return how a run takes causes into account, by their texts, where it can."""
    return {cause.text: cause.repair for cause in causes if cause.repair is not None}


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


class TwoStageEstimator:
    """Identifies one link and the total momentum in two stages.

    Parameters
    ----------
    first : the weighted difference form; None where it has no part
    second : the trajectory filter

    Attributes
    ----------
    tasks : background work, of the second stage and of the first beside it
    """

    needs_rates = False

    def __init__(self, first: Estimator | None, second: TrajectoryEstimator) -> None:
        self.method, self.tasks = second.method, second.tasks
        self._first = first
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
            remedies=late.remedies,
            innovations=late.innovations,
        )
        if not self._second.settled:
            return with_reasons(early, [DISAGREE]) if self._contradicts else self._first_stage_only(early, late)
        if not early.identifiable[0] or early.status == 'inconsistent' or self._second.disturbed:
            return late
        if not np.any(early.identifiable & late.identifiable):
            return late  # nothing in which they could agree or contradict each other
        return self._compared(early, late)

    def _first_stage_only(self, early: Estimate, late: Estimate) -> Estimate:
        """Return the first stage's estimate, at first without numbers if they contradict the data or lack a twist.

        Neither stamps that are late nor velocities that lag are among its unknowns: ten milliseconds of either move its
        numbers by many standard deviations. Poses alone come from a camera with a clock of its own.
        """
        if late.contradicted:
            early = with_reasons(early, [UNSOLVED])
        elif not early.identifiable.any() and not early.contradicted:
            return late  # neither has numbers: the second says what it waits for
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
