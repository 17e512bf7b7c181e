"""A circular orbit, and the frames that go round with it.

The frame that falls along and does not turn has the axes that the frame of the odometry has at the epoch. Up is away
from the centre; the orbit turns at the mean motion about its normal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mbaid_ros.core.geometry import Array, cross, exp

Frame = Literal['inertial', 'lvlh', 'hill']
Turning = Literal['lvlh', 'hill']

# Direction of up, and of the orbit's normal, in the frames that turn. CCSDS 500.0-G: LVLH has z down and y against the
# normal; Hill's frame (RSW, RTN, QSW) has x up and z along the normal.
_TURNING: dict[Turning, tuple[Array, Array]] = {
    'lvlh': (np.array([0.0, 0.0, -1.0]), np.array([0.0, -1.0, 0.0])),
    'hill': (np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])),
}


@dataclass(frozen=True, eq=False)
class Orbit:
    """A circular orbit.

    Attributes
    ----------
    mean_motion : rad/s
    up, normal : (3,) unit vectors at the epoch, in the frame that falls along
    turning : whether the frame of the odometry turns with the orbit
    """

    mean_motion: float
    up: Array
    normal: Array
    turning: bool

    @staticmethod
    def turning_with(mean_motion: float, frame: Turning) -> Orbit:
        """Return the orbit of a frame of the odometry that turns with it."""
        return Orbit(mean_motion, *_TURNING[frame], turning=True)

    @staticmethod
    def inertial(mean_motion: float, nadir: Array, normal: Array) -> Orbit:
        """Return the orbit of a frame that does not turn, with (3,) nadir and normal at the epoch in its axes.

        What the nadir has along the normal is taken off.
        """
        across = normal / np.linalg.norm(normal)
        down = nadir - (nadir @ across) * across
        return Orbit(mean_motion, -down / np.linalg.norm(down), across, turning=False)

    @property
    def rate(self) -> Array:
        """The (3,) angular velocity of what turns with the orbit, rad/s: the same in the turning frame's axes."""
        return self.mean_motion * self.normal

    def later(self, time: float) -> Orbit:
        """Return the same orbit with the epoch at a time (s) of this one; a frame that turns is not asked for here."""
        return replace(self, up=self.upward(np.array([time]))[0])

    def turned(self, time: Array) -> Array:
        """Return the (N, 3, 3) rotations from the turning frame's axes to inertial ones, (N,) s after the epoch."""
        return exp(time[:, None] * self.rate)

    def upward(self, time: Array) -> Array:
        """Return the (N, 3) unit vectors away from the centre, inertial axes, (N,) s after the epoch."""
        angle = self.mean_motion * time[:, None]
        return np.asarray(np.cos(angle) * self.up + np.sin(angle) * cross(self.normal, self.up))

    def gradient(self, time: Array) -> Array:
        """Return the (N, 3, 3) gradients G of gravity, 1/s^2: at x from the origin a body falls by G x faster."""
        up = self.upward(time)
        return np.asarray(self.mean_motion**2 * (3.0 * up[:, :, None] * up[:, None, :] - np.eye(3)))


def orbit_fixed_frame(rate: float) -> str:
    """Return that the odometry's frame turns at a rate, rad/s, as those of an orbit do."""
    return f'looks like gravity gradient or an orbit-fixed frame at about {rate:.2g} rad/s: set orbit.mean_motion'
