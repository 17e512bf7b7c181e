"""What may be wrong with the odometry beside its noise, as unknowns that only a run under suspicion is given.

Their standard deviations are far below what would matter, and a thousandth of what is plausible: the run stays what it
was, and what the data would gain by more of one of them follows from its estimate (`verdict/widening.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, skew
from mbaid_ros.core.unknowns.declaration import Reading, Unknown
from mbaid_ros.core.unknowns.known_side import KnownSide

SUSPECTS = SCALE, TURNING, CLOCK, LATE, BIAS = (
    'odometry scale',
    'odometry turning',
    'clock drift',
    'twist late',
    'twist bias',
)

_MINUTE = 60.0  # s


@dataclass(frozen=True, eq=False)
class Suspect(Unknown):
    """An unknown of the odometry that no windows are linearised at: its readings are linear."""

    read = True
    in_equations = False

    def settled(self, value: Array, deviation: Array) -> Array:
        """Return zero: the windows are those that are read."""
        del deviation
        return np.zeros_like(value)

    def moved(self, side: KnownSide, value: Array) -> KnownSide:
        """Return the known side as it is."""
        del value
        return side


@dataclass(frozen=True, eq=False)
class OdometryScale(Suspect):
    """By what part lengths are read too long."""

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return the position as far as the base has come, and its velocity."""
        pose, twist = np.zeros((2, len(motion.time), 6, 1))
        pose[:, 3:, 0], twist[:, 3:, 0] = motion.position, motion.twist[:, 3:]
        return pose, twist


@dataclass(frozen=True, eq=False)
class OdometryTurning(Suspect):
    """Angular velocity of the odometry's frame, rad/s, (3,) in its own axes: an orbit's, say."""

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return what such a frame turns back by, about the run's origin."""
        pose, twist = np.zeros((2, len(motion.time), 6, 3))
        arm, time = skew(motion.position), motion.time[:, None, None]
        pose[:, :3], pose[:, 3:] = -time * np.eye(3), time * arm
        twist[:, :3], twist[:, 3:] = -np.eye(3), arm
        return pose, twist


@dataclass(frozen=True, eq=False)
class ClockDrift(Suspect):
    """By how much the clock of the joints runs fast, s/s."""

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return what a delay makes that grows with time."""
        pose, twist = motion.time[:, None] * motion.twist, motion.time[:, None] * motion.slope
        return pose[..., None], twist[..., None]

    def gyro_reading(self, motion: Reading) -> Array:
        """Return what such a delay makes of an angular velocity."""
        return (motion.time[:, None] * motion.slope[:, :3])[..., None]


@dataclass(frozen=True, eq=False)
class TwistLate(Suspect):
    """By how much the twist is behind the pose, s."""

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return what the twist was before."""
        return np.zeros((len(motion.time), 6, 1)), -motion.slope[..., None]


@dataclass(frozen=True, eq=False)
class TwistBias(Suspect):
    """What the twist reads too much, rad/s and m/s, base axes."""

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return the base's axes."""
        pose, twist = np.zeros((2, len(motion.time), 6, 6))
        twist[:, :3, :3] = twist[:, 3:, 3:] = motion.rotation
        return pose, twist


@dataclass(frozen=True, eq=False)
class Line(Suspect):
    """A swing of the pose at one frequency: amplitudes (24,) rad and m of sine and cosine, and their growth a minute.

    Attributes
    ----------
    frequency : Hz
    """

    frequency: float = 0.0

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return each, and how fast it changes."""
        rate, time = 2.0 * np.pi * self.frequency, motion.time[:, None, None]
        axes = np.eye(6)
        sine, cosine = np.sin(rate * time) * axes, np.cos(rate * time) * axes
        late = time / _MINUTE
        pose = np.concatenate((sine, cosine, late * sine, late * cosine), axis=2)
        growing = (rate * late * cosine + sine / _MINUTE, cosine / _MINUTE - rate * late * sine)
        return pose, np.concatenate((rate * cosine, -rate * sine, *growing), axis=2)


def suspects() -> tuple[Suspect, ...]:
    """Return what a run under suspicion is asked for."""
    bias = np.repeat((1e-5, 1e-4), 3)
    return (
        OdometryScale(np.array([[5e-5]]), (SCALE,)),
        OdometryTurning(3e-6 * np.eye(3), (TURNING,) * 3),
        ClockDrift(np.array([[1e-6]]), (CLOCK,)),
        TwistLate(np.array([[3e-4]]), (LATE,)),
        TwistBias(np.diag(bias), (BIAS,) * 6),
    )


def line(frequency: float) -> Line:
    """Return a swing at a frequency, Hz."""
    size = np.tile(np.repeat((1e-3, 1e-2), 3), 4)
    return Line(np.diag(size), ('line',) * 24, frequency)
