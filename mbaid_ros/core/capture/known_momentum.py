"""The total momentum of a robot whose bodies are all known, and its constancy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.difference.window_rows import BODY, window_rows
from mbaid_ros.core.geometry import Array, skew
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.sensors.rates import FEWEST, with_rates

ENOUGH = 50  # redundant equations, before residual and jumps are judged: variances of fewer are uncertain to a fifth


@dataclass(frozen=True)
class Chaser:
    """The momentum of the robot alone, by its known model."""

    momentum: Array  # (6,) its (P, L) in the odometry frame, L about its origin, before any known thrust
    covariance: Array  # (6, 6)
    residual: float  # root mean square of the normalised residuals: 1 is momentum as constant as the noise lets it seem
    samples: int  # number used


class KnownMomentum:
    """The total momentum of a robot whose bodies are all known, updated window by window.

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

    def innovation_squared(self, window: Samples) -> float:
        """Return how far a window's momentum is from that of the others: chi-square of six numbers if nothing acts.

        Noise that has turned out larger than the parameters is allowed for.
        """
        if self._origin is None or self.redundancy <= ENOUGH or len(window) < FEWEST:
            return 0.0
        transport, measured, covariance = self._measured(window, self._origin)
        square = self._square(measured - transport @ self._momentum, transport, covariance)
        return square / max(self._cost / self.redundancy, 1.0)

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
