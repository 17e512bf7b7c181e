"""A robot that is not its URDF in motion, and what its sensors say: conservation, and an independent engine."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from floating import true_momentum
from mbaid_ros.core.geometry import Array, cross, exp, quaternion_from_rotation, rotate, rotation_from_quaternion
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.model_errors import ModelErrors
from mbaid_ros.core.robot.momentum import physical
from mbaid_ros.core.samples import Samples
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.motion import Passive
from mbaid_ros.simulation.simulation import Simulation, Truth, total_momentum
from mbaid_ros.simulation.true_robot import misread
from observed import MID, observe
from random_robots import random_urdf
from simulated import drawn, relative_drift, robot, state

BLOCKS = {
    'links_relative_std': 0.05, 'zero_std': 0.02, 'origin_std': 0.02, 'axis_std': 0.02,
    'mount_position_std': 0.05, 'mount_orientation_std': 0.05,
}  # fmt: skip


def tumbling(model: RobotModel, seed: int) -> Truth:
    """Return five seconds of a robot without torques."""
    rng = np.random.default_rng(seed)
    start = state(rng.normal(size=model.joints), 0.3 * rng.normal(size=model.joints), (0.1, 0.2, -0.1), 0.2)
    return Simulation(model, Passive(), start, 0.01).advance(np.linspace(0.0, 5.0, 101))


def as_it_is(samples: Samples, errors: ModelErrors) -> Samples:
    """Return what is measured with the zeros added and at the true base frame, straight from their definition."""
    turn, place = errors.mount[:3], rotate(samples.base_rotation, errors.mount[3:])
    return replace(
        samples,
        joint_position=samples.joint_position + errors.zeros,
        base_rotation=samples.base_rotation @ exp(turn),
        base_position=samples.base_position + place,
        base_linear_velocity=samples.base_linear_velocity + cross(samples.base_angular_velocity, place),
    )


@pytest.mark.parametrize('seed', range(3))
def test_the_true_robot_conserves_momentum(seed: int) -> None:
    model = load_model(random_urdf(np.random.default_rng(seed)))
    _, true = drawn(model, seed, **BLOCKS)
    truth = tumbling(true, seed)
    assert relative_drift(total_momentum(true, truth)) < 1e-9
    assert relative_drift(total_momentum(model, truth)) > 1e-4


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
    errors, true = drawn(model, **BLOCKS)
    step = 1e-4
    start = state(np.full(6, 0.3), np.full(6, 0.1), (0.05, -0.1, 0.08), 0.1)
    measured = misread(Simulation(true, Passive(), start, 0.02).advance(np.arange(0.0, 0.02, step)), errors)
    rotation = rotation_from_quaternion(measured.base_orientation)
    middle = slice(1, -1)
    speed = (measured.base_position[2:] - measured.base_position[:-2]) / (2.0 * step)
    assert rotate(rotation[middle], measured.base_linear_velocity[middle]) == pytest.approx(speed, abs=1e-8)
    turning = (rotation[2:] - rotation[:-2]) / (2.0 * step)
    spin = np.swapaxes(rotation[middle], -1, -2) @ turning
    axial = np.stack((spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]), axis=1)
    assert measured.base_angular_velocity[middle] == pytest.approx(axial, abs=1e-8)
    joints = (measured.joint_position[2:] - measured.joint_position[:-2]) / (2.0 * step)
    assert measured.joint_velocity[middle] == pytest.approx(joints, abs=1e-8)


# -- against MuJoCo, which is told of the errors in its own terms


def peer(model: RobotModel, errors: ModelErrors) -> mujoco.MjModel:
    """Return MuJoCo's model of the true robot: bodies displaced in its own description, and a site for the odometry."""
    spec = mujoco.MjSpec.from_string(model.urdf)
    base = spec.body(model.base_link)
    base.add_freejoint()
    spec.option.gravity = np.zeros(3)
    spec.option.timestep = 0.002
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    for index, change in enumerate(errors.bodies):
        (link,) = (link for link in model.links if link.body == index)
        body, inertia = spec.body(link.name), physical(link.parameters + change)
        if change.any():
            body.mass, body.ipos, body.iquat = inertia[0], inertia[1:4], [1.0, 0.0, 0.0, 0.0]
            body.fullinertia = inertia[[4, 7, 9, 5, 6, 8]]
        if index > 0:
            rotation = rotation_from_quaternion(np.roll(body.quat, -1))
            body.pos = body.pos + rotation @ errors.origins[index - 1]
            turned = rotation @ exp(errors.tilts[index - 1])
            body.quat = np.roll(quaternion_from_rotation(turned), 1)
    back = exp(-errors.mount[:3])
    base.add_site(name='odometry', pos=-back @ errors.mount[3:], quat=np.roll(quaternion_from_rotation(back), 1))
    return spec.compile()


