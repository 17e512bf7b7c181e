"""A tracked target in an independent engine, MuJoCo: both bodies free, then a weld that is switched on in flight."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.frame import PUBLISHED
from benchmarks.precapture import POSTURE
from benchmarks.tracked import BODY, CAPTURE, POSES, RATE, SPIN, Caught, robot, session_of
from mbaid_ros.core.geometry import (
    Array,
    exp,
    quaternion_from_rotation,
    rotate_back,
    rotation_from_quaternion,
    unvec,
    vec,
)
from mbaid_ros.sensor_messages import TargetPoses
from mbaid_ros.simulation.changes import Target
from mbaid_ros.simulation.simulation import Truth

STEP = 0.002  # s
REST, STIFFNESS, DAMPING = 3.0, 500.0, 1500.0  # s; N m/rad, N m s/rad of the arm that carries the target
ROTOR = 30.0  # kg m^2, of each joint's motor, geared up: it steadies the arm, and has no momentum of the links
RARE = 1e-4


class Flight:
    """A servicer at rest and a target in flight, which the hand holds from a time on."""

    def __init__(self, seed: int, approach: float) -> None:
        rng, self.free = np.random.default_rng([seed, 7]), robot('servicer7')
        spec = mujoco.MjSpec.from_string(self.free.urdf)
        spec.body(self.free.base_link).add_freejoint()
        body = spec.worldbody.add_body(name='target', mass=BODY[0], ipos=BODY[1:4], iquat=[1.0, 0.0, 0.0, 0.0])
        body.fullinertia, body.explicitinertial = BODY[[4, 7, 9, 5, 6, 8]], True
        body.add_freejoint()
        weld = spec.add_equality(name='grasp', active=False, name1='link7', name2='target')
        weld.type, weld.objtype = mujoco.mjtEq.mjEQ_WELD, mujoco.mjtObj.mjOBJ_BODY
        # As stiff as can be: a softer one lets the body move by micrometres, which momentum shows.
        weld.solref, weld.solimp = [0.02, 1.0], [0.9999, 0.9999, 1e-3, 0.5, 2.0]
        spec.option.gravity, spec.option.timestep = np.zeros(3), STEP
        spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        names = self.free.joint_names
        self.place, self.rate = (
            [getattr(self.model.joint(name), kind)[0] for name in names] for kind in ('qposadr', 'dofadr')
        )
        self.model.dof_armature[self.rate] = ROTOR
        at = int(self.model.body('target').jntadr[0])
        self.of_target, self.by_target = int(self.model.jnt_qposadr[at]), int(self.model.jnt_dofadr[at])
        self.start = np.array(POSTURE) + 0.3 * rng.standard_normal(len(names))
        self.reach, self.period = 0.4 * rng.uniform(0.5, 1.0, len(names)), rng.uniform(12.0, 30.0, len(names))
        toward, about = (each / np.linalg.norm(each) for each in rng.standard_normal((2, 3)))
        self._throw(toward, about, approach)
        self.noise = np.random.default_rng([seed, 8])

    def _throw(self, toward: Array, about: Array, approach: float) -> None:
        """Set the state from which the target reaches the hand at the time of the capture: by its flight, reversed."""
        model, data = self.model, self.data
        data.qpos[self.place] = self.start
        mujoco.mj_forward(model, data)
        hand = model.body('link7').id
        rotation = data.xmat[hand].reshape(3, 3)
        free, spin = slice(self.by_target, self.by_target + 6), SPIN * about
        data.qpos[self.of_target : self.of_target + 7] = np.concatenate((data.xpos[hand], data.xquat[hand]))
        velocity = approach * toward - np.cross(spin, rotation @ BODY[1:4])
        data.qvel[free] = -np.concatenate((velocity, rotation.T @ spin))
        mujoco.mj_step(model, data, nstep=round(CAPTURE / STEP))
        data.qvel[free] *= -1.0
        data.time = 0.0

    def _target(self) -> tuple[Array, Array]:
        """Return position and rotation of the target's frame."""
        mujoco.mj_kinematics(self.model, self.data)
        target = self.model.body('target').id
        return self.data.xpos[target].copy(), self.data.xmat[target].reshape(3, 3).copy()

    def poses(self) -> TargetPoses:
        """Fly until the capture, and return what a camera sees."""
        time, rows = np.arange(0.0, CAPTURE + 1e-9, 1.0 / POSES.rate), []
        for place in range(len(time)):
            position, rotation = self._target()
            away, turn = self.noise.standard_normal((2, 3))
            rows.append(
                (
                    position + rotation @ POSES.place + POSES.position_noise * away,
                    exp(POSES.orientation_noise * turn) @ rotation,
                )
            )
            if place < len(time) - 1:
                mujoco.mj_step(self.model, self.data, nstep=round(1.0 / POSES.rate / STEP))
        position, rotation = (np.array(each) for each in zip(*rows, strict=True))
        return TargetPoses(time, position, quaternion_from_rotation(rotation))

    def carried(self, seconds: float) -> tuple[Truth, Array]:
        """Switch the weld on, and return the robot's motion, and (10,) the body in the hand's frame at the end."""
        model, data, hand = self.model, self.data, self.model.body('link7').id
        position, rotation = self._target()
        to_hand = data.xmat[hand].reshape(3, 3).T.copy()
        model.eq_data[0, 3:6] = to_hand @ (position - data.xpos[hand])
        model.eq_data[0, 6:10] = np.roll(quaternion_from_rotation(to_hand @ rotation), 1)
        model.eq_data[0, :3], data.eq_active[0] = 0.0, 1
        rows, begin = [], data.time
        for _ in range(round(seconds * RATE)):
            rows.append(np.concatenate((data.qpos[self.place], data.qvel[self.rate], data.qpos[:7], data.qvel[:6])))
            for _ in range(round(1.0 / RATE / STEP)):
                since = max(data.time - begin - REST, 0.0)
                rate = 2.0 * np.pi / self.period
                wanted = self.start + self.reach * (1.0 - np.cos(rate * since))
                speed = self.reach * rate * np.sin(rate * since)
                away = wanted - data.qpos[self.place], speed - data.qvel[self.rate]
                data.qfrc_applied[self.rate] = STIFFNESS * away[0] + DAMPING * away[1]
                mujoco.mj_step(model, data)
        count = len(self.place)
        joints, rates, pose, twist = np.split(np.array(rows), np.cumsum([count, count, 7]), axis=1)
        orientation = np.roll(pose[:, 3:], -1, axis=1)
        linear = rotate_back(rotation_from_quaternion(orientation), twist[:, :3])
        time = CAPTURE + np.arange(len(rows)) / RATE
        position, rotation = self._target()
        hand_rotation = data.xmat[hand].reshape(3, 3)
        turned = hand_rotation.T @ rotation
        centre = hand_rotation.T @ (position - data.xpos[hand]) + turned @ BODY[1:4]
        body = np.concatenate((BODY[:1], centre, vec(turned @ unvec(BODY[4:]) @ turned.T)))
        return Truth(time, joints, rates, np.zeros_like(joints), pose[:, :3], orientation, linear, twist[:, 3:]), body


