"""The servicer pushed by its thrusters, and the messages that command them, for the tests of known thrust."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

import recorded
from benchmarks.honesty.paths import servicer
from captured import sensed
from floating import float_freely, still
from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.core.geometry import Array
from mbaid_ros.sensor_messages import Thrust
from mbaid_ros.simulation.simulation import Truth, total_momentum
from observed import configured_motion, kernel
from simulated import robot

WRENCH = 'geometry_msgs/msg/WrenchStamped'
SECONDS = 16.0
ON, OFF = 9.2, 9.5  # s
FORCE_TORQUE = np.array([6.0, -6.0, 5.0, 3.0, 2.7, -3.0])  # N, N m, on the base link's origin in its axes

Timed = tuple[str, Any, int]


def push(time: float, rotation: Array, position: Array) -> Array:
    """Return the rate of (P, L) by the thrusters."""
    if not ON <= time < OFF:
        return np.zeros(6)
    force, torque = rotation @ FORCE_TORQUE[:3], rotation @ FORCE_TORQUE[3:]
    return np.concatenate((force, np.cross(position, force) + torque))


@cache
def pushed(*, thrust: bool = True) -> Truth:
    """Return the servicer's motion with the pulse, or without."""
    start = total_momentum(robot('servicer7'), configured_motion('servicer7', 0.1, 20.0)[:1])[0]
    # Every fourth sample: 25 a second are enough.
    return float_freely(kernel('servicer7'), servicer(), start, SECONDS, push if thrust else still)[::4]


def command(time: float, wrench: Array, frame: str = 'base_link') -> Timed:
    """Return a command that comes when it is stamped, as in recorded.messages."""
    stamp = round(time * 1e9)
    thrust = Thrust(np.array([time]), wrench[None], frame)
    return '/thrust', thrust.message(BAG_TYPES, 0, recorded.EPOCH * 1_000_000_000 + stamp), stamp


def messages(seed: int, *commands: Timed, thrust: bool = True) -> list[Timed]:
    """Return what sensors and thrusters say, in the order of their stamps, commands first."""
    read = list(recorded.messages(robot('servicer7'), sensed(pushed(thrust=thrust), seed)))
    return sorted([*commands, *read], key=lambda timed: timed[2])


def pulse(frame: str = 'base_link') -> tuple[Timed, Timed]:
    """Return the commands of the pulse."""
    return command(ON, FORCE_TORQUE, frame), command(OFF, np.zeros(6), frame)
