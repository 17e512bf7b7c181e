"""Where a filter may begin that only a gyro tells the motion: with the angular momentum of a robot that turns so.

Without it the first pass takes the robot for one at rest, far from one that tumbles: what is linear there leads away.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbaid_ros.core.geometry import Array, rotate
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.locked_inertia import mobility_and_momentum
from mbaid_ros.core.trajectory.windows.window import Stack, Window

# First windows, whose mean angular momentum a start has: noise is far below the rate, disturbances have hardly acted.
_FIRST = 5


def angular_momentum(kernel: MomentumKernel, target: Array, windows: Sequence[Window]) -> Array:
    """Return the angular momentum about the centre of mass, odometry axes, (3,); zero where poses locate the base.

    Parameters
    ----------
    kernel : of the robot
    target : (10,) standard parameters of its target
    windows : of which the first ones count
    """
    known, found = kernel.with_target(target), []
    for window in windows[:_FIRST]:
        middle = Stack((window,), (0,)).middle[window.inside].flat
        if np.isfinite(window.noise.pose[-1, -1]) or not middle.gyro.shape[-1] or not np.all(np.isfinite(middle.gyro)):
            continue
        placed = kernel.kinematics.configure(middle.base_rotation, middle.joint_position)
        joints = kernel.kinematics.body_twists(placed, middle.joint_velocity, np.zeros((len(middle), 6)))
        mobility, moving = mobility_and_momentum(known, placed, joints)
        if kernel.storage.count:
            moving[:, 3:] += np.sum(kernel.storage.momenta(placed.rotation, middle.stored), axis=1)
        # With V = M^-1 (h - b) and no linear momentum: the angular part of M^-1 alone makes the rate of what is left.
        at_rest = (mobility @ moving[..., None])[..., 0]
        rate = rotate(middle.base_rotation, middle.gyro) + at_rest[:, 3:]
        found.append(np.linalg.solve(mobility[:, 3:, 3:], rate[..., None])[..., 0])
    return np.mean(np.concatenate(found), axis=0) if found else np.zeros(3)
