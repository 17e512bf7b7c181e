"""The outlines of a robot's visual geometry; meshes are left out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio

from mbaid_ros import limits
from mbaid_ros.core.geometry import Array, rotate
from mbaid_ros.core.robot.urdf_document import tree_of

_TURN = np.linspace(0.0, 2.0 * np.pi, 25)[:-1]
_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


@dataclass(frozen=True)
class Shape:
    """A convex body.

    Attributes
    ----------
    link : that it belongs to
    points : (N, 3) m, points whose hull it is, in the link's frame
    """

    link: str
    points: Array


def shapes(urdf: str) -> list[Shape]:
    """Return the first boxes, cylinders and spheres of a robot description that has been accepted as such."""
    return list(islice(_shapes(tree_of(urdf)), limits.SHAPES_DRAWN))


def _shapes(robot: ET.Element) -> Iterator[Shape]:
    for link in robot.findall('link'):
        for visual in link.findall('visual'):
            for points in _points(visual.find('geometry')):
                origin = visual.find('origin')
                rpy, xyz = _numbers(origin, 'rpy', '0 0 0'), _numbers(origin, 'xyz', '0 0 0')
                if len(rpy) == len(xyz) == 3:
                    placed = rotate(pinocchio.rpy.rpyToMatrix(*rpy), points) + np.array(xyz)
                    yield Shape(link.get('name', ''), placed)


def _points(geometry: ET.Element | None) -> Iterator[Array]:
    if geometry is None:
        return
    box, cylinder, sphere = (geometry.find(kind) for kind in ('box', 'cylinder', 'sphere'))
    if box is not None:
        size = _numbers(box, 'size')
        if len(size) == 3:
            yield _CORNERS * np.array(size)
    if cylinder is not None:
        radius, length = _numbers(cylinder, 'radius'), _numbers(cylinder, 'length')
        if len(radius) == len(length) == 1:
            circle = radius[0] * np.stack((np.cos(_TURN), np.sin(_TURN)), axis=1)
            yield np.concatenate([np.insert(circle, 2, end * length[0], axis=1) for end in (-0.5, 0.5)])
    if sphere is not None:
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
    """Return the corners of the convex hull of (N, 2) points in order (Andrew's monotone chain)."""
    ordered = sorted({(round(float(x), 9), round(float(y), 9)) for x, y in points})
    if len(ordered) < 3:
        return np.array(ordered)
    return np.array(_chain(ordered)[:-1] + _chain(ordered[::-1])[:-1])


def _chain(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    kept: list[tuple[float, float]] = []
    for x, y in points:
        while len(kept) > 1:
            (x1, y1), (x2, y2) = kept[-2:]
            if (x2 - x1) * (y - y1) - (y2 - y1) * (x - x1) > 0.0:
                break
            kept.pop()
        kept.append((x, y))
    return kept
