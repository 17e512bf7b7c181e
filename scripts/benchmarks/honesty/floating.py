"""A base that floats as conservation says while the joints move as told; a wrench may change the momentum."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from benchmarks.data import RATE
from benchmarks.honesty.paths import Path
from mbaid_ros.core.geometry import Array, quaternion_from_rotation
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import express, load_model
from mbaid_ros.core.robot.momentum import inertia_matrix, momentum
from mbaid_ros.simulation.simulation import Truth

# (time, s; base rotation (3, 3); base position (3,), m; (10,) standard parameters of the whole about the base's origin
# in its axes) -> (6,) rate of change of (P, L), odometry frame, L about its origin.
Wrench = Callable[[float, Array, Array, Array], Array]


@dataclass(frozen=True)
class Spring:
    """What holds a joint that nothing drives.

    Attributes
    ----------
    frequency : Hz, of the joint by itself on the floating robot, its other joints locked
    damping : over critical damping
    deflection : rad or m, at time 0
    """

    frequency: float
    damping: float
    deflection: float


@dataclass(frozen=True)
class World:
    """What really happens.

    Attributes
    ----------
    urdf : of the robot as it is
    path : of all its joints, in the model's order, but for those on springs
    seconds, rate : s, Hz
    spin : rad/s of the base at time 0; its velocity brings the linear momentum to zero
    wrench : from outside; None for nothing
    unread : joints that no sensor reads
    springs : by joint
    sought : (10,) physical parameters to be found; None for those of the target link in the URDF
    since : s, from when on these are the target's
    lost : s, and the robot as it is from then on, which has let go of a part; None where it keeps all
    """

    urdf: str
    path: Path
    seconds: float = 60.0
    rate: float = RATE
    spin: tuple[float, float, float] = (0.01, -0.015, 0.02)
    wrench: Wrench | None = None
    unread: tuple[str, ...] = ()
    springs: Mapping[str, Spring] = field(default_factory=dict)
    sought: Array | None = None
    since: float = 0.0
    lost: tuple[float, str] | None = None


def float_freely(world: World) -> Truth:
    """Return the motion of a world without springs."""
    steps = round(world.seconds * world.rate) + 1
    joints, rates = world.path(np.arange(2 * steps - 1) / (2.0 * world.rate))
    flow = _Flow.of(world, world.urdf, joints, rates)
    matrix = np.linalg.inv(flow.inverse[0])
    total = matrix @ start_twist(matrix, flow.moving[0], world.spin) + flow.moving[0]
    start = np.concatenate(([0.0, 0.0, 0.0, 1.0], np.zeros(3), total))
    states = integrated(flow.rate, start, steps, world.rate)
    twists = np.array([flow.twist(2 * number, state)[1] for number, state in enumerate(states)])
    if world.lost is not None:
        time, urdf = world.lost
        first = round(time * world.rate)
        after = _Flow.of(world, urdf, joints[2 * first :], rates[2 * first :])
        begin = after.moving_as(flow, 2 * first, states[first])
        states[first:] = integrated(after.rate, begin, steps - first, world.rate)
        twists[first:] = [after.twist(2 * number, state)[1] for number, state in enumerate(states[first:])]
    return truth_of(world, states, twists, joints[::2], rates[::2])


def start_twist(matrix: Array, moving: Array, spin: tuple[float, float, float]) -> Array:
    """Return the base's (6,) twist with a spin and no linear momentum.

    Parameters
    ----------
    matrix : (6, 6) spatial inertia of the locked robot
    moving : (6,) momentum by the joints' rates alone
    spin : rad/s
    """
    linear = -(matrix[:3, 3:] @ np.array(spin) + moving[:3]) / matrix[0, 0]
    return np.concatenate((linear, spin))


def truth_of(world: World, states: Array, twists: Array, joints: Array, rates: Array) -> Truth:
    """Return states that begin with (quaternion, position), and twists, as a motion."""
    return Truth(
        time=np.arange(len(states)) / world.rate,
        joint_position=joints,
        joint_velocity=rates,
        joint_effort=np.zeros_like(joints),
        base_position=states[:, 4:7],
        base_orientation=states[:, :4],
        base_linear_velocity=twists[:, :3],
        base_angular_velocity=twists[:, 3:],
    )


def integrated(rate: Callable[[int, Array], Array], state: Array, steps: int, pace: float) -> Array:
    """Return states (N, m), that begin with a quaternion, from step to step: Runge-Kutta of order 4.

    Parameters
    ----------
    rate : of a state at a node; nodes are half a step apart
    state : (m,) the first
    steps : N
    pace : steps a second
    """
    step = 1.0 / pace
    states = np.empty((steps, len(state)))
    for number in range(steps):
        states[number], node = state, 2 * number
        if number == steps - 1:
            break
        first = rate(node, state)
        second = rate(node + 1, state + 0.5 * step * first)
        third = rate(node + 1, state + 0.5 * step * second)
        fourth = rate(node + 2, state + step * third)
        state = state + step / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
        state[:4] /= np.linalg.norm(state[:4])
    return states


def pose_rate(state: Array, rotation: Array, twist: Array) -> Array:
    """Return the rate of (quaternion, position), (7,), by the base's twist in its axes."""
    (x, y, z, w), (a, b, c) = state[:4].tolist(), (0.5 * twist[3:]).tolist()
    turning = [w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a, -x * a - y * b - z * c]
    return np.concatenate((turning, rotation @ twist[:3]))


