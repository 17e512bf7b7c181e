"""Robots that are not their URDF, drawn at random: what the simulator moves in place of the one it is told of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.errors import ModelError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.consistency import is_physical
from mbaid_ros.core.robot.known_errors import relative_factor
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.model_errors import ModelErrors, changing_link, in_frame_of

_DRAWS = 10_000  # of a body, until one can exist
_STREAM = 6  # of a seed's: the noise of the sensors has 0 to 5


@dataclass(frozen=True)
class ErrorSizes:
    """Standard deviations of what a robot differs from its URDF by; 0 is exact.

    Attributes
    ----------
    links_relative_std : of each moving body, as `relative_factor` has it
    zero_std : rad, or m for a prismatic joint, of each joint's zero
    origin_std : m, of each coordinate of each joint's origin
    axis_std : rad, of each joint's axis about both directions normal to it
    mount_position_std, mount_orientation_std : m, rad, of each coordinate of the odometry's mount
    """

    links_relative_std: float = 0.0
    zero_std: float = 0.0
    origin_std: float = 0.0
    axis_std: float = 0.0
    mount_position_std: float = 0.0
    mount_orientation_std: float = 0.0


def generator(seed: int) -> np.random.Generator:
    """Return what the robot of a seed is drawn with; sensors with that seed draw their noise from other streams."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM,)))


def draw(model: RobotModel, target: str, sizes: ErrorSizes, rng: np.random.Generator) -> ModelErrors:
    """Draw the errors of a robot: Gaussian, a body's as `relative_factor` has them, the target link's inertia exact.

    Each block, and each body, has a stream of its own: a size changes what it scales, and nothing else. A draw that
    makes no body that can exist is made again: of thin bodies, at the boundary, the inertia spreads less than it says.

    Parameters
    ----------
    model : RobotModel, as its URDF says
    target : name of the link that is to be identified
    sizes : ErrorSizes
    rng : a generator in the same state gives the same errors

    Raises
    ------
    ModelError
        No body near one of the robot's can exist.
    """
    bodies, zeros, origins, tilts, mount = rng.spawn(5)
    joints = model.joints
    turned = sizes.axis_std * tilts.standard_normal((joints, 3))
    along = np.sum(turned * model.axes, axis=1, keepdims=True) * model.axes
    orientation, position = mount.standard_normal((2, 3))
    return ModelErrors(
        bodies=_bodies(model, target, sizes.links_relative_std, bodies),
        zeros=sizes.zero_std * zeros.standard_normal(joints),
        origins=sizes.origin_std * origins.standard_normal((joints, 3)),
        tilts=turned - along,
        mount=np.concatenate((sizes.mount_orientation_std * orientation, sizes.mount_position_std * position)),
    )


def _bodies(model: RobotModel, target: str, std: float, rng: np.random.Generator) -> Array:
    """Draw the (n + 1, 10) errors of the moving bodies, the target link left out of what they are relative to."""
    known = model.body_parameters(without=target)
    change = np.zeros_like(known)
    if std > 0.0:
        for body, stream in enumerate(rng.spawn(len(known))):
            if known[body, 0] > 0.0:
                change[body] = _body(model, target, body, relative_factor(known[body], std), stream)
    return change


def _body(model: RobotModel, target: str, body: int, factor: Array, rng: np.random.Generator) -> Array:
    """Draw the (10,) errors of one moving body, such that the link that takes them can exist."""
    link = changing_link(model, body, (target,))
    if link is None:
        return np.zeros(10)
    for _ in range(_DRAWS):
        change = factor @ rng.standard_normal(10)
        if is_physical(link.parameters + in_frame_of(link, change)):
            return change
    raise ModelError(
        f"of {_DRAWS} draws of link '{link.name}' none is a body that can exist; accepted: a smaller relative standard "
        'deviation, or an <inertial> further from the boundary'
    )
