"""The seven-joint servicer before its capture and after it, with reaction wheels, and pushed by its thrusters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

import recorded
from benchmarks.honesty.disturbed import AXES
from benchmarks.honesty.disturbed import wheeled as with_wheels
from benchmarks.honesty.paths import servicer
from benchmarks.precapture import BARE_LINK7, GENERAL, WEIGHED, free_model
from floating import RATE, float_freely, pushing, still
from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.core.geometry import Array, quaternion_from_rotation, rotation_from_quaternion, unvec
from mbaid_ros.core.robot.body import physical, standard
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.momentum import MomentumKernel
from mbaid_ros.sensor_messages import Thrust
from mbaid_ros.simulation.motion import Sinusoids, random_sinusoids
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import Simulation, Truth, total_momentum, without_linear_momentum
from mbaid_ros.simulation.true_robot import ModelErrors
from observed import MID, configured_motion, kernel
from simulated import robot, state

LINK = 'link7'
CHASER = np.array([0.3, -0.2, 0.1, 4.0, -3.0, 6.0])  # (P, L) of the robot before the capture


def alone() -> Array:
    """Return the captured body's (m, h, I_o) in the last link's frame."""
    return robot('servicer7').link(LINK).parameters - standard(BARE_LINK7)


def chaser() -> MomentumKernel:
    """Return the robot before the capture, its last link as the estimator's URDF has it."""
    return MomentumKernel(free_model(), LINK)


@dataclass(frozen=True)
class Joined:
    """A capture as declared.

    Attributes
    ----------
    truth : the motion before and after it
    momentum : (6,) (P, L) that the captured body had before, odometry frame, L about its origin
    """

    truth: Truth
    momentum: Array


def capture(before: float, after: float, velocity: Array, spin: Array) -> Joined:
    """Return the motion of the servicer that captures a body at a time and moves on for another.

    Both are joined rigidly in no time: poses go on, the total momentum jumps by what the captured body brought along.

    Parameters
    ----------
    before, after : s
    velocity, spin : (3,) m/s, rad/s of the body before the capture, its CoM's and its own, odometry axes
    """
    motion = servicer()
    first = float_freely(chaser(), motion, CHASER, before + 1.0 / RATE)  # its last instant is that of the capture
    rotation, position = rotation_from_quaternion(first.base_orientation[-1]), first.base_position[-1]
    brought = _momentum(rotation, position, first.joint_position[-1], velocity, spin)
    total = CHASER + brought
    about_base = total[3:] - np.cross(position, total[:3])
    start = np.concatenate((total[:3] @ rotation, about_base @ rotation))
    second = float_freely(kernel('servicer7'), motion.from_time(before), start, after)
    moved = replace(
        second,
        time=second.time + before,
        base_position=position + second.base_position @ rotation.T,
        base_orientation=quaternion_from_rotation(rotation @ rotation_from_quaternion(second.base_orientation)),
    )
    parts = (first[:-1], moved)
    return Joined(Truth.concatenate(parts), brought)


def _momentum(rotation: Array, position: Array, joints: Array, velocity: Array, spin: Array) -> Array:
    """Return (P, L) of the captured body where the last link is at the capture."""
    rest = np.zeros((1, 6))
    state = chaser().states_of(rotation[None], joints[None], np.zeros((1, len(joints))), rest)
    turn, place = state.rotation[0], position + state.position[0]
    body = physical(alone())
    centre = place + turn @ body[1:4]
    linear = body[0] * velocity
    inertia = turn @ unvec(body[4:]) @ turn.T
    return np.concatenate((linear, np.cross(centre, linear) + inertia @ spin))


def sensed(truth: Truth, seed: int, errors: ModelErrors | None = None) -> Truth:
    """Return what sensors of the middle kind make of a motion; they do not know the errors of zeros and mount."""
    sensors = Sensors(MID, seed, errors)
    joints, base = sensors.joints(truth), sensors.base(truth)
    return replace(
        truth,
        joint_position=joints.position,
        joint_velocity=joints.velocity,
        base_position=base.position,
        base_orientation=base.orientation,
        base_linear_velocity=base.linear_velocity,
        base_angular_velocity=base.angular_velocity,
    )


LINKS = ('base_link', *(f'link{index}' for index in range(1, 8)))
PRIORS = (WEIGHED, *(GENERAL,) * 7)


@cache
def free_motion(seed: int, seconds: float, rate: float = 20.0, joints: tuple[int, ...] = tuple(range(7))) -> Truth:
    """Return a random motion of all joints, or of some, the servicer turning slowly."""
    return motion_of(free_model(), seed, seconds, rate, joints)