def caught(seed: int, seconds: float) -> Caught:
    """Return a capture in MuJoCo."""
    flight = Flight(seed, 0.05)
    poses = flight.poses()
    after, body = flight.carried(seconds)
    time = np.arange(round(CAPTURE * RATE)) / RATE
    still = replace(after[np.zeros(len(time), dtype=int)], time=time)
    still = replace(
        still, base_linear_velocity=0.0 * still.base_position, base_angular_velocity=0.0 * still.base_position
    )
    target = Target(CAPTURE, 'link7', body, np.zeros(3), np.zeros(3))
    return Caught('servicer7', seed, Truth.concatenate([still, after]), poses, target)


@pytest.mark.parametrize('seed', [0, *(pytest.param(each, marks=pytest.mark.long) for each in (1, 2, 3))])
def test_the_target_is_within_its_interval(seed: int) -> None:
    """By the poses of its flight while the arm is at rest, and when the arm has moved."""
    run = caught(seed, REST + 5.0)
    estimates, _ = session_of(run, tracked=True)
    found = [each for each in estimates if each.status in PUBLISHED]
    assert found[0].time < CAPTURE + REST
    assert found[0].std[0] < 15.0
    for each in found:
        known = each.identifiable
        error, covariance = (each.parameters - run.together)[known], each.covariance[np.ix_(known, known)]
        assert float(error @ np.linalg.solve(covariance, error)) < chi2.isf(RARE, int(known.sum()))
    assert found[-1].identifiable.sum() >= 8
    assert found[-1].std[0] < 3.0
