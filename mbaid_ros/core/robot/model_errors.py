"""How a robot may differ from its URDF: bodies, joint zeros, joint placements, and where its odometry is mounted.

The same five blocks are what the simulator draws robots by, and what the estimator has among its unknowns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array, exp, rotate
from mbaid_ros.core.robot.model import Link, RobotModel, express


@dataclass(frozen=True)
class ModelErrors:
    """What a true robot of n joints has more than its URDF says.

    Attributes
    ----------
    bodies : (n + 1, 10) standard parameters (m, h, I_o) of each moving body, in its own frame: kg, kg m, kg m^2
    zeros : (n,) true joint position less the measured one, rad or m
    origins : (n, 3) m, displacement of each joint's frame, in that frame
    tilts : (n, 3) rad, rotation vector that turns each joint's frame, in that frame and normal to the joint's axis;
        what the joint carries turns along
    mount : (6,) the true base frame in the one that the odometry locates: rotation vector (rad), position (m)
    """

    bodies: Array
    zeros: Array
    origins: Array
    tilts: Array
    mount: Array

    @staticmethod
    def none(joints: int) -> ModelErrors:
        """Return the errors of a robot that is exactly its URDF."""
        return ModelErrors(
            np.zeros((joints + 1, 10)), np.zeros(joints), np.zeros((joints, 3)), np.zeros((joints, 3)), np.zeros(6)
        )

    @property
    def exact(self) -> bool:
        """Whether the robot is exactly its URDF."""
        return not any(np.any(block) for block in vars(self).values())


def displaced(model: RobotModel, origins: Array, tilts: Array) -> RobotModel:
    """Return a robot with its joints' frames elsewhere.

    Parameters
    ----------
    model : RobotModel
    origins, tilts : (n, 3), (n, 3) as in ModelErrors
    """
    return replace(
        model,
        positions=model.positions + rotate(model.rotations, origins),
        rotations=model.rotations @ exp(tilts),
    )


def with_bodies(model: RobotModel, change: Array, fixed: Sequence[str]) -> RobotModel:
    """Return a robot whose moving bodies differ by (n + 1, 10) standard parameters, each in its own frame.

    Of each body the link that `changing_link` names takes the change; a body without one stays.
    """
    changed = {}
    for body in np.flatnonzero(np.any(change, axis=1)).tolist():
        link = changing_link(model, body, fixed)
        if link is not None:
            changed[link.name] = replace(link, parameters=link.parameters + in_frame_of(link, change[body]))
    return replace(model, links=tuple(changed.get(link.name, link) for link in model.links))


def changing_link(model: RobotModel, body: int, fixed: Sequence[str] = ()) -> Link | None:
    """Return the heaviest link of a moving body, other than those in `fixed`; None where none of them has mass."""
    massive = [
        link for link in model.links if link.body == body and link.name not in fixed and link.parameters[0] > 0.0
    ]
    return max(massive, key=lambda link: float(link.parameters[0]), default=None)


def in_frame_of(link: Link, parameters: Array) -> Array:
    """Return a body's (10,) standard parameters in the frame of one of its links."""
    back = link.rotation.T
    return express(parameters, back, -back @ link.position)
