"""The simulator against an independent engine, MuJoCo: as described, with model errors, and in an orbit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.in_mujoco import InMuJoCo
from floating import true_momentum
from mbaid_ros.core.geometry import Array, cross, exp, rotate, rotation_from_quaternion, vec
from mbaid_ros.core.robot.body import physical, standard
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.environment import BodyPoses, Environment, GravityGradient
from mbaid_ros.simulation.motion import Passive
from mbaid_ros.simulation.simulation import Simulation, Truth
from mbaid_ros.simulation.true_robot import ModelErrors, as_measured
from observed import MID, observe
from random_robots import random_urdf
from sessions import orbit
from simulated import drawn, relative_drift, robot, state, table1

BLOCKS = {
    'links_relative_std': 0.05, 'zero_std': 0.02, 'origin_std': 0.02, 'axis_std': 0.02,
    'mount_position_std': 0.05, 'mount_orientation_std': 0.05,
}  # fmt: skip


def far(ours: Array, theirs: Array) -> float:
    return float(np.abs(ours - theirs).max())


def test_the_papers_case() -> None:
    model, start = table1()
    instants = np.arange(61.0)
    truth = Simulation(model, Passive(), start).advance(instants)
    other = InMuJoCo(model, 0.002).measured(start, instants)
    assert far(truth.joint_position, other.joint_position) < 1e-9
    assert far(truth.base_angular_velocity, other.base_angular_velocity) < 1e-9
    assert other.base_angular_velocity[30, 2] == pytest.approx(0.0531892573, abs=1e-9)
    assert not truth.joint_effort.any()


# The light wrist of servicer7 spins up fast: at more than this rate MuJoCo's step would have to be shorter.
@pytest.mark.parametrize(('name', 'rate'), [('ets7', 0.05), ('servicer7', 0.02)])
def test_mujoco_moves_and_measures_the_true_robot_alike(name: str, rate: float) -> None:
    model = robot(name)
    errors, true = drawn(model, 3, **BLOCKS)
    start = state(np.full(model.joints, 0.4), rate * np.cos(np.arange(model.joints)), (0.01, -0.01, 0.02), 0.05)
    start = replace(start, base_position=np.array([1.0, 2.0, 3.0]), base_orientation=np.array([0.5, 0.5, -0.5, 0.5]))
    instants = np.arange(0.0, 21.0, 2.0)
    ours = as_measured(Simulation(true, Passive(), start).advance(instants), errors)
    theirs = InMuJoCo(model, 0.002, errors).measured(start, instants)
    for part in ('joint_position', 'base_position', 'base_linear_velocity', 'base_angular_velocity'):
        assert far(getattr(ours, part), getattr(theirs, part)) < 1e-8
    assert far(*(rotation_from_quaternion(each.base_orientation) for each in (ours, theirs))) < 1e-8
    # The same robot without its errors is another one by far more than that.
    exact = Simulation(model, Passive(), start).advance(instants)
    assert far(exact.joint_position, theirs.joint_position) > 1e-3


@pytest.mark.parametrize('name', ['ets7', pytest.param('servicer7', marks=pytest.mark.long)])
def test_a_robot_in_orbit_moves_as_in_mujoco(name: str) -> None:
    """At sixty times the mean motion of a low orbit, so that half a minute is a good part of one."""
    model, around = robot(name), orbit(0.07)
    start = state(np.full(model.joints, 0.4), 0.01 * np.cos(np.arange(model.joints)), (0.01, -0.01, 0.02), 0.02)
    start = State(np.array([2.0, -1.0, 3.0]), np.array([0.5, 0.5, -0.5, 0.5]), start.joint_position, start.velocity)
    instants = np.arange(0.0, 21.0, 2.0)
    truth = Simulation(model, Passive(), start, environment=Environment(orbit=around)).advance(instants)
    free = Simulation(model, Passive(), start).advance(instants)
    other = InMuJoCo(model, 0.005, around=around).measured(start, instants)
    moved = far(truth.base_position, free.base_position)
    assert moved > 1.0
    assert far(truth.base_position, other.base_position) < 1e-8 * moved
    assert far(truth.joint_position, other.joint_position) < 1e-7 * far(truth.joint_position, free.joint_position)
    assert far(*(rotation_from_quaternion(each.base_orientation) for each in (truth, other))) < 1e-7


@pytest.mark.parametrize('seed', range(4))
def test_a_body_is_pulled_as_its_points_are(seed: int) -> None:
    rng = np.random.default_rng(seed)
    around, time = orbit(0.03), float(rng.uniform(0.0, 100.0))
    points, masses = rng.normal(size=(9, 3)), rng.uniform(0.5, 3.0, 9)
    moments = np.einsum('k,ki,kj->ij', masses, points, points)
    inertia = np.trace(moments) * np.eye(3) - moments
    body = physical(np.concatenate(([masses.sum()], masses @ points, vec(inertia))))
    assert standard(body)[4:] == pytest.approx(vec(inertia))
    about = np.array([[body[4], body[5], body[6]], [body[5], body[7], body[8]], [body[6], body[8], body[9]]])
    origin, place, rotation = rng.normal(size=3), rng.normal(size=3), exp(rng.normal(size=3))
    gravity_columns = GravityGradient(around, origin, body[:1], body[None, 1:4], about[None])
    found = gravity_columns.wrenches(BodyPoses(time, rotation[None], place[None], np.zeros(3)))[0]
    at = origin + place + points @ rotation.T
    up = around.zenith_at(np.array([time]))[0]
    pulls = 0.03**2 * masses[:, None] * (3.0 * (at @ up)[:, None] * up - at)
    levers = points @ rotation.T
    expected = np.concatenate((rotation.T @ pulls.sum(axis=0), rotation.T @ np.cross(levers, pulls).sum(axis=0)))
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-15)


def as_it_is(samples: Samples, errors: ModelErrors) -> Samples:
    """Return what is measured with the zeros added and at the true base frame, straight from their definition."""
    place = rotate(samples.base_rotation, errors.mount[3:])
    return replace(
        samples,
        joint_position=samples.joint_position + errors.zeros,
        base_rotation=samples.base_rotation @ exp(errors.mount[:3]),
        base_position=samples.base_position + place,
        base_linear_velocity=samples.base_linear_velocity + cross(samples.base_angular_velocity, place),
    )


def tumbling(model: RobotModel, seed: int) -> Truth:
    """Return five seconds of a robot without torques."""
    rng = np.random.default_rng(seed)
    start = state(rng.normal(size=model.joints), 0.3 * rng.normal(size=model.joints), (0.1, 0.2, -0.1), 0.2)
    return Simulation(model, Passive(), start).advance(np.linspace(0.0, 5.0, 101))


@pytest.mark.parametrize('seed', range(2))
@pytest.mark.parametrize('block', BLOCKS)
def test_measured_momentum_is_constant_for_the_true_robot_alone(block: str, seed: int) -> None:
    model = load_model(random_urdf(np.random.default_rng(seed)))
    errors, true = drawn(model, seed, **{block: BLOCKS[block]})
    measured = observe(tumbling(true, seed), MID, None, errors)
    right = true_momentum(MomentumKernel(true, model.last_link), as_it_is(measured, errors))
    assert relative_drift(right) < 1e-9
    assert relative_drift(true_momentum(MomentumKernel(model, model.last_link), measured)) > 1e-4


def test_a_measured_twist_is_the_rate_of_the_measured_pose() -> None:
    model = robot('ets7')
    errors, true = drawn(model, 4, **BLOCKS)
    step = 1e-4
    start = state(np.full(6, 0.3), np.full(6, 0.1), (0.05, -0.1, 0.08), 0.1)
    measured = as_measured(Simulation(true, Passive(), start).advance(np.arange(0.0, 0.02, step)), errors)
    rotation = rotation_from_quaternion(measured.base_orientation)
    middle = slice(1, -1)

    def slope(values: Array) -> Array:
        return np.asarray((values[2:] - values[:-2]) / (2.0 * step))

    linear = rotate(rotation[middle], measured.base_linear_velocity[middle])
    assert linear == pytest.approx(slope(measured.base_position), abs=1e-8)
    spin = np.swapaxes(rotation[middle], -1, -2) @ slope(rotation)
    axial = np.stack((spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]), axis=1)
    assert measured.base_angular_velocity[middle] == pytest.approx(axial, abs=1e-8)
    assert measured.joint_velocity[middle] == pytest.approx(slope(measured.joint_position), abs=1e-8)
