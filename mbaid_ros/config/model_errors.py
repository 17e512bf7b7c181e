"""How far a robot may be from its URDF beside its bodies: parameters that the estimator and `calibrate` share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mbaid_ros.config.parameters import by_name, parameter


def _zero() -> float:
    return parameter(
        1e-3,
        'Standard deviation of the true position of every joint less the measured one, constant; in m for a prismatic '
        "joint. 0 takes the encoders' zeros as exact.",
        unit='rad',
        minimum=0.0,
    )


@dataclass(frozen=True)
class JointDeviations:
    """Standard deviations of the joints."""

    zero_std: float = _zero()
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


# Parameters of a robot that is exactly its URDF and in no orbit that is not declared, as only a simulated one is.
EXACT = {
    'known_links.relative_std': 0.0,
    'known_joints.zero_std': 0.0,
    'known_joints.origin_std': 0.0,
    'known_joints.axis_std': 0.0,
    'odometry_mount.position_std': 0.0,
    'odometry_mount.orientation_std': 0.0,
    'odometry.angular_velocity_bias_std': 0.0,
    'time_offset.drift_std': 0.0,
    'orbit.undeclared_rate': 0.0,
    'orbit.undeclared_eccentricity': 0.0,
}


@dataclass(frozen=True)
class LinkDeviations:
    """Standard deviations of a single known link, in place of `known_links.relative_std`; 0 is exact."""

    mass_relative_std: float = parameter(
        0.01,
        'Relative standard deviation of the mass of this link and all that is fixed to it; the inertia goes with it.',
        minimum=0.0,
        maximum=1.0,
    )
    com_std: float = parameter(
        0.01, 'Standard deviation of each coordinate of their centre of mass.', unit='m', minimum=0.0
    )
    inertia_relative_std: float = parameter(
        0.01,
        'Standard deviation of each element of their inertia about the centre of mass at a given mass, relative to the '
        'mean moment.',
        minimum=0.0,
        maximum=1.0,
    )


@dataclass(frozen=True)
class LinkPriorConfig:
    """How far the <inertial> of every unknown link may be off: one standard deviation."""

    mass_relative_std: float = parameter(
        0.05, 'Relative standard deviation of each mass; 0 means that nothing is known of it.', minimum=0.0
    )
    com_std: float = parameter(
        0.01,
        'Standard deviation of each coordinate of a centre of mass; 0 means that nothing is known of it.',
        unit='m',
        minimum=0.0,
    )
    inertia_relative_std: float = parameter(
        0.1,
        'Standard deviation of each element I_ij about the centre of mass at a given mass, relative to '
        'sqrt(I_ii I_jj); 0 means that nothing is known of it.',
        minimum=0.0,
    )


@dataclass(frozen=True)
class KnownLinksConfig:
    """How well the known bodies are known."""

    relative_std: float = parameter(
        0.01,
        'Relative standard deviation of every known body as a whole, all of its inertial parameters by one factor, and '
        'beside that of each of them by itself; 0 takes the URDF as exact.',
        minimum=0.0,
        maximum=1.0,
    )
    calibration: str = parameter(
        '',
        'JSON file of calibrate, whose covariance of links, joints and mount counts, not relative_std, the zeros, '
        'origins and axes of known_joints, and odometry_mount; the URDF is then the one it wrote.',
    )
    links: Mapping[str, Mapping[str, float]] = by_name(LinkDeviations, 'link')


def _tracking() -> float:
    return parameter(
        0.0,
        'Standard deviation of what the true position of every joint wanders by about the measured one and its zero, '
        'as where joint states hold commands, which the arm follows with errors; in m for a prismatic joint; 0 is '
        'none.',
        unit='rad',
        minimum=0.0,
    )


@dataclass(frozen=True)
class SingleJointDeviations:
    """Standard deviations of a single joint, in place of those of all."""

    zero_std: float = _zero()
    tracking_std: float = _tracking()


@dataclass(frozen=True)
class KnownJointsConfig(JointDeviations):
    """How well the joints are known."""

    tracking_std: float = _tracking()
    joints: Mapping[str, Mapping[str, float]] = by_name(SingleJointDeviations, 'joint')


@dataclass(frozen=True)
class OdometryMountConfig:
    """How well it is known where on the base the odometry is mounted."""

    position_std: float = mount_position()
    orientation_std: float = mount_orientation()


@dataclass(frozen=True)
class OdometryConfig:
    """What the odometry may read wrong beside its noise, the same all the time."""

    scale_std: float = parameter(
        0.0,
        'Relative standard deviation of the lengths that it reads, as of a camera whose baseline is not quite as it is '
        'believed; 0 is exact.',
        minimum=0.0,
        maximum=0.1,
    )
    angular_velocity_bias_std: float = parameter(
        1e-4,
        'Standard deviation of a constant that its angular velocity has too much about each axis of the base, as the '
        'bias of a gyro that it is taken from: 10 deg/h are 5e-5 rad/s; 0 is exact.',
        unit='rad/s',
        minimum=0.0,
    )


@dataclass(frozen=True)
class TargetPriorConfig:
    """What is known of the target link, with all that it holds, beforehand."""

    mass: float = parameter(0.0, 'Its mass, where that is known.', unit='kg', minimum=0.0)
    mass_std: float = parameter(
        0.0, 'Standard deviation of that mass; 0 means that nothing is known of it.', unit='kg', minimum=0.0
    )
    com: tuple[float, ...] = parameter(
        (), "Its centre of mass in the link's frame, where that is known.", unit='m', lengths=(0, 3)
    )
    com_std: float = parameter(
        0.0,
        'Standard deviation of each coordinate of that, which takes mass_std too; 0 means that nothing is known of it.',
        unit='m',
        minimum=0.0,
    )
