"""What the method `trajectory` is told."""

from __future__ import annotations

from dataclasses import dataclass

from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.core.unknowns.catalogue import Uncertainty
from mbaid_ros.core.unknowns.environment import Axes


@dataclass(frozen=True)
class TrajectorySettings:
    """Settings of the trajectory-level estimator.

    Attributes
    ----------
    noise : of the joint sensors, and of the base where the samples carry none
    window : s
    start : windows before the first estimate
    kept : windows linearised again while the run is young
    uncertainty : of the known side
    adapt : also follow the hypotheses that a constant force and torque act, or that momentum or odometry drift, and
        take the best
    constant : axes of a constant force and torque that is taken to act
    gyro : rad/s/sqrt(Hz), density of the noise of an IMU's angular velocity; 0 where there is none
    located : whether anything locates the base; linear momentum means nothing where not
    orientation_measured : whether anything but a gyro tells how it is oriented
    """

    noise: SensorNoise
    window: float
    start: int
    kept: int
    uncertainty: Uncertainty
    adapt: bool
    constant: Axes = 'none'
    gyro: float = 0.0
    located: bool = True
    orientation_measured: bool = True
