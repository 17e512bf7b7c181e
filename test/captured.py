"""The seven-joint servicer with the hand known and what it holds unknown, for the tests of the captured body."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.honesty.paths import servicer
from benchmarks.precapture import BARE_LINK7, free_model
from floating import RATE, float_freely
from mbaid_ros.core.geometry import Array, quaternion_from_rotation, rotation_from_quaternion, unvec
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model_errors import ModelErrors
from mbaid_ros.core.robot.momentum import physical, standard
from mbaid_ros.simulation.sensors import Sensors
from mbaid_ros.simulation.simulation import Truth
from observed import MID, kernel
from simulated import robot

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
    """A capture that went as told.

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
    second = float_freely(kernel('servicer7'), motion.later(before), start, after)
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
