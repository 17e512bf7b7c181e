"""The robot in its last pose with the identified body, seen from the sides that show something."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio
from matplotlib.axes import Axes
from scipy.spatial import ConvexHull

from mbaid_ros import limits
from mbaid_ros.core.geometry import Array, rotate
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import ellipsoid_radii, principal
from mbaid_ros.core.robot.urdf_document import tree_of
from mbaid_ros.replay.report.markup import Colour, entitle, new_axes, svg
from mbaid_ros.replay.results import Run

_CHI_95 = 7.814728  # 95 % of the chi-squared distribution with three degrees of freedom
_TURN = np.linspace(0.0, 2.0 * np.pi, 25)[:-1]
_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_FLAT = 0.03  # a robot thinner than this fraction of its length moves in a plane
_CIRCLE = np.stack([np.cos(np.linspace(0.0, 2.0 * np.pi, 73)), np.sin(np.linspace(0.0, 2.0 * np.pi, 73))])


@dataclass(frozen=True)
class Body:
    """The identified body, relative to the base link's origin, in odometry axes."""

    com: Array
    ellipsoid: Array  # (3, 3) m^2, a surface x^T E^-1 x = 1 about the CoM (flat: a circle); zero where nothing is known
    uncertainty: Array  # (3, 3) m^2, the same of the 95 % region of the CoM
    axes: Array  # (3, 3) columns are the principal semi-axes, m; zero where not known
    complete: bool  # False where the circle of gyration stands for the ellipsoid


@dataclass(frozen=True)
class Scene:
    """Everything relative to the base link's origin, in odometry axes, m."""

    bones: list[tuple[Array, Array]]  # (begin, end) of straight lines along the arm
    joints: list[tuple[Array, bool]]  # position, and whether it slides
    solids: list[tuple[Array, bool]]  # (N, 3) points whose hull is a shape, and whether it belongs to the target link
    body: Body | None  # None where the CoM is not known
    skeleton: Array  # (N, 3) origins of the bodies, and the CoM


def scene(run: Run) -> Scene | None:
    """Return the robot in its last pose, None where that is not known."""
    if run.pose is None or not run.urdf:
        return None
    model = load_model(run.urdf, str(run.settings.get('base_link', '')))
    configuration = Kinematics(model).configure(run.pose.base_rotation[None], run.pose.joint_position[None])
    places = configuration.position[0]
    bones = [(places[parent], places[joint + 1]) for joint, parent in enumerate(model.parents)]

    def frame(link: str) -> tuple[Array, Array]:
        rotation, position = configuration.link(model.link(link))
        return rotation[0], position[0]

    body = _body(run.final, *frame(run.target_link))
    ends = [places]
    if body is not None:
        bones.append((places[model.link(run.target_link).body], body.com))
        ends.append(body.com[None])
    solids: list[tuple[Array, bool]] = []
    for link, points in islice(_shapes(run.urdf), limits.SHAPES_DRAWN):
        rotation, position = frame(link)
        solids.append((rotate(rotation, points) + position, link == run.target_link))
    joints = [(places[joint + 1], slides) for joint, slides in enumerate(model.prismatic)]
    return Scene(bones, joints, solids, body, np.concatenate(ends))


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


def _shapes(urdf: str) -> Iterator[tuple[str, Array]]:
    """Yield link and (N, 3) points, in its frame, whose hull is a box, cylinder or sphere of an accepted URDF."""
    for link in tree_of(urdf).findall('link'):
        for visual in link.findall('visual'):
            for points in _points(visual.find('geometry')):
                origin = visual.find('origin')
                rpy, xyz = _numbers(origin, 'rpy', '0 0 0'), _numbers(origin, 'xyz', '0 0 0')
                if len(rpy) == len(xyz) == 3:
                    yield link.get('name', ''), rotate(pinocchio.rpy.rpyToMatrix(*rpy), points) + np.array(xyz)


def _points(geometry: ET.Element | None) -> Iterator[Array]:
    if geometry is None:
        return
    box, cylinder, sphere = (geometry.find(kind) for kind in ('box', 'cylinder', 'sphere'))
    size = _numbers(box, 'size')
    if len(size) == 3:
        yield _CORNERS * np.array(size)
    radius, length = _numbers(cylinder, 'radius'), _numbers(cylinder, 'length')
    if len(radius) == len(length) == 1:
        circle = radius[0] * np.stack((np.cos(_TURN), np.sin(_TURN)), axis=1)
        yield np.concatenate([np.insert(circle, 2, end * length[0], axis=1) for end in (-0.5, 0.5)])
    radius = _numbers(sphere, 'radius')
    if len(radius) == 1:
        polar = np.linspace(0.0, np.pi, 9)
        rings = [(np.sin(p) * np.cos(t), np.sin(p) * np.sin(t), np.cos(p)) for p in polar for t in _TURN]
        yield radius[0] * np.array(rings)


def _numbers(element: ET.Element | None, key: str, default: str = '') -> list[float]:
    """Return the numbers of an attribute, none where it holds anything else."""
    text = default if element is None else element.get(key, default)
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        return []
    return values if all(math.isfinite(value) and abs(value) < 1e6 for value in values) else []


def hull(points: Array) -> Array:
    """Return the corners of the convex hull of (N, 2) points in order; of a flat one those of a hardly thicker one."""
    return points[ConvexHull(points, qhull_options='QJ').vertices]


