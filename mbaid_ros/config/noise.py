"""The parameters that say how noisy the sensors are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.config.parameters import parameter
from mbaid_ros.core.geometry import Flags
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.core.sensor_levels import CHANNELS, TYPICAL, UNITS

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
