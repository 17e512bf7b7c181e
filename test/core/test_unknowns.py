"""All that every unknown contributes at one generic state, as it was: readings, momentum, words, repairs, plane."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.contracts import Motion, NominalModel, Unknown, deviation_text, kind_in_words
from mbaid_ros.core.geometry import Array, exp
from mbaid_ros.core.odometry.model import vibration
from mbaid_ros.core.robot.model import PlaneDetector
from mbaid_ros.core.robot.momentum import BodyStates, MomentumKernel
from mbaid_ros.core.wheels import storage
from mbaid_ros.parameters import build
from mbaid_ros.session.catalogue import suspects, unknowns
from mbaid_ros.session.robot import KnownRobot, nominal_model, with_known_errors
from simulated import robot
from unchanged import Unchanged

COUNT = 2  # instants
PLANAR = {
    'known_links.relative_std': 0.02,
    'known_joints.tracking_std': 1e-3,
    'known_joints.lag_std': 0.01,
    'known_joints.turn_std': 2e-3,
    'known_joints.scale_std': 0.01,
    'odometry.turning_std': 1e-3,
    'thrust.frames': ['link1', 'base_link'],
    'thrust.scale_std': 0.05,
    'thrust.direction_std': 0.02,
    'thrust.common_scale_std': 0.03,
    'imu.noise_density': 1e-4,
    'imu.cross_axis_std': 0.02,
    'poses.names': ['mocap', 'star'],
    'poses.mocap.position_std': 2e-3,
    'poses.mocap.orientation_std': 3e-3,
    'poses.mocap.correlation_time': 2.0,
    'poses.star.measures': 'orientation',
    'poses.star.orientation_std': 1e-4,
}
SPATIAL = {
    **PLANAR,
    'wheels.names': ['w'],
    'wheels.axes': [0.0, 0.6, 0.8],
    'wheels.spin_inertias': [2.0],
    'wheels.spin_inertia_relative_std': 0.1,
    'disturbance.torque_std': 0.1,
    'disturbance.torque_time': 20.0,
    'disturbance.force_std': 0.2,
    'disturbance.force_time': 10.0,
    'disturbance.axes': 'inertial',
    'gyros.names': ['arm'],
    'gyros.arm.noise_density': 1e-4,
    'gyros.arm.frame': 'link4',
}
ORBITING = {'orbit.mean_motion': 1e-3, 'orbit.frame': 'hill', 'orbit.gradient_relative_std': 0.01}
CASES = {'servicer7': SPATIAL, 'table1': PLANAR, 'ets7': ORBITING}
Named = tuple[KnownRobot, dict[str, Unknown]]


@cache
def declared(name: str) -> Named:
    """Return a robot, and its unknowns and those that are suspected, by their place and class."""
    model, config = robot(name), build(EstimatorConfig, CASES[name])
    kernel = MomentumKernel(model, model.last_link).with_storage(storage(config.wheels, model))
    known = nominal_model(config, with_known_errors(kernel, config.known_links)[0])
    every = [*unknowns(config, known.kernel), *suspects(known.kernel), vibration(0.7)]
    kinds = {type(each): each for each in declared('servicer7')[1].values()} if name == 'ets7' else {}
    first = {f'{type(each).__name__} {each.labels[0]}': each for each in every[::-1] if type(each) not in kinds}
    return known, {f'{name} {label}': each for label, each in first.items()}


def drawn(seed: int, *shape: int) -> Array:
    """Return numbers of either sign, none near zero."""
    rng = np.random.default_rng(seed)
    return np.asarray(rng.uniform(0.3, 1.0, shape) * rng.choice([-1.0, 1.0], shape))


def states(kernel: MomentumKernel) -> BodyStates:
    turn, (joints, rates) = exp(drawn(1, COUNT, 3)), drawn(2, 2, COUNT, kernel.model.joints)
    found = kernel.states_of(turn, joints, rates, drawn(4, COUNT, 6), drawn(5, COUNT, kernel.storage.count))
    return replace(found, thrust=drawn(19, COUNT, 2, 6, 5))


def motion(numbers: int) -> Motion:
    axes = drawn(6, 5, COUNT, 3, 3)
    return Motion(
        np.array([3.0, 71.0]),
        drawn(7, 3),
        drawn(8, COUNT, 3),
        exp(drawn(9, COUNT, 3)),
        drawn(10, COUNT, 6),
        drawn(11, COUNT, numbers),
        drawn(12, COUNT, numbers),
        *axes,
    )


def weighed(columns: Array | None) -> Array | None:
    """Return columns (..., k) as k sums with generic weights."""
    if columns is None or not columns.size:
        return None
    flat = columns.reshape(-1, columns.shape[-1])
    return np.asarray(drawn(13, 1, len(flat))[0] @ flat)


def numbers(nominal: NominalModel) -> list[object]:
    """Return what a nominal model has, of its kernel sums."""
    kernel = nominal.kernel
    sums = [weighed(each.reshape(-1, 1)) for each in (kernel.model.positions, kernel.model.rotations, kernel.known)]
    return [
        *sums,
        kernel.springs,
        *(getattr(nominal, name) for name in ('zeros', 'mount', 'delay', 'thrust', 'gyro', 'lags')),
    ]


@pytest.mark.parametrize('name', [each for case in CASES for each in declared(case)[1]])
def test_what_an_unknown_contributes(name: str, unchanged: Unchanged) -> None:
    known, every = declared(name.partition(' ')[0])
    unknown, kernel = every[name], known.kernel
    here, count = states(kernel), len(unknown.factor)
    whole, rotation = drawn(14, COUNT, 10), here.configuration.rotation[:, 0]
    found: dict[str, object] = {'factor': weighed(unknown.factor.T), 'count': unknown.count, 'tilt': unknown.tilt}
    sensors = {'pose': 6, 'twist': 6, 'imu': 3, 'gyros.arm': 3, 'poses.mocap': 6, 'poses.star': 3}
    found['measured'] = [weighed(unknown.measured(each, motion(size))) for each, size in sensors.items()]
    found['momentum'] = weighed(unknown.momentum_columns(kernel, here))
    if unknown.changes_momentum:
        found['rates'] = weighed(unknown.momentum_rates(whole, drawn(15, 3), np.array([3.0, 71.0]), rotation))
    elif unknown.in_equations:
        found['equations'] = weighed(unknown.equation_columns(kernel, here))
    if unknown.moves_joints:
        moved = unknown.deflections(*drawn(16, 3, COUNT, kernel.model.joints))
        found['deflections'] = [weighed(each) for each in moved]
    found['loads'] = None
    loads = unknown.load_motions(kernel, here.configuration)
    if loads is not None:
        found['loads'] = weighed(np.moveaxis(loads, 2, 3).reshape(-1, loads.shape[2]))
    value = 0.1 * drawn(17, 1, count)[0]
    found['walk'], found['times'] = unknown.random_walk, unknown.time_constants
    found['point'] = unknown.linearisation_value(0.3 * drawn(18, 1, unknown.count)[0], np.full(unknown.count, 0.1))
    found['nominal'] = numbers(unknown.applied_to(NominalModel.nominal(kernel), value))
    causes = [*dict.fromkeys(unknown.labels)][:7]
    own = [value[[label == cause for label in unknown.labels]] for cause in causes]
    found['repairs'] = [unknown.repair(*each, 0.1 * np.abs(each[1]), kernel) for each in zip(causes, own, strict=True)]
    found['words'] = [
        (kind_in_words(cause), deviation_text(cause, part)) for cause, part in zip(causes, own, strict=True)
    ]
    found['parts'] = [len(unknown.part(causes[0]).causes), len(unknown.without(causes[:1]).causes), unknown.parts[:3]]
    if name.startswith('table1'):
        seen = unknown.in_plane(PlaneDetector(kernel.model))
        found['plane'] = [seen.count, weighed(seen.factor @ seen.factor.T), seen.random_walk]
    unchanged.values(**found)
