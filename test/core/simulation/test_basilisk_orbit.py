"""A six-joint servicer over an orbit of Basilisk (`make test-basilisk`), against the simulator, and identified from it.

Basilisk integrates it about the Earth, in inertial coordinates: a point mass for gravity, and its gravity gradient on
the whole craft. Joints are on springs; where they are is then given to the simulator.

Coordinates that count from the centre of the Earth are rounded to a nanometre, which over an orbit leads the craft two
micrometres astray. So it also circles a body a thousand times nearer, at the same rate: the tide is the same.
"""

from __future__ import annotations

import os
from functools import cache
from importlib import import_module

import numpy as np
import pytest

from benchmarks.data import history
from benchmarks.honesty.readings import Readings
from benchmarks.honesty.runs import messages
from in_basilisk import InOrbit, column, craft_of, seen_falling
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.core.geometry import Array, rotation_from_quaternion
from mbaid_ros.core.joint_trajectory import JointTrajectory
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.core.robot.orbit import Orbit
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.session.session import Session
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.environment import Surroundings
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import Simulation
from mbaid_ros.simulation.steered import Followed
from simulated import CONFIG, robot

pytest.importorskip('Basilisk', reason='Basilisk is not installed (pip install bsk)')
pytestmark = [
    pytest.mark.skipif('BASILISK' not in os.environ, reason='minutes: make test-basilisk'),
    pytest.mark.timeout(3600),
]

RADIUS, STEP = 6778e3, 0.16  # m, s
SPRINGS = [0.024, 0.024, 0.016, 0.008, 0.008, 0.006]  # N m / rad
SAMPLE = 3 * STEP  # of the estimator
NEARER = (1.0, 1000.0)  # times, than the radius, at the same rate
SILENT = SensorNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@cache
def in_basilisk(nearer: float) -> InOrbit:
    """Return an orbit of ets7, its centre of mass at the origin of the falling frame."""
    radius = RADIUS / nearer
    craft, arm = craft_of(robot('ets7'), SPRINGS)
    factory = import_module('Basilisk.utilities.simIncludeGravBody').gravBodyFactory()
    earth = factory.createEarth()
    earth.isCentralBody = True
    earth.mu /= nearer**3
    factory.addBodiesTo(craft)
    gradient = import_module('Basilisk.simulation.GravityGradientEffector').GravityGradientEffector()
    gradient.addPlanetName(earth.planetName)
    craft.addDynamicEffector(gradient)
    mean_motion = float(np.sqrt(earth.mu / radius**3))
    craft.hub.r_CN_NInit = column(np.array([radius, 0.0, 0.0]))
    craft.hub.v_CN_NInit = column(np.array([0.0, radius * mean_motion, 0.0]))
    craft.hub.sigma_BNInit = column(np.zeros(3))
    craft.hub.omega_BN_BInit = column(np.array([0.0004, -0.0006, 0.0008]))
    craft.setIntegrator(import_module('Basilisk.simulation.svIntegrators').svIntegratorRKF78(craft))
    seconds = import_module('Basilisk.utilities.macros').sec2nano
    simulation = import_module('Basilisk.utilities.SimulationBaseClass').SimBaseClass()
    simulation.CreateNewProcess('process').addTask(simulation.CreateNewTask('task', seconds(STEP)))
    base, joints = craft.scStateOutMsg.recorder(), [message.recorder() for message in arm.spinningBodyOutMsgs]
    for part in (arm, craft, gradient, base, *joints):
        simulation.AddModelToTask('task', part)
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(seconds(STEP * round(2.0 * np.pi / mean_motion / STEP)))
    simulation.ExecuteSimulation()
    return seen_falling(base, joints, mean_motion, radius)