def motion_of(
    model: RobotModel, seed: int, seconds: float, rate: float = 20.0, joints: Sequence[int] = range(7)
) -> Truth:
    """Return such a motion of a robot that is not quite the servicer."""
    motion = random_sinusoids(np.linspace(0.5, -0.4, 7), seed, 2, 1.0, 12.0, 30.0)
    motion = replace(motion, amplitude=motion.amplitude * np.isin(np.arange(7), joints)[:, None])
    start = without_linear_momentum(model, state(motion.start, motion.reference(0.0)[1], (0.01, -0.015, 0.02)))
    return Simulation(model, motion, start).advance(np.arange(round(seconds * rate)) / rate)


def all_unknown(model: RobotModel) -> MomentumKernel:
    """Return the momentum of a robot none of whose links are known."""
    return MomentumKernel(model, *(link.name for link in model.links))


def standard_parameters(model: RobotModel) -> Array:
    """Return the (10 k,) standard parameters of all links."""
    return np.concatenate([link.parameters for link in model.links])


# Speeding up to 100 rad/s in 20 s, at a quarter of a slow sine.
TOP, FREQUENCY = 200.0, 1.0 / 240.0


@cache
def wheeled_urdf() -> str:
    """Return the servicer with a pyramid of four wheels."""
    return with_wheels(*((-0.2 * axis[0], -0.2 * axis[1], 0.1) for axis in AXES))


def unaware() -> str:
    """Return the same to someone who knows nothing of the wheels' speeds."""
    return wheeled_urdf().replace('type="continuous"', 'type="fixed"')


@cache
def wheeled() -> MomentumKernel:
    """Return its momentum, with what the last link holds unknown."""
    return MomentumKernel(load_model(wheeled_urdf()), 'link7')


def spinning(joints: Sinusoids) -> Sinusoids:
    """Return the arm's motion with the wheels' beside it, in the order of the model's joints."""
    arm = [index for index, name in enumerate(wheeled().model.joint_names) if not name.startswith('wheel')]
    count, terms = wheeled().model.joints, joints.amplitude.shape[1]

    def spread(values: Array, wheel: float) -> Array:
        whole = np.zeros((count, terms))
        whole[:, 0] = wheel
        whole[arm] = values
        return whole

    start = np.zeros(count)
    start[arm] = joints.start
    return Sinusoids(
        start=start,
        amplitude=spread(joints.amplitude, TOP / (2.0 * np.pi * FREQUENCY)),
        frequency=spread(joints.frequency, FREQUENCY),
        phase=spread(joints.phase, -0.5 * np.pi),
    )


WRENCH = 'geometry_msgs/msg/WrenchStamped'
THRUST_SECONDS = 16.0
ON, OFF = 9.2, 9.5  # s
FORCE_TORQUE = np.array([6.0, -6.0, 5.0, 3.0, 2.7, -3.0])  # N, N m, on the base link's origin in its axes

Timed = tuple[str, Any, int]


def push(time: float, rotation: Array, position: Array) -> Array:
    """Return the rate of (P, L) by the thrusters."""
    return (pushing(FORCE_TORQUE, 'body') if ON <= time < OFF else still)(time, rotation, position)


@cache
def pushed(*, thrust: bool = True) -> Truth:
    """Return the servicer's motion with the pulse, or without."""
    start = total_momentum(robot('servicer7'), configured_motion('servicer7', 0.1, 20.0)[:1])[0]
    # Every fourth sample: 25 a second are enough.
    return float_freely(kernel('servicer7'), servicer(), start, THRUST_SECONDS, push if thrust else still)[::4]


def command(time: float, wrench: Array, frame: str = 'base_link') -> Timed:
    """Return a command that comes when it is stamped, as in recorded.messages."""
    stamp = round(time * 1e9)
    thrust = Thrust(np.array([time]), wrench[None], frame)
    return '/thrust', thrust.message(BAG_TYPES, 0, recorded.EPOCH * 1_000_000_000 + stamp), stamp


def thrust_messages(seed: int, *commands: Timed, thrust: bool = True) -> list[Timed]:
    """Return what sensors and thrusters say, in the order of their stamps, commands first."""
    read = list(recorded.messages(robot('servicer7'), sensed(pushed(thrust=thrust), seed)))
    return sorted([*commands, *read], key=lambda timed: timed[2])


def pulse(frame: str = 'base_link') -> tuple[Timed, Timed]:
    """Return the commands of the pulse."""
    return command(ON, FORCE_TORQUE, frame), command(OFF, np.zeros(6), frame)
