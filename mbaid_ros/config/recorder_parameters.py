"""The parameters of the recorder."""

from __future__ import annotations

from dataclasses import dataclass

from mbaid_ros.parameters import parameter


@dataclass(frozen=True)
class RecorderConfig:
    """The topics to record, for how long, and the bag."""

    output: str = parameter('')
    """Folder of the bag, which must not exist yet; empty means a new one named after the time of the start."""
    topics: tuple[str, ...] = parameter(())
    """Topics to record; empty means joint_states, odom, pose, imu, thrust, stored_momentum, target_pose and
    robot_description under these names, the estimates of the body, and the diagnostics, as they appear; no /tf."""
    duration: float = parameter(0.0, 's', minimum=0.0)
    """Length of the recording from the first message on; 0 means until it is stopped."""
