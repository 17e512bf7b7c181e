"""The robot in its last pose, seen from the sides that show something."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from mbaid_ros.core.geometry import Array
from mbaid_ros.replay.report.canvas import FAINT, FIRST, INK, LINE, PAGE, SECOND, entitle, new_axes, svg
from mbaid_ros.replay.report.scene import Body, Scene
from mbaid_ros.replay.report.shapes import hull

_FLAT = 0.03  # a robot thinner than this fraction of its length moves in a plane
_CIRCLE = np.stack([np.cos(np.linspace(0.0, 2.0 * np.pi, 73)), np.sin(np.linspace(0.0, 2.0 * np.pi, 73))])


@dataclass(frozen=True)
class View:
    """A direction to look from.

    Attributes
    ----------
    title, right, up : what the axes are called
    plane : (2, 3) directions of the drawing's axes
    towards : (3,) the direction to the eye
    """

    title: str
    right: str
    up: str
    plane: Array
    towards: Array


def _view(title: str, right: int, up: int, sign: float) -> View:
    unit = np.eye(3)
    return View(title, 'xyz'[right], 'xyz'[up], unit[[right, up]], sign * unit[3 - right - up])


_TOP, _FRONT, _SIDE = (
    _view('from above', 0, 1, 1.0),
    _view('from the right', 0, 2, -1.0),
    _view('from the front', 1, 2, 1.0),
)
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
        edge, width = (SECOND, 1.2) if is_target else (FAINT, 0.8)
        axis.fill(*outline.T, facecolor=PAGE, edgecolor='none', alpha=0.55, zorder=2)
        axis.fill(*outline.T, facecolor='none', edgecolor=edge, linewidth=width, zorder=2)
    for bone in found.bones:
        begin, end = (point @ project for point in bone)
        axis.plot([begin[0], end[0]], [begin[1], end[1]], color=INK, linewidth=1.6, alpha=0.75, zorder=3)
    for place, slides in found.joints:
        x, y = place @ project
        axis.plot(x, y, marker='s' if slides else 'o', markersize=4.5, color=INK, markerfacecolor=PAGE, zorder=4)
    if found.body is not None:
        _draw_body(axis, found.body, project)
    axis.set_aspect('equal', adjustable='datalim')
    axis.margins(0.06)
    entitle(axis, view.title, f'{view.right} [m]' if view.right else '')
    if view.right:
        axis.set_ylabel(f'{view.up} [m]', color=INK, fontsize=8)
    else:
        _triad(axis, project)


def _draw_body(axis: Axes, body: Body, project: Array) -> None:
    centre = body.com @ project
    outline = _outline(body.ellipsoid, project) + centre[:, None]
    axis.fill(*outline, facecolor=FIRST, alpha=0.16, linewidth=0.0, zorder=5)
    axis.plot(*outline, color=FIRST, linewidth=1.5, linestyle='-' if body.complete else '--', zorder=6)
    for end in body.axes.T @ project:
        axis.plot([centre[0] - end[0], centre[0] + end[0]], [centre[1] - end[1], centre[1] + end[1]],
                  color=FIRST, linewidth=0.9, zorder=6)  # fmt: skip
    region = _outline(body.uncertainty, project) + centre[:, None]
    axis.fill(*region, facecolor=SECOND, alpha=0.3, edgecolor=SECOND, linewidth=1.0, zorder=7)
    axis.plot(*centre, marker='P', markersize=9, color=SECOND, markeredgecolor=PAGE, markeredgewidth=0.8, zorder=8)


def _outline(matrix: Array, project: Array) -> Array:
    """Return (2, N) points on the outline of the ellipsoid x^T E^-1 x = 1 as it is seen."""
    sizes, axes = np.linalg.eigh(project.T @ matrix @ project)
    return axes @ (np.sqrt(np.maximum(sizes, 0.0))[:, None] * _CIRCLE)


def _triad(axis: Axes, project: Array) -> None:
    """Draw the directions of the axes in a corner."""
    axis.set_xticks([])
    axis.set_yticks([])
    axis.spines[:].set_color(LINE)
    for direction, label in zip(project, 'xyz', strict=True):
        end = 0.11 * direction
        axis.annotate(
            label, (0.13, 0.13), xytext=tuple(np.array([0.13, 0.13]) + end), textcoords='axes fraction',
            xycoords='axes fraction', fontsize=8, color=INK, ha='center', va='center',
            arrowprops={'arrowstyle': '<-', 'color': FAINT, 'shrinkA': 5, 'shrinkB': 0},
        )  # fmt: skip
