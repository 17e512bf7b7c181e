"""Robots whose base floats by conservation of momentum while joints follow a path, or swing on springs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio

from benchmarks.data import RATE
from benchmarks.honesty.paths import Path
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.robot.model import Kinematics, express, load_model, parse
from mbaid_ros.core.robot.momentum import inertia_matrix, momentum
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.environment import Environment, Springs
from mbaid_ros.simulation.motion import Driven
from mbaid_ros.simulation.simulation import Simulation, Truth

# (time, s; base rotation (3, 3); base position (3,), m; (10,) standard parameters of the robot about the base's origin
# in its axes) -> (6,) rate of change of (P, L), odometry frame, L about its origin.
Wrench = Callable[[float, Array, Array, Array], Array]


@dataclass(frozen=True)
class Spring:
    """A spring and damper on a joint without a motor."""

    frequency: float  # Hz, of the joint by itself on the floating robot, its other joints locked
    damping: float  # over critical damping
    deflection: float  # rad or m, at time 0


@dataclass(frozen=True)
class World:
    """The true robot and its motion."""

    urdf: str
    path: Path  # of all joints in the model's order, except those on springs
    seconds: float = 60.0
    rate: float = RATE  # Hz
    spin: tuple[float, float, float] = (0.01, -0.015, 0.02)  # rad/s of the base at time 0; no linear momentum
    wrench: Wrench | None = None  # external
    unread: tuple[str, ...] = ()  # joints without a sensor
    springs: Mapping[str, Spring] = field(default_factory=dict)  # by joint
    sought: Array | None = None  # (10,) true physical parameters; None: of the target link in the URDF
    since: float = 0.0  # s, from when on these hold
    lost: tuple[float, str] | None = None  # s, and the robot after it has lost a part


def float_freely(world: World) -> Truth:
    """Return the motion of a world without springs."""
    steps = round(world.seconds * world.rate) + 1
    joints, rates = world.path(np.arange(2 * steps - 1) / (2.0 * world.rate))
    flow = Flow.of(world, world.urdf, joints, rates)
    matrix = np.linalg.inv(flow.inverse[0])
    total = matrix @ _start_twist(matrix, flow.moving[0], world.spin) + flow.moving[0]
    start = np.concatenate(([0.0, 0.0, 0.0, 1.0], np.zeros(3), total))
    states = integrated(flow.rate, start, steps, world.rate)
    twists = np.array([flow.twist(2 * number, state)[1] for number, state in enumerate(states)])
    if world.lost is not None:
        time, urdf = world.lost
        first = round(time * world.rate)
        after = Flow.of(world, urdf, joints[2 * first :], rates[2 * first :])
        begin = after.moving_as(flow, 2 * first, states[first])
        states[first:] = integrated(after.rate, begin, steps - first, world.rate)
        twists[first:] = [after.twist(2 * number, state)[1] for number, state in enumerate(states[first:])]
    return truth_of(world, states, twists, joints[::2], rates[::2])


_STEP = 1e-4  # s, of a difference quotient


@dataclass(frozen=True)
class _Following(Driven):
    """Joints (n,) of which some follow a path; springs move the others."""

    path: Path
    driven: Flags

    def reference(self, time: float) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration of the joints at a time, (n,) each, zero for springs."""
        position, rate = self.path(np.array([time - _STEP, time, time + _STEP]))
        result = np.zeros((3, len(self.driven)))
        result[:, self.driven] = position[1], rate[1], (rate[2] - rate[0]) / (2.0 * _STEP)
        return result[0], result[1], result[2]

    def command(self, time: float, position: Array, velocity: Array) -> Array:
        """Return the joint accelerations, zero for springs, which no reference holds."""
        del position, velocity
        return self.reference(time)[2]

    def from_time(self, time: float) -> '_Following':
        """Return the motion from a time on, s."""
        return _Following(lambda times: self.path(times + time), self.driven)


