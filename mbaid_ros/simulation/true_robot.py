"""A robot that is not its URDF, with a document of its own: any reader of URDF can then move it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array, cross
from mbaid_ros.core.links import relative_factor
from mbaid_ros.core.robot.body import is_physical, physical
from mbaid_ros.core.robot.model import Link, RobotModel, express, load_model
from mbaid_ros.core.robot.urdf import displace_joint, replace_inertial
from mbaid_ros.errors import ModelError
from mbaid_ros.simulation import quaternions
from mbaid_ros.simulation.simulation import Truth


@dataclass(frozen=True)
class ModelErrors:
    """The true robot of n joints less its URDF."""

    bodies: Array  # (n + 1, 10) standard parameters (m, h, I_o) of each moving body, in its own frame: kg, kg m, kg m^2
    zeros: Array  # (n,) true joint position less the measured one, rad or m
    origins: Array  # (n, 3) m, displacement of each joint's frame, in that frame
    # (n, 3) rad, rotation vector of each joint's frame with its subtree, in that frame, normal to the axis
    tilts: Array
    mount: Array  # (6,) the true base frame in the one that the odometry locates: rotation vector (rad), position (m)

    @staticmethod
    def zero(joints: int) -> ModelErrors:
        """Return the errors of a robot that is exactly its URDF."""
        return ModelErrors(
            np.zeros((joints + 1, 10)), np.zeros(joints), np.zeros((joints, 3)), np.zeros((joints, 3)), np.zeros(6)
        )

    @property
    def is_zero(self) -> bool:
        """Whether the robot is exactly its URDF."""
        return not any(np.any(block) for block in vars(self).values())


def with_bodies(model: RobotModel, change: Array, fixed: Sequence[str]) -> RobotModel:
    """Return a robot whose moving bodies differ by (n + 1, 10) standard parameters, each in its own frame.

    The `heaviest_link` of each body takes the change; a body without one stays.
    """
    changed = {}
    for body in np.flatnonzero(np.any(change, axis=1)).tolist():
        link = heaviest_link(model, body, fixed)
        if link is not None:
            changed[link.name] = replace(link, parameters=link.parameters + in_link_frame(link, change[body]))
    return replace(model, links=tuple(changed.get(link.name, link) for link in model.links))


def heaviest_link(model: RobotModel, body: int, fixed: Sequence[str] = ()) -> Link | None:
    """Return the heaviest link of a moving body, other than those in `fixed`; None where none of them has mass."""
    massive = [
        link for link in model.links if link.body == body and link.name not in fixed and link.parameters[0] > 0.0
    ]
    return max(massive, key=lambda link: float(link.parameters[0]), default=None)


def in_link_frame(link: Link, parameters: Array) -> Array:
    """Return a body's (10,) standard parameters in the frame of one of its links."""
    back = link.rotation.T
    return express(parameters, back, -back @ link.position)


def true_robot(model: RobotModel, errors: ModelErrors, fixed: Sequence[str] = ()) -> RobotModel:
    """Return the robot that has these errors: its bodies and its joints' frames, by `with_bodies` and `displaced`.

    Zeros and mount are no part of it: they are in its sensors' readings. Without errors it is the same object.

    Parameters
    ----------
    model : RobotModel of its URDF
    fixed : links that are exact
    """
    if not any(np.any(block) for block in (errors.bodies, errors.origins, errors.tilts)):
        return model
    text = model.urdf
    for name, origin, tilt in zip(model.joint_names, errors.origins, errors.tilts, strict=True):
        text = displace_joint(text, name, origin, tilt)
    changed = with_bodies(model, errors.bodies, fixed)
    for link, before in zip(changed.links, model.links, strict=True):
        if link is not before:
            text = replace_inertial(text, link.name, physical(link.parameters))
    return load_model(text, model.base_link)


_DRAWS = 10_000  # of a body, until one can exist
_STREAM = 6  # of a seed's: the noise of the sensors has 0 to 5


@dataclass(frozen=True)
class ErrorStds:
    """Standard deviations of a robot's differences from its URDF; 0 is exact."""

    links_relative_std: float = 0.0  # of each moving body, as `relative_factor` has it
    zero_std: float = 0.0  # rad, or m for a prismatic joint, of each joint's zero
    origin_std: float = 0.0  # m, of each coordinate of each joint's origin
    axis_std: float = 0.0  # rad, of each joint's axis about both directions normal to it
    # mount_position_std, mount_orientation_std: m, rad, of each coordinate of the odometry's mount
    mount_position_std: float = 0.0
    mount_orientation_std: float = 0.0


def generator(seed: int) -> np.random.Generator:
    """Return the generator for the robot of a seed; sensors with that seed draw their noise from other streams."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM,)))


def draw(model: RobotModel, target: str, sizes: ErrorStds, rng: np.random.Generator) -> ModelErrors:
    """Draw the errors of a robot: Gaussian, a body's as `relative_factor` has them, the target link's inertia exact.

    Each block, and each body, has a stream of its own: a size changes its own errors, and nothing else. A draw that
    makes no body that can exist is made again: of thin bodies, at the boundary, the inertia spreads less than declared.

    Raises ModelError: No body near one of the robot's can exist.

    Parameters
    ----------
    model : RobotModel, of its URDF
    target : name of the link that is to be identified
    rng : a generator in the same state gives the same errors
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
    """Draw the (n + 1, 10) errors of the moving bodies, relative to the bodies without the target link."""
    known = model.body_parameters(without=target)
    change = np.zeros_like(known)
    if std > 0.0:
        for body, stream in enumerate(rng.spawn(len(known))):
            if known[body, 0] > 0.0:
                change[body] = _body(model, target, body, relative_factor(known[body], std), stream)
    return change


def _body(model: RobotModel, target: str, body: int, factor: Array, rng: np.random.Generator) -> Array:
    """Draw the (10,) errors of one moving body, such that the link that takes them can exist."""
    link = heaviest_link(model, body, (target,))
    if link is None:
        return np.zeros(10)
    for _ in range(_DRAWS):
        change = factor @ rng.standard_normal(10)
        if is_physical(link.parameters + in_link_frame(link, change)):
            return change
    raise ModelError(
        f"of {_DRAWS} draws of link '{link.name}' none is a body that can exist; accepted: a smaller relative standard "
        'deviation, or an <inertial> further from the boundary'
    )


def as_measured(truth: Truth, errors: ModelErrors) -> Truth:
    """Return a motion as measured by encoders with wrong zeros and an odometry with a mount error.

    Parameters
    ----------
    truth : the true motion of the true robot
    errors : its zeros and its mount; the other blocks are in the motion already

    Returns
    -------
    Truth
        Joint positions less their zeros; the base's pose and twist are those of the frame that the odometry locates:
        the pose that composed with the mount is the true one, the velocity of that frame's origin, in its axes.
    """
    truth = replace(truth, joint_position=truth.joint_position - errors.zeros)
    if not np.any(errors.mount):
        return truth
    turn, place = errors.mount[:3], errors.mount[3:]
    orientation = quaternions.product(truth.base_orientation, quaternions.exp(-turn))
    forth = quaternions.exp(turn)  # from true to measured axes
    angular = quaternions.rotate(forth, truth.base_angular_velocity)
    linear = quaternions.rotate(forth, truth.base_linear_velocity) - cross(angular, place)
    return replace(
        truth,
        base_position=truth.base_position - quaternions.rotate(orientation, place),
        base_orientation=orientation,
        base_linear_velocity=linear,
        base_angular_velocity=angular,
    )
