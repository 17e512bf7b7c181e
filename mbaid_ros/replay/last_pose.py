"""The last pose in a stream of messages, for a drawing: no synchronisation, whatever was read last of each joint."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbaid_ros.core.geometry import rotation_from_quaternion
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.replay.results import Pose


class LastPose:
    """Keeps what messages say of the pose of a robot.

    Parameters
    ----------
    model : RobotModel
    """

    def __init__(self, model: RobotModel) -> None:
        self._model = model
        self._carried = {link.name: link for link in model.links if link.body == 0}
        self._joint_state: dict[tuple[str, ...], Any] = {}  # the last message of each list of names
        self._odometry: Any = None

    def add_joint_state(self, message: Any) -> None:
        """Take a JointState, of all joints or of some."""
        names = tuple(message.name)
        if names in self._joint_state or len(self._joint_state) < 64:
            self._joint_state[names] = message

    def add_odometry(self, message: Any) -> None:
        """Take an Odometry of the base link or of a link fixed to it."""
        if message.child_frame_id.lstrip('/') in self._carried:
            self._odometry = message

    def pose(self) -> Pose | None:
        """Return the pose, None while a joint or the base has none."""
        positions: dict[str, float] = {}
        for message in self._joint_state.values():
            positions.update(
                (name, float(value))
                for name, value in zip(message.name, message.position, strict=False)
                if math.isfinite(value)
            )
        names = self._model.joint_names
        if self._odometry is None or not all(name in positions for name in names):
            return None
        place, turn = self._odometry.pose.pose.position, self._odometry.pose.pose.orientation
        position, quaternion = np.array([place.x, place.y, place.z]), np.array([turn.x, turn.y, turn.z, turn.w])
        if not np.all(np.isfinite(position)) or not 0.5 < np.sum(quaternion**2) < 2.0:
            return None
        link = self._carried[self._odometry.child_frame_id.lstrip('/')]
        rotation = rotation_from_quaternion(quaternion) @ link.rotation.T
        return Pose(rotation, position - rotation @ link.position, np.array([positions[name] for name in names]))
