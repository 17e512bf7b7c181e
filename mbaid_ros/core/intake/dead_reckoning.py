"""Where an IMU says that the base has turned to, where nothing locates it: integrated from where it was at first.

Position and heading are what nobody measures: the frame is that of the base at the first measurement, and stays with
the common centre of mass. What is integrated is a course to linearise along, no measurement: its covariance is NaN.
"""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import Array, cross, exp
from mbaid_ros.core.intake.orientation_only import orientation_only
from mbaid_ros.core.samples import BaseStream, ImuStream

_ONCE_MORE = 256  # rotations, after which rounding is taken off: it has grown to some 1e-14 by then


class DeadReckoning:
    """Turns along; the result does not depend on how the stream is cut into pieces."""

    def __init__(self) -> None:
        self._last: tuple[int, Array, Array] | None = None  # stamp, rate, orientation
        self._count = 0

    def push(self, imu: ImuStream | None) -> BaseStream | None:
        """Take measurements in the order of their stamps, and return the base's at each, in space without a place."""
        if imu is None or not len(imu.stamp):
            return None
        rotations = []
        for stamp, rate in zip(imu.stamp.tolist(), imu.angular_velocity, strict=True):
            rotations.append(self._turned(stamp, rate))
        return orientation_only(imu.stamp, np.array(rotations))

    def _turned(self, stamp: int, rate: Array) -> Array:
        """Return the orientation at the next measurement: with a rate that changes evenly, to fourth order."""
        if self._last is None:
            rotation: Array = np.eye(3)
        else:
            before, first, start = self._last
            step = 1e-9 * (stamp - before)
            turn = 0.5 * step * (first + rate) + step**2 / 12.0 * cross(first, rate)
            rotation = start @ exp(turn)
            self._count += 1
            if self._count % _ONCE_MORE == 0:
                left, _, right = np.linalg.svd(rotation)
                rotation = left @ right
        self._last = stamp, rate, rotation
        return rotation
