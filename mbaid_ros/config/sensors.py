"""The parameters that say how noisy the sensors are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.config.parameters import parameter
from mbaid_ros.core.geometry import Flags
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.core.sensors.levels import CHANNELS, TYPICAL, UNITS

_FOUND = (
    '; 0, also where not given, means that it is found in the readings, and taken to be {} where these do not tell it.'
)


def _level(channel: str, what: str) -> float:
    place = CHANNELS.index(channel)
    return parameter(0.0, what + _FOUND.format(f'{TYPICAL[place]:g}'), unit=UNITS[place], minimum=0.0)


@dataclass(frozen=True)
class NoiseConfig:
    """One standard deviation of each sensor channel, a sample."""

    joint_position: float = _level(
        'joint_position', 'Standard deviation of a joint position (for a prismatic joint the number counts in m)'
    )
    joint_velocity: float = _level(
        'joint_velocity', 'Standard deviation of a joint velocity (for a prismatic joint the number counts in m/s)'
    )
    base_position: float = _level(
        'base_position',
        'Standard deviation of each coordinate of the base position, where the Odometry carries no pose covariance',
    )
    base_orientation: float = _level(
        'base_orientation',
        'Standard deviation of the base orientation about each axis, where the Odometry carries no pose covariance',
    )
    base_linear_velocity: float = _level(
        'base_linear_velocity',
        'Standard deviation of the base velocity along each axis, where the Odometry carries no twist covariance',
    )
    base_angular_velocity: float = _level(
        'base_angular_velocity',
        'Standard deviation of the angular velocity of the base, where the Odometry carries no twist covariance',
    )
    base_correlation_time: float = parameter(
        0.0,
        'Time over which the errors of the base pose are correlated, as those of a filter or of visual odometry are: '
        'their correlation falls to 1/e. 0 means that it is found, where poses change less than their covariance says; '
        'elsewhere each pose has an error of its own.',
        unit='s',
        minimum=0.0,
    )

    estimate: bool = parameter(
        default=False,
        description='Use, of every sensor, the noise that is found in its readings, whatever is declared here or in '
        'messages. What is found is told in any case.',
    )

    @property
    def declared(self) -> SensorNoise:
        """What is declared, as the core has it; what sensors of a servicer have where nothing is."""
        levels = {name: getattr(self, name) or float(usual) for name, usual in zip(CHANNELS, TYPICAL, strict=True)}
        return SensorNoise(**levels, base_correlation_time=self.base_correlation_time)

    @property
    def undeclared(self) -> Flags:
        """Of which channels nothing is declared, (6,) of CHANNELS."""
        return np.array([getattr(self, name) == 0.0 for name in CHANNELS])


@dataclass(frozen=True)
class PoseConfig:
    """Poses of the base without a twist: PoseStamped and its like on the topic pose, or a transform on /tf."""

    frame: str = parameter(
        '',
        'Frame on the base that a PoseStamped locates: the base link, another link fixed to it, or the one that marker '
        'places. Empty: that of marker, where it is set, or else the base link.',
    )
    tf_child_frame: str = parameter(
        '',
        'Take the pose of the base from /tf: child frame of the transform, in the same place unless pose.frame names '
        'another. Empty does not read /tf.',
    )


@dataclass(frozen=True)
class ImuConfig:
    """The angular velocity that an IMU measures; with `noise_density` the topic imu is used."""

    noise_density: float = parameter(
        0.0,
        'Density of the white noise of its angular velocity, as data sheets have it: the standard deviation of a '
        'reading over the square root of the rate. 0 does not use the topic imu.',
        unit='rad/s/sqrt(Hz)',
        minimum=0.0,
    )
    alone: bool = parameter(
        default=False,
        description='Nothing locates the base: the gyro alone tells how it turns, about the common centre of mass. '
        'Method trajectory; odom and pose are not used, and linear momentum and heading are not known.',
    )
    orientation: bool = parameter(
        default=False,
        description='With alone: its messages tell the orientation, too, as a star tracker does; used where its '
        'covariance is not -1 (REP 145). The gyro then fills the gaps between them, and heading is known.',
    )
    bias_std: float = parameter(
        0.01, 'Standard deviation of the bias about each axis at the begin.', unit='rad/s', minimum=0.0
    )
    bias_walk: float = parameter(
        2e-5,
        'How much the bias wanders: standard deviation of its change in a second; it grows with the square root of '
        'the time.',
        unit='rad/s/sqrt(s)',
        minimum=0.0,
    )
    scale_std: float = parameter(
        0.01, 'Relative standard deviation of the scale of each axis; 0 is exact.', minimum=0.0
    )
    cross_axis_std: float = parameter(
        0.0,
        'Standard deviation of how much of the angular velocity about one axis is read about another, beside how all '
        'of them are turned; data sheets of MEMS call 0.01 to 0.02 the most. 0 is exact.',
        minimum=0.0,
    )
    orientation_std: float = parameter(
        0.01,
        'Standard deviation of how it is turned on the base, about each axis; 0 is exact.',
        unit='rad',
        minimum=0.0,
    )
    range: float = parameter(
        0.0,
        'Largest angular velocity that it can measure: readings there are not used. 0 is not known; then readings that '
        'stay the same to the last bit are not.',
        unit='rad/s',
        minimum=0.0,
    )
    frame: str = parameter(
        '',
        'Link that it is fixed to, in whose axes it measures: of the base, or one that joints move, but not the target '
        'nor what that carries. Empty: the frame_id of its messages says it, of links on the base.',
    )
