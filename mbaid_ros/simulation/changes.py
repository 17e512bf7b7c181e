"""Runs in which something changes: a pulse of thrust, or a capture, after which two bodies go on as one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from mbaid_ros.core.geometry import Array, cross, exp, rotation_from_quaternion, unvec
from mbaid_ros.core.robot.body import physical, standard
from mbaid_ros.core.robot.model import Kinematics, Link, RobotModel, load_model
from mbaid_ros.core.robot.urdf import replace_inertial
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.environment import BodyWrench, Environment, Wheels
from mbaid_ros.simulation.motion import Driven, Motion
from mbaid_ros.simulation.simulation import PiecewiseSimulation, Simulation, Truth, total_momentum
from mbaid_ros.simulation.slip import Slip, SlippingSimulation, link_motion, slip_of


@dataclass(frozen=True)
class Pulse:
    """A force and torque that act on a link; or on the base, constant in the odometry frame."""

    begin: float  # s since the start of the run, as commanded
    end: float  # s since the start of the run, as commanded
    link: Link | None  # None for the odometry frame
    wrench: Array  # (6,) force, N, and torque about the frame's origin, N m, in its axes, as commanded
    scale: float = 1.0  # how much stronger it is than that
    # (3,) rad, rotation vector by which it is turned against that
    turn: Array = field(default_factory=lambda: np.zeros(3))
    delay: float = 0.0  # s, by which it begins and ends late

    @property
    def actual(self) -> Array:
        """The (6,) force and torque that act."""
        if self.scale == 1.0 and not self.turn.any():
            return self.wrench
        rotation = self.scale * exp(self.turn)
        return np.concatenate((rotation @ self.wrench[:3], rotation @ self.wrench[3:]))


class ThrustSimulation(PiecewiseSimulation):
    """A run of the free-floating robot with a pulse of thrust, which stays in `pulse`; parameters as of Simulation."""

    def __init__(
        self, model: RobotModel, motion: Motion, initial: State, pulse: Pulse, environment: Environment | None = None
    ) -> None:
        self.pulse = pulse
        around = environment or Environment()

        def change(time: float, push: BodyWrench | None) -> tuple[float, Callable[[Truth], Simulation]]:
            return time, lambda at: Simulation(model, motion.from_time(time), _state(at), push, around.from_time(time))

        super().__init__(
            Simulation(model, motion, initial, environment=around),
            [
                change(pulse.begin + pulse.delay, BodyWrench.on_link(pulse.link, pulse.actual)),
                change(pulse.end + pulse.delay, None),
            ],
        )


def _state(truth: Truth) -> State:
    """Return the last of some instants as a state."""
    twist = (truth.base_linear_velocity[-1], truth.base_angular_velocity[-1], truth.joint_velocity[-1])
    return State(truth.base_position[-1], truth.base_orientation[-1], truth.joint_position[-1], np.concatenate(twist))


@dataclass(frozen=True)
class Target:
    """A body that is captured."""

    time: float  # s since the start of the run, at which it is
    link: str  # name of the link that holds it from then on
    body: Array  # (10,) mass, CoM and inertia about it, in the link's frame and axes: kg, m, kg m^2
    # velocity, spin: (3,) m/s, rad/s, of its CoM and its own, at that instant, odometry axes
    velocity: Array
    spin: Array
    settling: float = 0.0  # s, in which it slips in the grasp until it is where `body` has it


def with_target(model: RobotModel, target: Target) -> RobotModel:
    """Return the robot with the target in its hand."""
    together = model.link(target.link).parameters + standard(target.body)
    text = replace_inertial(model.urdf, target.link, physical(together))
    return load_model(text, model.base_link)


class CaptureSimulation(PiecewiseSimulation):
    """A run of the free-floating robot with a capture in it; parameters as of Simulation, the joints are driven.

    Attributes
    ----------
    target : as given
    joined_model : the robot after the capture
    link_pose : rotation (3, 3) and position (3,) m of the link that holds the target, at the capture, odometry frame;
        where the body has it, which is elsewhere if that slips
    slip : of the body in the grasp, None where it is held at once
    target_momentum : (6,) momentum (P, L) of the target before it, odometry frame, L about its origin
    total_momentum : (6,) that of the whole after it
    """

    def __init__(
        self,
        model: RobotModel,
        motion: Driven,
        initial: State,
        target: Target,
        environment: Environment | None = None,
    ) -> None:
        around, time = environment or Environment(), target.time
        self.target, self.joined_model = target, with_target(model, target)
        # Where the capture happens follows from the motion alone: a run of its own finds it.
        at = Simulation(model, motion, initial, environment=around).advance(np.array([time]))
        self.slip: Slip | None = None
        self.link_pose = _link_pose(model, at, target.link)
        if target.settling > 0.0:
            moving, body_moves = link_motion(model, at, target.link), (target.velocity, target.spin)
            self.slip = slip_of(self.link_pose, moving, target.body, body_moves, target.settling)
            (turn,), (place,) = self.slip.frames(np.zeros(1))
            rotation, position = self.link_pose
            self.link_pose = rotation @ turn, position + rotation @ place
        self.target_momentum = _target_momentum(self.link_pose, target)
        self.total_momentum: Array = total_momentum(model, at, around.wheels)[0] + self.target_momentum
        changes: list[tuple[float, Callable[[Truth], Simulation]]] = []
        if self.slip is None:
            start = _joined_state(self.joined_model, at, self.total_momentum, around.wheels)
            joined = Simulation(self.joined_model, motion.from_time(time), start, environment=around.from_time(time))
            changes.append((time, lambda _: joined))
        else:
            body, settled = (target.link, target.body), time + target.settling
            slipping = SlippingSimulation(
                model, motion.from_time(time), at, self.slip, body, environment=around.from_time(time)
            )
            moved, later = motion.from_time(settled), around.from_time(settled)
            changes.append((time, lambda _: slipping))
            changes.append((settled, lambda end: Simulation(self.joined_model, moved, _state(end), environment=later)))
        super().__init__(Simulation(model, motion, initial, environment=around), changes)


def _link_pose(model: RobotModel, at: Truth, name: str) -> tuple[Array, Array]:
    """Return rotation (3, 3) and position (3,) of a link's frame in the odometry frame."""
    configuration = Kinematics(model).configure(rotation_from_quaternion(at.base_orientation), at.joint_position)
    rotation, position = (values[0] for values in configuration.link_pose(model.link(name)))
    return rotation, at.base_position[0] + position


def _target_momentum(link_pose: tuple[Array, Array], target: Target) -> Array:
    """Return (P, L) of the target where the link is at the capture, (6,)."""
    rotation, position = link_pose
    centre = position + rotation @ target.body[1:4]
    linear = target.body[0] * target.velocity
    inertia = rotation @ unvec(target.body[4:]) @ rotation.T
    return np.concatenate((linear, cross(centre, linear) + inertia @ target.spin))


def _joined_state(model: RobotModel, at: Truth, momentum: Array, wheels: Wheels | None) -> State:
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
