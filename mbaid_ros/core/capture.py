"""A run that begins before the capture: the momentum of the robot alone, the jump, the body that came."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.contracts import Unknown
from mbaid_ros.core.difference import BODY, ConsiderParameters, window_rows
from mbaid_ros.core.filter.posterior import Posterior
from mbaid_ros.core.geometry import Array, skew, unvec
from mbaid_ros.core.pipeline import Estimator
from mbaid_ros.core.results.estimate import CapturePhase, Estimate, determined
from mbaid_ros.core.results.verdict import Reason, notes, with_reasons
from mbaid_ros.core.robot.momentum import MomentumKernel, momentum_change
from mbaid_ros.core.samples import FEWEST, Samples, SensorNoise, with_rates
from mbaid_ros.core.target import TargetAtCapture, TargetTrack
from mbaid_ros.parameters import parameter
from mbaid_ros.tasks import Tasks

PHASES = ('post_capture', 'pre_capture')
ENOUGH = 50  # redundant equations, before residual and jumps are judged: variances of fewer are uncertain to a fifth
BEFORE = 'before the capture only the known model is checked; nothing is identified'
MARGIN = 0.5  # s, before and after the capture, in which bodies touch and slip: those windows are not used
_KEPT = 240  # windows before the capture, at most, by which the robot's momentum depends on its errors
NOT_TAKEN = 'the poses of the target do not count: method is not trajectory'
SLIPPED = (
    'at the capture the tracked frame is {:.2g} deg and {:.2g} m from where target.frame has it: the body slips in the '
    'grasp (set capture.settling), or target.frame, joints or poses are wrong'
)
NO_ROBOT = 'the motion of the tracked target does not count: no window of the robot before the capture is usable'
DISTURBED = (
    'the momentum that the captured body had is not published: from {:.1f} s on an external force (see events) changes '
    'the total momentum, and no estimate is from before; repeat the capture without the force'
)
_SLACK = 1e-9  # s, by which times of stamps in nanoseconds may differ as numbers
_REMEMBERED = 200  # estimates, in which an event that is found late has to lie: those before are final
_GOES_ON = 3.0  # s after the body has settled, in which poses that go on show how it is held
_LATE = 1.0  # s by which these may come later than the windows: a replay has them sooner
_APART = 0.03  # rad, m: what joints, mount and camera may miss together, when a given target.frame is compared
_JUMP = 60.0  # chi-square of six numbers, which chance exceeds once in 1e10 windows


@dataclass(frozen=True)
class CaptureConfig:
    """The capture, in data that begin before it."""

    phase: str = parameter('post_capture', choices=PHASES)
    """First phase: post_capture identifies from the first sample on; pre_capture checks the known model until ~/capture
    is called."""
    time: float = parameter(0.0, 's', minimum=0.0)
    """Time of the capture after the first sample, if known beforehand; 0: phase decides."""
    detect: bool = parameter(default=False)
    """Interpret a jump of the momentum as the capture, once pre_capture has lasted five seconds."""
    settling: float = parameter(0.0, 's', minimum=0.0)
    """Time after the capture in which the body may slip in the grasp; of a target tracked before (target_pose), the
    velocity of its centre of mass alone counts then, unless target.frame or poses in the 3 s after it show how it is
    held. Estimates wait for these until 4 s after it."""


@dataclass(frozen=True)
class Chaser:
    """The momentum of the robot alone, by its known model."""

    momentum: Array  # (6,) its (P, L) in the odometry frame, L about its origin, before any known thrust
    covariance: Array  # (6, 6)
    residual: float  # root mean square of the normalised residuals: 1 is momentum as constant as the noise lets it seem
    samples: int  # number used

    @property
    def widened(self) -> Array:
        """The covariance (6, 6) as the residuals show it."""
        return self.covariance * (max(self.residual, 1.0) ** 2 if np.isfinite(self.residual) else 1.0)


class KnownMomentum:
    """The total momentum of a robot whose bodies are all known, updated window by window.

    Parameters
    ----------
    kernel : MomentumKernel, its target with its own inertia
    noise : of the joints; the base's stands in the samples
    kept : windows to keep at most
    """

    def __init__(self, kernel: MomentumKernel, noise: SensorNoise, kept: int = 0) -> None:
        self._kernel = kernel
        self.windows: deque[Samples] = deque(maxlen=kept)  # the last ones
        self._noise = noise
        self._origin: Array | None = None  # near the base: far from it L would be all p x P
        self._momentum: Array = np.zeros(6)
        self._information: Array = np.zeros((6, 6))
        self._cost = 0.0
        self._windows = 0
        self._samples = 0

    def add(self, window: Samples) -> None:
        """Take a window; one too short to take velocities from its positions is left out, even if it has some."""
        if len(window) < FEWEST:
            return
        if self._origin is None:
            self._origin = window.base_position[0].copy()
        transport, measured, covariance = self._measured(window, self._origin)
        innovation = measured - transport @ self._momentum
        self._cost += self._square(innovation, transport, covariance)
        # By innovations, which lose no digits.
        self._information = self._information + transport.T @ np.linalg.solve(covariance, transport)
        gain = transport.T @ np.linalg.solve(covariance, innovation)
        self._momentum = self._momentum + np.linalg.solve(self._information, gain)
        self._windows += 1
        self._samples += len(window)
        self.windows.append(with_rates(window))  # its columns are by velocities, as the momentum is

    def innovation_squared(self, window: Samples) -> float:
        """Return how far a window's momentum is from that of the others: chi-square of six numbers if nothing acts.

        Noise that has turned out larger than the parameters is allowed for.
        """
        if self._origin is None or self.redundancy <= ENOUGH or len(window) < FEWEST:
            return 0.0
        transport, measured, covariance = self._measured(window, self._origin)
        square = self._square(measured - transport @ self._momentum, transport, covariance)
        return square / max(self._cost / self.redundancy, 1.0)

    def columns(self, unknown: Unknown) -> Array:
        """Return how the momentum depends on an unknown's independent numbers, (6, e), by the windows that are kept."""
        considered = ConsiderParameters(self._kernel, (unknown,))
        if self._origin is None or not considered.count or unknown.changes_momentum:
            return np.zeros((6, unknown.count))
        body = self._kernel.target.parameters
        information, right = np.zeros((6, 6)), np.zeros((6, unknown.count))
        every = considered.columns(list(self.windows), body)
        for window, columns in zip(self.windows, every, strict=True):
            transport, _, covariance = self._measured(window, self._origin)
            weighed = np.linalg.solve(covariance, transport).T
            information += weighed @ transport
            right += weighed @ columns
        by_unknown = np.linalg.solve(information, right)
        by_unknown[3:] += skew(self._origin) @ by_unknown[:3]
        return by_unknown

    def _measured(self, window: Samples, origin: Array) -> tuple[Array, Array, Array]:
        """Return T, y and the covariance of y in y = T (P, L), L about an origin."""
        block = window_rows(self._kernel, [with_rates(window)], self._noise, origin)
        transport = -block.rows[0, :, BODY.stop :]
        body = self._kernel.target.parameters
        measured = block.rows[0, :, BODY] @ body + block.offset[0]
        factor = block.noise[0] + block.noise_rows[0] @ np.concatenate((body, np.linalg.solve(transport, measured)))
        return transport, measured, factor @ factor.T

    def _square(self, innovation: Array, transport: Array, covariance: Array) -> float:
        """Return an innovation's square, normalised; zero for the first."""
        if not self._windows:
            return 0.0
        spread = covariance + transport @ np.linalg.solve(self._information, transport.T)
        return float(innovation @ np.linalg.solve(spread, innovation))

    @property
    def redundancy(self) -> int:
        """Number of equations less that of unknowns."""
        return 6 * (self._windows - 1)

    def chaser(self) -> Chaser | None:
        """Return the result, None before the first window."""
        if self._origin is None or not self._windows:
            return None
        shift = np.eye(6)
        shift[3:, :3] = skew(self._origin)  # L = L_0 + origin x P
        covariance = shift @ np.linalg.inv(self._information) @ shift.T
        residual = np.sqrt(self._cost / self.redundancy) if self.redundancy else np.nan
        return Chaser(shift @ self._momentum, covariance, float(residual), self._samples)


