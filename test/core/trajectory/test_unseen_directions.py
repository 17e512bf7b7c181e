"""What no motion tells stays as uncertain as the priors leave it, however long the run."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from mbaid_ros.config.parameters import build
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.core.samples import Samples
from mbaid_ros.simulated_robot import make_initial_state, make_motion
from mbaid_ros.simulation.simulation import Simulation
from mbaid_ros.simulation.true_robot import ErrorSizes, draw, generator, true_robot
from observed import MID, estimator, observe, windows

SEED = 2  # of a robot whose odometry is mounted two standard deviations off
MASS, MASS_STD = 180.0, 1.8  # kg
MOUNT = 2e-3  # m
# As the estimator's defaults have it.
UNCERTAIN = {
    'known_links__relative_std': 0.01,
    'known_joints__zero_std': 1e-3,
    'known_joints__origin_std': 1e-3,
    'known_joints__axis_std': 1e-3,
    'odometry_mount__position_std': MOUNT,
    'odometry_mount__orientation_std': 2e-3,
}
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
    errors = draw(nominal, 'base_link', ErrorSizes(links, 1e-3, 1e-3, 1e-3, MOUNT, 2e-3), generator(SEED))
    config = build(
        SimulatorConfig,
        {
            'initial': {'base_angular_velocity': [0.03, -0.04, 0.05], 'zero_linear_momentum': True},
            'motion': {'kind': 'sinusoids', 'amplitudes': [40.0, 15.0], 'frequencies': [0.05, 0.12]},
        },
    )
    robot = true_robot(nominal, errors, ('base_link',))
    driven = make_motion(config, robot)
    simulation = Simulation(robot, driven, make_initial_state(config, robot, driven), 0.02)
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


def test_a_wheel_out_of_balance_tells_the_mass_of_its_base_as_far_as_it_is_out() -> None:
    estimate = last(0.01)
    assert estimate.identifiable.all()
    assert np.all(np.abs(estimate.parameters - BASE) < 3.0 * estimate.std)
    # A given mass is known ten times better.
    assert estimate.std[0] > 0.02 * MASS
    # Mass and CoM go together, and windows at different masses must not tell of the mount.
    assert np.all(estimate.std[1:4] > 0.7 * MOUNT)


def test_windows_linearised_at_different_points_do_not_tell_what_none_of_them_sees() -> None:
    estimate = last(0.01, target_prior__mass=MASS + MASS_STD, target_prior__mass_std=MASS_STD)
    assert np.all(np.abs(estimate.parameters - BASE) < 3.0 * estimate.std)
    # The CoM is known in the odometry's frame, which may be this far from the base's.
    assert np.all(estimate.std[1:4] > 0.9 * MOUNT)
    assert estimate.std[0] > 0.9 * MASS_STD