def orbit_of(run: InOrbit) -> Orbit:
    return Orbit.inertial(run.mean_motion, np.array([-1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))


def slopes(values: Array, step: float) -> Array:
    """Return the derivative of equally spaced (N, n) values, of sixth order."""
    found = np.empty_like(values)
    for place in range(7):
        powers = np.vander(np.arange(7.0) - place, increasing=True).T
        weights = np.linalg.solve(powers, np.eye(7)[1]) / step
        if place == 3:
            parts = [values[shift : len(values) - 6 + shift] * weight for shift, weight in enumerate(weights)]
            found[3:-3] = np.sum(parts, axis=0)
        elif place < 3:
            found[place] = weights @ values[:7]
        else:
            found[place - 7] = weights @ values[-7:]
    return found


@pytest.mark.parametrize('nearer', NEARER)
def test_the_simulator_moves_as_basilisk_does(nearer: float) -> None:
    run, model = in_basilisk(nearer), robot('ets7')
    truth = run.truth
    course = truth.joint_position, truth.joint_velocity, slopes(truth.joint_velocity, STEP)
    motion = Followed(
        JointTrajectory(model.joint_names, truth.time, *course), course[0][0], np.arange(model.joints), 0.0
    )
    velocity = np.concatenate((truth.base_linear_velocity[0], truth.base_angular_velocity[0], course[1][0]))
    start = State(truth.base_position[0], truth.base_orientation[0], course[0][0], velocity)
    found = Simulation(model, motion, start, surroundings=Surroundings(orbit=orbit_of(run))).advance(truth.time)
    rotation, expected = (rotation_from_quaternion(each.base_orientation) for each in (found, truth))
    turned = np.linalg.norm(expected - expected[0], axis=(1, 2)).max()
    moved = farthest(truth.base_position - truth.base_position[0])
    off, strayed = farthest(found.base_position - truth.base_position), farthest(run.strayed)
    # Its centre of mass leaves the circle by rounding alone.
    from_centre = farthest(found.base_position - truth.base_position + run.strayed)
    angle = np.linalg.norm(rotation - expected, axis=(1, 2)).max()
    print(  # noqa: T201
        f'{nearer:.0f} times nearer, {truth.time[-1]:.0f} s: Basilisk strays {strayed:.1e} m; position to {off:.1e} m, '
        f'without that to {from_centre / moved:.1e} of {moved:.3g} m, orientation to {angle / turned:.1e}'
    )
    assert from_centre < 1e-6 * moved
    assert angle < 1e-6 * turned
    if nearer > 1.0:
        assert off < 1e-6 * moved


def farthest(ways: Array) -> float:
    return float(np.linalg.norm(ways, axis=1).max())


def identified(nearer: float) -> Estimate:
    """Return what is estimated from noiseless messages of an orbit."""
    run = in_basilisk(nearer)
    # There is no noise but rounding: declared is a ten-thousandth of an ordinary sensor's.
    fine = SensorNoise(*(1e-4 * value for value in (1e-4, 1e-3, 1e-3, 1e-4, 1e-3, 1e-4)))
    given: dict[str, object] = {
        **EXACT,
        **{f'noise.{name}': value for name, value in vars(fine).items()},
        'target_link': robot('ets7').last_link,
        'window': 10.0 * SAMPLE,
        'maximum_gap': 1.5 * SAMPLE,
        'orbit.mean_motion': run.mean_motion,
        'orbit.nadir': [-1.0, 0.0, 0.0],
        'orbit.normal': [0.0, 0.0, 1.0],
    }
    session = Session(build(EstimatorConfig, given), (CONFIG / 'ets7.urdf').read_text(encoding='utf-8'))
    truth = run.truth[::3]
    readings = Readings(truth, *(getattr(Sensors(SILENT, 0), part)(truth) for part in ('joints', 'base')))
    return history(session, messages(session, readings, robot('ets7'), fine))[-1]


@pytest.mark.parametrize('nearer', NEARER)
def test_an_orbit_of_basilisk_is_identified(nearer: float) -> None:
    last = identified(nearer)
    true = physical(robot('ets7').link(robot('ets7').last_link).parameters)
    size = np.concatenate((true[:1], np.full(3, np.linalg.norm(true[1:4])), np.full(6, true[[4, 7, 9]].max())))
    off = np.abs(last.parameters - true) / size
    print(f'{nearer:.0f} times nearer: identified to {off.max():.1e}, {last.status}')  # noqa: T201
    assert off.max() < 1e-6
