"""Which topics are read."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Inputs:
    """The topics to read.

    Attributes
    ----------
    joint_states : of type sensor_msgs/JointState
    odometry : of type nav_msgs/Odometry
    """

    joint_states: str = '/joint_states'
    odometry: str = '/odom'

    @property
    def topics(self) -> tuple[str, str]:
        """Both of them."""
        return self.joint_states, self.odometry
