"""Method `trajectory`: from windows of samples to estimates."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.results.causes import PULSE, constant_force
from mbaid_ros.core.results.estimate import Estimate, Event, Status
from mbaid_ros.core.results.reporting import Instant, Reporting, Solution
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.trajectory.chain import ANGULAR, BODY, DELAY, FORCE, LINEAR
from mbaid_ros.core.trajectory.coordinates import coordinates
from mbaid_ros.core.trajectory.filter import Walk
from mbaid_ros.core.trajectory.gathering import Gathering, Taken
from mbaid_ros.core.trajectory.tracker import LARGEST_SURPRISE, Tracker
from mbaid_ros.core.trajectory.tracks import Track
from mbaid_ros.core.trajectory.windows import Window

# Random walk of the momentum that stands for a force which is not constant, a kilogram of the known bodies.
_CHANGING_FORCE = 5e-5  # N s / sqrt(s) / kg
_NOTHING = 1e-6  # chance of a force that is none to be told of
# (body, momentum) of the state.
_ORDER = np.concatenate((np.arange(BODY.start, BODY.stop), np.arange(LINEAR.start, ANGULAR.stop)))
_MOST_JUMPS = 3  # from more on the model is wrong rather than the run unlucky


@dataclass(frozen=True)
class TrajectorySettings:
    """Settings of the trajectory-level estimator.

    Attributes
    ----------
    noise : of the joint sensors, and of the base where the samples carry none
    window : s
    start : windows before the first estimate
    kept : windows linearised again while the run is young
    time_offset_std : s, of the joints' stamps before they are estimated; 0 takes them as true
    adapt : also follow the hypotheses that the momentum or the odometry drifts, and take the best
    constant : axes of a constant force and torque that is taken to act
    """

    noise: SensorNoise
    window: float
    start: int
    kept: int
    time_offset_std: float
    adapt: bool
    constant: Literal['none', 'inertial', 'body'] = 'none'


@dataclass(frozen=True)
class _Solved:
    """What a run has led to by an instant.

    `track` is the best hypothesis, `surprise` its mean normalised innovation squared, `delay` value and standard
    deviation of the joints' delay, s.
    """

    solution: Solution
    instant: Instant
    track: Track
    surprise: float
    events: tuple[Event, ...]
    delay: tuple[float, float]


class TrajectoryEstimator:
    """Identifies one link and the total momentum from how the base's pose moves."""

    method = 'trajectory'
    needs_rates = False

    def __init__(self, kernel: MomentumKernel, settings: TrajectorySettings, reporting: Reporting) -> None:
        self._kernel = kernel
        self._settings = settings
        self._reporting = reporting
        self._plane = PlaneDetector(kernel.model)
        self._gathering = Gathering(kernel.model.joints, settings.noise, settings.window)
        self._tracker: Tracker | None = None
        self._samples = 0

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Take closed windows and return one estimate a window.

        Parameters
        ----------
        windows : list of Samples
        origin : ns, stamp at time 0
        """
        taken = self._gathering.take(windows)
        coming = [window for each in taken for window in (each.ready, each.still_open) if window is not None]
        found = [self._follow(window, each, coming, origin) for window, each in zip(windows, taken, strict=True)]
        solved = [one for one in found if isinstance(one, _Solved)]
        estimates = iter(self._reported(solved))
        return [
            (next(estimates) if isinstance(one, _Solved) else one).after_thrust(window.impulse[-1])
            for window, one in zip(windows, found, strict=True)
        ]

    def work_off(self) -> None:
        """Do a part of what is to be done before the next window, if anything."""
        if self._tracker is not None:
            self._tracker.work_off()

    def _follow(self, window: Samples, taken: Taken, coming: list[Window], origin: int) -> _Solved | Estimate:
        """Take a window, and return what the run has led to by then: a solution, or an estimate that says why none."""
        self._plane.update(window)
        self._samples += len(window)
        tracker = self._tracking()
        tracker.expect(coming)
        tracker.take(taken.ready, taken.still_open, moved=taken.moved)
        time = float(window.time[-1])
        instant = Instant(time, origin + round(time * 1e9), self._samples)
        return self._waiting(tracker, taken, instant) or self._solved(tracker, instant)

    def _tracking(self) -> Tracker:
        """Return the filter; a new one where the motion has turned out spatial."""
        if self._tracker is None or self._tracker.planar != self._plane.planar:
            settings, kernel = self._settings, self._kernel
            variables = coordinates(kernel, self._plane, settings.time_offset_std)
            self._tracker = Tracker(
                kernel, variables, kernel.errors.bodies, self._walks(), (settings.start, settings.kept)
            )
        return self._tracker

    def _walks(self) -> tuple[Walk, ...]:
        if self._settings.constant != 'none':
            axes = 'base' if self._settings.constant == 'body' else 'inertial'
            acting = f'a constant force or torque acts, in {axes} axes'
            return (Walk(acting, force=self._settings.constant),)
        still = Walk('nothing drifts')
        if not self._settings.adapt:
            return (still,)
        mass = float(np.sum(self._kernel.known[:, 0]))
        return (
            still,
            Walk('a constant force or torque acts, in inertial axes', force='inertial'),
            Walk('a constant force or torque acts, in base axes', force='body'),
            Walk('the momentum drifts: a changing external force', momentum=_CHANGING_FORCE * mass),
            Walk('the odometry position drifts', position=self._settings.noise.base_position),
        )

    def _waiting(self, tracker: Tracker, taken: Taken, now: Instant) -> Estimate | None:
        """Return an estimate that says why there is no solution; None where there is one."""
        status: Status = 'not_identifiable'
        if not tracker.started and taken.moved:
            status = 'waiting'
            done = 'looking for a start in' if tracker.searching else 'collecting'
            warning = f'{done} the first {self._settings.start} windows'
        elif not tracker.started:
            warning = 'no joint has moved yet: joints at rest tell nothing of one body alone'
        elif not tracker.settled:
            warning = 'the motion so far leads to no solution that stays: more of it is needed'
        else:
            return None
        return Estimate(self.method, status, now.time, now.stamp, samples=now.samples, warnings=(warning,))

    def _solved(self, tracker: Tracker, now: Instant) -> _Solved:
        """Return the solution of the best hypothesis, and what its run says beside it."""
        track, origin = tracker.best, self._gathering.origin
        mean, covariance = tracker.state()
        # More surprise than the noise explains widens the intervals.
        surprise = track.belief.surprise / max(track.belief.measured, 1)
        ordered = covariance[_ORDER[:, None], _ORDER] * max(1.0, surprise)
        solution = Solution(
            x=mean[_ORDER],
            covariance=ordered,
            cautious_covariance=ordered,
            cost=track.belief.surprise,
            redundancy=track.belief.measured,
            origin=origin,
            plane=self._plane.plane(self._kernel.target),
        )
        jumps = events(track, mean[LINEAR.start : ANGULAR.stop], origin)
        delay = (np.nan, np.nan)
        if self._settings.time_offset_std > 0.0:
            delay = float(mean[DELAY]), float(np.sqrt(covariance[DELAY, DELAY]))
        return _Solved(
            solution, now, track, surprise, (*_force(track, mean[FORCE], covariance[FORCE, FORCE]), *jumps), delay
        )

    def _reported(self, solved: list[_Solved]) -> list[Estimate]:
        """Return the estimates of solutions."""
        if not solved:
            return []
        estimates = self._reporting.estimates(
            self.method, [one.solution for one in solved], [one.instant for one in solved]
        )
        return [_judged(estimate, one) for estimate, one in zip(estimates, solved, strict=True)]


def _judged(estimate: Estimate, solved: _Solved) -> Estimate:
    """Return the estimate with what its run says against it."""
    track, surprise = solved.track, solved.surprise
    warnings = list(estimate.warnings)
    if track.walk.disturbed:
        warnings.append(f'{track.walk.name}; estimated along, which widens the intervals')
    wrong = surprise > LARGEST_SURPRISE or len(track.jumps) > _MOST_JUMPS
    if wrong:
        warnings.append(
            f'the model does not explain the data: innovations {np.sqrt(surprise):.1f} times the noise, '
            f'{len(track.jumps)} jumps of the momentum'
        )
    return replace(
        estimate,
        status='inconsistent' if wrong and estimate.status != 'not_identifiable' else estimate.status,
        events=solved.events,
        warnings=tuple(warnings),
        time_offset=solved.delay[0],
        time_offset_std=solved.delay[1],
    )


def _force(track: Track, value: Array, covariance: Array) -> tuple[Event, ...]:
    """Return the constant force and torque (6,), if there is one and it is not nothing."""
    if track.walk.force == 'none' or value @ np.linalg.solve(covariance, value) < chi_square.limit(
        _NOTHING, len(value)
    ):
        return ()
    return (Event(0.0, 'ramp', value[:3], value[3:], constant_force(track.walk.force)),)


def events(track: Track, momentum: Array, origin: Array) -> tuple[Event, ...]:
    """Return the jumps of the momentum, each as the difference of what is known now of it before and after.

    Parameters
    ----------
    track : Track
    momentum : (6,) (P, L) at present, about the run's origin
    origin : (3,) m, of the run, in the odometry frame
    """
    levels = [*(jump.before for jump in track.jumps), momentum]
    found = []
    for jump, after in zip(track.jumps, levels[1:], strict=True):
        linear = after[:3] - jump.before[:3]
        angular = after[3:] - jump.before[3:] + cross(origin, linear)
        found.append(Event(jump.time, 'step', linear, angular, PULSE))
    return tuple(found)
