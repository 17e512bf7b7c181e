"""The runs of the filter over one stream: another one begins where the target has changed, or the twist is wrong."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mbaid_ros.core.diagnosis.candidates import CandidateCauses
from mbaid_ros.core.diagnosis.conventions import ConventionFactory
from mbaid_ros.core.diagnosis.fault_isolation import FaultIsolation
from mbaid_ros.core.diagnosis.filter_passes import another_body
from mbaid_ros.core.diagnosis.ranking import Change
from mbaid_ros.core.filter.prior_scale import PriorScaleFactors
from mbaid_ros.core.filter.run import FilterRun
from mbaid_ros.core.filter.square_root import MeanAndCovariance
from mbaid_ros.core.filter.state import BODY, Declared, Layout, layout_of
from mbaid_ros.core.filter.time_update import Hypothesis
from mbaid_ros.core.filter.variables import Variables, variables
from mbaid_ros.core.filter.window import Window, without_twist
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Event, changed_by
from mbaid_ros.core.results.status import Evidence
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.kinematics import PlaneDetector
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.core.trajectory.posterior import Continuation
from mbaid_ros.core.trajectory.solution import jumps
from mbaid_ros.core.unknowns.catalogue import kind_in_words, target_changed_text
from mbaid_ros.core.unknowns.declaration import Unknown
from mbaid_ros.core.unknowns.priors import UnknownsPrior


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
    gyro: float = 0.0  # rad/s/sqrt(Hz), density of the noise of an IMU's angular velocity; 0 where there is none
    located: bool = True  # whether anything locates the base; linear momentum means nothing where not
    orientation_measured: bool = True  # whether anything but a gyro measures the orientation
    before: Continuation | None = None  # the run that this one continues


_KNOWN = 0.1  # relative standard deviation of a mass, up to which its centre of mass can be compared
_SETTLING = 2  # windows that a changing target may take: the next run begins as many later


@dataclass(frozen=True, eq=False)
class ChangedTarget:
    """A target that has changed in a run."""

    time: float  # s since the first sample
    text: str  # the event in words
    exchanged: bool  # whether it is another body, not the same elsewhere
    before: MeanAndCovariance | None  # state until then; None where unknown

    def event(self, after: MeanAndCovariance | None) -> Event:
        """Return it as an event, with the change of mass and centre of mass where both states are known."""
        text, both = self.text, [each for each in (self.before, after) if each is not None]
        known = [each.deviation[BODY.start] < _KNOWN * each.mean[BODY.start] for each in both]
        if len(both) == 2 and all(known):
            then, now = (each.mean[BODY] for each in both)
            heavier = float(now[0] - then[0]) if self.exchanged else None
            text = changed_by(text, heavier, now[1:4] / now[0] - then[1:4] / then[0])
        return Event(self.time, 'target_changed', np.zeros(3), np.zeros(3), text)


class TargetRuns:
    """The present run of the filter, its state layout, and the events of the runs before.

    Parameters
    ----------
    plane : decides whether the motion is planar

    Attributes
    ----------
    run : the present one; None before the first window
    layout, variables : of its state
    isolation : of its faults
    """

    def __init__(self, kernel: MomentumKernel, settings: TrajectorySettings, plane: PlaneDetector) -> None:
        self._kernel = kernel
        self._settings = settings
        self._plane = plane
        self.run: FilterRun | None = None
        self.layout: Layout
        self.variables: Variables
        self.isolation: FaultIsolation
        self._earlier: tuple[Event, ...] = ()  # before the target changed last
        self._change: ChangedTarget | None = None
        self._wrong_twist = ''  # why the twist has been left out
        self._coming: list[Window] = []
        before = settings.before
        plane.planar = plane.planar and (before is None or before.planar)  # in space a planar motion counts as well

    @property
    def changed(self) -> bool:
        """Whether the target has changed since the first run began, or the twist has been left out."""
        return self._change is not None or bool(self._wrong_twist)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the present run."""
        before, found = self._settings.before, []
        if self._wrong_twist:
            found.append(f'the twist is not used, because it contradicts the poses: {self._wrong_twist}')
        if before is not None and self.run is not None and before.planar and not self.run.planar:
            found.append('the run before, which was planar, does not count: this motion is not')
        return tuple(found)

    def usable_window(self, window: Window) -> Window:
        """Return the part of a window that the run uses."""
        return without_twist(window) if self._wrong_twist else window

    def expect(self, windows: list[Window]) -> None:
        """Take the windows that are going to come, in order."""
        self._coming = windows
        if self.run is not None:
            self.run.expect([self.usable_window(window) for window in windows])

    def events(self, now: MeanAndCovariance | None) -> tuple[Event, ...]:
        """Return the events of earlier runs, and the change of target that ended them.

        Parameters
        ----------
        now : state of the present run; None where there is none yet
        """
        return self._earlier if self._change is None else (*self._earlier, self._change.event(now))

    def current_run(self, origin: Array) -> FilterRun:
        """Return the run for the next window: a new one if the motion is not planar, target or twist have changed.

        Parameters
        ----------
        origin : (3,) m, of the runs, in the odometry frame
        """
        if self.run is None or self.run.planar != self._plane.planar:
            self.layout = layout_of(self._kernel, self._settings.declared, self._plane)
            self.variables = variables(self.layout, self._plane, self._settings.declared)
            before = self._settings.before
            if before is not None and before.planar == self._plane.planar:
                self.variables = self.variables.for_continued_run(before.root, before.bias)
            self.run = self._new_run([])
            if self.variables.previous_bias is not None:  # of the run that this one continues
                self.run.offer(partial(self.layout.point, self.variables.to_state @ self.variables.prior()[0]))
        elif (change := self.isolation.change) is not None:
            self.run = self._run_after(self.run, change, origin)
        elif (wrong := self.isolation.wrong_twist) and not self._wrong_twist:
            self._wrong_twist = wrong
            self.run = self._new_run([self.usable_window(window) for window in self.isolation.windows_since(-np.inf)])
        return self.run

    def finish_due_work(self) -> None:
        """Complete the background work that the next window needs."""
        if self.run is not None:
            while self.run.run_slice():
                pass
            self.isolation.accept_result()

    def _new_run(self, windows: list[Window]) -> FilterRun:
        """Return a run over some windows."""
        settings, layout, bank = self._settings, self.layout, self._settings.hypotheses
        candidates = CandidateCauses(
            layout, self._plane, settings.declared, bank, settings.suspects, settings.conventions
        )
        self.isolation = FaultIsolation(candidates, settings.noise)
        run = FilterRun(layout, self.variables, bank, settings.kept)
        run.expect(windows)
        for window in windows:
            run.filter_windows(window, None, joints_moved=True)
        run.expect([self.usable_window(window) for window in self._coming])
        return run

    def _run_after(self, run: FilterRun, change: Change, origin: Array) -> FilterRun:
        """Return a run over the windows since a change of the target: the posterior of the robot carries over."""
        slack = _SETTLING * self._settings.window
        windows = self.isolation.windows_since(change.time + slack)
        gaussian = run.gaussian_before(change.time, slack)
        before = None if gaussian is None else MeanAndCovariance.from_gaussian(gaussian, self.variables)
        jumped = jumps(run.best, run.distribution(), origin) if run.has_state else ()
        self._earlier = (*self.events(before), *(jump for jump in jumped if jump.time < change.time - slack))
        text = target_changed_text(change.time, exchanged=change.exchanged)
        self._change = ChangedTarget(change.time, text, change.exchanged, before)
        if gaussian is not None:
            after = another_body(gaussian, self.variables, exchanged=change.exchanged)
            distribution = MeanAndCovariance.from_gaussian(after, self.variables)
            prior = UnknownsPrior(distribution.mean[BODY.stop :], distribution.factor[BODY.stop :])
            self.layout = replace(self.layout, known=prior)
            self.variables = self.variables.for_new_target(after.root, distribution.mean, exchanged=change.exchanged)
        return self._new_run(windows)

    def evidence(self, run: FilterRun, prior_scales: PriorScaleFactors) -> Evidence:
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
            unconfirmed=run.unconfirmed_jumps or self.isolation.open_jumps(run),
            hypothesis=hypothesis.name if hypothesis.disturbed else '',
            physical=hypothesis.physical,
            gain=run.log_likelihood_ratio,
            instead=(kind_in_words(instead), gain),
        )
