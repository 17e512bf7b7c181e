"""From groups of parameters and a robot to the core's settings: frames, orbit, stored momentum, and each unknown."""

from __future__ import annotations

from typing import cast

import numpy as np

from mbaid_ros.config.environment import OrbitConfig, WheelsConfig, make_orbit, make_storage
from mbaid_ros.config.estimator import DisturbanceConfig, MarkerConfig, MomentumConfig, ThrustConfig, TimeOffsetConfig
from mbaid_ros.config.model_errors import (
    FlexibleConfig,
    KnownJointsConfig,
    OdometryConfig,
    OdometryMountConfig,
    TargetPriorConfig,
)
from mbaid_ros.config.sensors import ImuConfig
from mbaid_ros.core.errors import ParameterError, listing
from mbaid_ros.core.geometry import rotation_from_quaternion
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.kinematics import Kinematics, Springs
from mbaid_ros.core.robot.model import Link, RobotModel
from mbaid_ros.core.robot.momentum import Storage
from mbaid_ros.core.robot.orbit import FallingFrame
from mbaid_ros.core.sensors.base import AttachedFrame
from mbaid_ros.core.unknowns.base import (
    OdometryMount,
    OdometryScale,
    TwistBias,
    odometry_mount,
    odometry_scale,
    twist_bias,
)
from mbaid_ros.core.unknowns.bodies import SpinInertias, TargetPrior, spin_inertias
from mbaid_ros.core.unknowns.declaration import Unknown
from mbaid_ros.core.unknowns.environment import (
    Circle,
    DisturbanceAxes,
    DisturbanceModel,
    ExternalForce,
    ExternalTorque,
    Gravity,
    OrbitShape,
    Thrusters,
    disturbances,
    gravity,
    orbit_shape,
    thrusters,
)
from mbaid_ros.core.unknowns.flexible import spring_errors, starting_swing, swing_noise
from mbaid_ros.core.unknowns.joints import JointPlacements, JointTracking, joint_placements, joint_tracking
from mbaid_ros.core.unknowns.sensors import (
    ClockDrift,
    Gyro,
    GyroErrors,
    TimeOffset,
    clock_drift,
    gyro,
    time_offset,
)
from mbaid_ros.messages.imu import ImuReader

_UNIT = 1e-3  # largest difference of a quaternion parameter from unit length
_NO_MOMENTUM = 1e-9  # N s, of a frame that nothing locates: it moves with the common centre of mass
_IMU_DELAY_STD = 5e-3  # s, of stamps that a driver sets on arrival: half a period at 100 Hz
_WHEEL_SPEED_STD = 0.05  # rad/s, of tachometers and of Hall sensors: 0.5 rpm
_TRACKING_TIME = 2.0  # s, in which a servo's following error decorrelates: some periods of its slow loop


# Frames


def marker_frame(config: MarkerConfig) -> AttachedFrame | None:
    """Return the frame that the parameters place on the base.

    Raises ParameterError: The orientation is no unit quaternion.
    """
    quaternion = np.array(config.orientation)
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > _UNIT:
        raise ParameterError(
            f"parameter 'marker.orientation' has length {length:g}; accepted: a quaternion x, y, z, w of length 1"
        )
    if not config.position:
        return None
    return AttachedFrame(rotation_from_quaternion(quaternion), np.array(config.position))


def imu_link(config: ImuConfig, model: RobotModel, target_link: str, frame_prefix: str) -> Link | None:
    """Return the link of an IMU that joints move; None on the base.

    Raises ParameterError: There is no such link, or it moves with the target.

    Parameters
    ----------
    target_link : as of the parameters, the last link if empty
    frame_prefix : before the names of links in frame names
    """
    given, links = config.frame, {frame_prefix + link.name: link for link in model.links}
    if not given:
        return None
    target, ancestors = model.link(target_link or model.last_link).body, Kinematics(model).ancestors
    carried = [target > 0 and (body == target or bool(ancestors[body, target - 1])) for body in range(len(ancestors))]
    accepted = [name for name, link in links.items() if not carried[link.body] and not (config.alone and link.body)]
    if given not in accepted:
        why = ''
        if given in links:
            why = ', which moves with the target' if carried[links[given].body] else ", and 'imu.alone' is true"
        raise ParameterError(f"parameter 'imu.frame' is '{given}'{why}; accepted: {listing(accepted)}")
    return links[given] if links[given].body else None


