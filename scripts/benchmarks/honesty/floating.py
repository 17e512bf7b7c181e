"""A base that floats as conservation says while the joints move as told; a wrench may change the momentum."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.data import RATE
from benchmarks.honesty.paths import Path
from mbaid_ros.core.geometry import Array, quaternion_from_rotation
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import express, load_model
from mbaid_ros.core.robot.momentum import inertia_matrix, momentum
from mbaid_ros.core.simulation.run import Truth

# (time, s; base rotation (3, 3); base position (3,), m; (10,) standard parameters of the whole about the base's origin
# in its axes) -> (6,) rate of change of (P, L), odometry frame, L about its origin.
Wrench = Callable[[float, Array, Array, Array], Array]


@dataclass(frozen=True)
class World:
    """What really happens.

    Attributes
    ----------
    urdf : of the robot as it is
    path : of all its joints, in the model's order
    seconds, rate : s, Hz
    spin : rad/s of the base at time 0; its velocity brings the linear momentum to zero
    wrench : from outside; None for nothing
    unread : joints that no sensor reads
    sought : (10,) physical parameters to be found; None for those of the target link in the URDF
    """

    urdf: str
    path: Path
    seconds: float = 60.0
    rate: float = RATE
    spin: tuple[float, float, float] = (0.01, -0.015, 0.02)
    wrench: Wrench | None = None
    unread: tuple[str, ...] = ()
    sought: Array | None = None


def float_freely(world: World) -> Truth:
    """Return the motion of a world: Runge-Kutta of order 4, one step a sample."""
    model = load_model(world.urdf)
    steps = round(world.seconds * world.rate) + 1
    joints, rates = world.path(np.arange(2 * steps - 1) / (2.0 * world.rate))
    kinematics = Kinematics(model)
    configuration = kinematics.configure(np.broadcast_to(np.eye(3), (len(joints), 3, 3)), joints)
    bodies = express(model.body_parameters(), configuration.rotation, configuration.position)
    whole = np.sum(bodies, axis=1)
    matrix = inertia_matrix(whole)
    moving = np.sum(momentum(bodies, kinematics.body_twists(configuration, rates, np.zeros((len(joints), 6)))), axis=1)
    spin = np.array(world.spin)
    linear = -(matrix[0, :3, 3:] @ spin + moving[0, :3]) / whole[0, 0]
    total = matrix[0] @ np.concatenate((linear, spin)) + moving[0]
    flow = _Flow(np.linalg.inv(matrix), moving, whole, world)
    states, twists = _integrated(flow, np.concatenate(([0.0, 0.0, 0.0, 1.0], np.zeros(3), total)), steps)
    return Truth(
        time=np.arange(steps) / world.rate,
        joint_position=joints[::2],
        joint_velocity=rates[::2],
        joint_effort=np.zeros_like(joints[::2]),
        base_position=states[:, 4:7],
        base_orientation=states[:, :4],
        base_linear_velocity=twists[:, :3],
        base_angular_velocity=twists[:, 3:],
    )


@dataclass(frozen=True)
class _Flow:
    """How (quaternion, position, momentum), (13,), changes; nodes are half a step apart."""

    inverse: Array  # (K, 6, 6) of the locked robot's spatial inertia
    moving: Array  # (K, 6) momentum by the joints' rates alone
    whole: Array  # (K, 10)
    world: World

    def twist(self, node: int, state: Array) -> tuple[Array, Array]:
        """Return the base's rotation and its (6,) twist in base axes."""
        rotation = _rotation(*state[:4].tolist())
        (x, y, z), (a, b, c) = state[4:7].tolist(), state[7:10].tolist()
        angular = state[10:] - np.array([y * c - z * b, z * a - x * c, x * b - y * a])
        own = np.concatenate((state[7:10] @ rotation, angular @ rotation))
        return rotation, self.inverse[node] @ (own - self.moving[node])

    def rate(self, node: int, state: Array) -> Array:
        """Return the rate of a state."""
        rotation, twist = self.twist(node, state)
        (x, y, z, w), (a, b, c) = state[:4].tolist(), (0.5 * twist[3:]).tolist()
        result = np.zeros(13)
        result[:4] = w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a, -x * a - y * b - z * c
        result[4:7] = rotation @ twist[:3]
        if self.world.wrench is not None:
            time = node / (2.0 * self.world.rate)
            result[7:] = self.world.wrench(time, rotation, state[4:7], self.whole[node])
        return result


def _integrated(flow: _Flow, state: Array, steps: int) -> tuple[Array, Array]:
    """Return states (N, 13) and twists (N, 6) from step to step."""
    step = 1.0 / flow.world.rate
    states, twists = np.empty((steps, 13)), np.empty((steps, 6))
    for number in range(steps):
        node = 2 * number
        states[number], twists[number] = state, flow.twist(node, state)[1]
        if number == steps - 1:
            break
        first = flow.rate(node, state)
        second = flow.rate(node + 1, state + 0.5 * step * first)
        third = flow.rate(node + 1, state + 0.5 * step * second)
        fourth = flow.rate(node + 2, state + step * third)
        state = state + step / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
        state[:4] /= np.linalg.norm(state[:4])
    return states, twists


def _rotation(x: float, y: float, z: float, w: float) -> Array:
    """Return the rotation matrix of a quaternion of about unit length."""
    scale = 2.0 / (x * x + y * y + z * z + w * w)
    return np.array(
        [
            [1.0 - scale * (y * y + z * z), scale * (x * y - w * z), scale * (x * z + w * y)],
            [scale * (x * y + w * z), 1.0 - scale * (x * x + z * z), scale * (y * z - w * x)],
            [scale * (x * z - w * y), scale * (y * z + w * x), 1.0 - scale * (x * x + y * y)],
        ]
    )


def turned(truth: Truth, rotation: Array) -> Array:
    """Return (N, 4) quaternions of (N, 3, 3) rotations, continuous in time."""
    quaternion = quaternion_from_rotation(rotation)
    flips = np.cumprod(np.where(np.sum(quaternion[1:] * quaternion[:-1], axis=1) < 0.0, -1.0, 1.0))
    return quaternion * np.concatenate(([1.0], flips))[: len(truth), None]
