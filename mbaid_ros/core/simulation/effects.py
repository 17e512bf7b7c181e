"""What acts on the bodies of a simulated robot beside the torques of its joints and a constant push."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from mbaid_ros.core.geometry import Array


@dataclass(frozen=True)
class BodyPoses:
    """Where the n + 1 bodies are at an instant.

    Attributes
    ----------
    time : s since the start of the run
    rotation : (n + 1, 3, 3) body to odometry axes
    position : (n + 1, 3) m, body origins in the odometry frame
    angular_velocity : (3,) rad/s, of the base, in its axes
    """

    time: float
    rotation: Array
    position: Array
    angular_velocity: Array


class Effect(Protocol):
    """Something that acts on bodies."""

    def wrenches(self, now: BodyPoses) -> Array:
        """Return force (N) and torque (N m) about each body's origin, in its axes, (n + 1, 6)."""
        ...
