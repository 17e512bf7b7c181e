"""A captured body that slips in the grasp until it is held: six driven joints between the hand and the body."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, cross, exp, rotate, rotation_from_quaternion
from mbaid_ros.core.robot.model import Kinematics, RobotModel, load_model
from mbaid_ros.core.robot.urdf import replace_inertial, tree_of
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.dynamics import State
from mbaid_ros.simulation.environment import Environment
from mbaid_ros.simulation.motion import Driven
from mbaid_ros.simulation.simulation import Simulation, Truth

_NAME = 'captured_body'
_ITERATIONS = 50  # of place and rate at the capture, each of which follows from the other
_AXES = ('1 0 0', '0 1 0', '0 0 1')


@dataclass(frozen=True, eq=False)
class Slip:
    """How far the body is from where it will be held, in the link's frame: (6,) place, m, and angles about x, y, z."""

    rate: Array  # (6,) at the capture, m/s and rad/s
    length: float  # s, in which it falls to zero

    def reference(self, time: float) -> tuple[Array, Array, Array]:
        """Return place, rate and acceleration (6,) at a time, s after the capture; zero once it is held."""
        left = max(1.0 - time / self.length, 0.0)
        return -self.rate * self.length / 3.0 * left**3, self.rate * left**2, -2.0 * self.rate / self.length * left

    def frames(self, time: Array) -> tuple[Array, Array]:
        """Return rotations (N, 3, 3) and positions (N, 3) of the body's frame in the link's at times (N,) s."""
        places = np.array([self.reference(float(each))[0] for each in time]).reshape(-1, 6)
        return _turned(places[:, 3:]), places[:, :3]


def _turned(angles: Array) -> Array:
    """Return the rotations (N, 3, 3) about x, then the new y, then the new z."""
    x, y, z = (exp(angles[:, [axis]] * np.eye(3)[axis]) for axis in range(3))
    return np.asarray(x @ y @ z)


def slip_of(
    link: tuple[Array, Array], moving: tuple[Array, Array], body: Array, motion: tuple[Array, Array], length: float
) -> Slip:
    """Return the slip that begins with the body's own motion.

    Parameters
    ----------
    link : rotation (3, 3) and position (3,) m of the link at the capture, odometry frame
    moving : velocity of its origin and angular velocity (3,), odometry axes
    body : (10,) mass, CoM and inertia, in the link's frame once held
    motion : velocity of the body's CoM and its spin, odometry axes
    length : s, until it is held
    """
    rotation, position = link
    rate: Array = np.zeros(6)
    for _ in range(_ITERATIONS):
        turns, places = Slip(rate, length).frames(np.zeros(1))
        turned, origin = rotation @ turns[0], position + rotation @ places[0]
        velocity = motion[0] - cross(motion[1], turned @ body[1:4])
        relative = velocity - moving[0] - cross(moving[1], origin - position)
        angles = -rate[3:] * length / 3.0
        first = _turned(np.array([[angles[0], 0.0, 0.0]]))[0]
        second = first @ _turned(np.array([[0.0, angles[1], 0.0]]))[0]
        axes = np.column_stack((np.eye(3)[0], first[:, 1], second[:, 2]))
        rate = np.concatenate((rotation.T @ relative, np.linalg.solve(axes, rotation.T @ (motion[1] - moving[1]))))
    return Slip(rate, length)


def link_motion(model: RobotModel, at: Truth, name: str) -> tuple[Array, Array]:
    """Return the velocity of a link's origin and its angular velocity, (3,) each, odometry axes, at one instant."""
    kinematics, link = Kinematics(model), model.link(name)
    configuration = kinematics.configure(rotation_from_quaternion(at.base_orientation), at.joint_position)
    linear, angular = (
        quaternions.rotate(at.base_orientation, each) for each in (at.base_linear_velocity, at.base_angular_velocity)
    )
    twist = kinematics.body_twists(configuration, at.joint_velocity, np.concatenate((linear, angular), axis=1))
    velocity, spin = twist[0, link.body, :3], twist[0, link.body, 3:]
    return velocity + cross(spin, configuration.link_pose(link)[1][0]), spin


