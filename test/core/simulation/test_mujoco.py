"""The simulator against an independent engine, MuJoCo."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from floating import true_momentum
from mbaid_ros.core.geometry import (
    Array,
    cross,
    exp,
    quaternion_from_rotation,
    rotate,
    rotate_back,
    rotation_from_quaternion,
    vec,
)
from mbaid_ros.core.orbit import Orbit
from mbaid_ros.core.robot.inertia import physical, standard
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.model_errors import ModelErrors
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.simulation.dynamics import State
from mbaid_ros.core.simulation.effects import BodyPoses
from mbaid_ros.core.simulation.misreading import misread
from mbaid_ros.core.simulation.motion import Passive
from mbaid_ros.core.simulation.run import Simulation, Truth, total_momentum, without_linear_momentum
from mbaid_ros.core.simulation.surroundings import Surroundings
from mbaid_ros.core.simulation.tide import Tide
from observed import MID, observe
from orbiting import orbit
from random_robots import random_urdf
from simulated import CONFIG, drawn, relative_drift, robot, state, table1

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


TIDE_STEP = 0.005  # s, of MuJoCo's Runge-Kutta method of order 4


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
    tide = Tide(around, origin, body[:1], body[None, 1:4], about[None])
    found = tide.wrenches(BodyPoses(time, rotation[None], place[None], np.zeros(3)))[0]
    at = origin + place + points @ rotation.T
    up = around.upward(np.array([time]))[0]
    pulls = 0.03**2 * masses[:, None] * (3.0 * (at @ up)[:, None] * up - at)
    levers = points @ rotation.T
    expected = np.concatenate((rotation.T @ pulls.sum(axis=0), rotation.T @ np.cross(levers, pulls).sum(axis=0)))
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-15)


class InMuJoCo:
    """A robot in MuJoCo with tide and gravity gradient as passive forces, worked out from its own bodies."""

    def __init__(self, name: str, joint_names: tuple[str, ...], around: Orbit) -> None:
        spec = mujoco.MjSpec.from_file(str(CONFIG / f'{name}.urdf'))
        spec.body('base_link').add_freejoint()
        spec.option.gravity = np.zeros(3)
        spec.option.timestep = TIDE_STEP
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
        spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.around = around
        self.place = [self.model.joint(joint).qposadr[0] for joint in joint_names]
        self.rate = [self.model.joint(joint).dofadr[0] for joint in joint_names]

    def pull(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Add what acts on each body to the generalised forces, at the stage's own time and place."""
        angle = self.around.mean_motion * data.time
        up = np.cos(angle) * self.around.up + np.sin(angle) * np.cross(self.around.normal, self.around.up)
        square = self.around.mean_motion**2
        for body in range(1, model.nbody):
            mass, at = float(model.body_mass[body]), data.xipos[body]
            axes = data.ximat[body].reshape(3, 3)
            inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
            force = mass * square * (3.0 * (up @ at) * up - at)
            torque = 3.0 * square * np.cross(up, inertia @ up)
            mujoco.mj_applyFT(model, data, force, torque, at, body, data.qfrc_passive)

    def run(self, start: State, instants: Array) -> tuple[Array, Array, Array]:
        """Return joint positions, base positions and orientations (w first) at instants."""
        data = self.data
        data.qpos[:3], data.qpos[3:7] = start.base_position, np.roll(start.base_orientation, 1)
        data.qpos[self.place] = start.joint_position
        data.qvel[:3] = rotation_from_quaternion(start.base_orientation) @ start.velocity[:3]
        data.qvel[3:6], data.qvel[self.rate] = start.velocity[3:6], start.joint_velocity
        kept = []
        mujoco.set_mjcb_passive(self.pull)
        try:
            for steps in np.diff(np.round(instants / TIDE_STEP).astype(int), prepend=0):
                mujoco.mj_step(self.model, data, nstep=int(steps))
                kept.append((data.qpos[self.place].copy(), data.qpos[:3].copy(), data.qpos[3:7].copy()))
        finally:
            mujoco.set_mjcb_passive(None)
        joints, position, orientation = (np.array(part) for part in zip(*kept, strict=True))
        return joints, position, orientation


@pytest.mark.parametrize('name', ['ets7', pytest.param('servicer7', marks=pytest.mark.long)])
def test_a_robot_moves_as_in_mujoco(name: str) -> None:
    """At sixty times the mean motion of a low orbit, so that half a minute is a good part of one."""
    model, around = robot(name), orbit(0.07)
    start = state(np.full(model.joints, 0.4), 0.01 * np.cos(np.arange(model.joints)), (0.01, -0.01, 0.02), 0.02)
    start = State(np.array([2.0, -1.0, 3.0]), np.array([0.5, 0.5, -0.5, 0.5]), start.joint_position, start.velocity)
    instants = np.arange(0.0, 21.0, 2.0)
    truth = Simulation(model, Passive(), start, 0.02, surroundings=Surroundings(orbit=around)).advance(instants)
    free = Simulation(model, Passive(), start, 0.02).advance(instants)
    joints, position, orientation = InMuJoCo(name, model.joint_names, around).run(start, instants)
    same = np.abs(np.sum(np.roll(truth.base_orientation, 1, axis=1) * orientation, axis=1))
    moved = np.abs(truth.base_position - free.base_position).max()
    assert moved > 1.0
    assert np.abs(truth.base_position - position).max() < 1e-8 * moved
    assert np.abs(truth.joint_position - joints).max() < 1e-7 * np.abs(truth.joint_position - free.joint_position).max()
    assert np.arccos(np.minimum(same, 1.0)).max() < 1e-7


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


def true_peer(model: RobotModel, errors: ModelErrors) -> mujoco.MjModel:
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
    other = true_peer(model, errors)
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
