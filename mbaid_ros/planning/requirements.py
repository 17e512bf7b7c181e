"""Goal and limits of a planned motion; `search.py` minimises its duration."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, fields

import numpy as np

from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.errors import ParameterError, listing
from mbaid_ros.simulation.motion import independent_limits

_SHARP = 8  # exponent of the mean that stands for the worst, smooth enough to be climbed


@dataclass(frozen=True, eq=False)
class Goal:
    """The goal of a motion."""

    relative: Array  # (10,) relative standard deviations wanted
    determinable: Flags  # (10,) which of them count

    def ratio(self, relative: Array) -> Array:
        """Return the largest ratio (...) of (..., 10) to the wanted precision: 1 is reached."""
        return np.asarray((relative / self.relative)[..., self.determinable].max(axis=-1))

    def cost(self, relative: Array) -> Array:
        """Return the cost of the search, (...): the largest ratio, made smooth."""
        ratios = (relative / self.relative)[..., self.determinable]
        return np.asarray((ratios**_SHARP).mean(axis=-1) ** (1.0 / _SHARP))


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of the k joints that follow no other; rad or m, and per s and s^2. A joint that is not moved has none."""

    lower: Array  # (k,)
    upper: Array  # (k,)
    velocity: Array  # (k,)
    acceleration: Array  # (k,)
    moved: Flags  # (k,) which may be moved at all
    held: Flags  # (k,) which go on at the speed that they have, as wheels do


@dataclass(frozen=True)
class BaseLimits:
    """How far a motion of the joints may move base and passive joints from where they would be if the joints rested.

    Infinite for no limit.
    """

    rotation: float = np.inf  # rad
    translation: float = np.inf  # m, of the base link's origin
    rate: float = np.inf  # rad/s
    deflection: float = np.inf  # rad or m, of passive joints that begin at rest

    @property
    def array(self) -> Array:
        """(4,) rotation, translation, rate, deflection."""
        return np.array([getattr(self, each.name) for each in fields(self)])


def joint_limits(
    model: RobotModel,
    position: Array,
    velocity: float,
    acceleration: float,
    stuck: Collection[str],
    held: Flags | None = None,
) -> JointLimits:
    """Return the limits of a robot's joints.

    Raises ParameterError: A name is of no joint, none can be moved, or one is outside its limits.

    Parameters
    ----------
    position : (k,) where the motion begins, of the joints that follow no other
    velocity : rad/s or m/s that no joint may exceed, besides its own limit
    acceleration : rad/s^2 or m/s^2
    stuck : names of joints that cannot be moved
    held : (k,) True for joints that keep their speed; None for none
    """
    names = model.independent_joints
    _require_joints('stuck', stuck, names)
    kept = np.zeros(len(names), dtype=bool) if held is None else held
    lower, upper, fastest = independent_limits(model)
    speed = np.minimum(fastest, velocity)
    moved = (speed > 0.0) & (upper > lower) & np.array([name not in stuck for name in names], dtype=bool) & ~kept
    if not moved.any():
        raise ParameterError(
            "no joint can be moved; accepted: one at least that is in neither 'plan.stuck' nor 'plan.held', with a "
            "range and a velocity in its URDF limits, or 'plan.joint_velocity'"
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
    return JointLimits(lower, upper, speed, np.full(len(names), acceleration), moved, kept)


def speed_held(model: RobotModel, rate: Array, velocity: float, held: Collection[str]) -> Flags:
    """Return which joints keep their speed (k,): those named, or all that turn without any limit, as wheels do.

    Raises ParameterError: A name is of no joint.

    Parameters
    ----------
    rate : (k,) rad/s or m/s when the motion begins
    velocity : rad/s that moves joints without a limit, if they are not faster when the motion begins
    held : names
    """
    names = model.independent_joints
    _require_joints('held', held, names)
    if held:
        return np.array([name in held for name in names])
    lower, upper, fastest = independent_limits(model)
    free = np.isinf(lower) & np.isinf(upper) & np.isinf(fastest)
    return np.asarray(free & (np.isinf(velocity) | (np.abs(rate) > velocity)))


def _require_joints(parameter: str, given: Collection[str], names: Sequence[str]) -> None:
    if foreign := [name for name in given if name not in names]:
        raise ParameterError(f"parameter 'plan.{parameter}' names '{foreign[0][:60]}'; accepted: {listing(names)}")