def slipping_model(model: RobotModel, link: str, body: Array) -> RobotModel:
    """Return a robot with six joints more, that end in a body (10,) mass, CoM and inertia."""
    robot, parent = tree_of(model.urdf, comments=True), link
    for place in range(6):
        child = f'{_NAME}_{place}'
        ET.SubElement(robot, 'link', name=child)
        joint = ET.SubElement(robot, 'joint', name=child, type='prismatic' if place < 3 else 'revolute')
        ET.SubElement(joint, 'parent', link=parent)
        ET.SubElement(joint, 'child', link=child)
        ET.SubElement(joint, 'axis', xyz=_AXES[place % 3])
        ET.SubElement(joint, 'limit', lower='-10', upper='10', velocity='10', effort='1000')
        parent = child
    return load_model(replace_inertial(ET.tostring(robot, encoding='unicode'), parent, body), model.base_link)


class _Both(Driven):
    """The joints of the arm, and those of the slip."""

    def __init__(self, arm: Driven, slip: Slip, of_arm: Flags, begin: float = 0.0) -> None:
        self._arm, self._slip, self._of_arm, self._begin = arm, slip, of_arm, begin

    def reference(self, time: float) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration of the joints at a time, (n + 6,) each."""
        arm, slip = self._arm.reference(time), self._slip.reference(self._begin + time)
        one, two, three = (self.merged(*each) for each in zip(arm, slip, strict=True))
        return one, two, three

    def from_time(self, time: float) -> _Both:
        """Return the motion with time 0 at a time (s) of this one."""
        return _Both(self._arm.from_time(time), self._slip, self._of_arm, self._begin + time)

    def merged(self, arm: Array, slip: Array) -> Array:
        """Return numbers of all joints, (n + 6,), from those of the arm and of the slip."""
        whole = np.zeros(len(self._of_arm))
        whole[self._of_arm], whole[~self._of_arm] = arm, slip
        return whole


class SlippingSimulation(Simulation):
    """A run of the robot while the body slips, from the capture on; its truth has the joints of the arm alone.

    Parameters
    ----------
    model : with an empty hand
    motion : of the arm, from the capture on
    at : the robot at the capture
    """

    def __init__(
        self,
        model: RobotModel,
        motion: Driven,
        at: Truth,
        slip: Slip,
        held: tuple[str, Array],
        environment: Environment,
    ) -> None:
        together = slipping_model(model, *held)
        self._of_arm = _are_in(together.joint_names, model.joint_names)
        both = _Both(motion, slip, self._of_arm)
        place, rate, _ = slip.reference(0.0)
        position, velocity = both.merged(at.joint_position[0], place), both.merged(at.joint_velocity[0], rate)
        twist = (at.base_linear_velocity[0], at.base_angular_velocity[0], velocity)
        start = State(at.base_position[0], at.base_orientation[0], position, np.concatenate(twist))
        super().__init__(together, both, start, environment=environment)

    def _truth(self, instants: Array, values: Array) -> Truth:
        truth = super()._truth(instants, values)
        parts = ('joint_position', 'joint_velocity', 'joint_effort')
        return replace(truth, **{name: getattr(truth, name)[:, self._of_arm] for name in parts})


def _are_in(names: Sequence[str], some: Sequence[str]) -> Flags:
    return np.array([name in some for name in names], dtype=bool)


def body_poses(model: RobotModel, truth: Truth, link: str, slip: Slip | None, time: Array) -> tuple[Array, Array]:
    """Return rotations (N, 3, 3) and positions (N, 3) of the frame of the link that the body has, odometry frame.

    Parameters
    ----------
    truth : of the robot at N instants after the capture
    time : (N,) s after it
    """
    configuration = Kinematics(model).configure(rotation_from_quaternion(truth.base_orientation), truth.joint_position)
    rotation, position = configuration.link_pose(model.link(link))
    position = truth.base_position + position
    if slip is None:
        return rotation, position
    turn, place = slip.frames(time)
    return rotation @ turn, position + rotate(rotation, place)
