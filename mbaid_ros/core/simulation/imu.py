"""An IMU on the base: its gyro reads the true angular velocity with noise, a bias that walks, and scales of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array


@dataclass(frozen=True)
class ImuErrors:
    """What an IMU reads wrong.

    Attributes
    ----------
    noise_density : rad/s/sqrt(Hz)
    bias : (3,) rad/s at the begin
    bias_walk : rad/s/sqrt(s)
    scale : (3,) by what part each axis reads too much
    """

    noise_density: float = 0.0
    bias: tuple[float, ...] = (0.0, 0.0, 0.0)
    bias_walk: float = 0.0
    scale: tuple[float, ...] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class ImuReadings:
    """N readings, in base axes.

    Attributes
    ----------
    time : (N,) s since the start of the run
    angular_velocity : (N, 3) rad/s
    """

    time: Array
    angular_velocity: Array


class Imu:
    """A gyro with seeded errors; they do not depend on how the readings are cut into batches.

    Parameters
    ----------
    rate : Hz
    errors : ImuErrors
    seed : the same seed gives the same noise
    """

    def __init__(self, rate: float, errors: ImuErrors, seed: int) -> None:
        self.rate = rate
        self._errors = errors
        noise, walk = np.random.SeedSequence(seed).spawn(2)
        self._noise, self._walk = np.random.default_rng(noise), np.random.default_rng(walk)
        self._bias: Array = np.array(errors.bias, dtype=float)

    def readings(self, time: Array, angular_velocity: Array) -> ImuReadings:
        """Return what it reads of a true angular velocity (N, 3), base axes, at the next N of its instants."""
        errors, shape = self._errors, angular_velocity.shape
        steps = errors.bias_walk / np.sqrt(self.rate) * self._walk.standard_normal(shape)
        bias = np.cumsum(np.concatenate((self._bias[None], steps)), axis=0)
        self._bias = bias[-1]
        noise = errors.noise_density * np.sqrt(self.rate) * self._noise.standard_normal(shape)
        return ImuReadings(time, (1.0 + np.array(errors.scale)) * angular_velocity + bias[:-1] + noise)
