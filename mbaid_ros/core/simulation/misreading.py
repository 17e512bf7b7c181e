"""What sensors without noise say that believe the URDF, of a robot that is not its URDF."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbaid_ros.core.geometry import cross
from mbaid_ros.core.robot.model_errors import ModelErrors
from mbaid_ros.core.simulation import quaternions
from mbaid_ros.core.simulation.run import Truth


def misread(truth: Truth, errors: ModelErrors) -> Truth:
    """Return a motion as encoders with wrong zeros and odometry that is mounted elsewhere tell it.

    Parameters
    ----------
    truth : the true motion of the true robot
    errors : its zeros and its mount; the other blocks are in the motion already

    Returns
    -------
    Truth
        Joint positions less their zeros; the base's pose and twist are those of the frame that the odometry locates:
        the pose that composed with the mount is the true one, the velocity of that frame's origin, in its axes.
    """
    truth = replace(truth, joint_position=truth.joint_position - errors.zeros)
    if not np.any(errors.mount):
        return truth
    turn, place = errors.mount[:3], errors.mount[3:]
    orientation = quaternions.product(truth.base_orientation, quaternions.exp(-turn))
    forth = quaternions.exp(turn)  # from true to measured axes
    angular = quaternions.rotate(forth, truth.base_angular_velocity)
    linear = quaternions.rotate(forth, truth.base_linear_velocity) - cross(angular, place)
    return replace(
        truth,
        base_position=truth.base_position - quaternions.rotate(orientation, place),
        base_orientation=orientation,
        base_linear_velocity=linear,
        base_angular_velocity=angular,
    )
