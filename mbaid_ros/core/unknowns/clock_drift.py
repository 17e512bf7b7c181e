"""By how much the clock that stamps the joints runs fast against that of the odometry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.unknowns.declaration import Linear, Reading

CLOCK = 'clock drift'


@dataclass(frozen=True, eq=False)
class ClockDrift(Linear):
    """How fast the joints' clock runs, s/s: a delay that grows with time since the run began.

    The momentum is then that of the joints' clock. Linear, as far as the base's motion is over that delay: to some
    50 ms, eight minutes at 100 ppm.
    """

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return how much further on pose and twist are read, and how much faster the base is by the joints' clock."""
        time = motion.time[:, None]
        return (time * motion.twist)[..., None], (time * motion.slope + motion.twist)[..., None]

    def gyro_reading(self, motion: Reading) -> Array:
        """Return how much further on the angular velocity is read."""
        assert motion.imu is not None, 'there is an IMU'
        return (motion.time[:, None] * motion.imu.slope + motion.imu.rate)[..., None]


def clock_drift(deviation: float) -> ClockDrift:
    """Return the drift as an unknown, of a standard deviation, s/s."""
    return ClockDrift(np.array([[deviation]]), (CLOCK,))
