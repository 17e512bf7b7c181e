"""The variance by source, and what the motion does not determine."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from declarations import exact_but
from mbaid_ros.config.simulator_parameters import SimulatorConfig
from mbaid_ros.core.filter.gaussian import BiasSeparatedRoot, SquareRootInformation
from mbaid_ros.core.filter.posterior import MeanAndCovariance, error_budget
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.results.estimate import SENSOR_NOISE, Estimate
from mbaid_ros.core.robot.body import physical, physical_jacobian
from mbaid_ros.core.robot.model import PlaneDetector, load_model
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.state import BODY, Declared, Layout, Variables, variables
from mbaid_ros.core.target import TargetPrior
from mbaid_ros.parameters import build
from mbaid_ros.simulated_robot import make_initial_state, make_motion
from mbaid_ros.simulation.simulation import Simulation, Truth
from mbaid_ros.simulation.true_robot import ErrorStds, draw, generator, true_robot
from observed import MID, configured_motion, estimator, kernel, observe, windows


def uncertain(robot: MomentumKernel, *, given: bool) -> Declared:
    declared = exact_but(
        robot,
        known_joints__zero_std=1e-3,
        known_joints__origin_std=1e-3,
        known_joints__axis_std=1e-3,
        odometry_mount__position_std=2e-3,
        odometry_mount__orientation_std=2e-3,
    )
    prior = TargetPrior(160.0, 2.0, (0.1, 0.2, 0.3), 0.01) if given else TargetPrior()
    return replace(declared, target=prior, linear_momentum=0.5 if given else 0.0)


def measured(gaussian: SquareRootInformation, seed: int, truth: Array) -> tuple[SquareRootInformation, Array]:
    """Return a gaussian after measurements of unit variance, and their rows."""
    rows = np.random.default_rng(seed).normal(size=(60, gaussian.size))
    known = np.column_stack((rows, np.zeros(60), rows @ truth))
    root = np.asarray(np.linalg.qr(np.vstack((gaussian.root, known)), mode='r'))
    measured_root = BiasSeparatedRoot.from_rows(root[: gaussian.size], ())
    return replace(gaussian, conditional=measured_root), rows


def blocks(layout: Layout, filter_variables: Variables, *, given: bool) -> dict[str, Flags]:
    """Return of each cause which variables have its prior."""
    place, head, own = np.arange(len(filter_variables.scale)), filter_variables.moving, filter_variables.first_unknown
    labels = [cause for unknown in layout.unknowns for cause in unknown.causes]
    found = {cause: np.isin(place - own, np.flatnonzero(np.array(labels) == cause)) for cause in layout.causes}
    if given:
        found['target prior'] = (place >= head) & (place < own)
        found['momentum prior'] = (place >= filter_variables.pose_size) & (place < head)
    return found


@pytest.mark.parametrize('given', [False, True])
@pytest.mark.parametrize('name', ['servicer7', 'table1'])
def test_each_prior_has_its_share_and_noise_the_rest(name: str, given: bool) -> None:
    robot = kernel(name)
    detector, known = PlaneDetector(robot.model), uncertain(robot, given=given)
    unknowns = known.unknowns
    detector.update(observe(configured_motion(name, 0.5, 20.0), MID))
    if detector.planar:
        unknowns = tuple(unknown.in_plane(detector) for unknown in unknowns)
    layout = Layout.from_unknowns(robot, unknowns)
    of_filter = variables(layout, detector, known)
    state = np.zeros(layout.size)
    state[BODY] = robot.target.parameters
    prior = SquareRootInformation.prior(of_filter)
    gaussian, rows = measured(prior, 1, of_filter.from_state @ state)
    distribution = MeanAndCovariance.from_gaussian(gaussian, of_filter)
    declared = replace(distribution.prior_scales(layout), factors=np.ones(layout.size - BODY.stop))
    found = error_budget(distribution, layout, known, declared, np.ones(10, dtype=bool))
    zeros = np.array([cause.startswith('zero') for unknown in layout.unknowns for cause in unknown.causes])
    wrong = replace(declared, factors=np.where(zeros, 3.0, 1.0))
    wider = error_budget(distribution, layout, known, wrong, np.ones(10, dtype=bool))

    information = prior.root[:, :-2].T @ prior.root[:, :-2]
    covariance = np.linalg.inv(information + rows.T @ rows)
    gains = physical_jacobian(distribution.mean[BODY]) @ of_filter.to_state[BODY] @ covariance
    parts = {
        cause: np.sum((gains[:, which] @ np.linalg.cholesky(information[np.ix_(which, which)])) ** 2, axis=1)
        for cause, which in blocks(layout, of_filter, given=given).items()
    }
    seen = [0, 1, 2, 9] if detector.planar else list(range(10))
    assert found.causes == (SENSOR_NOISE, *parts)
    variance = np.sum((gains @ np.linalg.cholesky(information + rows.T @ rows)) ** 2, axis=1)
    expected = np.column_stack(list(parts.values()))[seen] / variance[seen, None]
    np.testing.assert_allclose(found.shares[seen, 1:], expected, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(found.shares[seen].sum(axis=1), 1.0)
    # What is no prior that is given is noise: the measurements, and next to nothing of pose and momentum at the start.
    np.testing.assert_allclose(
        found.shares[seen, 0], np.sum((gains @ rows.T) ** 2, axis=1)[seen] / variance[seen], atol=0.05
    )
    assert found.shares[seen, 0].max() > 0.1
    # Where zeros are three times as far off, their part of the variance is nine times as large, the others stay.
    factor = np.array([9.0 if cause.startswith('zero') else 1.0 for cause in found.causes])
    of_zeros = found.shares[seen] * factor
    np.testing.assert_allclose(wider.shares[seen], of_zeros / of_zeros.sum(axis=1, keepdims=True), rtol=1e-9)


DECLARED = {
    'known_links__relative_std': 0.01,
    'known_joints__zero_std': 1e-3,
    'known_joints__origin_std': 1e-3,
    'known_joints__axis_std': 1e-3,
}


@cache
def half_minute() -> Truth:
    return configured_motion('servicer7', 30.0, 20.0)


def identified(joint: int, off: float, **parameters: object) -> Estimate:
    """Return the last estimate of a servicer of which one joint is read with an offset, rad."""
    robot = kernel('servicer7')
    samples = observe(half_minute(), MID)
    position = samples.joint_position.copy()
    position[:, joint] += off
    samples = replace(samples, joint_position=position)
    return estimator(robot, MID, method='trajectory', **parameters).update(windows(samples), 0)[-1]


def far(estimate: Estimate) -> float:
    """Return the largest error in standard deviations."""
    error = estimate.parameters - physical(kernel('servicer7').target.parameters)
    return float(np.max(np.abs(error / estimate.std)))


def test_the_zero_of_the_last_joint_is_named_as_nothing_shows_that_it_is_wrong() -> None:
    wrong = identified(6, 0.05, **{**DECLARED, 'known_joints__zero_std': 5e-3})
    assert wrong.budget is not None
    assert 'zero of joint7 (' in wrong.budget.unobservable()
    assert wrong.status != 'inconsistent'  # ten times as far off as declared, and nothing contradicts it
    assert far(wrong) > 5.0


SEED = 2  # of a robot whose odometry is mounted two standard deviations off
MASS, MASS_STD = 180.0, 1.8  # kg
MOUNT = 2e-3  # m
# As the estimator's defaults have it.
UNCERTAIN = {**DECLARED, 'odometry_mount__position_std': MOUNT, 'odometry_mount__orientation_std': 2e-3}
# A base that one flywheel turns, which moves no mass: of the base's mass nothing is seen, and of its CoM only where it
# is in the frame that the odometry locates.
URDF = f"""\
<robot name="flywheel">
  <link name="base_link"><inertial><origin xyz="0.03 -0.02 0.05"/><mass value="{MASS}"/>
    <inertia ixx="42" ixy="1.5" ixz="-2" iyy="35" iyz="0.8" izz="30"/></inertial></link>
  <joint name="spin" type="continuous"><parent link="base_link"/><child link="wheel"/>
    <origin xyz="0.2 0.1 0.3" rpy="0.4 0.5 0"/><axis xyz="0 0 1"/></joint>
  <link name="wheel"><inertial><mass value="12"/>
    <inertia ixx="0.3" ixy="0" ixz="0" iyy="0.3" iyz="0" izz="0.5"/></inertial></link>