@dataclass(frozen=True)
class _Flow:
    """How (quaternion, position, momentum), (13,), changes; nodes are half a step apart."""

    inverse: Array  # (K, 6, 6) of the locked robot's spatial inertia
    moving: Array  # (K, 6) momentum by the joints' rates alone
    whole: Array  # (K, 10)
    world: World

    @staticmethod
    def of(world: World, urdf: str, joints: Array, rates: Array) -> _Flow:
        """Return the flow of a robot whose joints have positions and rates (K, n)."""
        model = load_model(urdf)
        kinematics = Kinematics(model)
        configuration = kinematics.configure(np.broadcast_to(np.eye(3), (len(joints), 3, 3)), joints)
        bodies = express(model.body_parameters(), configuration.rotation, configuration.position)
        whole = np.sum(bodies, axis=1)
        twists = kinematics.body_twists(configuration, rates, np.zeros((len(joints), 6)))
        return _Flow(np.linalg.inv(inertia_matrix(whole)), np.sum(momentum(bodies, twists), axis=1), whole, world)

    def moving_as(self, other: _Flow, node: int, state: Array) -> Array:
        """Return the state in which this robot, at its first node, moves as another one does at a node of its own."""
        rotation, twist = other.twist(node, state)
        own = np.linalg.solve(self.inverse[0], twist) + self.moving[0]
        linear = rotation @ own[:3]
        return np.concatenate((state[:7], linear, rotation @ own[3:] + np.cross(state[4:7], linear)))

    def twist(self, node: int, state: Array) -> tuple[Array, Array]:
        """Return the base's rotation and its (6,) twist in base axes."""
        rotation = rotation_of(state)
        (x, y, z), (a, b, c) = state[4:7].tolist(), state[7:10].tolist()
        angular = state[10:] - np.array([y * c - z * b, z * a - x * c, x * b - y * a])
        own = np.concatenate((state[7:10] @ rotation, angular @ rotation))
        return rotation, self.inverse[node] @ (own - self.moving[node])

    def rate(self, node: int, state: Array) -> Array:
        """Return the rate of a state."""
        rotation, twist = self.twist(node, state)
        result = np.zeros(13)
        result[:7] = pose_rate(state, rotation, twist)
        if self.world.wrench is not None:
            time = node / (2.0 * self.world.rate)
            result[7:] = self.world.wrench(time, rotation, state[4:7], self.whole[node])
        return result


def rotation_of(state: Array) -> Array:
    """Return the rotation matrix of a state, whose quaternion is of about unit length."""
    x, y, z, w = state[:4].tolist()
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
