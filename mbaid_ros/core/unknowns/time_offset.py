"""By how much the joints' stamps are late against those of the odometry."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.unknowns.declaration import Reading, Unknown
from mbaid_ros.core.unknowns.known_side import KnownSide

_CLEAR = 4.0  # standard deviations, from which a delay is one: joints are moved in time at the price of noise in them


@dataclass(frozen=True, eq=False)
class TimeOffset(Unknown):
    """A constant delay of the joints' stamps, s. A pose error that comes of joints tau too late is -tau (w, v)."""

    read = True
    in_equations = False  # of the measured motion at one instant

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return how much further on pose and twist are read."""
        return motion.twist[..., None], motion.slope[..., None]

    def gyro_reading(self, motion: Reading) -> Array:
        """Return how much further on the angular velocity is read."""
        assert motion.imu is not None, 'there is an IMU'
        return motion.imu.slope[..., None]

    def settled(self, value: Array, deviation: Array) -> Array:
        """Return the delay that the joints are taken later by: none, unless it is clearly one."""
        return np.where(np.abs(value) > _CLEAR * deviation, value, 0.0)

    def moved(self, side: KnownSide, value: Array) -> KnownSide:
        """Return the known side with this delay."""
        return replace(side, delay=side.delay + float(value[0]))


def time_offset(deviation: float) -> TimeOffset:
    """Return the offset as an unknown, of a standard deviation, s."""
    return TimeOffset(np.array([[deviation]]), ('time offset',))