</robot>
"""
BASE = physical(load_model(URDF).link('base_link').parameters)


@cache
def observed(links: float) -> Samples:
    """Return a minute of the base; but for the links the robot is drawn as the defaults say."""
    nominal = load_model(URDF)
    errors = draw(nominal, 'base_link', ErrorStds(links, 1e-3, 1e-3, 1e-3, MOUNT, 2e-3), generator(SEED))
    config = build(
        SimulatorConfig,
        {
            'initial': {'base_angular_velocity': [0.03, -0.04, 0.05], 'zero_linear_momentum': True},
            'motion': {'kind': 'sinusoids', 'amplitudes': [40.0, 15.0], 'frequencies': [0.05, 0.12]},
        },
    )
    robot = true_robot(nominal, errors, ('base_link',))
    driven = make_motion(config, robot)
    simulation = Simulation(robot, driven, make_initial_state(config, robot, driven))
    return observe(simulation.advance(np.arange(6000) / 100.0), MID, SEED, errors)


@cache
def last(links: float, seconds: float = 60.0, **parameters: float) -> Estimate:
    """Return the last estimate of the base in that minute, or the first seconds of it."""
    given = {**UNCERTAIN, **parameters}
    method = estimator(MomentumKernel(load_model(URDF), 'base_link'), MID, method='trajectory', **given)
    return method.update(windows(observed(links)[: round(100.0 * seconds)]), 0)[-1]


@pytest.mark.long
def test_the_base_with_one_flywheel_is_identified_only_with_a_mass_that_is_given() -> None:
    # A wheel whose centre is off its axis would move a little mass.
    assert last(0.0, seconds=30.0).status == 'not_identifiable'
    assert last(0.0, target_prior__mass=MASS, target_prior__mass_std=MASS_STD).identifiable.all()


@pytest.mark.long
def test_an_unbalanced_wheel_determines_the_mass_of_its_base_as_far_as_it_is_unbalanced() -> None:
    estimate = last(0.01)
    assert estimate.identifiable.all()
    assert np.all(np.abs(estimate.parameters - BASE) < 3.0 * estimate.std)
    # A given mass is known ten times better.
    assert estimate.std[0] > 0.02 * MASS
    # Mass and CoM go together, and windows at different masses must not tell of the mount.
    assert np.all(estimate.std[1:4] > 0.7 * MOUNT)


def test_windows_linearised_at_different_points_do_not_tell_what_none_of_them_sees() -> None:
    estimate = last(0.01, 30.0, target_prior__mass=MASS + MASS_STD, target_prior__mass_std=MASS_STD)
    assert np.all(np.abs(estimate.parameters - BASE) < 3.0 * estimate.std)
    # The CoM is known in the odometry's frame, which may be this far from the base's.
    assert np.all(estimate.std[1:4] > 0.9 * MOUNT)
    assert estimate.std[0] > 0.9 * MASS_STD