def imu_reader(
    config: ImuConfig, model: RobotModel, target_link: str, frame_prefix: str, orientation_std: float
) -> ImuReader:
    """Return the reader of Imu messages: in base axes, or in those of a link that joints move.

    Raises ParameterError: The IMU cannot be on the frame that the parameters name.

    Parameters
    ----------
    target_link, frame_prefix : as of `imu_link`
    orientation_std : rad, of an orientation in messages without a covariance
    """
    axes = {frame_prefix + link.name: link.rotation for link in model.links if link.body == 0}
    if imu_link(config, model, target_link, frame_prefix) is not None:
        axes = {config.frame: np.eye(3)}
    return ImuReader(axes, config.frame, orientation_std if config.orientation else None)


# Environment


def falling_frame(config: OrbitConfig, model: RobotModel, *, located: bool = True) -> FallingFrame | None:
    """Return the transformation of odometry to the frame in free fall, None without an orbit.

    Raises ParameterError: The directions do not make an orbit.
    """
    orbit = make_orbit(config)
    if orbit is None:
        return None
    epoch = round(config.epoch * 1e9) if config.epoch > 0.0 else None
    return FallingFrame(orbit, model, relative_twist=config.twist == 'relative', epoch=epoch, located=located)


def uncertain_thrusters(config: ThrustConfig, model: RobotModel) -> tuple[str, ...]:
    """Return the frames of thrusters whose strength and direction are estimated.

    Raises ModelError, ParameterError: A frame is no link, or named twice.
    """
    if config.scale_std == config.direction_std == 0.0 and not config.frames:
        return ()
    if len(set(config.frames)) < len(config.frames):
        raise ParameterError(
            f"parameter 'thrust.frames' is {listing(config.frames)}; accepted: links of the robot, each once"
        )
    return tuple(model.link(name).name for name in config.frames or (model.base_link,))


def storage(config: WheelsConfig, model: RobotModel) -> Storage:
    """Return the momentum stored inside bodies: the wheels by name, then that of the topic stored_momentum.

    Raises ModelError, ParameterError: Names, axes and spin inertias differ in number, an axis is zero, or a name is a
    joint's or no link's.
    """
    wheels = make_storage(config.names, config.axes, config.spin_inertias, model, _WHEEL_SPEED_STD)
    if not config.momentum_frame:
        return wheels
    return wheels + Storage.from_published(model.link(config.momentum_frame), config.momentum_std)


def springs(config: FlexibleConfig, model: RobotModel) -> Springs:
    """Return the springs of passive joints as declared.

    Raises ParameterError: A name is no joint's, a joint has no frequency, or mimics another.
    """
    passive = config.passive(model.joint_names)
    followers = [name for name in passive if name not in model.independent_joints]
    if followers:
        raise ParameterError(
            f"parameter 'flexible.joints' has '{followers[0]}', which mimics another joint; accepted: "
            f'{listing(model.independent_joints)}'
        )
    return Springs(
        tuple(model.joint_names.index(name) for name in passive),
        2.0 * np.pi * np.array([joint.frequency for joint in passive.values()]),
        np.array([joint.damping for joint in passive.values()]),
        np.zeros((2, len(passive))),
    )


def _spin_deviations(config: WheelsConfig) -> tuple[float, ...]:
    """Return the standard deviation of each spin inertia, kg m^2; 0 for a published momentum, which has none."""
    wheels = (config.spin_inertia_relative_std * inertia for inertia in config.spin_inertias)
    return (*wheels, *((0.0,) * 3 if config.momentum_frame else ()))


