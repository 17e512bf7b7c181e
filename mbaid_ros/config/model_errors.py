"""The uncertainty of the robot description, the odometry and the target; and passive joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mbaid_ros.config.parameters import by_name, parameter
from mbaid_ros.core.errors import ParameterError, listing


@dataclass(frozen=True)
class _Zero:
    zero_std: float = parameter(1e-3, 'rad', minimum=0.0)
    """Standard deviation of every joint's zero, true minus measured position, constant; m for a prismatic joint. 0:
    exact."""


@dataclass(frozen=True)
class JointDeviations(_Zero):
    """Standard deviations of the joints."""

    origin_std: float = parameter(1e-3, 'm', minimum=0.0)
    """Standard deviation of each coordinate of every joint's origin; 0: exact."""
    axis_std: float = parameter(1e-3, 'rad', minimum=0.0)
    """Standard deviation of the tilt of every joint's axis, about each of two directions; 0: exact."""


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

    mass_relative_std: float = parameter(0.01, minimum=0.0, maximum=1.0)
    """Relative standard deviation of the mass of this link and everything fixed to it; the inertia scales with it."""
    com_std: float = parameter(0.01, 'm', minimum=0.0)
    """Standard deviation of each coordinate of the centre of mass of this link and everything fixed to it."""
    inertia_relative_std: float = parameter(0.01, minimum=0.0, maximum=1.0)
    """Standard deviation of each element of this link's inertia about the centre of mass at a given mass, relative to
    the mean moment."""


@dataclass(frozen=True)
class KnownLinksConfig:
    """The uncertainty of the known bodies."""

    relative_std: float = parameter(0.01, minimum=0.0, maximum=1.0)
    """Relative standard deviation of every known body: of a common factor of its inertial parameters, and of each
    parameter by itself; 0: exact."""
    total_mass: float = parameter(0.0, 'kg', minimum=0.0)
    """Mass of the whole robot without what it holds, if it was weighed; a known_links.calibration has it already. 0:
    unknown."""
    total_mass_std: float = parameter(0.0, 'kg', minimum=0.0)
    """Standard deviation of known_links.total_mass; 0: unknown."""
    calibration: str = parameter('')
    """JSON file of calibrate: its covariance of links, joints and mount replaces all else of known_links, the zeros,
    origins and axes of known_joints, and odometry_mount. It needs the URDF that calibrate wrote."""
    links: Mapping[str, Mapping[str, float]] = by_name(LinkDeviations, 'link')


@dataclass(frozen=True)
class _Tracking:
    tracking_std: float = parameter(0.0, 'rad', minimum=0.0)
    """Standard deviation of the tracking error of every joint, for joint states that hold commands: true minus
    commanded position, a Gauss-Markov process of 2 s; m for a prismatic joint; 0: none."""


@dataclass(frozen=True)
class SingleJointDeviations(_Tracking, _Zero):
    """Standard deviations of a single joint, in place of those of all."""


@dataclass(frozen=True)
class KnownJointsConfig(_Tracking, JointDeviations):
    """The uncertainty of the joints."""

    joints: Mapping[str, Mapping[str, float]] = by_name(SingleJointDeviations, 'joint')


@dataclass(frozen=True)
class OdometryMountConfig:
    """The uncertainty of the mount of the odometry on the base."""

    position_std: float = parameter(2e-3, 'm', minimum=0.0)
    """Standard deviation of each coordinate of the base link's origin in the frame that the odometry locates; 0:
    exact."""
    orientation_std: float = parameter(2e-3, 'rad', minimum=0.0)
    """Standard deviation of the base link's orientation in that frame, about each axis; 0: exact."""


@dataclass(frozen=True)
class OdometryConfig:
    """Constant errors of the odometry, beside its noise."""

    scale_std: float = parameter(0.0, minimum=0.0, maximum=0.1)
    """Relative standard deviation of the odometry's length scale, as from the baseline of a stereo camera; 0: exact."""
    angular_velocity_bias_std: float = parameter(1e-4, 'rad/s', minimum=0.0)
    """Standard deviation of the bias of the odometry's angular velocity about each axis of the base, if a gyro measures
    it: 10 deg/h are 5e-5 rad/s; 0: exact."""


@dataclass(frozen=True)
class TargetPriorConfig:
    """The prior of the target link with everything it holds."""

    mass: float = parameter(0.0, 'kg', minimum=0.0)
    """Mass of the target link, if known."""
    mass_std: float = parameter(0.0, 'kg', minimum=0.0)
    """Standard deviation of the target's mass; 0: unknown."""
    com: tuple[float, ...] = parameter((), 'm', lengths=(0, 3))
    """Centre of mass of the target link in its frame, if known."""
    com_std: float = parameter(0.0, 'm', minimum=0.0)
    """Standard deviation of each coordinate of target_prior.com; needs mass_std too; 0: unknown."""


@dataclass(frozen=True)
class PassiveJointConfig:
    """Spring and damper of a single passive joint, which act towards its zero."""

    frequency: float = parameter(0.0, 'Hz', minimum=0.0, maximum=1e3)
    """Natural frequency of this joint with everything else held still (cantilever); required for every joint of
    flexible.joints."""
    frequency_relative_std: float = parameter(0.05, minimum=0.0, maximum=0.5)
    """Relative standard deviation of the natural frequency; 0: exact."""
    damping: float = parameter(0.01, minimum=0.0, maximum=1.0)
    """Damping ratio, a fraction of critical."""
    damping_std: float = parameter(0.01, minimum=0.0, maximum=1.0)
    """Standard deviation of the damping ratio; 0: exact."""
    initial_std: float = parameter(0.05, 'rad', minimum=0.0)
    """Standard deviation of the deflection at the start (m for a prismatic joint); that of the rate follows from the
    frequency. 0: at rest at zero."""
    disturbance_std: float = parameter(1e-4, 'rad', minimum=0.0)
    """Standard deviation of an unmodelled deflection (m for a prismatic joint), as from a nonlinear spring or encoder
    noise. 0: none."""


@dataclass(frozen=True)
class FlexibleConfig:
    """Passive joints."""

    joints: tuple[str, ...] = parameter(())
    """Joints of the URDF that a spring holds and no JointState reports: panels, booms, propellant, a grasp that
    gives."""
    each: Mapping[str, Mapping[str, float]] = by_name(PassiveJointConfig, 'joint')

    def passive(self, joint_names: tuple[str, ...]) -> dict[str, PassiveJointConfig]:
        """Return the passive joints by their names.

        Raises ParameterError: A name is no joint's, or a joint has no frequency.
        """
        for name in self.joints:
            if name not in joint_names or self.joints.count(name) > 1:
                raise ParameterError(
                    f"parameter 'flexible.joints' has '{name[:60]}'; accepted: {listing(joint_names)}, each once"
                )
        foreign = [name for name in self.each if name not in self.joints]
        if foreign:
            raise ParameterError(
                f"parameter 'flexible.{foreign[0][:60]}' is of no joint in 'flexible.joints'; accepted: "
                f'{listing(self.joints) or "none"}'
            )
        found = {name: PassiveJointConfig(**self.each.get(name, {})) for name in self.joints}
        still = [name for name, joint in found.items() if joint.frequency == 0.0]
        if still:
            raise ParameterError(f"parameter 'flexible.{still[0]}.frequency' is 0 Hz; accepted: above 0")
        return found
