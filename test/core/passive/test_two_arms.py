"""Two arms on one target, in MuJoCo: the second hand is welded on, and all joints of both are measured."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.stats import chi2

from mbaid_ros.core.geometry import Array, quaternion_from_rotation
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.simulation.simulation import Truth
from observed import MID, estimator, nees, observe, true_body, windows
from simulated import CONFIG

SECONDS, STEP, EVERY = 25.0, 0.002, 10


def two_arms() -> RobotModel:
    """Return the servicer with its arm a second time, whose last link is the hand alone."""
    text = (CONFIG / 'servicer7.urdf').read_text(encoding='utf-8')
    arm = text[text.index('<joint name="joint1"') : text.index('<link name="link7"')]
    for kind in ('joint', 'link'):
        arm = arm.replace(f'"{kind}', f'"second_{kind}')
    arm = arm.replace('xyz="0.60 0.15 0.40" rpy="0.15 1.10 0.30"', 'xyz="0.60 -0.35 0.30" rpy="-0.2 1.3 -0.2"')
    hand = (
        '<link name="second_link7"><inertial><origin xyz="0.01 -0.015 0.15"/><mass value="7"/>'
        '<inertia ixx="0.07" ixy="0.001" ixz="-0.003" iyy="0.075" iyz="0.002" izz="0.04"/></inertial></link>'
    )
    return load_model(text.replace('</robot>', f'{arm}{hand}</robot>'))


def welded(model: RobotModel) -> Truth:
    """Return how the robot moves freely from joint rates that the weld permits."""
    spec = mujoco.MjSpec.from_string(model.urdf)
    spec.body(model.base_link).add_freejoint()
    spec.option.gravity, spec.option.timestep = np.zeros(3), STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    for shape in spec.geoms:
        shape.contype = shape.conaffinity = 0
    start = 0.4 * np.cos(1.7 * np.arange(model.joints))
    robot, data = _at(spec, model, start)
    target, hand = (robot.body(name).id for name in ('link7', 'second_link7'))
    turn = data.xmat[target].reshape(3, 3).T
    weld = spec.add_equality()
    weld.type, weld.objtype = mujoco.mjtEq.mjEQ_WELD, mujoco.mjtObj.mjOBJ_BODY
    weld.name1, weld.name2 = 'link7', 'second_link7'
    x, y, z, w = quaternion_from_rotation((turn @ data.xmat[hand].reshape(3, 3))[None])[0]
    weld.data[:11] = [0.0, 0.0, 0.0, *(turn @ (data.xpos[hand] - data.xpos[target])), w, x, y, z, 1.0]
    robot, data = _at(spec, model, start)
    # The rates nearest to some that keep the hand where it is on the target.
    place = [robot.joint(name).dofadr[0] for name in model.joint_names]
    jacobians: Array = np.zeros((2, 6, robot.nv))
    for jacobian, body in zip(jacobians, (target, hand), strict=True):
        mujoco.mj_jac(robot, data, jacobian[:3], jacobian[3:], data.xpos[hand], body)
    apart = (jacobians[1] - jacobians[0])[:, place]
    wanted = 0.06 * np.cos(1.3 * np.arange(model.joints))
    data.qvel[place] = wanted - np.linalg.pinv(apart) @ apart @ wanted
    data.qvel[:6] = [0.001, -0.002, 0.0, 0.01, -0.015, 0.02]
    return _followed(model, robot, data)


def _at(spec: mujoco.MjSpec, model: RobotModel, start: Array) -> tuple[mujoco.MjModel, mujoco.MjData]:
    robot = spec.compile()
    data = mujoco.MjData(robot)
    data.qpos[[robot.joint(name).qposadr[0] for name in model.joint_names]] = start
    mujoco.mj_forward(robot, data)
    return robot, data


def _followed(model: RobotModel, robot: mujoco.MjModel, data: mujoco.MjData) -> Truth:
    each = [robot.joint(name) for name in model.joint_names]
    place, rate = [joint.qposadr[0] for joint in each], [joint.dofadr[0] for joint in each]
    base = robot.body(model.base_link).id
    rows = []
    for _ in range(round(SECONDS / STEP / EVERY)):
        turn = data.xmat[base].reshape(3, 3).copy()
        motion = turn, turn.T @ data.qvel[:3], data.qvel[3:6].copy()
        rows.append((data.qpos[place], data.qvel[rate], data.qpos[:3].copy(), *motion))
        mujoco.mj_step(robot, data, nstep=EVERY)
        mujoco.mj_forward(robot, data)
    joints, rates, position, turns, linear, angular = (np.array(part) for part in zip(*rows, strict=True))
    times = STEP * EVERY * np.arange(len(joints))
    orientation = quaternion_from_rotation(turns)
    return Truth(times, joints, rates, np.zeros_like(joints), position, orientation, linear, angular)


@pytest.mark.long
@pytest.mark.parametrize('seed', [1, 2])
def test_a_target_between_two_hands_is_identified(seed: int) -> None:
    model = two_arms()
    truth = welded(model)
    assert np.all(np.ptp(truth.joint_position, axis=0)[[0, 7]] > 0.05)  # both arms move
    kernel = MomentumKernel(model, 'link7')
    last = estimator(kernel, MID, method='trajectory').update(windows(observe(truth, MID, seed)), 0)[-1]
    assert last.status in {'estimating', 'converged'}, last.warnings
    assert nees(last, true_body(kernel)) < chi2.isf(1e-3, 10)
    assert last.std[0] < 2.0