@dataclass(frozen=True)
class Capture:
    """A capture, and the motion of the captured body before it."""

    time: float  # s since the first sample
    chaser: Chaser | None  # the robot before it, None where nothing was measured
    momentum: Array  # (6,) of the captured body before it, as in Chaser; NaN where not known
    covariance: Array  # (6, 6)
    velocity: Array  # (3,) m/s, of the captured body's CoM before it, odometry axes; NaN where not known
    spin: Array  # (3,) rad/s, as the velocity
    tracked: TargetAtCapture | None = None  # where the target was tracked before
    misfit: tuple[float, int] = (0.0, 0)  # chi-square of its motion, as of Estimate


class CaptureEstimator:
    """Checks the known model until the capture, and hands later windows to a method.

    Parameters
    ----------
    make : makes the method; anew where the capture turns out to have been announced too early
    noise : of the sensors
    largest_residual : of the known model, from which its momentum does not count as conserved
    detect : take a jump of the momentum that two windows in a row show for the capture
    settling : s, after the capture, in which the body may slip
    track : of the target before the capture
    make_tracked : makes the method for a target that was tracked; None where it does not take any

    Attributes
    ----------
    time : s since the first sample, of the capture; None while there was none
    kernel : of the robot
    """

    def __init__(
        self,
        kernel: MomentumKernel,
        make: Callable[[], Estimator],
        noise: SensorNoise,
        largest_residual: float,
        *,
        detect: bool = False,
        settling: float = 0.0,
        track: TargetTrack | None = None,
        make_tracked: Callable[[TargetAtCapture], Estimator] | None = None,
    ) -> None:
        self._make, self._method = make, make()
        self._make_tracked, self._track, self._settling = make_tracked, track, settling
        self._tracked: TargetAtCapture | None = None
        self._notes: tuple[str, ...] = ()  # about the tracked target
        self._begun = False  # whether a window after the capture has been used
        self._held: list[Samples] = []  # windows after it that wait for poses
        self.method = self._method.method
        self.needs_rates = self._method.needs_rates
        self.time: float | None = None
        self.kernel = kernel
        self._largest_residual = largest_residual
        self._detect = detect
        self._suspect: Samples | None = None  # the first window after a possible capture
        self._known = KnownMomentum(kernel, noise, 0 if track is None else _KEPT)
        self._waiting: deque[Samples] = deque()  # windows that may yet turn out to lie within the margin
        self._latest = -np.inf  # s, end of the last window
        self._estimates: deque[Estimate] = deque(maxlen=_REMEMBERED)
        self._earlier: Estimate | None = None  # the last one before these that no event disturbed
        self._target_pose: tuple[float, Array, Array] | None = None  # s from the capture; R, r of the target link then
        self._at_capture: Samples | None = None  # the sample of that
        self._last: Samples | None = None  # the last sample
        self._last_before: Samples | None = None  # the same before the capture

    @property
    def phase(self) -> CapturePhase:
        """Where the run is."""
        if self.time is None or self._latest < self.time:
            return 'pre_capture'
        return 'post_capture' if self._estimates else 'capture'

    @property
    def tasks(self) -> Tasks:
        """The background work of the method since the capture."""
        return self._method.tasks

    def posterior(self) -> Posterior | None:
        """Return the posterior of the method since the capture."""
        return self._method.posterior()

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Return the estimates of closed windows, of the momentum alone before the capture; origin: ns, at time 0."""
        made: list[Estimate] = []
        later: list[Samples] = []
        for window in windows:
            self._latest = float(window.time[-1])
            self._last = window[-1:]
            if self.time is None or self._latest < self.time - _SLACK:
                made.append(self._pre_capture_estimate(window, origin))
                self._last_before = self._last
                continue
            self._add_known_windows(self.time - MARGIN)
            self._waiting.clear()
            if self._target_pose is None or not self._estimates:
                self._note_target_pose(window, self.time)
            if window.time[0] > self.time + max(MARGIN, self._settling) - _SLACK:
                later.append(self._with_tide_since_capture(window))
        later = [*self._held, *later]
        self._held = later if later and not self._begun and self._waits_for_poses(later) else []
        if self._held:
            later = []
        if later and not self._begun:
            self._begin(later, origin)
        doubts = (*self._notes, *self._doubts())
        for each in self._method.update(later, origin) if later else []:
            self._remember(each)
            made.append(with_reasons(each, notes((*doubts, *self._withheld()))))
        return made

    def restart_at(self, time: float) -> None:
        """Move the capture to a later time (s) and begin the method anew."""
        self.time, self._method, self._target_pose = time, self._make(), None
        self._last_before = self._last
        self._tracked, self._notes, self._begun, self._held = None, (), False, []
        self._estimates.clear()
        self._earlier = None

    def _waits_for_poses(self, later: list[Samples]) -> bool:
        """Return whether poses of the target that go on may yet show how the body is held once it has settled.

        Whether they do is not asked before: of a live run fewer have arrived by then than of a recording.
        """
        if self.time is None or self._settling == 0.0 or not self._track or self._track.frame is not None:
            return False
        return float(later[-1].time[-1]) < self.time + self._settling + _GOES_ON + _LATE

    def _begin(self, later: list[Samples], origin: int) -> None:
        """Begin the method anew where the target was tracked before the capture; origin: ns, at time 0."""
        self._begun = True
        if not self._track or self._at_capture is None or self.time is None:
            return
        if self._make_tracked is None:
            self._notes = (NOT_TAKEN,)
            return
        chaser = self._known.chaser()
        if chaser is None:
            self._notes = (NO_ROBOT,)
            return
        windows, end = list(self._known.windows), self.time - MARGIN
        flight, self._notes = self._track.flight(self.kernel, windows, origin, end, self.time)
        if flight is None:
            return
        frame = self._track.frame
        if frame is None and self._settling > 0.0:
            settled = self.time + self._settling
            # The same windows and poses however they are cut into calls.
            seen = [window for window in later if window.time[0] < settled + _GOES_ON]
            part = settled, min(float(seen[-1].time[-1]), settled + _GOES_ON)
            frame = self._track.frame_in_hand(self.kernel, seen, origin, part, flight.noise)
        self._tracked = TargetAtCapture(
            self.time,
            flight,
            self.kernel,
            self._at_capture,
            chaser.momentum + self._tide_before_capture(),
            np.linalg.cholesky(chaser.widened),
            self._known.columns,
            rigid=self._settling == 0.0,
            frame=frame,
        )
        turned, away = self._tracked.distance_from_robot
        if self._settling == 0.0 and max(turned, away) > _APART:
            self._notes = (*self._notes, SLIPPED.format(np.rad2deg(turned), away))
        self._method = self._make_tracked(self._tracked)

    def _with_tide_since_capture(self, window: Samples) -> Samples:
        """Return a window with the orbit's momentum since the capture only: the captured body was not there before."""
        if self._last_before is None or not window.gravity_columns.shape[1]:
            return window
        return replace(window, gravity_columns=window.gravity_columns - self._last_before.gravity_columns)

    def _tide_before_capture(self) -> Array:
        """Return the orbit's momentum of the robot alone until the capture, (6,)."""
        if self._last_before is None or not self._last_before.gravity_columns.shape[1]:
            return np.zeros(6)
        return momentum_change(self._last_before, self._robot_parameters()) - self._last_before.impulse[-1]

    def _robot_parameters(self) -> Array:
        """Return the (n + 1, 10) standard parameters of the robot alone."""
        return self.kernel.body_parameters(self.kernel.target.parameters)

    def capture(self, body: Array | None) -> Capture | None:
        """Return the capture, None while there was none.

        Parameters
        ----------
        body : (10,) mass, CoM, inertia about it of the captured body in the target link's frame, if known
        """
        if self.phase == 'pre_capture' or self.time is None:
            return None
        chaser, total = self._known.chaser(), self._undisturbed_estimate()
        if chaser is None or total is None:
            nothing: Array = np.full(6, np.nan)
            return Capture(self.time, chaser, nothing, np.full((6, 6), np.nan), nothing[:3], nothing[:3])
        momentum, covariance = _known_part(
            total.momentum - total.impulse - chaser.momentum - self._tide_before_capture(),
            total.momentum_covariance + chaser.widened,
        )
        velocity, spin = self._motion(momentum, body)
        misfit = self._estimates[-1].target_misfit
        return Capture(self.time, chaser, momentum, covariance, velocity, spin, self._tracked, misfit)

    def _pre_capture_estimate(self, window: Samples, origin: int) -> Estimate:
        self._waiting.append(window)
        time = float(window.time[-1])
        if self._detect and self.time is None:
            self._detect_capture(window)
        self._add_known_windows((time if self._suspect is None else float(self._suspect.time[0])) - MARGIN)
        chaser = self._known.chaser()
        estimate = Estimate(
            method=self.method, status='waiting', phase='pre_capture', time=time, stamp=origin + round(time * 1e9)
        )
        if chaser is None:
            return with_reasons(estimate, [Reason(BEFORE)])
        measured = replace(
            estimate,
            momentum=chaser.momentum,
            momentum_covariance=chaser.covariance,
            residual=chaser.residual,
            samples=chaser.samples,
        ).after_thrust(momentum_change(window, self._robot_parameters()))
        return with_reasons(measured, [*(Reason(text, 'conflict') for text in self._doubts()), Reason(BEFORE)])

    def _detect_capture(self, window: Samples) -> None:
        """Detect the capture: the momentum has jumped in this window and in the one before."""
        if self._known.innovation_squared(window) < _JUMP:
            self._suspect = None
        elif self._suspect is None:
            self._suspect = window
        else:
            self.time = float(self._suspect.time[0])
            self._note_target_pose(self._suspect, self.time)

    def _add_known_windows(self, end: float) -> None:
        """Add the windows that end before a time, s, to the momentum of the known model."""
        while self._waiting and self._waiting[0].time[-1] < end - _SLACK:
            window = self._waiting.popleft()
            self._known.add(window)

    def _doubts(self) -> tuple[str, ...]:
        """Return the reasons to distrust the known model."""
        chaser = self._known.chaser()
        if chaser is None or self._known.redundancy <= ENOUGH or not chaser.residual > self._largest_residual:
            return ()
        doubt = (
            f'before the capture the momentum of the known model changes {chaser.residual:.1f} times as much as the '
            'noise parameters explain: the model, the frames or the noise values are wrong, or an external force acts'
        )
        return (doubt,)

    def _remember(self, estimate: Estimate) -> None:
        """Remember an estimate; of those that are forgotten the last one that nothing disturbed."""
        if len(self._estimates) == _REMEMBERED and self._estimates[0].time <= _first_event(self._estimates[-1]):
            self._earlier = self._estimates[0]
        self._estimates.append(estimate)

    def _undisturbed_estimate(self) -> Estimate | None:
        """Return the last estimate whose momentum only the capture has changed; None where a force always acts."""
        if not self._estimates:
            return None
        undisturbed = [each for each in self._estimates if each.time <= _first_event(self._estimates[-1])]
        return undisturbed[-1] if undisturbed else self._earlier

    def _withheld(self) -> tuple[str, ...]:
        """Return why the momentum of the captured body is not published, where what acts from outside is in it."""
        if self._undisturbed_estimate() is not None or not self._estimates:
            return ()
        return (DISTURBED.format(_first_event(self._estimates[-1])),)

    def _note_target_pose(self, window: Samples, time: float) -> None:
        """Note the pose of the target link in the sample nearest to the capture."""
        nearest = int(np.argmin(np.abs(window.time - time)))
        apart = abs(float(window.time[nearest]) - time)
        if self._target_pose is None or apart < self._target_pose[0]:
            state = self.kernel.states(window[nearest : nearest + 1])
            self._target_pose = (apart, state.rotation[0], window.base_position[nearest] + state.position[0])
            self._at_capture = window[nearest : nearest + 1]

    def _motion(self, momentum: Array, body: Array | None) -> tuple[Array, Array]:
        """Return velocity of the CoM and spin of the captured body before the capture; NaN where not known."""
        if body is None or self._target_pose is None:
            return np.full(3, np.nan), np.full(3, np.nan)
        _, rotation, position = self._target_pose
        centre = position + rotation @ body[1:4]
        inertia = rotation @ unvec(body[4:]) @ rotation.T
        about_centre = momentum[3:] - np.cross(centre, momentum[:3])
        return momentum[:3] / body[0], np.linalg.solve(inertia, about_centre)


def _known_part(momentum: Array, covariance: Array) -> tuple[Array, Array]:
    """Return a momentum with its covariance, NaN where a planar motion does not determine it."""
    stds = np.sqrt(np.diag(covariance))
    unknown = ~np.concatenate([determined(momentum[part], stds[part]) for part in (slice(0, 3), slice(3, 6))])
    momentum, covariance = momentum.copy(), covariance.copy()
    momentum[unknown] = covariance[unknown] = covariance[:, unknown] = np.nan
    return momentum, covariance


def _first_event(estimate: Estimate) -> float:
    """Return when the first event of an estimate was, s; infinite without any."""
    return min((event.time for event in estimate.events), default=np.inf)
