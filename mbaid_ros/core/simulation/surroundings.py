"""What a simulated robot is in beside its own bodies: an orbit, and wheels inside the base."""

from __future__ import annotations

from dataclasses import dataclass

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.orbit import Orbit
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.simulation.effects import Effect
from mbaid_ros.core.simulation.tide import Tide
from mbaid_ros.core.simulation.wheels import Wheels


@dataclass(frozen=True)
class Surroundings:
    """What acts on the bodies all the time.

    Attributes
    ----------
    wheels : inside the base; None where there are none
    orbit : about the epoch at time 0; None where there is none
    """

    wheels: Wheels | None = None
    orbit: Orbit | None = None

    def effects(self, model: RobotModel, origin: Array) -> tuple[Effect, ...]:
        """Return what acts on a robot whose positions count from an origin (3,) m in the odometry frame."""
        tide = () if self.orbit is None else (Tide.on(model, self.orbit, origin),)
        return (*tide, *(() if self.wheels is None else (self.wheels,)))

    def later(self, time: float) -> Surroundings:
        """Return the same, begun at a time (s) of this one."""
        return Surroundings(
            None if self.wheels is None else self.wheels.later(time),
            None if self.orbit is None else self.orbit.later(time),
        )
