"""What pinocchio says of the same robot in the same state, one sample at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio

from mbaid_ros.core.geometry import Array, quaternion_from_rotation
from mbaid_ros.core.robot.model import RobotModel, parse


@dataclass(frozen=True)
class Motion:
    """The state of N samples.

    Attributes
    ----------
    base_rotation : (N, 3, 3)
    joint_position, joint_velocity : (N, n)
    base_twist : (N, 6) of the base's origin, odometry axes
    """

    base_rotation: Array
    joint_position: Array
    joint_velocity: Array
    base_twist: Array


class Peer:
    """Pinocchio's model of a robot with its base's origin at the odometry's."""

    def __init__(self, model: RobotModel) -> None:
        self.model = parse(model)
        self.data = self.model.createData()
        self._continuous = model.continuous

    def to(self, motion: Motion, index: int) -> None:
        """Move to one sample: placements and velocities of all bodies."""
        rotation = motion.base_rotation[index]
        joints: list[float] = []
        for angle, turns in zip(motion.joint_position[index], self._continuous, strict=True):
            joints += [np.cos(angle), np.sin(angle)] if turns else [angle]
        position = np.concatenate((np.zeros(3), quaternion_from_rotation(rotation), joints))
        twist = motion.base_twist[index].reshape(2, 3)
        velocity = np.concatenate((rotation.T @ twist[0], rotation.T @ twist[1], motion.joint_velocity[index]))
        pinocchio.forwardKinematics(self.model, self.data, position, velocity)
        pinocchio.updateFramePlacements(self.model, self.data)
        pinocchio.centerOfMass(self.model, self.data, position)
        pinocchio.computeCentroidalMomentum(self.model, self.data)

    def placement(self, body: int) -> tuple[Array, Array]:
        """Return rotation and position of a body."""
        placement = self.data.oMi[body + 1]
        return placement.rotation.copy(), placement.translation.copy()

    def link(self, name: str) -> tuple[Array, Array]:
        """Return rotation and position of a link's frame."""
        placement = self.data.oMf[self.model.getFrameId(name)]
        return placement.rotation.copy(), placement.translation.copy()

    def twist(self, body: int) -> Array:
        """Return the twist (u, w) of a body at the base's origin, odometry axes."""
        return np.array(self.data.oMi[body + 1].act(self.data.v[body + 1]).vector)

    def momentum(self) -> Array:
        """Return (P, L) about the base's origin, odometry axes."""
        linear, angular = self.data.hg.linear, self.data.hg.angular
        return np.concatenate((linear, angular + np.cross(self.data.com[0], linear)))
