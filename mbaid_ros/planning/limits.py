"""The limits of a motion: those of the joints, and those of the base's motion."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, fields

import numpy as np

from mbaid_ros.core.errors import ParameterError, listing
from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.simulation.motion import independent_limits


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of the k joints that follow no other; rad or m, and per s and s^2. A joint that is not moved has none.

    Attributes
    ----------
    lower, upper : (k,)
    velocity, acceleration : (k,)
    moved : (k,) which may be moved at all
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    moved: Flags


@dataclass(frozen=True)
class BaseLimits:
    """How far a motion of the joints may move the base from where it would be if they rested; infinite for no limit.

    Attributes
    ----------
    rotation : rad
    translation : m, of the base link's origin
    rate : rad/s
    """

    rotation: float = np.inf
    translation: float = np.inf
    rate: float = np.inf

    @property
    def array(self) -> Array:
        """(3,) rotation, translation, rate."""
        return np.array([getattr(self, each.name) for each in fields(self)])


def joint_limits(
    model: RobotModel, position: Array, velocity: float, acceleration: float, stuck: Collection[str]
) -> JointLimits:
    """Return the limits of a robot's joints.

    Parameters
    ----------
    model : RobotModel
    position : (k,) where the motion begins, of the joints that follow no other
    velocity : rad/s or m/s that no joint may exceed, besides its own limit
    acceleration : rad/s^2 or m/s^2
    stuck : names of joints that cannot be moved

    Raises
    ------
    ParameterError
        A name is of no joint, none can be moved, or one is outside its limits.
    """
    names = model.independent_joints
    foreign = [name for name in stuck if name not in names]
    if foreign:
        raise ParameterError(f"parameter 'plan.stuck' names '{foreign[0][:60]}'; accepted: {listing(names)}")
    lower, upper, fastest = independent_limits(model)
    speed = np.minimum(fastest, velocity)
    moved = (speed > 0.0) & (upper > lower) & np.array([name not in stuck for name in names])
    if not moved.any():
        raise ParameterError(
            "no joint can be moved; accepted: one at least that is not in 'plan.stuck', with a range and a velocity "
            'in its URDF limits'
        )
    outside = moved & ((position < lower) | (position > upper))
    if outside.any():
        joint = int(np.flatnonzero(outside)[0])
        raise ParameterError(
            f"joint '{names[joint]}' is at {position[joint]:.4g}, outside its limits {lower[joint]:g} to "
            f"{upper[joint]:g}: a motion within limits cannot begin there; accepted: inside, or 'plan.stuck' with it"
        )
    if not np.isfinite(speed[moved]).all():
        joint = int(np.flatnonzero(moved & ~np.isfinite(speed))[0])
        raise ParameterError(
            f"joint '{names[joint]}' has no velocity limit in the robot description; accepted: one there, or "
            "'plan.joint_velocity'"
        )
    return JointLimits(lower, upper, speed, np.full(len(names), acceleration), moved)