# Unknowns, one function for each line of the catalogue


def declared_placements(config: KnownJointsConfig, kernel: MomentumKernel) -> JointPlacements:
    """Return the placements of the joints.

    Raises ParameterError: A name is not that of a joint.
    """
    parts = (joint_values(config, part, kernel.model) for part in ('zero_std', 'origin_std', 'axis_std'))
    return joint_placements(kernel, *parts)


def declared_wheels(config: WheelsConfig, kernel: MomentumKernel) -> SpinInertias:
    """Return the spin inertias of wheels."""
    return spin_inertias(kernel, _spin_deviations(config))


def declared_thrusters(config: ThrustConfig, model: RobotModel) -> Thrusters:
    """Return the thrusters.

    Raises ModelError, ParameterError: A frame is no link, or named twice.
    """
    return thrusters(uncertain_thrusters(config, model), config.scale_std, config.direction_std, config.delay_std)


def declared_tracking(config: KnownJointsConfig, model: RobotModel) -> JointTracking:
    """Return the deviations of the joints from their readings.

    Raises ParameterError: A name is not that of a joint.
    """
    deviations = joint_values(config, 'tracking_std', model)
    return joint_tracking(model.joint_names, deviations, (_TRACKING_TIME,) * len(deviations))


def declared_springs(config: FlexibleConfig, kernel: MomentumKernel) -> tuple[Unknown, ...]:
    """Return the springs of passive joints, how these swing at the start, and what else excites them."""
    own, passive = kernel.springs, config.passive(kernel.model.joint_names).values()
    if not own.count:
        return ()
    names = [kernel.model.joint_names[joint] for joint in own.joints]
    return (
        spring_errors(
            names, [joint.frequency_relative_std for joint in passive], [joint.damping_std for joint in passive]
        ),
        starting_swing(names, [joint.initial_std for joint in passive], own.frequency),
        swing_noise(names, [joint.disturbance_std for joint in passive], own.frequency, own.damping_ratio),
    )


def declared_mount(config: OdometryMountConfig, *, located: bool) -> OdometryMount:
    """Return the mount of the odometry, exact where nothing locates the base."""
    return odometry_mount(config.position_std, config.orientation_std) if located else odometry_mount(0.0, 0.0)


def declared_gyro(config: ImuConfig, link: Link | None) -> Gyro:
    """Return the errors of an IMU, on a link that joints move if there is one; exact without an IMU."""
    if config.noise_density == 0.0:
        return gyro(None)
    errors = GyroErrors(
        config.bias_std,
        config.scale_std,
        config.orientation_std,
        0.0 if config.alone else _IMU_DELAY_STD,  # alone, its delay is the joints' time offset
        config.bias_walk,
        config.cross_axis_std,
        alone=config.alone and not config.orientation,
        with_orientation=config.orientation,
        link=link,
    )
    return gyro(errors)


def declared_offset(config: TimeOffsetConfig) -> TimeOffset:
    """Return the offset of the joints' stamps."""
    return time_offset(config.prior_std if config.estimate else 0.0)


def declared_drift(config: TimeOffsetConfig) -> ClockDrift:
    """Return the drift of the joints' clock."""
    return clock_drift(config.drift_std if config.estimate else 0.0)


def declared_scale(config: OdometryConfig, *, located: bool) -> OdometryScale:
    """Return the scale of the odometry, exact where nothing locates the base."""
    return odometry_scale(config.scale_std if located else 0.0)


def declared_twist_bias(config: OdometryConfig, *, located: bool) -> TwistBias:
    """Return the bias of the odometry's angular velocity, exact where nothing locates the base."""
    return twist_bias(config.angular_velocity_bias_std if located else 0.0, 0.0)


def declared_gravity(config: OrbitConfig, *, located: bool) -> Gravity:
    """Return the gravity gradient of an orbit that may be there undeclared."""
    return gravity(config.undeclared_rate if located and config.mean_motion == 0.0 else 0.0)


