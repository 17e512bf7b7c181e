"""From two streams of measurements to estimates, live or recorded: synchronise, cut into windows, identify."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.status import Reason, notes, with_reasons
from mbaid_ros.core.samples import BaseStream, ImuStream, JointStream, Samples
from mbaid_ros.core.sensors.gyro import Gyro
from mbaid_ros.core.sensors.levels import NoiseEstimator, SensorLevels
from mbaid_ros.core.sensors.rates import FEWEST, with_rates
from mbaid_ros.core.sensors.streams import Windows
from mbaid_ros.core.sensors.synchroniser import Synchroniser
from mbaid_ros.core.tasks import Tasks
from mbaid_ros.core.trajectory.posterior import Posterior
from mbaid_ros.core.window_checks import WindowChecks

RATE_MISSING = 'velocity missing, and too few positions to derive it'

JOINT_RATES_DERIVED = (
    'JointState without velocities: derived from the positions of each window, with the resulting noise; method '
    'trajectory does not need them'
)
TWIST_DERIVED = (
    'no twist of the base: derived from the poses of each window, with the resulting noise; method trajectory does '
    'not need it'
)
POSES_ALONE = 'no twist of the base: the poses alone are used'
GYRO_ALONE = 'nothing locates the base: the angular velocity of the IMU alone is used, about the common centre of mass'
ORIENTATION_AND_GYRO = (
    'nothing locates the base: orientation and angular velocity of the IMU are used, about the common centre of mass'
)
POSES_AND_GYRO = 'no twist of the base: the poses and the angular velocity of the IMU are used'
WITHOUT_GYRO = 'the angular velocity of the IMU is not used: method trajectory uses it'


class Estimator(Protocol):
    """A method of identification."""

    method: str
    needs_rates: bool  # whether it works with measured velocities, of the joints and of the base

    @property
    def tasks(self) -> Tasks:
        """Its background work, of which the next `update` completes what it needs; when it runs changes no numbers."""

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Take closed windows, in order, and return the estimates they lead to; origin: ns, stamp at time 0."""

    def posterior(self) -> Posterior | None:
        """Return the posterior, from which a motion is planned; None where the method has none, or not yet."""


class Force(Protocol):
    """A known change of the momentum: commanded thrust, the gravity gradient of an orbit."""

    def with_momentum(self, window: Samples, origin: int) -> Samples:
        """Return the next window with the change until each of its samples; `origin` is the stamp at time 0, ns."""


class Identifier:
    """One identification, from its first measurement on.

    The estimates do not depend on the partition of the measurements into calls: the live node hands over a few at a
    time, a replay thousands, and both get the same numbers.

    Parameters
    ----------
    estimator : the method
    window : s, length of a window
    maximum_gap : s, longest odometry interval that is interpolated
    checks : of windows before they are identified; None makes those of the twist alone
    forces : known changes of the momentum, in the order in which they are added to windows
    noise : follows how noisy the sensors are; None takes it as declared
    view : from odometry to the frame in which it is used; None: as it is
    gyro : integrates the IMU's angular velocity; None where there is none
    """

    def __init__(
        self,
        estimator: Estimator,
        window: float,
        maximum_gap: float,
        checks: WindowChecks | None = None,
        forces: Sequence[Force] = (),
        noise: NoiseEstimator | None = None,
        *,
        view: Callable[[BaseStream], BaseStream] | None = None,
        gyro: Gyro | None = None,
    ) -> None:
        self.estimator = estimator
        self.synchroniser = Synchroniser(maximum_gap, view, gyro, noise)
        self._windows = Windows(window)
        self._noise = noise
        self._levels: dict[float, SensorLevels] = {}  # by the end of the latest windows, s
        self._checks = checks or WindowChecks()
        self._forces = forces
        self._window = window
        self._notes: dict[str, float] = {}  # notes on the data for the user, and since when (s)
        self.used = 0
        self.end_of_window: int | None = None  # ns, stamp that closes the window that is open
        self._dropped: Counter[str] = Counter()

    def add_note(self, text: str) -> None:
        """Add a warning to every estimate."""
        self._notes[text] = -np.inf

    @property
    def origin(self) -> int:
        """Stamp of the first sample, ns: time 0 of every estimate."""
        return self.synchroniser.origin

    @property
    def dropped(self) -> Counter[str]:
        """Measurements that were not used, by cause."""
        return self._dropped + self.synchroniser.dropped

    def push(self, joints: JointStream | None, base: BaseStream | None, imu: ImuStream | None = None) -> list[Estimate]:
        """Take measurements of any kind and return the estimates of the windows they close."""
        samples = self.synchroniser.push(joints, base, imu)
        if samples is None:
            return []
        self.used += len(samples)
        number = np.floor((samples.time[-1] + 1e-9) / self._window) + 1.0
        self.end_of_window = self.synchroniser.origin + round(number * self._window * 1e9)
        return self._estimates(self._windows.push(samples))

    def finish(self) -> list[Estimate]:
        """Return the estimates of windows that wait for the noise of more, where no more come."""
        return self._estimates([], last=True)

    def _estimates(self, windows: list[Samples], *, last: bool = False) -> list[Estimate]:
        closed = self._prepared(windows, last=last)
        if not closed:
            return []
        estimates = self.estimator.update(closed, self.synchroniser.origin)
        if self._levels:
            estimates = [replace(each, noise=self._levels.get(each.time)) for each in estimates]
        return [with_reasons(each, self._reasons(each.time)) for each in estimates]

    def _prepared(self, windows: list[Samples], *, last: bool) -> list[Samples]:
        """Return closed windows with the velocities their method needs, without those that cannot have them."""
        for force in self._forces:
            windows = [force.with_momentum(window, self.origin) for window in windows]
        if self._noise is not None:
            each = self._noise.windows_with_noise(windows, self.origin, last=last)
            windows = [window for window, _ in each]
            self._levels = {float(window.time[-1]): levels for window, levels in each}
        windows = self._checks.with_valid_rates(windows)
        return [window for window in map(self._with_rates, windows) if window is not None]

    def _with_rates(self, window: Samples) -> Samples | None:
        """Return a window with the velocities its method needs, None if it cannot have them; note the source."""
        start = float(window.time[0])
        joints, base = window.missing_rates
        if not self.estimator.needs_rates:
            if base:
                self._notes.setdefault(_measured(window), start)
            return window
        if window.gyro.shape[1]:
            self._notes.setdefault(WITHOUT_GYRO, start)
        if (joints or base) and len(window) < FEWEST:
            self._dropped[RATE_MISSING] += len(window)
            self.used -= len(window)
            return None
        if joints:
            self._notes.setdefault(JOINT_RATES_DERIVED, start)
        if base:
            self._notes.setdefault(TWIST_DERIVED, start)
        return with_rates(window)

    def _reasons(self, time: float) -> list[Reason]:
        """Return the notes on the data up to the end of a window, s: none of later windows in the same call."""
        levels = self._levels.get(time)
        texts = [] if levels is None else levels.warnings
        reasons = notes([*texts, *(text for text, since in self._notes.items() if since <= time)])
        return [*reasons, *self._checks.reasons(time)]


def _measured(window: Samples) -> str:
    """Return the sensors that measure the base's motion in a window without its twist."""
    located, oriented = np.isfinite(np.diagonal(window.pose_covariance[0])[[0, 3]]).tolist()
    if not located:
        return ORIENTATION_AND_GYRO if oriented else GYRO_ALONE
    return POSES_AND_GYRO if window.gyro.shape[1] and bool(np.isfinite(window.gyro).all()) else POSES_ALONE
