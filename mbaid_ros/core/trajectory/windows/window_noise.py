"""The noise of a window's means: of the joints as it is declared or found, of the base as its samples carry it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import Samples, SensorNoise
from mbaid_ros.core.trajectory.state import ANGULAR_FIRST


@dataclass(frozen=True)
class WindowNoise:
    """Noise of the means of a window's measurements.

    Attributes
    ----------
    samples : number in the window
    joint_position : one standard deviation of one sample, rad or m; (n,) where joints differ
    pose : (6, 6) mean covariance of one sample, (orientation, position), odometry axes
    twist : (6, 6) of one sample, (angular, linear), base axes
    gyro : rad/s/sqrt(Hz), density of an IMU's; 0 where there is none
    correlation_time : s, over which the errors of the poses are correlated; 0 for independent ones
    """

    samples: int
    joint_position: float | Array
    pose: Array
    twist: Array
    gyro: float = 0.0
    correlation_time: float = 0.0


def window_noises(windows: Sequence[Samples], noise: SensorNoise, gyro: float = 0.0) -> list[WindowNoise]:
    """Return the noise of windows' means; a twist's covariance as given, whether or not it is measured."""
    poses, twists = (
        np.stack([np.add.reduce(each, axis=0) / len(each) for each in covariances])[
            :, ANGULAR_FIRST[:, None], ANGULAR_FIRST
        ]
        for covariances in ([each.pose_covariance for each in windows], [each.twist_covariance for each in windows])
    )
    return [
        WindowNoise(len(window), own.joint_position, pose, twist, gyro, own.base_correlation_time)
        for window, pose, twist in zip(windows, poses, twists, strict=True)
        for own in [noise.found_in(window)]
    ]
