"""Forward and inverse dynamics: identities on random robots, and the order of the integrator."""

from __future__ import annotations

import re

import numpy as np
import pytest

from mbaid_ros.core.errors import ModelError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.simulation.dynamics import Dynamics, State
from mbaid_ros.simulation.motion import Passive
from mbaid_ros.simulation.simulation import Simulation, total_momentum
from random_robots import random_urdf
from simulated import relative_drift, state, table1

SEEDS = range(6)


def random_state(rng: np.random.Generator, joints: int) -> State:
    quaternion = rng.normal(size=4)
    return State(
        rng.normal(size=3),
        quaternion / np.linalg.norm(quaternion),
        rng.normal(size=joints),
        rng.normal(size=6 + joints),
    )


def free(count: int) -> Array:
    return np.zeros(count)


@pytest.mark.parametrize('seed', SEEDS)
def test_the_torque_gives_the_acceleration_it_is_asked_for(seed: int) -> None:
    rng = np.random.default_rng(seed)
    dynamics = Dynamics(load_model(random_urdf(rng)))
    joints = dynamics.model.joints
    moving, wanted = random_state(rng, joints), rng.normal(size=joints)
    assert dynamics.acceleration(moving, dynamics.torque(moving, wanted))[6:] == pytest.approx(wanted, abs=1e-10)


@pytest.mark.parametrize('seed', SEEDS)
def test_joint_torques_do_not_change_the_momentum(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = load_model(random_urdf(rng))
    torque = rng.normal(size=model.joints)

    class Push(Passive):
        def command(self, time: float, position: Array, velocity: Array) -> Array:  # type: ignore[override]
            push: Array = torque * np.sin(time) - 0.1 * velocity - 0.1 * position
            return push

    # Random robots weigh 30 kg a link and turn at a radian a second: faster than any servicer, hence the shorter step.
    run = Simulation(model, Push(), random_state(rng, model.joints), 0.005)
    assert relative_drift(total_momentum(model, run.advance(np.linspace(0.0, 3.0, 31)))) < 1e-9


def test_the_integrator_is_of_order_six() -> None:
    model, start = table1()
    dynamics = Dynamics(model)

    def after(steps: int) -> Array:
        now, length = start, 8.0 / steps
        for index in range(steps):
            acceleration = dynamics.acceleration(now, free(4))
            now = dynamics.step(index * length, now, acceleration, length, lambda _time, _state: free(4))
        return np.concatenate((now.base_position, now.base_orientation, now.joint_position, now.velocity))

    exact = after(256)
    errors = [np.abs(after(steps) - exact).max() for steps in (16, 32)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(6.0, abs=0.5)


def test_a_single_body_tumbles_as_euler_says() -> None:
    urdf = (
        '<robot name="body"><link name="base_link"><inertial><mass value="10"/>'
        '<inertia ixx="1" ixy="0" ixz="0" iyy="2" iyz="0" izz="2.5"/></inertial></link></robot>'
    )
    dynamics = Dynamics(load_model(urdf))
    angular, moments = np.array([0.3, -0.2, 0.5]), np.array([1.0, 2.0, 2.5])
    turning = dynamics.acceleration(state(np.zeros(0), np.zeros(0), tuple(angular)), free(0))
    assert turning[3:] == pytest.approx(-np.cross(angular, moments * angular) / moments, abs=1e-15)


def test_a_continuous_joint_counts_its_turns() -> None:
    model, start = table1()
    turned = State(start.base_position, start.base_orientation, start.joint_position + 4.0 * np.pi, start.velocity)
    dynamics = Dynamics(model)
    assert dynamics.acceleration(turned, free(4)) == pytest.approx(dynamics.acceleration(start, free(4)), abs=1e-15)
    run = Simulation(model, Passive(), turned, 0.02)
    assert run.advance(np.array([0.0])).joint_position[0] == pytest.approx(turned.joint_position)


TAIL = '<joint name="tail" type="continuous"><parent link="base_link"/><child link="leaf"/><axis xyz="0 0 1"/></joint>'
BODY = '<inertial><mass value="{}"/><inertia ixx="{}" ixy="0" ixz="0" iyy="{}" iyz="0" izz="{}"/></inertial>'


def robot_with_leaf(leaf: str, base: str = BODY.format(10, 1, 1, 1)) -> str:
    return f'<robot name="r"><link name="base_link">{base}</link><link name="leaf">{leaf}</link>{TAIL}</robot>'


def test_a_leaf_without_mass_is_refused_by_name() -> None:
    with pytest.raises(ModelError, match=re.escape('joints tail')):
        Dynamics(load_model(robot_with_leaf('')))


@pytest.mark.parametrize('base', ['', BODY.format(10, 0, 0, 0)])
def test_a_singular_mass_matrix_is_refused(base: str) -> None:
    with pytest.raises(ModelError, match=r'singular|inertia'):
        Dynamics(load_model(robot_with_leaf(BODY.format(1e-30, 0, 0, 1), base)))


def test_a_motion_that_diverges_is_refused() -> None:
    model, start = table1()
    wild = State(start.base_position, start.base_orientation, start.joint_position, 1e200 * np.ones(10))
    with pytest.raises(ModelError, match='not finite'):
        Simulation(model, Passive(), wild, 0.02).advance(np.array([1.0]))
