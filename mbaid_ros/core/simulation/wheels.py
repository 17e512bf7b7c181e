"""Reaction wheels inside the base that are no joints of the robot: motors turn them, and the base the other way."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.simulation.effects import BodyPoses

_TERMS = 3  # sinusoids of a wheel that wanders
_PERIODS = (8.0, 40.0)  # s


@dataclass(frozen=True, eq=False)
class Wheels:
    """w wheels whose speeds relative to the base are s(t) = start + slope t + sum_k a_k (sin(r_k t + p_k) - sin(p_k)).

    Attributes
    ----------
    names : of each
    axes : (w, 3) unit vectors in the base's axes
    spin_inertias : (w,) kg m^2
    start, slope : (w,) rad/s, rad/s^2
    amplitude, rate, phase : (w, K) rad/s, rad/s, rad
    """

    names: tuple[str, ...]
    axes: Array
    spin_inertias: Array
    start: Array
    slope: Array
    amplitude: Array
    rate: Array
    phase: Array

    @staticmethod
    def drawn(
        names: tuple[str, ...],
        axes: Array,
        spin_inertias: Array,
        speeds: tuple[Array, Array],
        wander: tuple[float, int],
    ) -> Wheels:
        """Return wheels that are held, or ramped, and wander beside.

        Parameters
        ----------
        names, axes, spin_inertias : as of the class
        speeds : start and slope
        wander : rad/s, largest departure from that, and a seed
        """
        amplitude, seed = wander
        rng = np.random.default_rng(seed)
        shape = (len(names), _TERMS)
        rate = 2.0 * np.pi / rng.uniform(*_PERIODS, shape)
        share = rng.uniform(0.5, 1.0, shape)
        return Wheels(
            names, axes, spin_inertias, *speeds, amplitude * share / _TERMS, rate, rng.uniform(0.0, 2.0 * np.pi, shape)
        )

    def speeds(self, time: Array) -> Array:
        """Return the (N, w) speeds at (N,) times, rad/s."""
        angle = self.rate * time[:, None, None] + self.phase
        wandering = np.sum(self.amplitude * (np.sin(angle) - np.sin(self.phase)), axis=-1)
        return np.asarray(self.start + self.slope * time[:, None] + wandering)

    def stored(self, speeds: Array) -> Array:
        """Return the (N, 3) angular momentum that they store at (N, w) speeds, N m s, base axes."""
        return np.asarray((self.spin_inertias * speeds) @ self.axes)

    def wrenches(self, now: BodyPoses) -> Array:
        """Return what their motors and their gyroscopic reaction do to the base: -(h' + w x h)."""
        angle = self.rate * now.time + self.phase
        slopes = self.slope + np.sum(self.amplitude * self.rate * np.cos(angle), axis=-1)
        stored = self.stored(self.speeds(np.array([now.time])))[0]
        wrenches = np.zeros((len(now.position), 6))
        wrenches[0, 3:] = -(self.spin_inertias * slopes) @ self.axes - np.cross(now.angular_velocity, stored)
        return wrenches

    def later(self, time: float) -> Wheels:
        """Return the same wheels, begun at a time (s) of this one."""
        return replace(self, start=self.speeds(np.array([time]))[0], phase=self.phase + self.rate * time)
