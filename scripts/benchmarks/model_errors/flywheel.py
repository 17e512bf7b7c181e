"""A base with one flywheel: no motion of it tells its mass, which has to be given for its inertia to be found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.data import MAXIMUM_GAP, RATE, readings
from benchmarks.model_errors.variant import DEFAULT, NOISE
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.config.simulator import SimulatorConfig
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.identifier import Identifier
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.inertia import physical
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.session import make_estimator
from mbaid_ros.session.session import UNSOLVABLE
from mbaid_ros.simulated_robot import make_initial_state, make_motion
from mbaid_ros.simulation.simulation import Simulation
from mbaid_ros.simulation.true_robot import draw, generator, true_robot

_SECONDS = 60.0
BASE = 'base_link'
MASS = 180.0  # kg, of the base
# The wheel turns about its own centre: it moves no mass.
URDF = f"""\
<robot name="flywheel">
  <link name="{BASE}">
    <inertial>
      <origin xyz="0.03 -0.02 0.05"/>
      <mass value="{MASS}"/>
      <inertia ixx="42" ixy="1.5" ixz="-2" iyy="35" iyz="0.8" izz="30"/>
    </inertial>
  </link>
  <joint name="spin" type="continuous">
    <parent link="{BASE}"/>
    <child link="wheel"/>
    <origin xyz="0.2 0.1 0.3" rpy="0.4 0.5 0"/>
    <axis xyz="0 0 1"/>
  </joint>
  <link name="wheel">
    <inertial>
      <mass value="12"/>
      <inertia ixx="0.3" ixy="0" ixz="0" iyy="0.3" iyz="0" izz="0.5"/>
    </inertial>
  </link>
</robot>
"""
_MOTION: dict[str, object] = {
    'initial': {'base_angular_velocity': [0.03, -0.04, 0.05], 'zero_linear_momentum': True},
    'motion': {'kind': 'sinusoids', 'amplitudes': [40.0, 15.0], 'frequencies': [0.05, 0.12]},
}


def estimate(seed: int, mass_std: float) -> Estimate:
    """Return the last estimate of the base in a minute, of a robot that is drawn as the defaults say, but for the base.

    Parameters
    ----------
    seed : of the robot, the sensors' noise and the mass that is given
    mass_std : kg, of that mass about the true one; 0 gives none
    """
    nominal = load_model(URDF)
    errors = draw(nominal, BASE, DEFAULT, generator(seed))
    robot = true_robot(nominal, errors, (BASE,))
    simulated = build(SimulatorConfig, _MOTION)
    driven = make_motion(simulated, robot)
    simulation = Simulation(robot, driven, make_initial_state(simulated, robot, driven), 0.02)
    truth = simulation.advance(np.arange(round(_SECONDS * RATE) + 1) / RATE)
    given: dict[str, object] = {f'noise.{name}': value for name, value in vars(NOISE).items()}
    if mass_std > 0.0:
        off = float(np.random.default_rng([seed, 1]).normal(scale=mass_std))
        given |= {'target_prior.mass': MASS + off, 'target_prior.mass_std': mass_std}
    config = build(EstimatorConfig, {'target_link': BASE, **given})
    estimator = make_estimator(config, MomentumKernel(nominal, BASE))
    try:
        return Identifier(estimator, config.window, MAXIMUM_GAP).push(*readings(truth, NOISE, seed, errors))[-1]
    except UNSOLVABLE:  # which a session tells, and begins anew
        return Estimate(method=config.method, status='waiting')


def rows(seeds: Sequence[int], mass_std: float) -> list[tuple[Estimate, Array]]:
    """Return estimates of some seeds, each with its errors in standard deviations, (10,)."""
    truth = physical(load_model(URDF).link(BASE).parameters)
    found = [estimate(seed, mass_std) for seed in seeds]
    return [(one, (one.parameters - truth) / one.std) for one in found]
