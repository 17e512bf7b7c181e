"""What there is to draw of a robot in a pose and of the body that was identified."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, rotate
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.kinematics import Configuration, Kinematics
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.momentum import ellipsoid_radii, principal
from mbaid_ros.replay.report.shapes import Shape, shapes
from mbaid_ros.replay.results import Run

_CHI_95 = 7.814728  # 95 % of the chi-squared distribution with three degrees of freedom


@dataclass(frozen=True)
class Body:
    """The identified body.

    Attributes
    ----------
    com : (3,) m
    ellipsoid : (3, 3) m^2, a surface x^T E^-1 x = 1 about the CoM (flat: a circle); zero where nothing is known
    uncertainty : (3, 3) m^2, the same of the 95 % region of the CoM
    axes : (3, 3) columns are the principal semi-axes, m; zero where not known
    complete : False where the circle of gyration stands for the ellipsoid
    """

    com: Array
    ellipsoid: Array
    uncertainty: Array
    axes: Array
    complete: bool


@dataclass(frozen=True)
class Scene:
    """Everything relative to the base link's origin, in odometry axes, m.

    Attributes
    ----------
    bones : (begin, end) of straight lines along the arm
    joints : (position, whether it slides)
    solids : shapes and whether they belong to the target link
    body : None where the CoM is not known
    skeleton : (N, 3) points that tell how the robot lies
    """

    bones: list[tuple[Array, Array]]
    joints: list[tuple[Array, bool]]
    solids: list[tuple[Array, bool]]
    body: Body | None
    skeleton: Array


def scene(run: Run) -> Scene | None:
    """Return the robot in its last pose, None where that is not known."""
    if run.pose is None or not run.urdf:
        return None
    model = load_model(run.urdf, str(run.settings.get('base_link', '')))
    configuration = Kinematics(model).configure(run.pose.base_rotation[None], run.pose.joint_position[None])
    places = configuration.position[0]
    bones = [(places[parent], places[joint + 1]) for joint, parent in enumerate(model.parents)]
    body = _body(run.final, *_frame(model, configuration, run.target_link))
    target = model.link(run.target_link)
    if body is not None:
        bones.append((places[target.body], body.com))
    ends = [places] if body is None else [places, body.com[None]]
    return Scene(
        bones=bones,
        joints=[(places[joint + 1], slides) for joint, slides in enumerate(model.prismatic)],
        solids=[_solid(model, configuration, shape, run.target_link) for shape in shapes(run.urdf)],
        body=body,
        skeleton=np.concatenate(ends),
    )


def _frame(model: RobotModel, configuration: Configuration, link: str) -> tuple[Array, Array]:
    rotation, position = configuration.link(model.link(link))
    return rotation[0], position[0]


def _solid(model: RobotModel, configuration: Configuration, shape: Shape, target: str) -> tuple[Array, bool]:
    rotation, position = _frame(model, configuration, shape.link)
    return rotate(rotation, shape.points) + position, shape.link == target


def _body(estimate: Estimate, rotation: Array, position: Array) -> Body | None:
    parameters = estimate.parameters
    mass, com = parameters[0], parameters[1:4]
    if np.sum(np.isfinite(com)) < 2:
        return None
    spread = np.nan_to_num(estimate.covariance[1:4, 1:4])
    ellipsoid: Array = np.zeros((3, 3))
    axes: Array = np.zeros((3, 3))
    complete = False
    if mass > 0.0 and np.all(np.isfinite(parameters[4:])):
        found = principal(parameters)
        axes, complete = rotation @ found.axes * ellipsoid_radii(mass, found.moments), True
        ellipsoid = axes @ axes.T
    elif mass > 0.0 and np.any(np.isfinite(parameters[[4, 7, 9]])):
        # Of one moment the radius of gyration is known: a circle about the axis.
        moments = parameters[[4, 7, 9]]
        axis = int(np.nanargmax(moments))
        flat = np.where(np.arange(3) == axis, 0.0, max(moments[axis], 0.0) / mass)
        ellipsoid = rotation @ np.diag(flat) @ rotation.T
    return Body(
        com=rotation @ np.nan_to_num(com) + position,
        ellipsoid=ellipsoid,
        uncertainty=_CHI_95 * rotation @ spread @ rotation.T,
        axes=axes,
        complete=complete,
    )