def swing(world: World) -> Truth:
    """Return the motion of a world with springs, by the package's simulator."""
    robot, springs = load_model(world.urdf), list(world.springs.values())
    driven = np.array([name not in world.springs for name in robot.joint_names])
    position, rate = np.zeros((2, len(driven)))
    position[driven], rate[driven] = (part[0] for part in world.path(np.zeros(1)))
    free = np.concatenate((np.ones(6, dtype=bool), ~driven))
    model = parse(robot)

    def mass() -> Array:
        upper = np.triu(pinocchio.crba(model, model.createData(), np.concatenate((np.zeros(6), [1.0], position))))
        return np.asarray(upper + np.triu(upper, 1).T)

    # The inertia of a spring's joint, base and other springs being free: the inverse of its part of the inverse.
    moved = 1.0 / np.diag(np.linalg.inv(mass()[np.ix_(free, free)]))[6:]
    turn, ratio = (np.array([getattr(each, name) for each in springs]) for name in ('frequency', 'damping'))
    turn = 2.0 * np.pi * turn
    around = Environment(springs=Springs(np.flatnonzero(~driven), moved * turn**2, 2.0 * ratio * moved * turn))
    position[~driven] = [spring.deflection for spring in springs]
    matrix = mass()
    twist = _start_twist(matrix[:6, :6], matrix[:6, 6:] @ rate, world.spin)
    start = State(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), position, np.concatenate((twist, rate)))
    following: Any = _Following(world.path, driven)  # without a reference, which springs have not
    run = Simulation(robot, following, start, environment=around)
    return run.advance(np.arange(round(world.seconds * world.rate) + 1) / world.rate)


def _start_twist(matrix: Array, moving: Array, spin: tuple[float, float, float]) -> Array:
    """Return the base's (6,) twist with a spin and no linear momentum, by locked inertia and momentum of the joints."""
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
    """Return N states (N, m), which begin with a quaternion, by Runge-Kutta of order 4.

    `rate` is of a state at a node, of which there are two a step; `pace` is steps a second.
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


def _rotation(state: Array) -> Array:
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


@dataclass(frozen=True)
class Flow:
    """Rate of (quaternion, position, momentum), (13,); nodes are half a step apart."""

    inverse: Array  # (K, 6, 6) of the locked robot's spatial inertia
    moving: Array  # (K, 6) momentum by the joints' rates alone
    whole: Array  # (K, 10)
    world: World

    @staticmethod
    def of(world: World, urdf: str, joints: Array, rates: Array) -> 'Flow':
        """Return that of a robot, of joints at K nodes."""
        model = load_model(urdf)
        kinematics = Kinematics(model)
        configuration = kinematics.configure(np.broadcast_to(np.eye(3), (len(joints), 3, 3)), joints)
        bodies = express(model.body_parameters(), configuration.rotation, configuration.position)
        whole = np.sum(bodies, axis=1)
        twists = kinematics.body_twists(configuration, rates, np.zeros((len(joints), 6)))
        return Flow(np.linalg.inv(inertia_matrix(whole)), np.sum(momentum(bodies, twists), axis=1), whole, world)

    def moving_as(self, other: 'Flow', node: int, state: Array) -> Array:
        """Return the state of this robot, at its first node, with the motion of another one at a node of its own."""
        rotation, twist = other.twist(node, state)
        own = np.linalg.solve(self.inverse[0], twist) + self.moving[0]
        linear = rotation @ own[:3]
        return np.concatenate((state[:7], linear, rotation @ own[3:] + np.cross(state[4:7], linear)))

    def twist(self, node: int, state: Array) -> tuple[Array, Array]:
        """Return the base's rotation and its (6,) twist in base axes."""
        rotation = _rotation(state)
        (x, y, z), (a, b, c) = state[4:7].tolist(), state[7:10].tolist()
        angular = state[10:] - np.array([y * c - z * b, z * a - x * c, x * b - y * a])
        own = np.concatenate((state[7:10] @ rotation, angular @ rotation))
        return rotation, self.inverse[node] @ (own - self.moving[node])

    def rate(self, node: int, state: Array) -> Array:
        """Return the rate of a state (13,) at a node."""
        rotation, twist = self.twist(node, state)
        (x, y, z, w), (a, b, c) = state[:4].tolist(), (0.5 * twist[3:]).tolist()
        result = np.zeros(13)
        result[:4] = w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a, -x * a - y * b - z * c
        result[4:7] = rotation @ twist[:3]
        if self.world.wrench is not None:
            time = node / (2.0 * self.world.rate)
            result[7:] = self.world.wrench(time, rotation, state[4:7], self.whole[node])
        return result