def declared_disturbances(
    config: DisturbanceConfig, orbit: OrbitConfig, window: float, *, located: bool
) -> tuple[ExternalTorque, ExternalForce]:
    """Return a torque and a force from outside; no force where nothing locates the base.

    Raises ParameterError: They vary within a window (s), or have the axes of no orbit.
    """
    torque = _pushing(config, 'torque', orbit, window)
    return disturbances(torque, _pushing(config, 'force', orbit, window) if located else DisturbanceModel())


def declared_orbit_shape(config: OrbitConfig) -> tuple[OrbitShape, ...]:
    """Return the shape of the orbit; none where its eccentricity is declared, or there is no orbit."""
    circle = _uncertain_circle(config)
    return () if circle is None else (orbit_shape(circle),)


def _pushing(config: DisturbanceConfig, kind: str, declared: OrbitConfig, window: float) -> DisturbanceModel:
    """Return how a force or torque from outside varies; a time that windows cannot show, or no orbit, is refused."""
    deviation, time = getattr(config, f'{kind}_std'), getattr(config, f'{kind}_time')
    if 0.0 < time < window:
        raise ParameterError(
            f"parameter 'disturbance.{kind}_time' is {time:g} s; accepted: 0, or at least window, {window:g} s"
        )
    axes = cast('DisturbanceAxes', config.axes)
    orbit = make_orbit(declared) if axes == 'orbit' else None
    if axes == 'orbit' and (orbit is None or declared.epoch > 0.0):
        raise ParameterError(
            "parameter 'disturbance.axes' is 'orbit'; accepted with orbit.mean_motion above 0 and orbit.epoch 0"
        )
    return DisturbanceModel(deviation, time, axes, orbit)


def _uncertain_circle(config: OrbitConfig) -> Circle | None:
    """Return the orbit whose eccentricity is estimated; None where it is declared, or there is no orbit."""
    orbit = make_orbit(config)
    if orbit is None or config.eccentricity > 0.0 or config.epoch > 0.0 or config.undeclared_eccentricity == 0.0:
        return None
    return Circle(orbit, config.undeclared_eccentricity, config.twist == 'relative')


def joint_values(config: KnownJointsConfig, part: str, model: RobotModel) -> tuple[float, ...]:
    """Return a parameter of each joint: the joint's own, or that of all."""
    foreign = [name for name in config.joints if name not in model.joint_names]
    if foreign:
        raise ParameterError(
            f"parameter 'known_joints.{foreign[0][:60]}' is of no joint; accepted: {listing(model.joint_names)}"
        )
    every = getattr(config, part)
    return tuple(config.joints.get(name, {}).get(part, every) for name in model.joint_names)


def declared_linear_momentum(config: MomentumConfig, *, located: bool) -> float:
    """Return the standard deviation of the linear momentum, N s; 0 where nothing is known of it."""
    return config.linear_prior_std if located else _NO_MOMENTUM


def declared_target(config: TargetPriorConfig) -> TargetPrior:
    """Return the prior of the target; a value without its deviation, or the reverse, is refused."""
    given = {
        'mass': f'{config.mass:g} kg' if config.mass else '',
        'mass_std': f'{config.mass_std:g} kg' if config.mass_std else '',
        'com': f'{[*config.com]} m' if config.com else '',
        'com_std': f'{config.com_std:g} m' if config.com_std else '',
    }
    needs = ('mass', 'mass_std'), ('mass_std', 'mass'), ('com', 'com_std'), ('com_std', 'com'), ('com_std', 'mass_std')
    for name, other in needs:
        if given[name] and not given[other]:
            raise ParameterError(
                f"parameter 'target_prior.{name}' is {given[name]} without 'target_prior.{other}'; accepted: both"
            )
    return TargetPrior(config.mass, config.mass_std, config.com, config.com_std)
