"""What the method `trajectory` is told."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.diagnosis.candidates import CandidateCauses
from mbaid_ros.core.diagnosis.changed_target import another_body
from mbaid_ros.core.diagnosis.fault_isolation import FaultIsolation
from mbaid_ros.core.diagnosis.ranking import Change
from mbaid_ros.core.filter.gaussian import MeanAndCovariance, PriorScaleFactors
from mbaid_ros.core.filter.run import FilterRun
from mbaid_ros.core.filter.state import BODY, Layout, layout_of
from mbaid_ros.core.filter.variables import Variables, variables
from mbaid_ros.core.filter.window import Window, without_twist
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Event
from mbaid_ros.core.results.verdict import Evidence
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.trajectory.solution import ChangedTarget, jumps
from mbaid_ros.core.unknowns.catalogue import Uncertainty
from mbaid_ros.core.unknowns.hypotheses import Axes, hypotheses
from mbaid_ros.core.unknowns.priors import UnknownsPrior
from mbaid_ros.core.unknowns.words import all_of, of_change


@dataclass(frozen=True)
class TrajectorySettings:
    """Settings of the trajectory-level estimator.

    Attributes
    ----------
    noise : of the joint sensors, and of the base where the samples carry none
    window : s
    start : windows before the first estimate
    kept : windows linearised again while the run is young
    uncertainty : of the known side
    adapt : also follow the hypotheses that a constant force and torque act, or that momentum or odometry drift, and
        take the best
    constant : axes of a constant force and torque that is taken to act
    gyro : rad/s/sqrt(Hz), density of the noise of an IMU's angular velocity; 0 where there is none
    located : whether anything locates the base; linear momentum means nothing where not
    orientation_measured : whether anything but a gyro tells how it is oriented
    """

    noise: SensorNoise
    window: float
    start: int
    kept: int
    uncertainty: Uncertainty
    adapt: bool
    constant: Axes = 'none'
    gyro: float = 0.0
    located: bool = True
    orientation_measured: bool = True


# Windows that a changing target may take: the next run begins as many later, and jumps as near belong to the change.
_SETTLING = 2


class TargetRuns:
    """The present run of the filter, what its state is made of, and what happened in the runs before.

    Parameters
    ----------
    kernel : MomentumKernel
    settings : TrajectorySettings
    plane : decides whether the motion is planar

    Attributes
    ----------
    run : the present one; None before the first window
    layout, variables : of its state
    inquiries : into it
    """

    def __init__(self, kernel: MomentumKernel, settings: TrajectorySettings, plane: PlaneDetector) -> None:
        self._kernel = kernel
        self._settings = settings
        self._plane = plane
        self.run: FilterRun | None = None
        self.layout: Layout
        self.variables: Variables
        self.inquiries: FaultIsolation
        self._earlier: tuple[Event, ...] = ()  # what happened before the target changed last
        self._changed: ChangedTarget | None = None
        self._wrong_twist = ''  # why the twist has been left out
        self._coming: tuple[list[Window], list[Window]] = ([], [])  # windows, and what of them is expected then

    @property
    def changed(self) -> bool:
        """Whether the target has changed since the first run began, or what is taken of the data."""
        return self._changed is not None or bool(self._wrong_twist)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of the present run."""
        return (
            (f'the twist is left out, for it contradicts the poses: {self._wrong_twist}',) if self._wrong_twist else ()
        )

    def taken(self, window: Window) -> Window:
        """Return what of a window is taken into the run."""
        return without_twist(window) if self._wrong_twist else window

    def expected(self, windows: list[Window]) -> list[Window]:
        """Return what of windows is going to be taken: themselves as long as that is all of them."""
        if not self._wrong_twist:
            return windows
        if windows is not self._coming[0]:
            self._coming = windows, [without_twist(window) for window in windows]
        return self._coming[1]

    def past(self, now: MeanAndCovariance | None) -> tuple[Event, ...]:
        """Return what happened in the runs before this one, and why it began.

        Parameters
        ----------
        now : what this one has come to; None where nothing yet
        """
        return self._earlier if self._changed is None else (*self._earlier, self._changed.event(now))

    def present(self, origin: Array) -> FilterRun:
        """Return the run for the next window: another one where motion, target or twist are not as was thought.

        Parameters
        ----------
        origin : (3,) m, of the runs, in the odometry frame
        """
        if self.run is None or self.run.planar != self._plane.planar:
            self.layout = layout_of(self._kernel, self._settings.uncertainty, self._plane)
            self.variables = variables(self.layout, self._plane, self._settings.uncertainty)
            self.run = self._begun()
        elif (change := self.inquiries.change) is not None:
            self.run = self._begun_again(self.run, change, origin)
        elif (wrong := self.inquiries.wrong_twist) and not self._wrong_twist:
            self._wrong_twist = wrong
            self.run = self._begun_over(self.expected(self.inquiries.since(-np.inf)))
        return self.run

    def _begun(self) -> FilterRun:
        """Return a filter that has met nothing yet, and begin to inquire into it."""
        settings, known_mass = self._settings, float(np.sum(self._kernel.known[:, 0]))
        adapt = settings.adapt and settings.located  # what drifts would show in poses
        bank = hypotheses(known_mass, settings.noise.base_position, settings.constant, adapt=adapt)
        self.inquiries = FaultIsolation(
            CandidateCauses(self.layout, self._plane, settings.uncertainty, bank), settings.noise
        )
        return FilterRun(self.layout, self.variables, bank, (settings.start, settings.kept))

    def _begun_again(self, run: FilterRun, change: Change, origin: Array) -> FilterRun:
        """Follow the target as it is since a change: what is known of the robot carries over, and what has stayed."""
        slack = _SETTLING * self._settings.window
        belief = run.belief_before(change.time, slack)
        known = None if belief is None else MeanAndCovariance.of(belief, self.variables)
        met = jumps(run.best, run.moments(), origin) if run.started else ()
        self._earlier = (*self.past(known), *(jump for jump in met if jump.time < change.time - slack))
        text = of_change(change.time, exchanged=change.exchanged)
        self._changed = ChangedTarget(change.time, text, change.exchanged, known)
        if belief is not None:
            after = another_body(belief, self.variables, exchanged=change.exchanged)
            moments = MeanAndCovariance.of(after, self.variables)
            carried = UnknownsPrior(moments.mean[BODY.stop :], moments.factor[BODY.stop :])
            self.layout = replace(self.layout, known=carried)
            self.variables = self.variables.going_on(after.root, moments.mean, exchanged=change.exchanged)
        return self._begun_over(self.inquiries.since(change.time + slack))

    def _begun_over(self, windows: list[Window]) -> FilterRun:
        """Return a filter that has met nothing but some windows."""
        begun = self._begun()
        begun.expect(windows)
        for window in windows:
            begun.take(window, None, moved=True)
        return begun

    def evidence(self, run: FilterRun, sizes: PriorScaleFactors, latest: Samples) -> Evidence:
        """Return what a run that has started says of its model, and of what is declared, after its latest window."""
        track = run.best
        belief, hypothesis = track.belief, track.hypothesis
        # What acts or drifts takes up what would show where the robot is wrong.
        undisturbed = run.moments_of_first().sizes(self.layout) if hypothesis.disturbed else sizes
        beside_prior = sizes if hypothesis.physical else undisturbed
        # A force that is declared has no rival: nothing was followed without it.
        declared = self._settings.constant != 'none'
        instead, explained = ('', 0.0) if declared else undisturbed.likeliest
        return Evidence(
            nis=belief.nis / max(belief.measured, 1),
            innovations=belief.innovations,
            distances={all_of(cause): value for cause, value in beside_prior.distances.items()},
            jumps=len(track.jumps),
            unconfirmed=run.unconfirmed or self.inquiries.open_jumps(run),
            hypothesis=hypothesis.name if hypothesis.disturbed else '',
            physical=hypothesis.physical,
            odometry_drifts=hypothesis.position > 0.0,
            gain=run.lead,
            instead=(all_of(instead), explained),
            latest=latest,
            correlation_time=self._settings.noise.found_in(latest).base_correlation_time,
        )
