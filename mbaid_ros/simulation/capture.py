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
from mbaid_ros.simulation.simulation import Simulation, Truth, total_momentum


@dataclass(frozen=True)
class Target:
    """A body that is captured.

    Attributes
    ----------
    time : s since the start of the run, at which it is
    link : name of the link that holds it from then on
    body : (10,) mass, CoM and inertia about it, in the link's frame and axes: kg, m, kg m^2
    velocity, spin : (3,) m/s, rad/s, of its CoM and its own, at that instant, odometry axes
    """

    time: float
    link: str
    body: Array
    velocity: Array
    spin: Array


def with_target(model: RobotModel, target: Target) -> RobotModel:
    """Return the robot with the target in its hand."""
    together = model.link(target.link).parameters + standard(target.body)
    text = replace_inertial(model.urdf, target.link, physical(together))
    return load_model(text, model.base_link)


class CaptureSimulation:
    """A run of the free-floating robot with a capture in it, with the interface of Simulation.

    Parameters
    ----------
    model : RobotModel, before the capture
    motion : of the joints, which are driven
    initial : state at time 0
    step : s, of the integrator
    target : Target
    surroundings : further effects on its bodies

    Attributes
    ----------
    target : as given
    joined : the robot after the capture
    brought : (6,) momentum (P, L) of the target before it, odometry frame, L about its origin
    momentum : (6,) that of the whole after it

    Raises
    ------
    ModelError
        The robot, or the target in its hand, cannot be simulated.
    """

    def __init__(
        self,
        model: RobotModel,
        motion: Driven,
        initial: State,
        step: float,
        target: Target,
        surroundings: Surroundings | None = None,
    ) -> None:
        self.target = target
        self._before = Simulation(model, motion, initial, step, surroundings=surroundings)
        self.joined = with_target(model, target)
        # Where the capture happens follows from the motion alone: a run of its own finds it.
        at = Simulation(model, motion, initial, step, surroundings=surroundings).advance(np.array([target.time]))
        around = surroundings or Surroundings()
        self.brought = _momentum(model, at, target)
        self.momentum: Array = total_momentum(model, at, around.wheels)[0] + self.brought
        start, later = _joined(self.joined, at, self.momentum, around.wheels), around.later(target.time)
        self._after = Simulation(self.joined, motion.later(target.time), start, step, surroundings=later)

    def advance(self, instants: Array) -> Truth:
        """Return the true motion at instants (s, in order), and forget the motion before the last of them.

        Raises
        ------
        DataError
            An instant lies before one already passed.
        ModelError
            The motion has diverged.
        """
        early = instants < self.target.time
        parts = [self._before.advance(instants[early])] if np.any(early) or not len(instants) else []
        if not np.all(early):
            after = self._after.advance(instants[~early] - self.target.time)
            parts.append(replace(after, time=instants[~early]))
        return Truth.concatenate(parts)


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
    # The momentum is linear in the twist: a base at rest and six unit twists determine it.
    twists = np.concatenate((np.zeros((1, 6)), np.eye(6)))
    seven = at[np.zeros(7, dtype=int)]
    momenta = total_momentum(
        model, replace(seven, base_linear_velocity=twists[:, :3], base_angular_velocity=twists[:, 3:]), wheels
    )
    twist = np.linalg.solve((momenta[1:] - momenta[0]).T, momentum - momenta[0])
    velocity = np.concatenate((twist, at.joint_velocity[0]))
    return State(at.base_position[0], at.base_orientation[0], at.joint_position[0], velocity)
