"""A base that floats while some joints move as told and others swing on springs, with all of their dynamics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio

from benchmarks.honesty.floating import World, integrated, pose_rate, rotation_of, start_twist, truth_of
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.robot.model import load_model, parse
from mbaid_ros.simulation.simulation import Truth


def swing(world: World) -> Truth:
    """Return the motion of a world with springs."""
    steps = round(world.seconds * world.rate) + 1
    driven = world.path(np.arange(2 * steps - 1) / (2.0 * world.rate))
    flow = _Flow.of(world, *driven)
    deflection = np.array([spring.deflection for spring in world.springs.values()])
    state = np.concatenate(([0.0, 0.0, 0.0, 1.0], np.zeros(3), deflection, np.zeros(6), np.zeros(len(deflection))))
    mass, count = flow.mass(0, state), len(deflection)
    twist = start_twist(mass[:6, :6], mass[:6, 6:] @ flow.joints(0, state)[1], world.spin)
    state[7 + count : 13 + count] = twist
    states = integrated(flow.rate, state, steps, world.rate)
    joints = [flow.joints(2 * number, each) for number, each in enumerate(states)]
    first = 7 + len(deflection)
    return truth_of(
        world, states, states[:, first : first + 6], *(np.array(part) for part in zip(*joints, strict=True))
    )


@dataclass(frozen=True)
class _Flow:
    """How quaternion, position, deflections, base twist and rates of the deflections change.

    Nodes are half a step apart.
    """

    pinocchio: pinocchio.Model
    data: pinocchio.Data
    swinging: Flags  # (n,) True for the joints on springs
    position: Array  # (K, d) of the driven joints
    velocity: Array
    acceleration: Array
    stiffness: Array  # (k,)
    damping: Array

    @staticmethod
    def of(world: World, position: Array, rate: Array) -> _Flow:
        """Return the flow of a world whose driven joints have positions and rates (K, d)."""
        model = parse(world.urdf)
        swinging = np.array([name in world.springs for name in load_model(world.urdf).joint_names])
        acceleration = np.gradient(rate, 0.5 / world.rate, axis=0)
        none = np.zeros(len(world.springs))
        flow = _Flow(model, model.createData(), swinging, position, rate, acceleration, none, none)
        start = np.concatenate(([0.0, 0.0, 0.0, 1.0], np.zeros(3), none, np.zeros(6), none))
        free = np.concatenate((np.ones(6, dtype=bool), swinging))
        # What a spring moves while base and other springs give way: the inverse of its part of the inverse.
        moved = 1.0 / np.diag(np.linalg.inv(flow.mass(0, start)[np.ix_(free, free)]))[6:]
        turn = 2.0 * np.pi * np.array([spring.frequency for spring in world.springs.values()])
        ratio = np.array([spring.damping for spring in world.springs.values()])
        stiffness, damping = moved * turn**2, 2.0 * ratio * moved * turn
        return _Flow(model, flow.data, swinging, position, rate, acceleration, stiffness, damping)

    def joints(self, node: int, state: Array) -> tuple[Array, Array]:
        """Return positions and rates (n,) of all joints."""
        count = len(self.stiffness)
        position, velocity = np.empty(len(self.swinging)), np.empty(len(self.swinging))
        position[~self.swinging], velocity[~self.swinging] = self.position[node], self.velocity[node]
        position[self.swinging], velocity[self.swinging] = state[7 : 7 + count], state[13 + count :]
        return position, velocity

    def mass(self, node: int, state: Array) -> Array:
        """Return the (6 + n, 6 + n) joint-space inertia."""
        configuration = np.concatenate((state[4:7], state[:4], self.joints(node, state)[0]))
        upper = np.triu(pinocchio.crba(self.pinocchio, self.data, configuration))
        return np.asarray(upper + np.triu(upper, 1).T)

    def rate(self, node: int, state: Array) -> Array:
        """Return the rate of a state."""
        count, free = len(self.stiffness), np.concatenate((np.ones(6, dtype=bool), self.swinging))
        position, velocity = self.joints(node, state)
        twist = state[7 + count : 13 + count]
        configuration = np.concatenate((state[4:7], state[:4], position))
        known = np.zeros(len(free))
        known[~free] = self.acceleration[node]
        # What base and springs lack of the forces that the driven joints' accelerations take.
        force = -pinocchio.rnea(self.pinocchio, self.data, configuration, np.concatenate((twist, velocity)), known)[
            free
        ]
        force[6:] -= self.stiffness * state[7 : 7 + count] + self.damping * state[13 + count :]
        gained = np.linalg.solve(self.mass(node, state)[np.ix_(free, free)], force)
        pose = pose_rate(state, rotation_of(state), twist)
        return np.concatenate((pose, state[13 + count :], gained))
