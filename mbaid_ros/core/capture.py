"""The capture: before it the known model is put to the test, after it the captured body is identified.

Before the capture every body is known, the target link from its own <inertial>: each window of samples measures the
total momentum, which has to stay what it is. After it the method of identification finds the total momentum of robot
and captured body together. The difference is what the captured body brought along.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mbaid_ros.core.difference.window_rows import BODY, UNKNOWNS, window_rows
from mbaid_ros.core.geometry import Array, skew, unvec
from mbaid_ros.core.identifier import Estimator
from mbaid_ros.core.intake.rates import FEWEST, with_rates
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.samples import Samples, SensorNoise

Phase = Literal['pre_capture', 'capture', 'post_capture']

BEFORE = 'before the capture: the known model alone is checked, nothing is identified'
_SLACK = 1e-9  # s
_REMEMBERED = 200  # estimates, in which an event that is found late has to lie
_ENOUGH = 50  # redundant equations, before the residual is judged


@dataclass(frozen=True)
class Chaser:
    """What the known model says of the robot alone.

    Attributes
    ----------
    momentum, covariance : (6,), (6, 6) its (P, L) in the odometry frame, L about its origin
    residual : root mean square of the normalised residuals: 1 is momentum as constant as the noise lets it seem
    samples : number used
    """

    momentum: Array
    covariance: Array
    residual: float
    samples: int


@dataclass(frozen=True)
class Capture:
    """A capture and what it tells of the body that was captured.

    Attributes
    ----------
    time : s since the first sample
    chaser : the robot before it, None where nothing was measured
    momentum, covariance : (6,), (6, 6) of the captured body before it, as in Chaser; NaN where not known
    velocity, spin : (3,) m/s, rad/s of that body before it, its CoM's and its own, odometry axes; NaN where not known
    """

    time: float
    chaser: Chaser | None
    momentum: Array
    covariance: Array
    velocity: Array
    spin: Array


class KnownMomentum:
    """The total momentum of a robot of which every body is known, from window after window.

    Parameters
    ----------
    kernel : MomentumKernel, its target with its own inertia
    noise : of the joints; the base's stands in the samples
    """

    def __init__(self, kernel: MomentumKernel, noise: SensorNoise) -> None:
        self._kernel = kernel
        self._noise = noise
        self._origin: Array | None = None  # near the base: far from it L would be all p x P
        self._momentum: Array = np.zeros(6)
        self._information: Array = np.zeros((6, 6))
        self._cost = 0.0
        self._windows = 0
        self._samples = 0

    def add(self, window: Samples) -> None:
        """Take a window; one that lacks velocities and is too short to take them from the positions is left out."""
        if len(window) < FEWEST:
            return
        if self._origin is None:
            self._origin = window.base_position[0].copy()
        block = window_rows(self._kernel, [with_rates(window)], self._noise, self._origin)
        transport = -block.rows[0, :, BODY.stop :]
        body = self._kernel.target.parameters
        measured = block.rows[0, :, BODY] @ body + block.offset[0]
        own = np.linalg.solve(transport, measured)
        unknowns = np.concatenate((body, own))[:UNKNOWNS]
        factor = block.noise[0] + block.noise_rows[0] @ unknowns
        covariance = factor @ factor.T
        self._update(transport, measured, covariance)
        self._samples += len(window)

    def _update(self, transport: Array, measured: Array, covariance: Array) -> None:
        """Take measured = transport (P, L) with a covariance; by innovations, which lose no digits."""
        innovation = measured - transport @ self._momentum
        if self._windows:
            spread = covariance + transport @ np.linalg.solve(self._information, transport.T)
            self._cost += float(innovation @ np.linalg.solve(spread, innovation))
        self._information = self._information + transport.T @ np.linalg.solve(covariance, transport)
        gain = transport.T @ np.linalg.solve(covariance, innovation)
        self._momentum = self._momentum + np.linalg.solve(self._information, gain)
        self._windows += 1

    @property
    def redundancy(self) -> int:
        """Number of equations less that of unknowns."""
        return 6 * (self._windows - 1)

    def chaser(self) -> Chaser | None:
        """Return what has been found, None before the first window."""
        if self._origin is None or not self._windows:
            return None
        shift = np.eye(6)
        shift[3:, :3] = skew(self._origin)  # L = L_0 + origin x P
        covariance = shift @ np.linalg.inv(self._information) @ shift.T
        residual = np.sqrt(self._cost / self.redundancy) if self.redundancy else np.nan
        return Chaser(shift @ self._momentum, covariance, float(residual), self._samples)


class CaptureEstimator:
    """Checks the known model until the capture, and hands what comes after it to a method.

    Parameters
    ----------
    kernel : MomentumKernel
    after : the method
    noise : of the sensors
    margin : s, before and after the capture, that is used for neither
    largest_residual : of the known model, from which its momentum does not count as conserved

    Attributes
    ----------
    time : s since the first sample, of the capture; None while there was none
    """

    def __init__(
        self, kernel: MomentumKernel, after: Estimator, noise: SensorNoise, margin: float, largest_residual: float
    ) -> None:
        self.method = after.method
        self.needs_rates = after.needs_rates
        self.time: float | None = None
        self._kernel = kernel
        self._after = after
        self._margin = margin
        self._largest_residual = largest_residual
        self._known = KnownMomentum(kernel, noise)
        self._waiting: deque[Samples] = deque()  # windows that may yet turn out to lie within the margin
        self._latest = -np.inf  # s, end of the last window
        self._found: deque[Estimate] = deque(maxlen=_REMEMBERED)
        self._place: tuple[float, Array, Array] | None = None  # s from the capture; R, r of the target link then

    @property
    def phase(self) -> Phase:
        """Where the run is."""
        if self.time is None or self._latest < self.time:
            return 'pre_capture'
        return 'post_capture' if self._found else 'capture'

    def update(self, windows: list[Samples], origin: int) -> list[Estimate]:
        """Take closed windows and return the estimates they lead to: of the momentum alone, before the capture.

        Parameters
        ----------
        windows : list of Samples
        origin : ns, stamp at time 0
        """
        made: list[Estimate] = []
        later: list[Samples] = []
        for window in windows:
            self._latest = float(window.time[-1])
            if self.time is None or self._latest < self.time - _SLACK:
                made.append(self._before(window, origin))
                continue
            self._use(self.time - self._margin)
            self._waiting.clear()
            if self._place is None or not self._found:
                self._look(window, self.time)
            if window.time[0] > self.time + self._margin - _SLACK:
                later.append(window)
        found = self._after.update(later, origin) if later else []
        self._found.extend(found)
        return [*made, *map(self._with_doubts, found)]

    def capture(self, body: Array | None) -> Capture | None:
        """Return what the capture tells, None while there was none.

        Parameters
        ----------
        body : (10,) mass, CoM, inertia about it of the captured body in the target link's frame, if known
        """
        if self.phase == 'pre_capture' or self.time is None:
            return None
        chaser, total = self._known.chaser(), self._total()
        if chaser is None or total is None:
            nothing: Array = np.full(6, np.nan)
            return Capture(self.time, chaser, nothing, np.full((6, 6), np.nan), nothing[:3], nothing[:3])
        momentum = total.momentum - chaser.momentum
        covariance = total.momentum_covariance + chaser.covariance
        velocity, spin = self._motion(momentum, body)
        return Capture(self.time, chaser, momentum, covariance, velocity, spin)

    def _before(self, window: Samples, origin: int) -> Estimate:
        self._waiting.append(window)
        time = float(window.time[-1])
        self._use(time - self._margin)
        chaser = self._known.chaser()
        estimate = Estimate(
            method=self.method,
            status='waiting',
            time=time,
            stamp=origin + round(time * 1e9),
            warnings=(BEFORE,),
        )
        if chaser is None:
            return estimate
        doubts = self._doubts()
        return replace(
            estimate,
            status='inconsistent' if doubts else 'waiting',
            momentum=chaser.momentum,
            momentum_covariance=chaser.covariance,
            residual=chaser.residual,
            samples=chaser.samples,
            warnings=(*doubts, BEFORE),
        )

    def _use(self, end: float) -> None:
        """Let the known model have the windows that end before a time, s."""
        while self._waiting and self._waiting[0].time[-1] < end - _SLACK:
            self._known.add(self._waiting.popleft())

    def _doubts(self) -> tuple[str, ...]:
        """Return why the known model is not to be trusted."""
        chaser = self._known.chaser()
        if chaser is None or self._known.redundancy <= _ENOUGH or not chaser.residual > self._largest_residual:
            return ()
        doubt = (
            f'before the capture the momentum of the known model changes {chaser.residual:.1f} times as much as the '
            'noise parameters explain: the model, the frames or the noise values are wrong, or something pushes'
        )
        return (doubt,)

    def _with_doubts(self, estimate: Estimate) -> Estimate:
        doubts = self._doubts()
        return replace(estimate, warnings=(*estimate.warnings, *doubts)) if doubts else estimate

    def _total(self) -> Estimate | None:
        """Return the last estimate whose momentum nothing but the capture has changed."""
        if not self._found:
            return None
        times = [event.time for event in self._found[-1].events]
        undisturbed = [estimate for estimate in self._found if not times or estimate.time <= min(times)]
        return undisturbed[-1] if undisturbed else self._found[0]

    def _look(self, window: Samples, time: float) -> None:
        """Remember where the target link is in the sample nearest to the capture."""
        nearest = int(np.argmin(np.abs(window.time - time)))
        apart = abs(float(window.time[nearest]) - time)
        if self._place is None or apart < self._place[0]:
            state = self._kernel.states(window[nearest : nearest + 1])
            self._place = (apart, state.rotation[0], window.base_position[nearest] + state.position[0])

    def _motion(self, momentum: Array, body: Array | None) -> tuple[Array, Array]:
        """Return velocity of the CoM and spin of the captured body before the capture; NaN where not known."""
        if body is None or self._place is None:
            return np.full(3, np.nan), np.full(3, np.nan)
        _, rotation, position = self._place
        centre = position + rotation @ body[1:4]
        inertia = rotation @ unvec(body[4:]) @ rotation.T
        about_centre = momentum[3:] - np.cross(centre, momentum[:3])
        return momentum[:3] / body[0], np.linalg.solve(inertia, about_centre)
