"""Settings of method `trajectory`, and a target that changes: another run of the filter begins there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.diagnosis.conventions import ConventionFactory
from mbaid_ros.core.filter.square_root import MeanAndCovariance
from mbaid_ros.core.filter.state import BODY, Declared
from mbaid_ros.core.filter.time_update import Hypothesis
from mbaid_ros.core.results.estimate import Event, changed_by
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.core.trajectory.posterior import Continuation
from mbaid_ros.core.unknowns.declaration import Unknown


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
