"""Each parameter reaches the core setting that it is documented to change; others are tested by what they change."""

from __future__ import annotations

import inspect
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core import clocks, forces, gyro, orbit, wheels
from mbaid_ros.core.forces import DisturbanceModel
from mbaid_ros.core.odometry import model as odometry
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.wheels import storage
from mbaid_ros.parameters import build
from mbaid_ros.session import catalogue, methods, session
from mbaid_ros.session.methods import make_reporting
from mbaid_ros.session.planning import plan_settings
from mbaid_ros.session.session import Session
from simulated import robot
from streams import urdf

ORBIT = {'orbit.mean_motion': 1e-3, 'orbit.nadir': [0.0, 0.0, -1.0], 'orbit.normal': [0.0, 1.0, 0.0]}
LVLH = {'orbit.mean_motion': 1e-3, 'orbit.frame': 'lvlh'}
PAPER = {'method': 'paper_difference'}
BEFORE = {'capture.phase': 'pre_capture'}
TORQUE, FORCE = {'disturbance.torque_std': 0.1}, {'disturbance.force_std': 0.1}
WHEEL = {'wheels.names': ['w'], 'wheels.axes': [0.0, 0.0, 1.0], 'wheels.spin_inertias': [2.0]}


def argument(module: Any, name: str, key: str, parameters: dict[str, object]) -> object:
    """Return an argument of the call of a class, by its name in a module, while a session of some parameters begins."""
    original = getattr(module, name)
    with patch.object(module, name, wraps=original) as spy:
        Session(build(EstimatorConfig, parameters), urdf('table1'))
    return inspect.signature(original).bind(*spy.call_args.args, **spy.call_args.kwargs).arguments[key]


@pytest.mark.parametrize(
    ('name', 'value', 'beside', 'module', 'made', 'key', 'expected'),
    [
        ('maximum_gap', 0.3, {}, session, 'Identifier', 'maximum_gap', 0.3),
        ('noise.estimate', True, {}, session, 'NoiseEstimator', 'estimate', True),
        ('noise.trust_declared', True, {}, session, 'NoiseEstimator', 'trusted', True),
        ('thrust.frames', ['link2'], {}, session, 'Thrust', 'uncertain', ('link2',)),
        ('capture.detect', True, BEFORE, methods, 'CaptureEstimator', 'detect', True),
        ('disturbance.constant', 'body', {}, methods, 'hypotheses', 'constant', 'body'),
        ('momentum.linear_prior_std', 0.1, {}, methods, 'DifferenceSettings', 'linear_momentum_std', 0.1),
        ('paper.forgetting_factor', 0.9, PAPER, methods, 'PaperSettings', 'forgetting_factor', 0.9),
        ('paper.initial_covariance', 1e3, PAPER, methods, 'PaperSettings', 'initial_covariance', 1e3),
        ('paper.reference', 'first', PAPER, methods, 'PaperSettings', 'reference', 'first'),
        ('paper.lag', 5, PAPER, methods, 'PaperSettings', 'lag', 5),
        ('orbit.twist', 'inertial', LVLH, orbit, 'FallingFrame', 'relative_twist', False),
        ('orbit.epoch', 12.5, ORBIT, orbit, 'FallingFrame', 'epoch', 12_500_000_000),
        ('imu.cross_axis_std', 0.02, {'imu.noise_density': 1e-4}, gyro, 'GyroErrors', 'cross', 0.02),
        ('imu.bias_walk', 1e-5, {'imu.noise_density': 1e-4}, gyro, 'GyroErrors', 'walk', 1e-5),
        ('momentum.linear_prior_std', 0.1, {}, catalogue, 'Declared', 'linear_momentum', 0.1),
        ('time_offset.estimate', False, {}, clocks, 'time_offset', 'deviation', 0.0),
        ('time_offset.prior_std', 0.1, {}, clocks, 'time_offset', 'deviation', 0.1),
        ('time_offset.drift_std', 1e-4, {}, clocks, 'clock_drift', 'deviation', 1e-4),
        ('odometry.scale_std', 0.01, {}, odometry, 'odometry_scale', 'deviation', 0.01),
        ('odometry.turning_std', 1e-3, {}, odometry, 'odometry_turning', 'deviation', 1e-3),
        ('odometry.angular_velocity_bias_std', 1e-3, {}, odometry, 'twist_bias', 'angular', 1e-3),
        ('disturbance.torque_std', 0.02, {}, forces, 'disturbances', 'torque', DisturbanceModel(0.02)),
        ('disturbance.torque_time', 30.0, TORQUE, forces, 'disturbances', 'torque', DisturbanceModel(0.1, 30.0)),
        ('disturbance.force_std', 0.02, {}, forces, 'disturbances', 'force', DisturbanceModel(0.02)),
        ('disturbance.force_time', 30.0, FORCE, forces, 'disturbances', 'force', DisturbanceModel(0.1, 30.0)),
        ('wheels.spin_inertia_relative_std', 0.1, WHEEL, wheels, 'spin_inertias', 'deviations', (0.2,)),
    ],
)
def test_a_parameter_reaches_its_setting(  # noqa: PLR0917 - a row of the table
    name: str, value: object, beside: dict[str, object], module: Any, made: str, key: str, expected: object
) -> None:
    assert argument(module, made, key, {**beside, name: value}) == expected
    assert argument(module, made, key, beside) != expected


def test_an_orbit_that_is_not_declared() -> None:
    assert argument(orbit, 'gravity', 'rate', {}) == 1.2e-3
    assert argument(orbit, 'gravity', 'rate', {'orbit.undeclared_rate': 5e-4}) == 5e-4


def test_the_noise_of_a_published_momentum() -> None:
    config = build(EstimatorConfig, {'wheels.momentum_frame': 'base_link', 'wheels.momentum_std': 0.01}).wheels
    np.testing.assert_array_equal(storage(config, robot('table1')).noises, [0.01] * 3)


def test_the_wanted_precision_of_published_estimates() -> None:
    model = robot('table1')
    config = build(EstimatorConfig, {'convergence.relative_std': 0.5})
    assert make_reporting(config, MomentumKernel(model, model.last_link)).converged_std == 0.5


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('duration', 20.0),
        ('joint_velocity', 0.2),
        ('joint_acceleration', 0.3),
        ('clearance', 0.1),
        ('stuck', ('joint2',)),
        ('effort', 50),
    ],
)
def test_a_setting_of_planned_motions(name: str, value: object) -> None:
    assert getattr(plan_settings(build(EstimatorConfig, {f'plan.{name}': value})), name) == value


def test_the_limits_of_the_base_in_planned_motions() -> None:
    names = ('base_rotation', 'base_translation', 'base_rate', 'deflection')
    config = build(EstimatorConfig, {f'plan.{name}': 0.1 * number for number, name in enumerate(names, 1)})
    assert list(vars(plan_settings(config).base).values()) == [0.1, 0.2, 0.1 * 3, 0.4]
