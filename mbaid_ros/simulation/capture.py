"""A capture: chaser and target move freely, each by itself, until they are joined; their momentum goes on as one.

The target is a rigid body that tumbles until then. It is joined to a link of the robot in no time; the joints hold
their rates, as they are driven: the base's twist jumps, such that the momentum of both is that of the whole.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array, cross, rotation_from_quaternion, unvec
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.momentum import physical, standard
from mbaid_ros.core.robot.urdf_edit import replace_inertial
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.environment import Surroundings, Wheels
from mbaid_ros.simulation.motion import Driven
from mbaid_ros.simulation.simulation import ChangingSimulation, Simulation, Truth, total_momentum


@dataclass(frozen=True)
class Target:
    """A body that is captured."""

    time: float  # s since the start of the run, at which it is
    link: str  # name of the link that holds it from then on
    body: Array  # (10,) mass, CoM and inertia about it, in the link's frame and axes: kg, m, kg m^2
    # velocity, spin: (3,) m/s, rad/s, of its CoM and its own, at that instant, odometry axes
    velocity: Array
    spin: Array


def with_target(model: RobotModel, target: Target) -> RobotModel:
    """Return the robot with the target in its hand."""
    together = model.link(target.link).parameters + standard(target.body)
    text = replace_inertial(model.urdf, target.link, physical(together))
    return load_model(text, model.base_link)


class CaptureSimulation(ChangingSimulation):
    """A run of the free-floating robot with a capture in it; parameters as of Simulation, the joints are driven.

    Attributes
    ----------
    target : as given
    joined : the robot after the capture
    brought : (6,) momentum (P, L) of the target before it, odometry frame, L about its origin
    momentum : (6,) that of the whole after it
    """

    def __init__(
        self,
        model: RobotModel,
        motion: Driven,
        initial: State,
        target: Target,
        surroundings: Surroundings | None = None,
    ) -> None:
        around, time = surroundings or Surroundings(), target.time
        self.target, self.joined = target, with_target(model, target)
        # Where the capture happens follows from the motion alone: a run of its own finds it.
        at = Simulation(model, motion, initial, surroundings=around).advance(np.array([time]))
        self.brought = _momentum(model, at, target)
        self.momentum: Array = total_momentum(model, at, around.wheels)[0] + self.brought
        start = _joined(self.joined, at, self.momentum, around.wheels)
        after = Simulation(self.joined, motion.later(time), start, surroundings=around.later(time))
        super().__init__(Simulation(model, motion, initial, surroundings=around), [(time, lambda _: after)])


def _momentum(model: RobotModel, at: Truth, target: Target) -> Array:
    """Return (P, L) of the target where the link is at the capture, (6,)."""
    link = model.link(target.link)
    configuration = Kinematics(model).configure(rotation_from_quaternion(at.base_orientation), at.joint_position)
    rotation, position = (values[0] for values in configuration.link(link))
    centre = at.base_position[0] + position + rotation @ target.body[1:4]
    linear = target.body[0] * target.velocity
    inertia = rotation @ unvec(target.body[4:]) @ rotation.T
    return np.concatenate((linear, cross(centre, linear) + inertia @ target.spin))


def _joined(model: RobotModel, at: Truth, momentum: Array, wheels: Wheels | None) -> State:
    """Return the state with the same poses and joint rates, and the base's twist that gives the momentum."""
    # The momentum is linear in the twist: a base at rest and six unit twists tell how.
    twists = np.concatenate((np.zeros((1, 6)), np.eye(6)))
    seven = at[np.zeros(7, dtype=int)]
    momenta = total_momentum(
        model, replace(seven, base_linear_velocity=twists[:, :3], base_angular_velocity=twists[:, 3:]), wheels
    )
    twist = np.linalg.solve((momenta[1:] - momenta[0]).T, momentum - momenta[0])
    velocity = np.concatenate((twist, at.joint_velocity[0]))
    return State(at.base_position[0], at.base_orientation[0], at.joint_position[0], velocity)
