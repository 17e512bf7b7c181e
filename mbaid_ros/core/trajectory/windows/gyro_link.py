"""An IMU on a link that joints move: it turns as the base does and as the joints between turn it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import Link
from mbaid_ros.core.trajectory.windows.interpolation import Midpoints


def on_link(middle: Midpoints, kinematics: Kinematics, link: Link) -> Midpoints:
    """Return a motion with where the IMU's axes are, and how fast each joint turns them.

    Parameters
    ----------
    middle : of J - 1 intervals, of one window or several
    kinematics : of the robot
    link : that the IMU is on
    """
    flat, shape = middle.flat, middle.turn.shape[:-1]
    placed = kinematics.configure(flat.base_rotation, flat.joint_position)
    gain = np.swapaxes(placed.joint_twist[..., 3:] * kinematics.ancestors[link.body][:, None], 1, 2)
    axes, _ = placed.link(link)
    return replace(middle, gyro_axes=axes.reshape(*shape, 3, 3), gyro_gain=gain.reshape(*shape, *gain.shape[1:]))
