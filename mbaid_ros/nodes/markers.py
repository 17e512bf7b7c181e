"""For RViz and Foxglove: the identified body as markers."""

from __future__ import annotations

import math

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from mbaid_ros.core.geometry import Array, quaternion_from_rotation
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.momentum import ellipsoid_radii, principal

NAMESPACE = 'identified_body'
_RADIUS_95 = math.sqrt(7.814728)  # of the region that holds 95 % of a normal distribution in space
_SMALLEST = 1e-6  # m; viewers do not draw shapes without size

# Okabe and Ito's colours.
_ORANGE, _BLUE = (0.84, 0.37, 0.0), (0.0, 0.45, 0.7)


def markers(estimate: Estimate, frame: str) -> MarkerArray:
    """Return the centre of mass, its 95 % ellipsoid, the principal axes and the equivalent ellipsoid of an estimate.

    Unknown parts are deleted, everything if the data contradict the model; an unknown coordinate of the CoM is drawn as
    0. `frame` is the target link's.
    """
    parameters = estimate.parameters
    if estimate.status == 'inconsistent' or np.sum(np.isfinite(parameters[1:4])) < 2:
        return cleared()
    com = np.nan_to_num(parameters[1:4])
    made = [_sphere(0, com, np.eye(3), np.full(3, 0.02), _ORANGE, 1.0), _uncertainty(estimate, com)]
    if parameters[0] > 0.0 and np.all(np.isfinite(parameters[4:])):
        found = principal(parameters)
        radii = ellipsoid_radii(float(parameters[0]), found.moments)
        made += [_axes(com, found.axes * radii), _sphere(3, com, found.axes, radii, _BLUE, 0.25)]
    else:
        made += [Marker(id=2, action=Marker.DELETE), Marker(id=3, action=Marker.DELETE)]
    for marker in made:
        marker.ns, marker.header.frame_id, marker.frame_locked = NAMESPACE, frame, True
    return MarkerArray(markers=made)


def cleared() -> MarkerArray:
    """Return the marker that empties the display."""
    return MarkerArray(markers=[Marker(ns=NAMESPACE, action=Marker.DELETEALL)])


def _uncertainty(estimate: Estimate, com: Array) -> Marker:
    variances, axes = np.linalg.eigh(np.nan_to_num(estimate.covariance[1:4, 1:4]))
    if np.linalg.det(axes) < 0.0:
        axes[:, 2] *= -1.0
    return _sphere(1, com, axes, _RADIUS_95 * np.sqrt(np.maximum(variances, 0.0)), _ORANGE, 0.5)


def _sphere(number: int, centre: Array, axes: Array, radii: Array, colour: tuple[float, ...], opacity: float) -> Marker:
    sizes = np.maximum(2.0 * radii, _SMALLEST)
    return Marker(
        id=number,
        type=Marker.SPHERE,
        action=Marker.ADD,
        pose=Pose(position=_point(centre), orientation=_quaternion(axes)),
        scale=_vector(sizes),
        color=ColorRGBA(r=colour[0], g=colour[1], b=colour[2], a=opacity),
    )


def _axes(centre: Array, half: Array) -> Marker:
    red, green, blue = (ColorRGBA(r=r, g=g, b=b, a=1.0) for r, g, b in (_ORANGE, (0.0, 0.62, 0.45), _BLUE))
    lines = Marker(id=2, type=Marker.LINE_LIST, action=Marker.ADD)
    lines.pose.orientation.w = 1.0
    lines.scale.x = max(0.02 * float(np.max(np.linalg.norm(half, axis=0))), _SMALLEST)  # width
    for end, colour in zip(half.T, (red, green, blue), strict=True):
        lines.points += [_point(centre - end), _point(centre + end)]
        lines.colors += [colour, colour]
    return lines


def _point(values: Array) -> Point:
    return Point(x=float(values[0]), y=float(values[1]), z=float(values[2]))


def _vector(values: Array) -> Vector3:
    return Vector3(x=float(values[0]), y=float(values[1]), z=float(values[2]))


def _quaternion(rotation: Array) -> Quaternion:
    x, y, z, w = (float(value) for value in quaternion_from_rotation(rotation))
    return Quaternion(x=x, y=y, z=z, w=w)