@dataclass(frozen=True)
class View:
    """A direction to look from: title, names of the drawing's axes, (2, 3) their directions, (3,) that to the eye."""

    title: str
    right: str
    up: str
    plane: Array
    towards: Array


def _view(title: str, right: int, up: int, sign: float) -> View:
    unit = np.eye(3)
    return View(title, 'xyz'[right], 'xyz'[up], unit[[right, up]], sign * unit[3 - right - up])


_TOP, _FRONT = _view('from above', 0, 1, 1.0), _view('from the right', 0, 2, -1.0)
_SIDE = _view('from the front', 1, 2, 1.0)
_OBLIQUE_AXES = np.array([[-0.5, 0.866, 0.0], [-0.433, -0.25, 0.866]])
_OBLIQUE = View('oblique', '', '', _OBLIQUE_AXES, np.cross(*_OBLIQUE_AXES))


def drawing(found: Scene, name: str) -> str:
    """Return the drawing of a scene."""
    extent = np.ptp(found.skeleton, axis=0)
    flat = np.flatnonzero(extent < _FLAT * max(float(extent.max()), 1e-9))
    if len(flat) == 1:
        views = [(_SIDE, _FRONT, _TOP)[flat[0]]]
        figure, axes = new_axes(1, 1, 4.6)
    else:
        views = [_OBLIQUE, _TOP, _FRONT, _SIDE]
        figure, axes = new_axes(2, 2, 3.7)
    for axis, view in zip(axes, views, strict=True):
        _draw(axis, found, view)
    return svg(figure, f'{name} robot', 'The robot in its last pose with the identified body')


def _draw(axis: Axes, found: Scene, view: View) -> None:
    project = view.plane.T
    for points, is_target in sorted(found.solids, key=lambda solid: float(np.mean(solid[0] @ view.towards))):
        outline = hull(points @ project)
        edge, width = (Colour.SECOND, 1.2) if is_target else (Colour.FAINT, 0.8)
        axis.fill(*outline.T, facecolor=Colour.PAGE, edgecolor='none', alpha=0.55, zorder=2)
        axis.fill(*outline.T, facecolor='none', edgecolor=edge, linewidth=width, zorder=2)
    for bone in found.bones:
        begin, end = (point @ project for point in bone)
        axis.plot([begin[0], end[0]], [begin[1], end[1]], color=Colour.INK, linewidth=1.6, alpha=0.75, zorder=3)
    for place, slides in found.joints:
        x, y = place @ project
        axis.plot(
            x, y, marker='s' if slides else 'o', markersize=4.5, color=Colour.INK, markerfacecolor=Colour.PAGE, zorder=4
        )
    if found.body is not None:
        _draw_body(axis, found.body, project)
    axis.set_aspect('equal', adjustable='datalim')
    axis.margins(0.06)
    entitle(axis, view.title, f'{view.right} [m]' if view.right else '')
    if view.right:
        axis.set_ylabel(f'{view.up} [m]', color=Colour.INK, fontsize=8)
    else:
        _triad(axis, project)


def _draw_body(axis: Axes, body: Body, project: Array) -> None:
    centre = body.com @ project
    outline = _outline(body.ellipsoid, project) + centre[:, None]
    axis.fill(*outline, facecolor=Colour.FIRST, alpha=0.16, linewidth=0.0, zorder=5)
    axis.plot(*outline, color=Colour.FIRST, linewidth=1.5, linestyle='-' if body.complete else '--', zorder=6)
    for end in body.axes.T @ project:
        axis.plot([centre[0] - end[0], centre[0] + end[0]], [centre[1] - end[1], centre[1] + end[1]],
                  color=Colour.FIRST, linewidth=0.9, zorder=6)  # fmt: skip
    region = _outline(body.uncertainty, project) + centre[:, None]
    axis.fill(*region, facecolor=Colour.SECOND, alpha=0.3, edgecolor=Colour.SECOND, linewidth=1.0, zorder=7)
    axis.plot(
        *centre,
        marker='P',
        markersize=9,
        color=Colour.SECOND,
        markeredgecolor=Colour.PAGE,
        markeredgewidth=0.8,
        zorder=8,
    )


def _outline(matrix: Array, project: Array) -> Array:
    """Return (2, N) points on the outline of the ellipsoid x^T E^-1 x = 1 as it is seen."""
    sizes, axes = np.linalg.eigh(project.T @ matrix @ project)
    return axes @ (np.sqrt(np.maximum(sizes, 0.0))[:, None] * _CIRCLE)


def _triad(axis: Axes, project: Array) -> None:
    """Draw the directions of the axes in a corner."""
    axis.set_xticks([])
    axis.set_yticks([])
    axis.spines[:].set_color(Colour.LINE)
    for direction, label in zip(project, 'xyz', strict=True):
        end = 0.11 * direction
        axis.annotate(
            label, (0.13, 0.13), xytext=tuple(np.array([0.13, 0.13]) + end), textcoords='axes fraction',
            xycoords='axes fraction', fontsize=8, color=Colour.INK, ha='center', va='center',
            arrowprops={'arrowstyle': '<-', 'color': Colour.FAINT, 'shrinkA': 5, 'shrinkB': 0},
        )  # fmt: skip
