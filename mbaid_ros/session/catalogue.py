"""The lists of all that the estimator takes into account: unknowns, hypotheses, and causes of a contradicted run.

A new one is a class or a function beside its kin, with its words, and a line here. Orders count: that of the unknowns
is the state's, and of causes that explain a run equally well the first is named first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from mbaid_ros.config.estimator_parameters import EXACT, EstimatorConfig
from mbaid_ros.core.clocks import (
    clock_drift,
    declared_drift,
    declared_offset,
    joints_stamped_late,
    position_late,
    time_offset,
)
from mbaid_ros.core.contracts import (
    UNDISTURBED,
    Convention,
    ConventionFactory,
    Hypothesis,
    Instrument,
    NamedSensor,
    PlacedFrame,
    Unknown,
    uncertain,
)
from mbaid_ros.core.forces import (
    BODY_FORCE,
    INERTIAL_FORCES,
    declared_disturbances,
    declared_thrusters,
    drifting_momentum,
)
from mbaid_ros.core.gyro import (
    GyroSensor,
    declared_gyro,
    declared_gyros,
    drifting_gyro,
    gyro_inputs,
    gyro_instruments,
    gyro_sensors,
)
from mbaid_ros.core.joints.faults import joints_in_degrees, reversed_joints, swapped_joints
from mbaid_ros.core.joints.model import (
    SUSPECTED_LAG,
    declared_gears,
    declared_lags,
    declared_placements,
    declared_tracking,
    joint_lags,
    joint_placements,
    suspected_gears,
)
from mbaid_ros.core.links import (
    declared_errors,
    densities,
    independent_errors,
    known_bodies,
    mistaken_masses,
    mistaken_tensors,
)
from mbaid_ros.core.odometry.faults import axis_conventions, inverted_marker, mistaken_poses
from mbaid_ros.core.odometry.model import (
    LATE,
    TwistLate,
    declared_mount,
    declared_scale,
    declared_turning,
    declared_twist_bias,
    drifting_position,
    marker_frame,
    odometry_mount,
    odometry_scale,
    odometry_turning,
    poses_beside_others,
    twist_bias,
)
from mbaid_ros.core.orbit import declared_gravity, declared_orbit_shape
from mbaid_ros.core.passive import declared_springs
from mbaid_ros.core.poses import (
    PoseSensor,
    declared_poses,
    pose_drift,
    pose_inputs,
    pose_instruments,
    pose_sensors,
)
from mbaid_ros.core.repair import Repair, Setting
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import BaseStream, Input
from mbaid_ros.core.state import Declared
from mbaid_ros.core.target import declared_linear_momentum, declared_target, other_targets
from mbaid_ros.core.wheels import declared_wheels
from mbaid_ros.parameters import build, values_of

# Standard deviations of values set as exact, where a contradicted run is tried without them: s, rad or m; of a link.
_EXACT, _EXACT_LINK = 2e-5, 1e-4
_EXACT_MASS = 2e-4  # relative, of a link that is heavier throughout: a thousand times as much is a plausible error
# Cause and warning of a contradicted run in which nothing may deviate.
EXACT_ROBOT = (
    'by its parameters the robot is exactly its URDF, as only a simulated one is: leave known_links, known_joints and '
    'odometry_mount at their defaults, or set its uncertainty'
)


def unknowns(config: EstimatorConfig, kernel: MomentumKernel) -> tuple[Unknown, ...]:
    """Return all unknowns of the nominal model but the exact ones; those that are only read come last.

    Raises ModelError, ParameterError: The parameters name what the robot has not, or contradict each other.

    Parameters
    ----------
    kernel : of the robot, with the errors of its known bodies
    """
    model, located, odometry = kernel.model, config.located, config.by_odometry
    of_target = [link.name for link in kernel.unknown]
    gyros = declared_gyros(config.imu, config.gyros)
    return uncertain(
        known_bodies(model, kernel.errors, kernel.known, of_target),
        declared_placements(config.known_joints, kernel),
        declared_wheels(config.wheels, kernel),
        *declared_thrusters(config.thrust, model),
        declared_tracking(config.known_joints, model),
        declared_lags(config.known_joints, model),
        declared_gears(config.known_joints, model),
        *declared_springs(config.flexible, kernel),
        declared_mount(config.odometry_mount, located=odometry),
        *(declared_gyro(gyros[each.name], each, among=len(gyros) > 1) for each in _gyro_sensors(config, model)),
        *declared_poses(config.poses),
        declared_offset(config.time_offset, jointed=model.joints > 0),
        declared_drift(config.time_offset, jointed=model.joints > 0),
        declared_scale(
            config.odometry, located=odometry, from_world=any(each.same_world for each in config.poses.used.values())
        ),
        declared_twist_bias(config.odometry, located=odometry),
        declared_turning(config.odometry, located=odometry),
        declared_gravity(config.orbit, located=located),
        *declared_disturbances(config.disturbance, config.orbit, config.window, located=located),
        *declared_orbit_shape(config.orbit),
    )


def inputs(config: EstimatorConfig) -> dict[str, Input]:
    """Return the topics of named sensors in use, by the names of their parameters.

    Raises ParameterError: A name cannot be used.
    """
    return gyro_inputs(config.imu, config.gyros) | pose_inputs(config.poses)


def _gyro_sensors(config: EstimatorConfig, model: RobotModel) -> tuple[GyroSensor, ...]:
    gyros = declared_gyros(config.imu, config.gyros)
    return gyro_sensors(gyros, model, config.frame_prefix, config.flexible.joints)


def sensors(config: EstimatorConfig, model: RobotModel) -> tuple[NamedSensor, ...]:
    """Return what measures the base's motion beside encoders and odometry.

    Raises ParameterError: A sensor cannot be where the parameters place it.
    """
    further = pose_sensors(config.poses, model, config.frame_prefix, config.flexible.joints)
    return (*_gyro_sensors(config, model), *further)


def instruments(
    config: EstimatorConfig, model: RobotModel, view: Callable[[BaseStream], BaseStream] | None = None
) -> dict[str, Instrument]:
    """Return the same sensors from their messages on, by the names of their parameters.

    Parameters
    ----------
    view : from the odometry to the frame in which it is used; None: as it is
    """
    gap, prefix = round(config.maximum_gap * 1e9), config.frame_prefix
    gyros, noise = declared_gyros(config.imu, config.gyros), config.noise.declared.base_orientation
    found = (
        *gyro_instruments(gyros, _gyro_sensors(config, model), model, prefix, noise, gap),
        *pose_instruments(config.poses, model, prefix, gap, view, config.flexible.joints),
    )
    return {each.sensor.name: each for each in found}


def declaration(config: EstimatorConfig, kernel: MomentumKernel) -> Declared:
    """Return the unknowns of a kernel's robot, and the priors of all else.

    Raises ModelError, ParameterError: As of `unknowns`; or half of a prior is missing.
    """
    return Declared(
        unknowns(config, kernel),
        target=declared_target(config.target_prior),
        linear_momentum=declared_linear_momentum(config.momentum, located=config.located),
        marker=marker_frame(config.marker),
        sensors=sensors(config, kernel.model),
        odometry=not config.poses.alone,
    )


def hypotheses(known_mass: float, position_std: float, constant: str, *, adapt: bool) -> tuple[Hypothesis, ...]:
    """Return the hypotheses of a run; the first is the one to beat.

    Parameters
    ----------
    known_mass : kg, of the known bodies
    position_std : m, of one reading of the base's position
    constant : axes of a force that is taken to act, wherever, or none; there are no other hypotheses then
    adapt : whether others than the first are followed
    """
    if constant != 'none':
        return (BODY_FORCE,) if constant == 'body' else INERTIAL_FORCES
    if not adapt:
        return (UNDISTURBED,)
    return (
        UNDISTURBED,
        *INERTIAL_FORCES,
        BODY_FORCE,
        drifting_momentum(known_mass),
        drifting_position(position_std),
    )


def suspects(kernel: MomentumKernel, sensors: Sequence[NamedSensor] = ()) -> tuple[Unknown, ...]:
    """Return the unknowns that a contradicted run is tried with, beside its own, and those of named sensors.

    Their standard deviations are too small to matter, a thousandth of a plausible value. Exact declarations are
    among them.
    """
    model, of_target = kernel.model, [link.name for link in kernel.unknown]
    each = np.full(model.joints, _EXACT)
    return (
        known_bodies(model, independent_errors(kernel.known, _EXACT_LINK), kernel.known, of_target),
        densities(model, kernel.known, _EXACT_MASS, of_target),
        joint_placements(kernel, *(each.tolist(),) * 3),
        odometry_mount(_EXACT, _EXACT),
        time_offset(_EXACT),
        odometry_scale(5e-5),
        odometry_turning(3e-6),
        clock_drift(1e-6),
        TwistLate(np.array([[3e-4]]), (LATE,)),
        position_late(1e-4),
        twist_bias(1e-5, 0.0),
        twist_bias(0.0, 1e-4),
        suspected_gears(model),
        joint_lags(model.joint_names, [SUSPECTED_LAG] * model.joints, model.transmission),
        *((poses_beside_others(1e-4, 1e-6),) if sensors else ()),
        *(drifting_gyro(sensor.name, 1e-7) for sensor in sensors if isinstance(sensor, GyroSensor)),
        *(
            pose_drift(sensor.name.partition('.')[2], sensor.measures, 3e-7, 3e-6)
            for sensor in sensors
            if isinstance(sensor, PoseSensor)
        ),
    )


def is_exact(config: EstimatorConfig, kernel: MomentumKernel) -> bool:
    """Return whether nothing of a robot is declared uncertain."""
    return not any(each.calibrated for each in unknowns(config, kernel))


def inexact_robot(kernel: MomentumKernel, config: EstimatorConfig) -> Iterator[Convention]:
    """Yield, of a robot that is declared to be exactly its URDF, that it deviates as robots do by default."""
    if not is_exact(config, kernel):
        return
    names = [name for name in EXACT if name.partition('.')[0] in {'known_links', 'known_joints', 'odometry_mount'}]
    usual = values_of(EstimatorConfig())
    parameters: dict[str, Setting] = {name: usual[name] for name in names}
    deviating = build(EstimatorConfig, values_of(config) | parameters)
    uncertain_kernel = kernel.with_errors(declared_errors(kernel, deviating.known_links))
    rest = tuple(each for each in unknowns(deviating, uncertain_kernel) if each.calibrated)
    repair = Repair('the robot deviates from its URDF', parameters)
    yield Convention(EXACT_ROBOT, kernel, misfit_left=np.inf, repair=repair, rest=rest)


def conventions(marker: PlacedFrame | None) -> tuple[ConventionFactory, ...]:
    """Return what a driver or a robot description may have mistaken; `marker` if one is declared."""
    return (
        reversed_joints,
        swapped_joints,
        joints_stamped_late,
        joints_in_degrees,
        mistaken_poses,
        other_targets,
        mistaken_masses,
        mistaken_tensors,
        partial(inverted_marker, marker=marker),
        partial(axis_conventions, marker=marker),
    )
