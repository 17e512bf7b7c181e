"""The simulated run: conservation, its dynamics, its integrator, and independence of the sampling."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from mbaid_ros.core.errors import ModelError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.simulation.dynamics import Dynamics, State
from mbaid_ros.simulation.motion import Passive, Sinusoids, random_sinusoids, sinusoids
from mbaid_ros.simulation.simulation import Simulation, total_momentum
from random_robots import random_urdf
from simulated import relative_drift, robot, state, table1


def moving_arm(name: str, linear: float = 0.0) -> tuple[Simulation, Sinusoids]:
    model = robot(name)
    motion = random_sinusoids(np.full(model.joints, 0.3), 3, 2, 0.5, 10.0, 40.0)
    start = state(motion.start, motion.reference(0.0)[1], (0.02, -0.05, 0.03), linear)
    return Simulation(model, motion, start), motion


def test_the_base_velocity_without_linear_momentum() -> None:
    model, start = table1()
    assert start.velocity[:3] == pytest.approx([0.0624, -0.0729, 0.0], abs=5e-5)
    total = total_momentum(model, Simulation(model, Passive(), start).advance(np.zeros(1)))[0]
    assert total == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.0, 4597.634], abs=5e-4)


@pytest.mark.parametrize('name', ['ets7', pytest.param('servicer7', marks=pytest.mark.long)])
def test_a_moving_arm_conserves_momentum_and_follows_its_trajectory(name: str) -> None:
    run, motion = moving_arm(name, linear=0.1)
    truth = run.advance(np.linspace(0.0, 60.0, 997))
    assert relative_drift(total_momentum(run.model, truth)) < 1e-9
    reference = [motion.reference(time) for time in truth.time]
    assert truth.joint_position == pytest.approx(np.array([position for position, _, _ in reference]), abs=1e-10)
    assert truth.joint_velocity == pytest.approx(np.array([velocity for _, velocity, _ in reference]), abs=1e-10)
    assert np.abs(truth.joint_effort).max() > 0.01


def test_sinusoids_are_read_joint_by_joint() -> None:
    motion = sinusoids(
        np.array([1.0, 2.0]), np.array([0.1, 0.2, 0.3, 0.4]), np.array([1.0, 2.0, 3.0, 4.0]), np.zeros(0)
    )
    position, velocity, _ = motion.reference(0.25)
    assert position == pytest.approx([1.0 + 0.1, 2.0 - 0.3])
    # The cosines of the four terms: 0, -1 and 0, 1.
    assert velocity == pytest.approx([-0.2 * 2.0 * np.pi * 2.0, 0.4 * 2.0 * np.pi * 4.0])


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

    run = Simulation(model, Push(), random_state(rng, model.joints))
    assert relative_drift(total_momentum(model, run.advance(np.linspace(0.0, 3.0, 31)))) < 1e-9


def test_the_integrator_agrees_with_another_one() -> None:
    model, start = table1()
    dynamics = Dynamics(model)

    def rates(_time: float, values: Array) -> Array:
        now = State.from_array(values)
        turn = Rotation.from_quat(now.base_orientation)
        x, y, z = now.velocity[3:6]
        of_quaternion = np.array([[0, z, -y, x], [-z, 0, x, y], [y, -x, 0, z], [-x, -y, -z, 0]])
        accelerations = dynamics.acceleration(now, free(4))
        return np.concatenate(
            (turn.apply(now.velocity[:3]), 0.5 * of_quaternion @ values[3:7], now.velocity[6:], accelerations)
        )

    end = solve_ivp(rates, (0.0, 8.0), start.array, 'Radau', rtol=1e-9, atol=1e-10).y[:, -1]
    found = Simulation(model, Passive(), start).advance(np.array([8.0]))
    assert found.base_position[0] == pytest.approx(end[:3], abs=1e-7)
    assert found.base_orientation[0] == pytest.approx(end[3:7], abs=1e-7)
    assert found.joint_position[0] == pytest.approx(end[7:11], abs=1e-7)


def test_a_single_body_tumbles_as_euler_says() -> None:
    urdf = (
        '<robot name="body"><link name="base_link"><inertial><mass value="10"/>'
        '<inertia ixx="1" ixy="0" ixz="0" iyy="2" iyz="0" izz="2.5"/></inertial></link></robot>'
    )
    dynamics = Dynamics(load_model(urdf))
    angular, moments = np.array([0.3, -0.2, 0.5]), np.array([1.0, 2.0, 2.5])
    turning = dynamics.acceleration(state(np.zeros(0), np.zeros(0), tuple(angular)), free(0))
    assert turning[3:] == pytest.approx(-np.cross(angular, moments * angular) / moments, abs=1e-15)


TAIL = '<joint name="tail" type="continuous"><parent link="base_link"/><child link="leaf"/><axis xyz="0 0 1"/></joint>'
BODY = '<inertial><mass value="{}"/><inertia ixx="{}" ixy="0" ixz="0" iyy="{}" iyz="0" izz="{}"/></inertial>'


def robot_with_leaf(leaf: str, base: str = BODY.format(10, 1, 1, 1)) -> str:
    return f'<robot name="r"><link name="base_link">{base}</link><link name="leaf">{leaf}</link>{TAIL}</robot>'


@pytest.mark.parametrize('base', ['', BODY.format(10, 0, 0, 0)])
def test_a_singular_mass_matrix_is_refused(base: str) -> None:
    with pytest.raises(ModelError, match=r'singular|inertia'):
        Dynamics(load_model(robot_with_leaf(BODY.format(1e-12, 0, 0, 1), base)))


def test_a_motion_that_diverges_is_refused() -> None:
    model, start = table1()
    wild = State(start.base_position, start.base_orientation, start.joint_position, 1e200 * np.ones(10))
    with pytest.raises(ModelError, match='not finite'):
        Simulation(model, Passive(), wild).advance(np.array([1.0]))
