"""For RViz and Foxglove: the identified body as markers, and on request the links' frames."""

from __future__ import annotations

import math
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion, TransformStamped, Vector3
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from mbaid_ros.core.geometry import Array, quaternion_from_rotation, rotate_back
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import RobotModel
from mbaid_ros.core.robot.momentum import ellipsoid_radii, principal
from mbaid_ros.core.robot.urdf_document import tree_of
from mbaid_ros.messages import positions_of, stamp_of
from mbaid_ros.nodes.subscriptions import LATCHED, qos, quiet_publisher, tf_message

NAMESPACE = 'identified_body'
_RADIUS_95 = math.sqrt(7.814728)  # of the region that holds 95 % of a normal distribution in space
_SMALLEST = 1e-6  # m; viewers do not draw shapes without size
_LATEST = 2**31 * 1_000_000_000 - 1  # ns, the largest stamp
_TF_PERIOD = 1_000_000_000 // 50  # ns

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


class LinkFrames:
    """The frame of each link in that of its parent, from joint positions; `prefix` is of the frames' names."""

    def __init__(self, model: RobotModel, prefix: str = '') -> None:
        self._model = model
        self._prefix = prefix
        self._kinematics = Kinematics(model)
        joints = tree_of(model.urdf).findall('joint')
        kept = {link.name for link in model.links}
        ends = ((_end(joint, 'child'), _end(joint, 'parent')) for joint in joints)
        self._parents = {child: parent for child, parent in ends if child in kept and parent in kept}
        self._positions = dict.fromkeys(model.independent_joints, math.nan)
        self._sent = -_TF_PERIOD

    def transforms(self, message: Any) -> list[TransformStamped]:
        """Return the frames after a JointState, of all joints or of some; none while that is too soon or too little."""
        for name, value in positions_of(message).items():
            if name in self._positions:
                self._positions[name] = value
        positions = self._model.positions_from(self._positions)
        stamp = stamp_of(message)
        if not np.all(np.isfinite(positions)) or 0 <= stamp - self._sent < _TF_PERIOD:
            return []
        self._sent = stamp
        second, nanosecond = divmod(min(stamp, _LATEST), 1_000_000_000)
        configuration = self._kinematics.configure(np.eye(3)[None], positions[None])
        places = {link.name: configuration.link(link) for link in self._model.links}
        made = []
        for child, parent in self._parents.items():
            (rotation, position), (carrier, origin) = places[child], places[parent]
            header = Header(stamp=Time(sec=second, nanosec=nanosecond), frame_id=self._prefix + parent)
            transform = TransformStamped(header=header, child_frame_id=self._prefix + child)
            transform.transform.translation = _vector(rotate_back(carrier[0], position[0] - origin[0]))
            transform.transform.rotation = _quaternion(carrier[0].T @ rotation[0])
            made.append(transform)
        return made


class Display:
    """Publishes ~/markers, and with frames /tf, with a prefix of the frames' names.

    Raises ParameterError: Frames are asked for, but the message package for them is not installed.
    """

    def __init__(self, node: Node, *, with_frames: bool, prefix: str = '') -> None:
        self._prefix = prefix
        self._node = node
        self._message: Any = None
        self._tf: Publisher | None = None
        self._frames: tuple[RobotModel, LinkFrames] | None = None
        self.send_frames(wanted=with_frames)
        self._markers = quiet_publisher(node, MarkerArray, '~/markers', LATCHED)

    def send_frames(self, *, wanted: bool) -> None:
        """Begin or end to send the links' frames.

        Raises ParameterError: Frames are asked for, but the message package for them is not installed.
        """
        if wanted and self._tf is None:
            self._message = tf_message("parameter 'publish_tf' is true", 'false')
            self._tf = self._node.create_publisher(self._message, '/tf', qos(100))
        elif not wanted and self._tf is not None:
            self._node.destroy_publisher(self._tf)
            self._tf = None

    def close(self) -> None:
        """Publish no more."""
        self._node.destroy_publisher(self._markers)
        self.send_frames(wanted=False)

    def show(self, estimate: Estimate, frame: str) -> None:
        """Show an estimate in the frame of the target link."""
        self._markers.publish(markers(estimate, frame))

    def clear(self) -> None:
        """Show nothing."""
        self._markers.publish(cleared())

    def follow(self, model: RobotModel, message: Any) -> None:
        """Send the links' frames as a JointState gives them, if that was asked for."""
        if self._tf is None:
            return
        if self._frames is None or self._frames[0] is not model:
            self._frames = (model, LinkFrames(model, self._prefix))
        transforms = self._frames[1].transforms(message)
        if transforms:
            self._tf.publish(self._message(transforms=transforms))


def _end(joint: ET.Element, role: str) -> str:
    element = joint.find(role)
    return '' if element is None else element.get('link', '')


def _point(values: Array) -> Point:
    return Point(x=float(values[0]), y=float(values[1]), z=float(values[2]))


def _vector(values: Array) -> Vector3:
    return Vector3(x=float(values[0]), y=float(values[1]), z=float(values[2]))


def _quaternion(rotation: Array) -> Quaternion:
    x, y, z, w = (float(value) for value in quaternion_from_rotation(rotation))
    return Quaternion(x=x, y=y, z=z, w=w)
