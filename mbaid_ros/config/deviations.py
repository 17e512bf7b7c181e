"""How far a robot may be from its URDF beside its bodies: parameters that the estimator and `calibrate` share."""

from __future__ import annotations

from dataclasses import dataclass

from mbaid_ros.config.parameters import parameter


@dataclass(frozen=True)
class JointDeviations:
    """Standard deviations of the joints."""

    zero_std: float = parameter(
        1e-3,
        'Standard deviation of the true position of every joint less the measured one, constant; in m for a prismatic '
        "joint. 0 takes the encoders' zeros as exact.",
        unit='rad',
        minimum=0.0,
    )
    origin_std: float = parameter(
        1e-3,
        "Standard deviation of each coordinate of every joint's origin; 0 takes the URDF as exact.",
        unit='m',
        minimum=0.0,
    )
    axis_std: float = parameter(
        1e-3,
        "Standard deviation of the tilt of every joint's axis, about either of two directions; 0 takes it as exact.",
        unit='rad',
        minimum=0.0,
    )


def mount_position() -> float:
    """Return the parameter of where the odometry is mounted."""
    return parameter(
        2e-3,
        "Standard deviation of each coordinate of the base link's origin in the frame that the odometry locates; 0 is "
        'exact.',
        unit='m',
        minimum=0.0,
    )


def mount_orientation() -> float:
    """Return the parameter of how the odometry is mounted."""
    return parameter(
        2e-3,
        "Standard deviation of the base link's orientation in that frame, about each axis; 0 is exact.",
        unit='rad',
        minimum=0.0,
    )
