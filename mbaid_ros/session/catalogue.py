"""The lists of all that the estimator takes into account: unknowns, hypotheses, and causes of a contradicted run.

A new one is a class or a function beside its kin, with its words, and a line here. Orders count: that of the unknowns
is the state's, and of causes that explain a run equally well the first is named first.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.diagnosis.conventions import (
    ConventionFactory,
    axis_conventions,
    inverted_marker,
    joints_in_degrees,
    joints_stamped_late,
    mistaken_masses,
    mistaken_poses,
    other_targets,
    reversed_joints,
    swapped_joints,
)
from mbaid_ros.core.filter.bank import BODY_FORCE, INERTIAL_FORCES, drifting_momentum, drifting_position
from mbaid_ros.core.filter.state import Declared
from mbaid_ros.core.filter.time_update import UNDISTURBED, Hypothesis
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import Link, RobotModel
from mbaid_ros.core.unknowns.base import LATE, TURNING, OdometryTurning, TwistLate, odometry_scale, twist_bias
from mbaid_ros.core.unknowns.bodies import known_bodies
from mbaid_ros.core.unknowns.declaration import PlacedFrame, Unknown, uncertain
from mbaid_ros.core.unknowns.joints import geared_joints
from mbaid_ros.core.unknowns.sensors import clock_drift
from mbaid_ros.session.settings import (
    declared_disturbances,
    declared_drift,
    declared_gravity,
    declared_gyro,
    declared_linear_momentum,
    declared_mount,
    declared_offset,
    declared_orbit_shape,
    declared_placements,
    declared_scale,
    declared_springs,
    declared_target,
    declared_thrusters,
    declared_tracking,
    declared_twist_bias,
    declared_wheels,
    imu_link,
    marker_frame,
)


def unknowns(config: EstimatorConfig, kernel: MomentumKernel, imu: Link | None) -> tuple[Unknown, ...]:
    """Return all unknowns of the nominal model but the exact ones; those that are only read come last.

    Raises ModelError, ParameterError: The parameters name what the robot has not, or contradict each other.

    Parameters
    ----------
    kernel : of the robot, with the errors of its known bodies
    imu : the link that an IMU is on, where joints move it
    """
    model, located = kernel.model, not config.imu.alone
    return uncertain(
        known_bodies(model, kernel.errors),
        declared_placements(config.known_joints, kernel),
        declared_wheels(config.wheels, kernel),
        declared_thrusters(config.thrust, model),
        declared_tracking(config.known_joints, model),
        *declared_springs(config.flexible, kernel),
        declared_mount(config.odometry_mount, located=located),
        declared_gyro(config.imu, imu),
        declared_offset(config.time_offset),
        declared_drift(config.time_offset),
        declared_scale(config.odometry, located=located),
        declared_twist_bias(config.odometry, located=located),
        declared_gravity(config.orbit, located=located),
        *declared_disturbances(config.disturbance, config.orbit, config.window, located=located),
        *declared_orbit_shape(config.orbit),
    )


def declaration(config: EstimatorConfig, kernel: MomentumKernel) -> Declared:
    """Return the unknowns of a kernel's robot, and the priors of all else.

    Raises ModelError, ParameterError: As of `unknowns`; or half of a prior is missing.
    """
    imu = None
    if config.imu.noise_density > 0.0:
        imu = imu_link(config.imu, kernel.model, config.target_link, config.frame_prefix)
    return Declared(
        unknowns(config, kernel, imu),
        target=declared_target(config.target_prior),
        linear_momentum=declared_linear_momentum(config.momentum, located=not config.imu.alone),
        marker=marker_frame(config.marker),
        imu=imu,
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


def suspects(model: RobotModel) -> tuple[Unknown, ...]:
    """Return the unknowns that a contradicted run is tried with, beside its own.

    Their standard deviations are too small to matter, a thousandth of a plausible value.
    """
    return (
        odometry_scale(5e-5),
        OdometryTurning(3e-6 * np.eye(3), (TURNING,) * 3),
        clock_drift(1e-6),
        TwistLate(np.array([[3e-4]]), (LATE,)),
        twist_bias(1e-5, 0.0),
        twist_bias(0.0, 1e-4),
        geared_joints(model.joint_names),
    )


def conventions(marker: PlacedFrame | None) -> tuple[ConventionFactory, ...]:
    """Return what a driver or a robot description may have mistaken, with a declared marker if there is one."""
    return (
        reversed_joints,
        swapped_joints,
        joints_stamped_late,
        joints_in_degrees,
        mistaken_poses,
        other_targets,
        mistaken_masses,
        partial(inverted_marker, marker=marker),
        partial(axis_conventions, marker=marker),
    )
