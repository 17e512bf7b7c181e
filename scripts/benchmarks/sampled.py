"""Samples as the core works on them, of a simulated motion."""

from __future__ import annotations

import numpy as np

from mbaid_ros.core.geometry import rotation_from_quaternion
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import Truth


def sampled(truth: Truth, sensors: Sensors, declared: SensorNoise) -> Samples:
    """Return the samples that sensors give of a motion, which claim a noise of the base."""
    joints, base = sensors.joints(truth), sensors.base(truth)
    count = len(truth)
    return Samples(
        time=truth.time - truth.time[0],
        joint_position=joints.position,
        joint_velocity=joints.velocity,
        base_position=base.position,
        base_rotation=rotation_from_quaternion(base.orientation),
        base_linear_velocity=quaternions.rotate(base.orientation, base.linear_velocity),
        base_angular_velocity=quaternions.rotate(base.orientation, base.angular_velocity),
        pose_covariance=np.tile(declared.pose_covariance(), (count, 1, 1)),
        twist_covariance=np.tile(declared.twist_covariance(), (count, 1, 1)),
    )
