"""The parameters that say how noisy the sensors are."""

from __future__ import annotations

from dataclasses import dataclass

from mbaid_ros.config.parameters import parameter
from mbaid_ros.core.samples import SensorNoise


@dataclass(frozen=True)
class NoiseConfig:
    """One standard deviation of each sensor channel, a sample."""

    joint_position: float = parameter(
        1e-4,
        'Standard deviation of a joint position; for a prismatic joint the number counts in m.',
        unit='rad',
        minimum=0.0,
        exclusive_minimum=True,
    )
    joint_velocity: float = parameter(
        1e-3,
        'Standard deviation of a joint velocity; for a prismatic joint the number counts in m/s.',
        unit='rad/s',
        minimum=0.0,
        exclusive_minimum=True,
    )
    base_position: float = parameter(
        1e-3,
        'Standard deviation of each coordinate of the base position, where the Odometry carries no pose covariance.',
        unit='m',
        minimum=0.0,
        exclusive_minimum=True,
    )
    base_orientation: float = parameter(
        1e-4,
        'Standard deviation of the base orientation about each axis, where the Odometry carries no pose covariance.',
        unit='rad',
        minimum=0.0,
        exclusive_minimum=True,
    )
    base_linear_velocity: float = parameter(
        1e-3,
        'Standard deviation of the base velocity along each axis, where the Odometry carries no twist covariance.',
        unit='m/s',
        minimum=0.0,
        exclusive_minimum=True,
    )
    base_angular_velocity: float = parameter(
        1e-4,
        'Standard deviation of the angular velocity of the base, where the Odometry carries no twist covariance.',
        unit='rad/s',
        minimum=0.0,
        exclusive_minimum=True,
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
        """What is declared, as the core has it."""
        return SensorNoise(**{name: value for name, value in vars(self).items() if name != 'estimate'})
