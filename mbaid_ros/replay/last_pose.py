"""The last pose in a stream of messages, for a drawing: no synchronisation, whatever was read last of each joint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mbaid_ros.cdr import Packets
from mbaid_ros.core.geometry import rotation_from_quaternion
from mbaid_ros.core.robot.model import Link, RobotModel
from mbaid_ros.messages import joint_state_shape, odometry_shape, positions_of
from mbaid_ros.replay.results import Pose


class LastPose:
    """Keeps what messages say of the pose of a robot.

    Parameters
    ----------
    model : RobotModel
    prefix : of the frames' names
    """

    def __init__(self, model: RobotModel, prefix: str = '') -> None:
        self._model = model
        self._carried = {prefix + link.name: link for link in model.links if link.body == 0}
        self._joint_state: dict[tuple[str, ...], Any] = {}  # the last message of each list of names
        self._odometry: Any = None

    def add_joint_states(self, messages: Sequence[Any]) -> None:
        """Take JointStates in order, of all joints or of some."""
        last = {joint_state_shape(message): message for message in _ends(messages)}
        for shape, message in last.items():
            if shape.names in self._joint_state or len(self._joint_state) < 64:
                self._joint_state[shape.names] = message

    def add_odometry(self, messages: Sequence[Any]) -> None:
        """Take Odometry in order, of the base link or of links fixed to it."""
        own = (message for message in reversed(_ends(messages)) if self._carrier(message) is not None)
        self._odometry = next(own, self._odometry)

    def _carrier(self, odometry: Any) -> Link | None:
        return self._carried.get(odometry_shape(odometry).child_frame_id.lstrip('/'))

    def pose(self) -> Pose | None:
        """Return the pose, None while a joint or the base has none."""
        positions: dict[str, float] = {}
        for message in self._joint_state.values():
            positions.update(positions_of(message))
        link = None if self._odometry is None else self._carrier(self._odometry)
        angles = self._model.positions_from(positions)
        if link is None or not np.all(np.isfinite(angles)):
            return None
        numbers = odometry_shape(self._odometry).columns([self._odometry])[1][0]
        position, quaternion = numbers[:3], numbers[3:7]
        if not np.all(np.isfinite(position)) or not np.all(np.abs(quaternion) < 2.0):
            return None
        if not 0.5 < np.sum(quaternion**2) < 2.0:
            return None
        rotation = rotation_from_quaternion(quaternion) @ link.rotation.T
        return Pose(rotation, position - rotation @ link.position, angles)


def _ends(messages: Sequence[Any]) -> Sequence[Any]:
    """Return of messages in order those that may be the last of their shape; packets together have one shape."""
    return messages[-1:] if isinstance(messages, Packets) else messages
