"""The uncertainty of the robot description, the odometry and the target."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mbaid_ros.config.parameters import by_name, parameter


def _zero() -> float:
    return parameter(
        1e-3,
        "Standard deviation of every joint's zero, true less measured position, constant; m for a prismatic joint. 0: "
        'exact.',
        unit='rad',
        minimum=0.0,
    )


@dataclass(frozen=True)
class JointDeviations:
    """Standard deviations of the joints."""

    zero_std: float = _zero()
    origin_std: float = parameter(
        1e-3,
        "Standard deviation of each coordinate of every joint's origin; 0: exact.",
        unit='m',
        minimum=0.0,
    )
    axis_std: float = parameter(
        1e-3,
        "Standard deviation of the tilt of every joint's axis, about each of two directions; 0: exact.",
        unit='rad',
        minimum=0.0,
    )


def mount_position() -> float:
    """Return the parameter of where the odometry is mounted."""
    return parameter(
        2e-3,
        "Standard deviation of each coordinate of the base link's origin in the frame that the odometry locates; 0: "
        'exact.',
        unit='m',
        minimum=0.0,
    )


def mount_orientation() -> float:
    """Return the parameter of how the odometry is mounted."""
    return parameter(
        2e-3,
        "Standard deviation of the base link's orientation in that frame, about each axis; 0: exact.",
        unit='rad',
        minimum=0.0,
    )


# Parameters of a robot that is exactly its URDF and in no undeclared orbit, as only a simulated one is.
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
        'Relative standard deviation of the mass of this link and everything fixed to it; the inertia scales with it.',
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
    """The prior of the <inertial> of every link to calibrate: standard deviations."""

    mass_relative_std: float = parameter(0.05, 'Relative standard deviation of each mass; 0: unknown.', minimum=0.0)
    com_std: float = parameter(
        0.01,
        'Standard deviation of each coordinate of a centre of mass; 0: unknown.',
        unit='m',
        minimum=0.0,
    )
    inertia_relative_std: float = parameter(
        0.1,
        'Standard deviation of each element I_ij about the centre of mass at a given mass, relative to '
        'sqrt(I_ii I_jj); 0: unknown.',
        minimum=0.0,
    )


@dataclass(frozen=True)
class KnownLinksConfig:
    """The uncertainty of the known bodies."""

    relative_std: float = parameter(
        0.01,
        'Relative standard deviation of every known body: of a common factor of its inertial parameters, and of each '
        'parameter by itself; 0: exact.',
        minimum=0.0,
        maximum=1.0,
    )
    calibration: str = parameter(
        '',
        'JSON file of calibrate: its covariance of links, joints and mount replaces relative_std, the zeros, origins '
        'and axes of known_joints, and odometry_mount. It needs the URDF that calibrate wrote.',
    )
    links: Mapping[str, Mapping[str, float]] = by_name(LinkDeviations, 'link')


def _tracking() -> float:
    return parameter(
        0.0,
        'Standard deviation of the tracking error of every joint, for joint states that hold commands: true less '
        'commanded position, a Gauss-Markov process of 2 s; m for a prismatic joint; 0: none.',
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
    """The uncertainty of the joints."""

    tracking_std: float = _tracking()
    joints: Mapping[str, Mapping[str, float]] = by_name(SingleJointDeviations, 'joint')


@dataclass(frozen=True)
class OdometryMountConfig:
    """The uncertainty of the mount of the odometry on the base."""

    position_std: float = mount_position()
    orientation_std: float = mount_orientation()


@dataclass(frozen=True)
class OdometryConfig:
    """Constant errors of the odometry, beside its noise."""

    scale_std: float = parameter(
        0.0,
        'Relative standard deviation of its length scale, as from the baseline of a stereo camera; 0: exact.',
        minimum=0.0,
        maximum=0.1,
    )
    angular_velocity_bias_std: float = parameter(
        1e-4,
        'Standard deviation of the bias of its angular velocity about each axis of the base, if a gyro measures it: '
        '10 deg/h are 5e-5 rad/s; 0: exact.',
        unit='rad/s',
        minimum=0.0,
    )


@dataclass(frozen=True)
class TargetPriorConfig:
    """The prior of the target link with everything it holds."""

    mass: float = parameter(0.0, 'Mass of the target link, if known.', unit='kg', minimum=0.0)
    mass_std: float = parameter(0.0, 'Standard deviation of that mass; 0: unknown.', unit='kg', minimum=0.0)
    com: tuple[float, ...] = parameter(
        (), "Its centre of mass in the link's frame, if known.", unit='m', lengths=(0, 3)
    )
    com_std: float = parameter(
        0.0,
        'Standard deviation of each of its coordinates, which needs mass_std too; 0: unknown.',
        unit='m',
        minimum=0.0,
    )
