"""Tide and gravity gradient of the simulator against point masses, and against MuJoCo with forces applied to it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from mbaid_ros.core.geometry import Array, exp, rotation_from_quaternion, vec
from mbaid_ros.core.robot.momentum import physical, standard
from mbaid_ros.core.robot.orbit import Orbit
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.environment import BodyPoses, Surroundings, Tide
from mbaid_ros.simulation.motion import Passive
from mbaid_ros.simulation.simulation import Simulation
from orbiting import orbit
from simulated import CONFIG, robot, state

STEP = 0.005  # s, of MuJoCo's Runge-Kutta method of order 4


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
        spec.option.timestep = STEP
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
            for steps in np.diff(np.round(instants / STEP).astype(int), prepend=0):
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
