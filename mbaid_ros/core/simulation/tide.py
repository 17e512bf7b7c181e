"""Tide and gravity gradient on the bodies of a simulated robot.

The bodies are taken as they are, by mass, centre of mass and inertia about it: the estimator has the same physics in
standard parameters, and tests compare the two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, cross, rotate, rotate_back, unvec
from mbaid_ros.core.orbit import Orbit
from mbaid_ros.core.robot.inertia import physical
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.simulation.effects import BodyPoses


@dataclass(frozen=True, eq=False)
class Tide:
    """What gravity leaves in the frame that falls along.

    Attributes
    ----------
    orbit : Orbit
    origin : (3,) m, which the bodies' positions count from
    mass, centre, inertia : (b,), (b, 3), (b, 3, 3) of each body, kg, m, kg m^2 about the centre of mass, its own axes
    """

    orbit: Orbit
    origin: Array
    mass: Array
    centre: Array
    inertia: Array

    @staticmethod
    def on(model: RobotModel, orbit: Orbit, origin: Array) -> Tide:
        """Return what acts on a robot whose positions count from an origin (3,) m in the falling frame."""
        bodies = model.body_parameters()
        massive = bodies[:, 0] > 0.0
        values = np.zeros_like(bodies)
        values[massive] = [physical(body) for body in bodies[massive]]
        return Tide(orbit, origin, values[:, 0], values[:, 1:4], unvec(values[:, 4:]))

    def wrenches(self, now: BodyPoses) -> Array:
        """Return m G x at each centre of mass and 3 mu/r^3 up x I up, about the body's origin: (n + 1, 6)."""
        instant = np.array([now.time])
        up = rotate_back(now.rotation, np.broadcast_to(self.orbit.upward(instant), now.position.shape))
        place = self.origin + now.position + rotate(now.rotation, self.centre)
        force = rotate_back(now.rotation, self.mass[:, None] * (place @ self.orbit.gradient(instant)[0]))
        torque = 3.0 * self.orbit.strength(instant) * cross(up, rotate(self.inertia, up))
        return np.concatenate((force, torque + cross(self.centre, force)), axis=1)
