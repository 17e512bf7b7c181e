"""From parameters and a robot to the core's settings: frames, orbit, stored momentum, and the robot's uncertainty."""

from __future__ import annotations

from typing import cast

import numpy as np

from mbaid_ros.config.environment import OrbitConfig, WheelsConfig, make_orbit, make_storage
from mbaid_ros.config.estimator import DisturbanceConfig, EstimatorConfig, MarkerConfig, ThrustConfig
from mbaid_ros.config.model_errors import FlexibleConfig, KnownJointsConfig, TargetPriorConfig
from mbaid_ros.config.sensors import ImuConfig
from mbaid_ros.core.errors import ParameterError, listing
from mbaid_ros.core.geometry import rotation_from_quaternion
from mbaid_ros.core.robot.kinematics import Kinematics, Springs
from mbaid_ros.core.robot.model import Link, RobotModel
from mbaid_ros.core.robot.momentum import Storage
from mbaid_ros.core.robot.orbit import FallingFrame
from mbaid_ros.core.sensors.base import AttachedFrame
from mbaid_ros.core.unknowns.bodies import TargetPrior
from mbaid_ros.core.unknowns.catalogue import Uncertainty
from mbaid_ros.core.unknowns.environment import Circle, DisturbanceAxes, DisturbanceModel
from mbaid_ros.core.unknowns.sensors import GyroErrors
from mbaid_ros.messages.imu import ImuReader

_UNIT = 1e-3  # largest difference of a quaternion parameter from unit length
_NO_MOMENTUM = 1e-9  # N s
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


# Uncertainty


def declared_uncertainty(config: EstimatorConfig, model: RobotModel) -> Uncertainty:
    """Return the declared uncertainty of joints, mount, wheels, thrusters, stamps, target, momentum and orbit.

    Raises ParameterError: A name is not that of a joint, or half of a prior is missing.
    """
    joints, mount = config.known_joints, config.odometry_mount
    alone = config.imu.alone  # without odometry there is no mount, and the frame has no momentum
    tracking = joint_values(joints, 'tracking_std', model)
    passive = config.flexible.passive(model.joint_names).values()
    return Uncertainty(
        zeros=joint_values(joints, 'zero_std', model),
        origins=joint_values(joints, 'origin_std', model),
        axes=joint_values(joints, 'axis_std', model),
        mount_position=0.0 if alone else mount.position_std,
        mount_orientation=0.0 if alone else mount.orientation_std,
        marker=marker_frame(config.marker),
        spin_inertias=_spin_deviations(config.wheels),
        thrusters=uncertain_thrusters(config.thrust, model),
        thrust_scale=config.thrust.scale_std,
        thrust_direction=config.thrust.direction_std,
        thrust_delay=config.thrust.delay_std,
        time_offset=config.time_offset.prior_std if config.time_offset.estimate else 0.0,
        linear_momentum=_NO_MOMENTUM if alone else config.momentum.linear_prior_std,
        gyro=_gyro(config.imu, model, config.target_link, config.frame_prefix),
        clock_drift=config.time_offset.drift_std if config.time_offset.estimate else 0.0,
        odometry_scale=0.0 if alone else config.odometry.scale_std,
        twist_bias=0.0 if alone else config.odometry.angular_velocity_bias_std,
        torque=_pushing(config.disturbance, 'torque', config.orbit, config.window),
        force=DisturbanceModel() if alone else _pushing(config.disturbance, 'force', config.orbit, config.window),
        tracking=tracking,
        tracking_time=(_TRACKING_TIME,) * len(tracking),
        spring_frequency=[joint.frequency_relative_std for joint in passive],
        spring_ratio=[joint.damping_std for joint in passive],
        spring_start=[joint.initial_std for joint in passive],
        spring_noise=[joint.disturbance_std for joint in passive],
        target=_target_prior(config.target_prior),
        orbit=0.0 if alone or config.orbit.mean_motion > 0.0 else config.orbit.undeclared_rate,
        circle=_uncertain_circle(config.orbit),
    )


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


def _gyro(imu: ImuConfig, model: RobotModel, target_link: str, frame_prefix: str) -> GyroErrors | None:
    if imu.noise_density == 0.0:
        return None
    return GyroErrors(
        imu.bias_std,
        imu.scale_std,
        imu.orientation_std,
        0.0 if imu.alone else _IMU_DELAY_STD,  # alone, its delay is the joints' time offset
        imu.bias_walk,
        imu.cross_axis_std,
        alone=imu.alone and not imu.orientation,
        with_orientation=imu.orientation,
        link=imu_link(imu, model, target_link, frame_prefix),
    )


def joint_values(config: KnownJointsConfig, part: str, model: RobotModel) -> tuple[float, ...]:
    """Return a parameter of each joint: the joint's own, or that of all."""
    foreign = [name for name in config.joints if name not in model.joint_names]
    if foreign:
        raise ParameterError(
            f"parameter 'known_joints.{foreign[0][:60]}' is of no joint; accepted: {listing(model.joint_names)}"
        )
    every = getattr(config, part)
    return tuple(config.joints.get(name, {}).get(part, every) for name in model.joint_names)


def _target_prior(config: TargetPriorConfig) -> TargetPrior:
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
