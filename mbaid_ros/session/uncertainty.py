"""From parameters to how uncertain the known side is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import KnownJointsConfig, TargetPriorConfig
from mbaid_ros.core.errors import ParameterError, listing
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.unknowns.bodies import TargetPrior
from mbaid_ros.core.unknowns.catalogue import Uncertainty
from mbaid_ros.core.unknowns.sensors import GyroErrors
from mbaid_ros.session.environment import spin_deviations, uncertain_circle, uncertain_thrusters
from mbaid_ros.session.frames import imu_link

_NO_MOMENTUM = 1e-9  # N s


def declared_uncertainty(config: EstimatorConfig, model: RobotModel) -> Uncertainty:
    """Return what the parameters declare of joints, mount, wheels, stamps, target and momentum.

    Raises
    ------
    ParameterError
        A name is not that of a joint, or half of a prior is missing.
    """
    mount = config.odometry_mount
    zeros, origins, axes = (
        _of_joints(config.known_joints, part, model) for part in ('zero_std', 'origin_std', 'axis_std')
    )
    uncertainty = with_surroundings(config, model, (zeros, origins, axes), (mount.position_std, mount.orientation_std))
    orbit = 0.0 if config.imu.alone or config.orbit.mean_motion > 0.0 else config.orbit.undeclared_rate
    return replace(uncertainty, target=_prior(config.target_prior), orbit=orbit, circle=uncertain_circle(config.orbit))


def with_surroundings(
    config: EstimatorConfig,
    model: RobotModel,
    joints: tuple[Sequence[float], Sequence[float], Sequence[float]],
    mount: tuple[float, float],
) -> Uncertainty:
    """Return how uncertain joints and mount are, and what is declared of wheels, thrusters, stamps and momentum.

    Parameters
    ----------
    config : EstimatorConfig
    model : RobotModel
    joints : (n,) standard deviations of zeros, origins and axes
    mount : m and rad, of the odometry's mount
    """
    position, orientation = mount
    alone = config.imu.alone  # then nothing else is mounted anywhere, and the frame has no momentum
    return Uncertainty(
        *joints,
        mount_position=0.0 if alone else position,
        mount_orientation=0.0 if alone else orientation,
        spin_inertias=spin_deviations(config.wheels),
        thrusters=uncertain_thrusters(config.thrust, model),
        thrust_scale=config.thrust.scale_std,
        thrust_direction=config.thrust.direction_std,
        thrust_delay=config.thrust.delay_std,
        time_offset=config.time_offset.prior_std if config.time_offset.estimate else 0.0,
        linear_momentum=_NO_MOMENTUM if alone else config.momentum.linear_prior_std,
        gyro=_gyro(config, model),
        clock_drift=config.time_offset.drift_std if config.time_offset.estimate else 0.0,
        odometry_scale=0.0 if alone else config.odometry.scale_std,
        twist_bias=0.0 if alone else config.odometry.angular_velocity_bias_std,
        torque=config.disturbance.torque_std,
        tracking=_of_joints(config.known_joints, 'tracking_std', model),
        tracking_time=_of_joints(config.known_joints, 'tracking_time', model),
    )


def _gyro(config: EstimatorConfig, model: RobotModel) -> GyroErrors | None:
    imu = config.imu
    if imu.noise_density == 0.0:
        return None
    # Alone, it is as late as the joints are early.
    delay = 0.0 if imu.alone else imu.delay_std
    errors = GyroErrors(imu.bias_std, imu.scale_std, imu.orientation_std, delay, imu.bias_walk, imu.cross_axis_std)
    alone = imu.alone and not imu.orientation
    return replace(errors, alone=alone, with_orientation=imu.orientation, link=imu_link(config, model))


def _of_joints(config: KnownJointsConfig, part: str, model: RobotModel) -> tuple[float, ...]:
    """Return a parameter of each joint, the standard deviation of its zero, say: its own, or that of all."""
    foreign = [name for name in config.joints if name not in model.joint_names]
    if foreign:
        raise ParameterError(
            f"parameter 'known_joints.{foreign[0][:60]}' is of no joint; accepted: {listing(model.joint_names)}"
        )
    every = getattr(config, part)
    return tuple(config.joints.get(name, {}).get(part, every) for name in model.joint_names)


def _prior(config: TargetPriorConfig) -> TargetPrior:
    if config.mass_std > 0.0 and config.mass == 0.0:
        raise ParameterError(
            f"parameter 'target_prior.mass_std' is {config.mass_std:g} kg without 'target_prior.mass'; accepted: both"
        )
    if config.mass > 0.0 and config.mass_std == 0.0:
        raise ParameterError(
            f"parameter 'target_prior.mass' is {config.mass:g} kg without 'target_prior.mass_std'; accepted: both"
        )
    if config.com and config.com_std == 0.0:
        raise ParameterError(
            f"parameter 'target_prior.com' is {[*config.com]} m without 'target_prior.com_std'; accepted: both"
        )
    missing = [name for name in ('com', 'mass_std') if not getattr(config, name)]
    if config.com_std > 0.0 and missing:
        raise ParameterError(
            f"parameter 'target_prior.com_std' is {config.com_std:g} m without 'target_prior.{missing[0]}'; accepted: "
            'with the centre of mass, and the mass that it is the centre of'
        )
    return TargetPrior(config.mass, config.mass_std, config.com, config.com_std)
