"""Motions as they look from elsewhere, or in another convention."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.honesty.floating import turned
from mbaid_ros.core.geometry import Array, cross, exp, rotate, rotate_back, rotation_from_quaternion
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.simulation import Truth

View = Callable[[Truth], Truth]


def zero_off(joint: int, angle: float, truth: Truth) -> Truth:
    """Return a motion whose joint reads less than it is (rad)."""
    return replace(truth, joint_position=truth.joint_position - angle * np.eye(truth.joint_position.shape[1])[joint])


def geared(joint: int, size: float, truth: Truth) -> Truth:
    """Return a motion whose joint is off by so much (rad) times the sine of its angle: an eccentric gear."""
    own = np.eye(truth.joint_position.shape[1])[joint]
    angle, rate = truth.joint_position[:, joint, None], truth.joint_velocity[:, joint, None]
    return replace(
        truth,
        joint_position=truth.joint_position - size * np.sin(angle) * own,
        joint_velocity=truth.joint_velocity - size * np.cos(angle) * rate * own,
    )


def sign_flipped(joint: int, truth: Truth) -> Truth:
    """Return a motion of which a joint is read with the wrong sign."""
    signs = 1.0 - 2.0 * np.eye(truth.joint_position.shape[1])[joint]
    return replace(truth, joint_position=signs * truth.joint_position, joint_velocity=signs * truth.joint_velocity)


def swapped(one: int, other: int, truth: Truth) -> Truth:
    """Return a motion of which two joints are taken for each other."""
    order = np.arange(truth.joint_position.shape[1])
    order[[one, other]] = order[[other, one]]
    return replace(truth, joint_position=truth.joint_position[:, order], joint_velocity=truth.joint_velocity[:, order])


def misgeared(joint: int, factor: float, truth: Truth) -> Truth:
    """Return a motion of which a joint is read larger by a factor, as with the wrong gear ratio."""
    factors = 1.0 + (factor - 1.0) * np.eye(truth.joint_position.shape[1])[joint]
    return replace(truth, joint_position=factors * truth.joint_position, joint_velocity=factors * truth.joint_velocity)


def mounted(position: Array, turn: Array, truth: Truth) -> Truth:
    """Return the motion of a frame elsewhere on the base, at (3,) m and turned by a (3,) rotation vector."""
    rotation = rotation_from_quaternion(truth.base_orientation)
    angular = truth.base_angular_velocity
    return replace(
        truth,
        base_position=truth.base_position + rotate(rotation, position),
        base_orientation=turned(truth, rotation @ exp(turn)),
        base_linear_velocity=(truth.base_linear_velocity + cross(angular, position)) @ exp(turn),
        base_angular_velocity=angular @ exp(turn),
    )


def scaled(factor: float, truth: Truth) -> Truth:
    """Return a motion whose lengths are seen larger by a factor."""
    return replace(
        truth,
        base_position=factor * truth.base_position,
        base_linear_velocity=factor * truth.base_linear_velocity,
    )


def in_orbit_frame(rate: float, truth: Truth) -> Truth:
    """Return a motion in a frame that turns about its z axis (rad/s)."""
    back = exp(-rate * truth.time[:, None] * np.array([0.0, 0.0, 1.0]))
    rotation = rotation_from_quaternion(truth.base_orientation)
    spin = np.array([0.0, 0.0, rate])
    return replace(
        truth,
        base_position=rotate(back, truth.base_position),
        base_orientation=turned(truth, back @ rotation),
        base_linear_velocity=truth.base_linear_velocity - rotate_back(rotation, cross(spin, truth.base_position)),
        base_angular_velocity=truth.base_angular_velocity
        - rotate_back(rotation, np.broadcast_to(spin, (len(truth), 3))),
    )


def twist_late(delay: float, truth: Truth) -> Truth:
    """Return a motion with the base's twist of a while ago (s)."""
    linear, angular = (
        np.column_stack([np.interp(truth.time - delay, truth.time, column) for column in values.T])
        for values in (truth.base_linear_velocity, truth.base_angular_velocity)
    )
    return replace(truth, base_linear_velocity=linear, base_angular_velocity=angular)


def twist_in_odometry_axes(truth: Truth) -> Truth:
    """Return a motion whose twist is given in the axes of the odometry frame, not in the base's."""
    rotation = rotation_from_quaternion(truth.base_orientation)
    linear, angular = truth.base_linear_velocity, truth.base_angular_velocity
    return replace(
        truth, base_linear_velocity=rotate(rotation, linear), base_angular_velocity=rotate(rotation, angular)
    )


def twist_in_degrees(truth: Truth) -> Truth:
    """Return a motion whose angular velocity is in degrees a second."""
    return replace(truth, base_angular_velocity=np.rad2deg(truth.base_angular_velocity))


def twist_of_point(position: Array, truth: Truth) -> Truth:
    """Return a motion whose twist is that of another point, (3,) m from the base's, in its axes."""
    linear = truth.base_linear_velocity + cross(truth.base_angular_velocity, position)
    return replace(truth, base_linear_velocity=linear)


def twist_turned(turn: Array, truth: Truth) -> Truth:
    """Return a motion whose twist is given in axes that are turned by a (3,) rotation vector."""
    linear, angular = (each @ exp(turn) for each in (truth.base_linear_velocity, truth.base_angular_velocity))
    return replace(truth, base_linear_velocity=linear, base_angular_velocity=angular)


def in_degrees(truth: Truth) -> Truth:
    """Return a motion whose joints are read in degrees."""
    position, velocity = np.rad2deg(truth.joint_position), np.rad2deg(truth.joint_velocity)
    return replace(truth, joint_position=position, joint_velocity=velocity)


def in_millimetres(truth: Truth) -> Truth:
    """Return a motion whose positions, not velocities, are in millimetres."""
    return replace(truth, base_position=1e3 * truth.base_position)


def turned_round(truth: Truth) -> Truth:
    """Return a motion whose orientation turns from the odometry frame to the base."""
    return replace(truth, base_orientation=quaternions.conjugate(truth.base_orientation))


def scalar_first(truth: Truth) -> Truth:
    """Return a motion whose quaternions are (w, x, y, z)."""
    return replace(truth, base_orientation=np.roll(truth.base_orientation, 1, axis=-1))


def at_once(truth: Truth) -> Truth:
    """Return a motion as it is."""
    return truth
