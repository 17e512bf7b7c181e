"""What may be wrong with joints or odometry beside their noise, as unknowns that only a run under suspicion is given.

Their standard deviations are far below what would matter, and a thousandth of what is plausible: the run stays what it
was. The likelihood gain of more of one of them follows from its estimate (`core/results/variance_components.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, skew
from mbaid_ros.core.unknowns.base import SPEEDS, TURNS, odometry_scale, twist_bias
from mbaid_ros.core.unknowns.declaration import Linear, Reading
from mbaid_ros.core.unknowns.joints import flexible_joints
from mbaid_ros.core.unknowns.sensors import clock_drift

TURNING, LATE = 'odometry turning', 'twist late'
OF_TWIST = (LATE, TURNS, SPEEDS)  # what is wrong with the twist alone

_MINUTE = 60.0  # s: a unit


@dataclass(frozen=True, eq=False)
class OdometryTurning(Linear):
    """Angular velocity of the odometry's frame, rad/s, (3,) in its own axes: an orbit's, say."""

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return what such a frame turns back by, about the run's origin."""
        pose, twist = np.zeros((2, len(motion.time), 6, 3))
        arm, time = skew(motion.position), motion.time[:, None, None]
        pose[:, :3], pose[:, 3:] = -time * np.eye(3), time * arm
        twist[:, :3], twist[:, 3:] = -np.eye(3), arm
        return pose, twist


@dataclass(frozen=True, eq=False)
class TwistLate(Linear):
    """By how much the twist is behind the pose, s."""

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return what the twist was before."""
        return np.zeros((len(motion.time), 6, 1)), -motion.slope[..., None]


@dataclass(frozen=True, eq=False)
class Line(Linear):
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


def suspects(known: Sequence[str], joints: Sequence[str]) -> tuple[Linear, ...]:
    """Return what a run under suspicion is asked for.

    Parameters
    ----------
    known : labels of the unknowns that the run has anyway
    joints : their names
    """
    every: tuple[Linear, ...] = (
        odometry_scale(5e-5),
        OdometryTurning(3e-6 * np.eye(3), (TURNING,) * 3),
        clock_drift(1e-6),
        TwistLate(np.array([[3e-4]]), (LATE,)),
        twist_bias(1e-5, 0.0),
        twist_bias(0.0, 1e-4),
        flexible_joints(joints),
    )
    return tuple(each for each in every if not set(each.causes) & set(known))


def line(frequency: float) -> Line:
    """Return a swing at a frequency, Hz."""
    size = np.tile(np.repeat((1e-3, 1e-2), 3), 4)
    return Line(np.diag(size), ('line',) * 24, frequency)
