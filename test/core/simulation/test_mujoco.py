"""The simulator against an independent engine, MuJoCo."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from mbaid_ros.core.geometry import Array, rotate, rotate_back, rotation_from_quaternion
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.motion import Passive
from mbaid_ros.simulation.simulation import Simulation, without_linear_momentum
from simulated import CONFIG, robot, state, table1

STEP = 0.002  # s, of MuJoCo's Runge-Kutta method of order 4


def rollout(name: str, start: State, joint_names: tuple[str, ...], instants: Array) -> dict[str, Array]:
    """Return joint positions and base angular velocities (base axes) at instants, by MuJoCo."""
    spec = mujoco.MjSpec.from_file(str(CONFIG / f'{name}.urdf'))
    spec.body('base_link').add_freejoint()
    spec.option.gravity = np.zeros(3)
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    model = spec.compile()
    data = mujoco.MjData(model)
    place = [model.joint(joint).qposadr[0] for joint in joint_names]
    rate = [model.joint(joint).dofadr[0] for joint in joint_names]
    # A free joint: linear velocity in world axes, angular velocity in the body's.
    data.qpos[:3], data.qpos[3:7] = start.base_position, np.roll(start.base_orientation, 1)
    data.qpos[place] = start.joint_position
    data.qvel[:3] = rotate(rotation_from_quaternion(start.base_orientation), start.velocity[:3])
    data.qvel[3:6], data.qvel[rate] = start.velocity[3:6], start.joint_velocity
    joints, angular, linear = [], [], []
    for steps in np.diff(np.round(instants / STEP).astype(int), prepend=0):
        mujoco.mj_step(model, data, nstep=int(steps))
        joints.append(data.qpos[place].copy())
        angular.append(data.qvel[3:6].copy())
        linear.append(data.qvel[:3].copy())
    return {'joints': np.array(joints), 'angular': np.array(angular), 'linear': np.array(linear)}


def test_the_papers_case() -> None:
    model, start = table1()
    instants = np.arange(61.0)
    truth = Simulation(model, Passive(), start, 0.02).advance(instants)
    other = rollout('table1', start, model.joint_names, instants)
    assert np.abs(truth.joint_position - other['joints']).max() < 1e-9
    assert np.abs(truth.base_angular_velocity - other['angular']).max() < 1e-9
    assert other['angular'][30, 2] == pytest.approx(0.0531892573, abs=1e-9)


# The light wrist of servicer7 spins up fast: at twice its rate MuJoCo's step would have to be shorter.
@pytest.mark.parametrize(('name', 'rate'), [('ets7', 0.05), ('servicer7', 0.02)])
def test_a_tumbling_robot_with_a_swinging_arm(name: str, rate: float) -> None:
    model = robot(name)
    rates = rate * np.cos(np.arange(model.joints))
    start = state(np.full(model.joints, 0.4), rates, (0.01, -0.01, 0.02))
    turned = State(np.array([1.0, 2.0, 3.0]), np.array([0.5, 0.5, -0.5, 0.5]), start.joint_position, start.velocity)
    start = without_linear_momentum(model, turned)
    instants = np.arange(0.0, 31.0, 2.0)
    truth = Simulation(model, Passive(), start, 0.02).advance(instants)
    other = rollout(name, start, model.joint_names, instants)
    assert np.abs(truth.joint_position - other['joints']).max() < 1e-9
    assert np.abs(truth.base_angular_velocity - other['angular']).max() < 1e-9
    velocity = rotate_back(rotation_from_quaternion(truth.base_orientation), other['linear'])
    assert np.abs(truth.base_linear_velocity - velocity).max() < 1e-9
