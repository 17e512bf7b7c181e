"""The skeleton of the robot in its last pose with the identified body, seen along the axes that show something."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.momentum import ellipsoid_radii, principal
from mbaid_ros.replay.report.markup import Colour, entitle, new_axes, svg
from mbaid_ros.replay.results import Run

_CHI_95 = 7.814728  # 95 % of the chi-squared distribution with three degrees of freedom
_FLAT = 0.03  # a robot thinner than this fraction of its length moves in a plane
_CIRCLE = np.stack([np.cos(np.linspace(0.0, 2.0 * np.pi, 73)), np.sin(np.linspace(0.0, 2.0 * np.pi, 73))])
_VIEWS = (('from above', (0, 1)), ('from the right', (0, 2)), ('from the front', (1, 2)))
_IN_PLANE = (2, 1, 0)  # the view along each axis


def drawing(run: Run, name: str) -> tuple[str, str]:
    """Return the drawing of a robot with a last sample, in odometry axes from the base link, and its caption."""
    assert run.last is not None, 'there is a sample'
    model = load_model(run.urdf, str(run.settings.get('base_link', '')))
    placed = Kinematics(model).configure(run.last.base_rotation, run.last.joint_position)
    origins, target = placed.position[0], model.link(run.target_link)
    rotation, position = (part[0] for part in placed.link(target))
    com = rotation @ np.nan_to_num(run.final.parameters[1:4]) + position
    known = np.sum(np.isfinite(run.final.parameters[1:4])) >= 2
    bones = [(origins[parent], origins[joint + 1]) for joint, parent in enumerate(model.parents)]
    bones += [(origins[target.body], com)] if known else []
    extent = np.ptp(np.concatenate((origins, com[None])) if known else origins, axis=0)
    flat = np.flatnonzero(extent < _FLAT * max(float(extent.max()), 1e-9))
    views = (_VIEWS[_IN_PLANE[flat[0]]],) if len(flat) == 1 else _VIEWS
    chart, axes = new_axes(1, len(views), 4.6 if len(views) == 1 else 3.4)
    for axis, (title, (right, up)) in zip(axes, views, strict=True):
        seen = [right, up]
        for bone in bones:
            axis.plot(*np.array(bone)[:, seen].T, color=Colour.INK, linewidth=1.6, alpha=0.75, zorder=3)
        for place, slides in zip(origins[1:, seen], model.prismatic, strict=True):
            marker = 's' if slides else 'o'
            axis.plot(*place, marker=marker, markersize=4.5, color=Colour.INK, markerfacecolor=Colour.PAGE, zorder=4)
        if known:
            _draw_body(axis, run.final, rotation, com, seen)
        axis.set_aspect('equal', adjustable='datalim')
        axis.margins(0.06)
        entitle(axis, f'{title}: {"xyz"[right]}, {"xyz"[up]} [m]')
    cross = 'Cross: centre of mass with its 95 % region. Ellipse: the uniform body of the same inertia, if known.'
    caption = cross if known else f"The centre of mass of '{run.target_link}' is not known."
    return svg(chart, f'{name} robot', 'The robot in its last pose with the identified body'), (
        f'In odometry axes, the origin in the base link. {caption}'
    )


def _draw_body(axis: Axes, estimate: Estimate, rotation: Array, com: Array, seen: list[int]) -> None:
    """Draw the centre of mass (3,) of the target, whose axes are turned by (3, 3), and the ellipsoid of its inertia."""
    parameters, centre = estimate.parameters, com[seen, None]
    if parameters[0] > 0.0 and np.all(np.isfinite(parameters[4:])):
        body = principal(parameters)
        semi = rotation @ body.axes * ellipsoid_radii(float(parameters[0]), body.moments)  # one a column
        outline = _outline(semi @ semi.T, seen) + centre
        axis.fill(*outline, facecolor=Colour.FIRST, alpha=0.16, linewidth=0.0, zorder=5)
        axis.plot(*outline, color=Colour.FIRST, linewidth=1.5, zorder=6)
        for end in semi[seen].T[..., None]:
            axis.plot(*np.hstack((centre - end, centre + end)), color=Colour.FIRST, linewidth=0.9, zorder=6)
    spread = _CHI_95 * rotation @ np.nan_to_num(estimate.covariance[1:4, 1:4]) @ rotation.T
    region = _outline(spread, seen) + centre
    axis.fill(*region, facecolor=Colour.SECOND, alpha=0.3, edgecolor=Colour.SECOND, linewidth=1.0, zorder=7)
    axis.plot(*centre, marker='P', markersize=9, color=Colour.SECOND, markeredgecolor=Colour.PAGE, zorder=8)


def _outline(matrix: Array, seen: list[int]) -> Array:
    """Return (2, N) points on the outline of the ellipsoid x^T E^-1 x = 1 as it is seen."""
    sizes, axes = np.linalg.eigh(matrix[np.ix_(seen, seen)])
    return axes @ (np.sqrt(np.maximum(sizes, 0.0))[:, None] * _CIRCLE)