def measured_by_mujoco(model: RobotModel, errors: ModelErrors, start: State, instants: Array) -> dict[str, Array]:
    """Return what encoders and the mounted odometry see of MuJoCo's motion."""
    other = peer(model, errors)
    data = mujoco.MjData(other)
    place = [other.joint(joint).qposadr[0] for joint in model.joint_names]
    rate = [other.joint(joint).dofadr[0] for joint in model.joint_names]
    rotation = rotation_from_quaternion(start.base_orientation)
    data.qpos[:3], data.qpos[3:7] = start.base_position, np.roll(start.base_orientation, 1)
    data.qpos[place] = start.joint_position
    data.qvel[:3], data.qvel[3:6], data.qvel[rate] = rotation @ start.velocity[:3], *np.split(start.velocity[3:], [3])
    seen: dict[str, list[Array]] = {'joints': [], 'position': [], 'rotation': [], 'twist': []}
    site = other.site('odometry').id
    for steps in np.diff(np.round(instants / other.opt.timestep).astype(int), prepend=0):
        mujoco.mj_step(other, data, nstep=int(steps))
        mujoco.mj_forward(other, data)
        twist = np.zeros(6)
        mujoco.mj_objectVelocity(other, data, mujoco.mjtObj.mjOBJ_SITE, site, twist, 1)
        for name, value in (
            ('joints', data.qpos[place] - errors.zeros),
            ('position', data.site_xpos[site]),
            ('rotation', data.site_xmat[site].reshape(3, 3)),
            ('twist', twist),
        ):
            seen[name].append(np.array(value))
    return {name: np.array(values) for name, values in seen.items()}


@pytest.mark.parametrize('name', ['ets7', 'servicer7'])
def test_mujoco_moves_and_measures_the_true_robot_alike(name: str) -> None:
    model = robot(name)
    errors, true = drawn(model, 3, **BLOCKS)
    rates = 0.03 * np.cos(np.arange(model.joints))
    start = state(np.full(model.joints, 0.4), rates, (0.01, -0.01, 0.02), 0.05)
    start = replace(start, base_position=np.array([1.0, 2.0, 3.0]), base_orientation=np.array([0.5, 0.5, -0.5, 0.5]))
    instants = np.arange(0.0, 21.0, 2.0)
    ours = misread(Simulation(true, Passive(), start, 0.02).advance(instants), errors)
    theirs = measured_by_mujoco(model, errors, start, instants)
    assert np.abs(ours.joint_position - theirs['joints']).max() < 1e-8
    assert np.abs(ours.base_position - theirs['position']).max() < 1e-8
    assert np.abs(rotation_from_quaternion(ours.base_orientation) - theirs['rotation']).max() < 1e-8
    assert np.abs(ours.base_angular_velocity - theirs['twist'][:, :3]).max() < 1e-8
    assert np.abs(ours.base_linear_velocity - theirs['twist'][:, 3:]).max() < 1e-8
    # The same robot without its errors is another one by far more than that.
    exact = Simulation(model, Passive(), start, 0.02).advance(instants)
    assert np.abs(exact.joint_position - theirs['joints']).max() > 1e-3
