"""Method `trajectory`: from windows of samples to estimates."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mbaid_ros.core import chi_square
from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.results.causes import PULSE, constant_force
from mbaid_ros.core.results.estimate import Estimate, Event
from mbaid_ros.core.results.reporting import Reporting, Solution
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.trajectory.chain import ANGULAR, BODY, DELAY, FORCE, LINEAR
from mbaid_ros.core.trajectory.coordinates import coordinates
from mbaid_ros.core.trajectory.filter import Walk
from mbaid_ros.core.trajectory.nodes import AFTER, BEFORE, Nodes, averages, bridged
from mbaid_ros.core.trajectory.tracker import LARGEST_SURPRISE, Tracker
from mbaid_ros.core.trajectory.tracks import Track
from mbaid_ros.core.trajectory.windows import Window, WindowNoise

_NODE = 0.05  # s, wanted spacing of nodes
_FEWEST_NODES = 5
# A joint has moved when its range is this many standard deviations of one sample; noise alone reaches about five.
_MOVED = 10.0
# Random walk of the momentum that stands for a force which is not constant, a kilogram of the known bodies.
_CHANGING_FORCE = 5e-5  # N s / sqrt(s) / kg
_NOTHING = 1e-6  # chance of a force that is none to be told of
# From (linear, angular) to (angular, linear), and (body, momentum) of the state.
_SWAP = np.array([3, 4, 5, 0, 1, 2])
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
class _Taken:
    """What a window adds: the one before with all its neighbours, itself without the later ones, if they are linked.

    `moved` tells whether a joint has moved by more than its noise by then, `origin` is the run's.
    """

    ready: Window | None
    still_open: Window | None
    moved: bool
    origin: Array


class TrajectoryEstimator:
    """Identifies one link and the total momentum from how the base's pose moves."""

    method = 'trajectory'
    needs_rates = False

    def __init__(self, kernel: MomentumKernel, settings: TrajectorySettings, reporting: Reporting) -> None:
        self._kernel = kernel
        self._settings = settings
        self._reporting = reporting
        self._plane = PlaneDetector(kernel.model)
        self._origin: Array | None = None
        self._nodes_a_window = 0
        self._tracker: Tracker | None = None
        self._number = -1
        self._sequence: list[Nodes] = []  # nodes of up to three consecutive windows
        self._noise: WindowNoise | None = None  # of the last of them
        self._lowest = np.full(kernel.model.joints, np.inf)
        self._highest = np.full(kernel.model.joints, -np.inf)
        self._samples = 0

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Take closed windows and return one estimate a window.

        Parameters
        ----------
        windows : list of Samples
        origin : ns, stamp at time 0
        """
        if self._origin is None:
            self._origin = windows[0].base_position[0].copy()
            self._nodes_a_window = nodes_a_window(windows[0], self._settings.window)
        taken = self._take(windows, self._origin)
        coming = [window for each in taken for window in (each.ready, each.still_open) if window is not None]
        return [self._estimates(window, each, coming, origin) for window, each in zip(windows, taken, strict=True)]

    def work_off(self) -> None:
        """Do a part of what is to be done before the next window, if anything."""
        if self._tracker is not None:
            self._tracker.work_off()

    def _take(self, windows: list[Samples], origin: Array) -> list[_Taken]:
        """Return what windows add to the chain; what is said of each has to wait for its turn."""
        length, count = self._settings.window, self._nodes_a_window
        numbers = [int(np.floor((window.time[0] + 1e-9) / length)) for window in windows]
        nodes = averages(windows, np.array(numbers) * length, length / count, count, origin)
        taken = []
        for number, window, own in zip(numbers, windows, nodes, strict=True):
            ready, still_open = self._collect(number, own, window_noise(window, self._settings.noise))
            moved = bool(np.any(self._highest - self._lowest > _MOVED * self._settings.noise.joint_position))
            taken.append(_Taken(ready, still_open, moved, origin))
        return taken

    def _estimates(self, window: Samples, taken: _Taken, coming: list[Window], origin: int) -> Estimate:
        self._plane.update(window)
        self._samples += len(window)
        tracker = self._tracking()
        tracker.expect(coming)
        tracker.take(taken.ready, taken.still_open, moved=taken.moved)
        time = float(window.time[-1])
        estimate = self._estimate(tracker, taken, time, origin + round(time * 1e9))
        return estimate.after_thrust(window.impulse[-1])

    def _collect(self, number: int, nodes: Nodes | None, noise_now: WindowNoise) -> tuple[Window | None, Window | None]:
        """Take a window's nodes; return the window before, which has all its neighbours now, and the window itself."""
        linked = nodes is not None and bool(self._sequence) and number == self._number + 1
        if nodes is None or not linked or (self._sequence[-1].empty[-1] and nodes.empty[0]):
            self._sequence = []  # a gap: what comes next is linked to the past by momentum and body alone
        self._number = number
        if nodes is None or (nodes.empty[0] and not self._sequence):
            return None, None
        self._lowest = np.minimum(self._lowest, np.nanmin(nodes.joint_position, axis=0))
        self._highest = np.maximum(self._highest, np.nanmax(nodes.joint_position, axis=0))
        self._sequence = [*self._sequence[-2:], nodes]
        noise, self._noise = self._noise, noise_now
        ready = None
        if len(self._sequence) > 1 and noise is not None:
            ready = self._linked(self._sequence[:-2], self._sequence[-2], nodes[:AFTER], noise)
        still_open = None if nodes.empty[-1] else self._linked(self._sequence[:-1], nodes, nodes[:0], self._noise)
        return ready, still_open

    def _linked(self, earlier: list[Nodes], nodes: Nodes, after: Nodes, noise: WindowNoise) -> Window:
        """Return a window with the neighbours it has; the last interval of one without a successor is missing."""
        before = earlier[-1][-BEFORE:] if earlier else nodes[:0]
        number = self._number - 1 if len(after) else self._number
        # An empty node is bridged from both sides: at the outer ends it is none of the neighbours.
        before = before[1:] if len(before) and before.empty[0] else before
        after = after[:-1] if len(after) and after.empty[-1] else after
        return Window(
            nodes=bridged(Nodes.concatenate([before, nodes, after])),
            inside=slice(len(before), len(before) + len(nodes) - (0 if len(after) else 1)),
            spacing=self._settings.window / self._nodes_a_window,
            noise=noise,
            start=number * self._settings.window,
            fresh=not earlier,
        )

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

    def _estimate(self, tracker: Tracker, taken: _Taken, time: float, stamp: int) -> Estimate:
        if not tracker.started and taken.moved:
            done = 'looking for a start in' if tracker.searching else 'collecting'
            warning = f'{done} the first {self._settings.start} windows'
            return Estimate(self.method, 'waiting', time, stamp, samples=self._samples, warnings=(warning,))
        if not tracker.started:
            warning = 'no joint has moved yet: joints at rest tell nothing of one body alone'
            return Estimate(self.method, 'not_identifiable', time, stamp, samples=self._samples, warnings=(warning,))
        if not tracker.settled:
            warning = 'the motion so far leads to no solution that stays: more of it is needed'
            return Estimate(self.method, 'not_identifiable', time, stamp, samples=self._samples, warnings=(warning,))
        track = tracker.best
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
            origin=taken.origin,
            plane=self._plane.plane(self._kernel.target),
        )
        estimate = self._reporting.estimate(self.method, solution, time=time, stamp=stamp, samples=self._samples)
        jumps = events(track, mean[LINEAR.start : ANGULAR.stop], taken.origin)
        estimate = replace(estimate, events=(*_force(track, mean[FORCE], covariance[FORCE, FORCE]), *jumps))
        if self._settings.time_offset_std > 0.0:
            deviation = float(np.sqrt(covariance[DELAY, DELAY]))
            estimate = replace(estimate, time_offset=float(mean[DELAY]), time_offset_std=deviation)
        return _judged(estimate, track, surprise)


