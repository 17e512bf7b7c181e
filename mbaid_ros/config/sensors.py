"""The parameters of sensors and their noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.config.parameters import parameter
from mbaid_ros.core.geometry import Flags
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.core.sensors.levels import CHANNELS, TYPICAL


@dataclass(frozen=True)
class NoiseConfig:
    """Standard deviation of one sample of each sensor channel."""

    joint_position: float = parameter(0.0, 'rad', minimum=0.0)
    """Standard deviation of a joint position (for a prismatic joint the number counts in m); 0: estimated from the
    readings, 0.0001 where these do not determine it."""
    joint_velocity: float = parameter(0.0, 'rad/s', minimum=0.0)
    """Standard deviation of a joint velocity (for a prismatic joint the number counts in m/s); 0: estimated from the
    readings, 0.001 where these do not determine it."""
    base_position: float = parameter(0.0, 'm', minimum=0.0)
    """Standard deviation of each coordinate of the base position, where the Odometry carries no pose covariance; 0:
    estimated from the readings, 0.001 where these do not determine it."""
    base_orientation: float = parameter(0.0, 'rad', minimum=0.0)
    """Standard deviation of the base orientation about each axis, where the Odometry carries no pose covariance; 0:
    estimated from the readings, 0.0001 where these do not determine it."""
    base_linear_velocity: float = parameter(0.0, 'm/s', minimum=0.0)
    """Standard deviation of the base velocity along each axis, where the Odometry carries no twist covariance; 0:
    estimated from the readings, 0.001 where these do not determine it."""
    base_angular_velocity: float = parameter(0.0, 'rad/s', minimum=0.0)
    """Standard deviation of the angular velocity of the base, where the Odometry carries no twist covariance; 0:
    estimated from the readings, 0.0001 where these do not determine it."""
    base_correlation_time: float = parameter(0.0, 's', minimum=0.0)
    """Time in which the correlation of errors of the base pose falls to 1/e, for poses of a filter or of visual
    odometry. 0: estimated from the readings, as that of the base twist is."""

    estimate: bool = parameter(default=False)
    """Use the noise estimated from the readings of every sensor, in place of the declared one. The estimated noise is
    reported in any case."""

    trust_declared: bool = parameter(default=False)
    """Keep the declared noise of the base where the readings contradict it; otherwise the estimated noise replaces it,
    with a warning."""

    @property
    def declared(self) -> SensorNoise:
        """The declared noise, with typical levels of a servicer's sensors where nothing is declared."""
        levels = {name: getattr(self, name) or float(usual) for name, usual in zip(CHANNELS, TYPICAL, strict=True)}
        return SensorNoise(**levels, base_correlation_time=self.base_correlation_time)

    @property
    def undeclared(self) -> Flags:
        """Which of CHANNELS have no declared noise, (6,)."""
        return np.array([getattr(self, name) == 0.0 for name in CHANNELS])


@dataclass(frozen=True)
class PoseConfig:
    """Poses of the base without a twist: a PoseStamped or the like on the topic pose, or a transform on /tf."""

    tf_child_frame: str = parameter('')
    """Take the pose of the base from /tf: child frame of the transform, a link of the base or, with marker.position, a
    marker. Empty: /tf is not read."""


@dataclass(frozen=True)
class ImuConfig:
    """The angular velocity of an IMU; with `noise_density` the topic imu is used."""

    noise_density: float = parameter(0.0, 'rad/s/sqrt(Hz)', minimum=0.0)
    """White noise density of the gyro, as in data sheets: standard deviation of a reading over the square root of the
    rate. 0: the topic imu is not used."""
    alone: bool = parameter(default=False)
    """Nothing locates the base: the gyro alone measures its rotation about the common centre of mass. Only for method
    trajectory; odom and pose are ignored, linear momentum and heading are unobservable."""
    orientation: bool = parameter(default=False)
    """With imu.alone: also use the orientation in the messages, as from a star tracker, unless its covariance is -1
    (REP 145). The gyro then fills the gaps between messages, and the heading is observable."""
    bias_std: float = parameter(0.01, 'rad/s', minimum=0.0)
    """Standard deviation of the gyro's initial bias about each axis."""
    bias_walk: float = parameter(2e-5, 'rad/s/sqrt(s)', minimum=0.0)
    """Random walk of the gyro's bias: standard deviation of its change in a second; grows with the square root of
    time."""
    scale_std: float = parameter(0.01, minimum=0.0)
    """Relative standard deviation of the gyro's scale on each axis; 0: exact."""
    cross_axis_std: float = parameter(0.0, minimum=0.0)
    """Standard deviation of the gyro's cross-axis sensitivity, without the common misalignment; data sheets of MEMS
    have 0.01 to 0.02 as a maximum. 0: exact."""
    orientation_std: float = parameter(0.01, 'rad', minimum=0.0)
    """Standard deviation of the IMU's misalignment about each axis; 0: exact."""
    range: float = parameter(0.0, 'rad/s', minimum=0.0)
    """Largest measurable angular velocity: readings at that limit are not used. 0: unknown; then fast readings that
    repeat to the last bit are not used."""
    frame: str = parameter('')
    """Link that carries the IMU and whose axes it measures in: on the base or moved by joints, but not the target or a
    link that the target carries. Empty: the frame_id of the messages, a link on the base."""
