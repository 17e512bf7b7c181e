"""How an orbit differs from the circle that is declared: an eccentricity e at a true anomaly nu at the begin, its rate.

To first order in k = e cos(nu), h = e sin(nu) and the relative error d of the mean motion n, it has turned by

    D = 2 sin(nt) k - 2 (1 - cos(nt)) h + nt d

more than the circle after a time t, and gravity is stronger by s = 3 cos(nt) k - 3 sin(nt) h + 2 d. All that is read in
a frame that turns along is turned back by D. What gravity brings a second, (P', L') about the frame's origin, is 1 + s
times what is taken for it, and turned by D; in a frame that does not turn only the direction to the centre is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, cross, skew
from mbaid_ros.core.orbit import Orbit
from mbaid_ros.core.robot.planar import PlaneDetector
from mbaid_ros.core.unknowns.declaration import Linear, Reading
from mbaid_ros.core.unknowns.gravity import rates_by

SHAPE = 'orbit shape'


@dataclass(frozen=True, eq=False)
class Circle:
    """A circular orbit that may be none.

    Attributes
    ----------
    orbit : the circle, the epoch at the begin of the run
    eccentricity : up to which it may be none
    relative_twist : whether the twist is read relative to a frame that turns
    """

    orbit: Orbit
    eccentricity: float
    relative_twist: bool = True


@dataclass(frozen=True, eq=False)
class OrbitShape(Linear):
    """The numbers k, h and d.

    Attributes
    ----------
    circle : Circle
    """

    circle: Circle

    in_equations = True
    pushes = True

    def momentum_rates(self, whole: Array, origin: Array, time: Array, rotation: Array) -> Array:
        """Return what gravity brings otherwise than that of the circle does."""
        del rotation
        orbit = self.circle.orbit
        gradient, normal = orbit.gradient(time), skew(orbit.normal)
        brought = rates_by(gradient[:, None], whole, origin)
        if orbit.turning:
            # The run's origin is read turned, too.
            turned: Array = np.concatenate((normal @ brought[:, :3], normal @ brought[:, 3:]), axis=1)
            turned[:, 3:] += skew(np.cross(orbit.normal, origin)) @ brought[:, :3]
        else:
            turned = rates_by((normal @ gradient - gradient @ normal)[:, None], whole, origin)
        ahead, stronger = self._course(time)[::2]
        return np.asarray(brought * stronger[:, None] + turned * ahead[:, None])

    def reading(self, motion: Reading) -> tuple[Array, Array]:
        """Return what a frame that turns along is turned back by, about its own origin."""
        pose: Array = np.zeros((len(motion.time), 6, 3))
        twist: Array = pose
        if self.circle.orbit.turning:
            normal = np.broadcast_to(self.circle.orbit.normal, motion.position.shape)
            turn = np.concatenate((normal, cross(normal, motion.origin + motion.position)), axis=1)[..., None]
            ahead, faster, _ = self._course(motion.time)
            pose = np.asarray(-turn * ahead[:, None])
            if self.circle.relative_twist:
                twist = np.asarray(-turn * faster[:, None])
        return pose, twist

    def _course(self, time: Array) -> tuple[Array, Array, Array]:
        """Return how D, its rate and s depend on the numbers, (N, 3) each."""
        n = self.circle.orbit.mean_motion
        angle, one = n * time, np.ones(len(time))
        sine, cosine = np.sin(angle), np.cos(angle)
        ahead = np.column_stack((2.0 * sine, 2.0 * cosine - 2.0, angle))
        faster = n * np.column_stack((2.0 * cosine, -2.0 * sine, one))
        return ahead, faster, np.column_stack((3.0 * cosine, -3.0 * sine, 2.0 * one))

    def plane_basis(self, detector: PlaneDetector) -> Array:
        """Return nothing: tables do not orbit."""
        del detector
        return np.zeros((len(self.factor), 0))


def orbit_shape(circle: Circle) -> OrbitShape:
    """Return what a circle may lack as an unknown: each number as large as the eccentricity is in one direction."""
    return OrbitShape(np.sqrt(0.5) * circle.eccentricity * np.eye(3), (SHAPE,) * 3, circle)
