"""Robots in an independent engine, MuJoCo: a reference for the simulator, and a simulation of springs."""

from collections.abc import Callable, Mapping, Sequence

import mujoco
import numpy as np

from mbaid_ros.core.geometry import Array, exp, quaternion_from_rotation, rotate_back, rotation_from_quaternion
from mbaid_ros.core.orbit import Orbit
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.motion import Driven
from mbaid_ros.simulation.simulation import Truth
from mbaid_ros.simulation.true_robot import ModelErrors


class InMuJoCo:
    """A robot in MuJoCo, with its errors and an orbit's pull in MuJoCo's own terms; a site stands for the odometry."""

    def __init__(
        self,
        robot: RobotModel,  # of its URDF
        step: float,  # s, of a Runge-Kutta method of order 4
        errors: ModelErrors | None = None,  # deviations of the moving robot
        around: Orbit | None = None,  # the frame falls along
        springs: Mapping[str, tuple[float, float]] | None = None,  # stiffness (N m/rad) and damping (N m s/rad) by name
    ) -> None:
        self.errors = errors or ModelErrors.zero(robot.joints)
        self.around = around
        spec = mujoco.MjSpec.from_string(robot.urdf)
        base = spec.body(robot.base_link)
        base.add_freejoint()
        spec.option.gravity = np.zeros(3)
        spec.option.timestep = step
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
        spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        for index, change in enumerate(self.errors.bodies):
            (link,) = (link for link in robot.links if link.body == index)
            body, inertia = spec.body(link.name), physical(link.parameters + change)
            if change.any():
                body.mass, body.ipos, body.iquat = inertia[0], inertia[1:4], [1.0, 0.0, 0.0, 0.0]
                body.fullinertia = inertia[[4, 7, 9, 5, 6, 8]]
            if index > 0:
                rotation = rotation_from_quaternion(np.roll(body.quat, -1))
                body.pos = body.pos + rotation @ self.errors.origins[index - 1]
                turned = rotation @ exp(self.errors.tilts[index - 1])
                body.quat = np.roll(quaternion_from_rotation(turned), 1)
        back = exp(-self.errors.mount[:3])
        site = np.roll(quaternion_from_rotation(back), 1)
        base.add_site(name='odometry', pos=-back @ self.errors.mount[3:], quat=site)
        for joint, (stiffness, damping) in (springs or {}).items():
            spec.joint(joint).stiffness[0], spec.joint(joint).damping[0] = stiffness, damping
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.place = [self.model.joint(joint).qposadr[0] for joint in robot.joint_names]
        self.rate = [self.model.joint(joint).dofadr[0] for joint in robot.joint_names]

    def _pull(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Add the orbit's effect on each body to the generalised forces, at the stage's own time and place."""
        around = self.around
        if around is None:
            return
        angle, square = around.mean_motion * data.time, around.mean_motion**2
        up = np.cos(angle) * around.zenith + np.sin(angle) * np.cross(around.normal, around.zenith)
        for body in range(1, model.nbody):
            mass, at, axes = float(model.body_mass[body]), data.xipos[body], data.ximat[body].reshape(3, 3)
            inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
            force, torque = mass * square * (3.0 * (up @ at) * up - at), 3.0 * square * np.cross(up, inertia @ up)
            mujoco.mj_applyFT(model, data, force, torque, at, body, data.qfrc_passive)

    def measured(self, start: State, instants: Array) -> Truth:
        """Return the readings of encoders and odometry, all joints free."""
        model, data, twist = self.model, self.data, np.zeros(6)
        site = model.site('odometry').id

        def row() -> tuple[Array, ...]:
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, site, twist, 1)
            return data.qpos[self.place], data.qvel[self.rate], data.site_xpos[site], data.site_xmat[site], twist

        count = len(self.place)
        rows = self._followed(start, instants, row)
        position, velocity, place, turn, angular, linear = np.split(rows, np.cumsum([count, count, 3, 9, 3]), axis=1)
        joints = (position - self.errors.zeros, velocity, np.zeros_like(position))
        orientation = quaternion_from_rotation(turn.reshape(-1, 3, 3))
        return Truth(np.array(instants), *joints, place, orientation, linear, angular)

    def driven(self, motion: Driven, start: State, instants: Array, joints: Sequence[str]) -> Truth:
        """Return the true motion at instants, in which named joints follow a motion by computed torques.

        The base and all other joints float; of the joints, the result has the named ones.
        """
        model, data = self.model, self.data
        place, rate = ([getattr(model.joint(name), kind)[0] for name in joints] for kind in ('qposadr', 'dofadr'))
        free = np.setdiff1d(np.arange(model.nv), rate)
        matrix = np.zeros((model.nv, model.nv))

        def drive(model: mujoco.MjModel, data: mujoco.MjData) -> None:
            wanted = motion.command(data.time, data.qpos[place], data.qvel[rate])
            mujoco.mj_fullM(model, data, matrix)
            other = data.qfrc_passive - data.qfrc_bias
            floating = np.linalg.solve(matrix[np.ix_(free, free)], other[free] - matrix[np.ix_(free, rate)] @ wanted)
            data.qfrc_applied[rate] = matrix[np.ix_(rate, free)] @ floating + matrix[np.ix_(rate, rate)] @ wanted
            data.qfrc_applied[rate] -= other[rate]

        def row() -> tuple[Array, ...]:
            return data.qpos[place], data.qvel[rate], data.qfrc_applied[rate], data.qpos[:7], data.qvel[:6]

        count = len(joints)
        rows = self._followed(start, instants, row, drive)
        position, velocity, effort, pose, twist = np.split(rows, np.cumsum([count, count, count, 7]), axis=1)
        orientation = np.roll(pose[:, 3:], -1, axis=1)
        linear = rotate_back(rotation_from_quaternion(orientation), twist[:, :3])
        return Truth(np.array(instants), position, velocity, effort, pose[:, :3], orientation, linear, twist[:, 3:])

    def _followed(
        self, start: State, instants: Array, row: Callable[[], Sequence[Array]], drive: object | None = None
    ) -> Array:
        """Return rows of numbers at instants; `drive` sets the torques of the joints."""
        model, data, rows = self.model, self.data, []
        data.qpos[:3], data.qpos[3:7] = start.base_position, np.roll(start.base_orientation, 1)
        data.qpos[self.place] = start.joint_position
        # A free joint: linear velocity in world axes, angular velocity in the body's.
        data.qvel[:3] = rotation_from_quaternion(start.base_orientation) @ start.velocity[:3]
        data.qvel[3:6], data.qvel[self.rate] = start.velocity[3:6], start.joint_velocity
        mujoco.set_mjcb_control(drive)
        mujoco.set_mjcb_passive(self._pull if self.around else None)
        try:
            for steps in np.diff(np.round(instants / model.opt.timestep).astype(int), prepend=0):
                mujoco.mj_step(model, data, nstep=int(steps))
                mujoco.mj_forward(model, data)
                rows.append(np.concatenate(row()))
        finally:
            mujoco.set_mjcb_control(None)
            mujoco.set_mjcb_passive(None)
        return np.array(rows)
