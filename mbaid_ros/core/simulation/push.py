"""A constant force and torque from outside."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import Link
from mbaid_ros.core.simulation import quaternions


@dataclass(frozen=True)
class Push:
    """A force and torque on a body, constant in its axes; or on the base, constant in those of the odometry frame.

    Attributes
    ----------
    body : index of the moving body; None for the odometry frame
    force, torque : (3,) N, N m, about the frame's origin, in its axes
    """

    body: int | None
    force: Array
    torque: Array

    @staticmethod
    def on(link: Link | None, wrench: Array) -> Push:
        """Return a (6,) force and torque about the origin of a link's frame, or of the odometry frame, in its axes."""
        if link is None:
            return Push(None, wrench[:3], wrench[3:])
        force = link.rotation @ wrench[:3]
        return Push(link.body, force, np.cross(link.position, force) + link.rotation @ wrench[3:])

    def about(self, origin: Array) -> Push:
        """Return the same where positions count from another place (3,) of the odometry frame."""
        return self if self.body is not None else replace(self, torque=self.torque - np.cross(origin, self.force))

    def on_base(self, position: Array, orientation: Array) -> tuple[Array, Array]:
        """Return force and torque, constant in the odometry frame, about the base's origin and in its axes.

        Parameters
        ----------
        position : (3,) m, of the base
        orientation : (4,) quaternion (x, y, z, w), base to odometry frame
        """
        back = quaternions.conjugate(orientation)
        return quaternions.rotate(back, self.force), quaternions.rotate(back, self.about(position).torque)
