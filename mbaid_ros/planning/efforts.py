"""The torques that a planned motion asks of the joints, by pinocchio."""

from __future__ import annotations

import numpy as np
import pinocchio

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.robot.model import RobotModel, configurations, parse
from mbaid_ros.core.robot.momentum import Storage

_STILL, _NONE, _NOTHING = np.zeros(3), np.zeros(0), Storage()
_ORDER = [0, 1, 2, 3, 4, 5, 7, 6, 8, 9]  # of standard parameters, as pinocchio has them


class JointEfforts:
    """The torques, or forces, of a robot's joints.

    Parameters
    ----------
    bodies : (n + 1, 10) standard parameters of its bodies, each in its own frame
    storage, stored : momentum inside these bodies; its readings (c,), which stay constant

    Attributes
    ----------
    limits : (k,) of the joints that follow no other, N m or N; infinite where the URDF has none
    """

    def __init__(self, model: RobotModel, bodies: Array, storage: Storage = _NOTHING, stored: Array = _NONE) -> None:
        self._model = model
        self._spinning: dict[int, Array] = {}  # by pinocchio's index of a body, N m s in its axes
        for body, momentum in zip(storage.bodies, storage.axes * (storage.inertias * stored)[:, None], strict=True):
            self._spinning[body + 1] = self._spinning.get(body + 1, 0.0) + momentum
        self._parsed = parse(model)
        for place, body in enumerate(bodies, start=1):
            # Of a body without mass that would divide by zero.
            massive = body[0] > 0.0
            own = pinocchio.Inertia.FromDynamicParameters(body[_ORDER]) if massive else pinocchio.Inertia.Zero()
            self._parsed.inertias[place] = own
        self._data = self._parsed.createData()
        self.limits = np.array([model.limits[place].effort for place in model.transmission.independent])

    @property
    def limited(self) -> bool:
        """Whether any joint has a limit."""
        return bool(np.isfinite(self.limits).any())

    def limit_use(self, position: Array, rate: Array, acceleration: Array, twist: Array) -> Array:
        """Return which part of their limits the joints use at most, (B, k), in B motions.

        Parameters
        ----------
        position, rate, acceleration : (T, B, n) of all joints
        twist : (T, B, 6) of the base, its axes
        """
        joints = position.shape[-1]
        flat = (each.reshape(-1, each.shape[-1]) for each in (position, rate, acceleration, twist))
        torque = self.torques(*flat).reshape(*position.shape[:2], joints)
        moved = self._model.transmission
        own = np.zeros((*torque.shape[:2], len(moved.independent)))
        for joint in range(joints):
            own[..., moved.driver[joint]] += moved.multiplier[joint] * torque[..., joint]
        return np.asarray(np.abs(own).max(axis=0) / self.limits)

    def torques(self, position: Array, rate: Array, acceleration: Array, twist: Array) -> Array:
        """Return the torques (N, n) that accelerate all joints at N instants.

        Parameters
        ----------
        position, rate, acceleration : (N, n)
        twist : (N, 6) of the base, its axes
        """
        parsed, data, size = self._parsed, self._data, 6 + position.shape[1]
        still = np.zeros((len(position), 6))
        configuration = configurations(self._model, position)
        velocity, change = np.hstack((twist, rate)), np.hstack((still, acceleration))
        needed, inertia = np.empty((len(position), size)), np.empty((len(position), 6, size))
        for place in range(len(position)):
            motion = configuration[place], velocity[place]
            if self._spinning:
                needed[place] = pinocchio.rnea(parsed, data, *motion, change[place], self._gyroscopic(*motion))
            else:
                needed[place] = pinocchio.rnea(parsed, data, *motion, change[place])
            inertia[place] = pinocchio.crba(parsed, data, configuration[place])[:6]
        # Nothing pushes the base: it accelerates so that its own six rows vanish.
        of_base = np.linalg.solve(_symmetric(inertia[:, :, :6]), -needed[:, :6, None])
        return np.asarray(needed[:, 6:] + (np.swapaxes(inertia[:, :, 6:], 1, 2) @ of_base)[..., 0])

    def _gyroscopic(self, configuration: Array, velocity: Array) -> pinocchio.StdVec_Force:
        """Return what stored momentum h exerts on the bodies that turn it with w, -w x h, in their axes."""
        pinocchio.forwardKinematics(self._parsed, self._data, configuration, velocity)
        forces = pinocchio.StdVec_Force()
        for place, twist in enumerate(self._data.v):
            torque = -np.cross(twist.angular, self._spinning.get(place, _STILL))
            forces.append(pinocchio.Force(_STILL, torque))
        return forces


def _symmetric(upper: Array) -> Array:
    """Return matrices (N, 6, 6) of which the upper triangles are given."""
    upper = np.triu(upper)
    return np.asarray(upper + np.swapaxes(np.triu(upper, 1), 1, 2))