def _judged(estimate: Estimate, track: Track, surprise: float) -> Estimate:
    """Return the estimate with what its run says against it."""
    warnings = list(estimate.warnings)
    if track.walk.disturbed:
        warnings.append(f'{track.walk.name}; estimated along, which widens the intervals')
    wrong = surprise > LARGEST_SURPRISE or len(track.jumps) > _MOST_JUMPS
    if wrong:
        warnings.append(
            f'the model does not explain the data: innovations {np.sqrt(surprise):.1f} times the noise, '
            f'{len(track.jumps)} jumps of the momentum'
        )
    status = 'inconsistent' if wrong and estimate.status != 'not_identifiable' else estimate.status
    return replace(estimate, status=status, warnings=tuple(warnings))


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


def nodes_a_window(window: Samples, length: float) -> int:
    """Return how many nodes a window is cut into: near 50 ms each, and no fewer samples than nodes.

    Parameters
    ----------
    window : the first one
    length : s
    """
    spacing = float(np.median(np.diff(window.time))) if len(window) > 1 else length
    return max(round(length / max(_NODE, spacing)), _FEWEST_NODES)


def window_noise(window: Samples, noise: SensorNoise) -> WindowNoise:
    """Return the noise of a window's means; a twist's covariance as given, whether or not it is measured."""
    return WindowNoise(
        samples=len(window),
        joint_position=noise.joint_position,
        pose=np.mean(window.pose_covariance, axis=0)[_SWAP[:, None], _SWAP],
        twist=np.mean(window.twist_covariance, axis=0)[_SWAP[:, None], _SWAP],
    )
