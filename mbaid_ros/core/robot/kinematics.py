"""Poses of every moving body and unit twists of every joint, for a batch of samples at once; and planar robots.

All positions are relative to the origin of the base link, all axes are those of the odometry frame, and every twist is
given at the base link's origin: (u, w) with u the velocity of the point of the body (extended) that lies there. Twists
then add along the chain without levers, and nothing here depends on how far the base has drifted.

All joint axes of a planar robot are parallel, and its base turns about them alone. Its support (an air-bearing table)
may exert force out of the plane, so only three equations hold: two of linear momentum in the plane and one of angular
momentum about its normal.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mbaid_ros.core.geometry import Array, cross, rotate, skew, vec
from mbaid_ros.core.robot.model import Link, RobotModel
from mbaid_ros.core.samples import ArrayRecord, Samples


@dataclass(frozen=True)
class Configuration(ArrayRecord):
    """Poses and joint twists at N samples."""

    rotation: Array  # (N, n + 1, 3, 3) body to odometry axes
    position: Array  # (N, n + 1, 3) m, body origins relative to the base origin
    joint_twist: Array  # (N, n, 6) unit twist (u, w) of each joint at the base origin (Jacobian columns)

    def link_pose(self, link: Link) -> tuple[Array, Array]:
        """Return rotation (N, 3, 3) and position (N, 3) of a link's frame."""
        rotation = self.rotation[:, link.body]
        return rotation @ link.rotation, self.position[:, link.body] + rotate(rotation, link.position)


class Kinematics:
    """The vectorised kinematics of one robot.

    Attributes
    ----------
    axes : (n, 3) axis of each joint in its parent body's frame
    ancestors : (n + 1, n) 1 where joint j moves body b, else 0
    across : (n, 3, 2) two unit vectors normal to each joint's axis and to each other, in the joint's own frame
    """

    def __init__(self, model: RobotModel) -> None:
        self.model = model
        count = model.joints
        self._sliding = np.flatnonzero(model.prismatic)
        # Joint j's rotation in its parent is A + sin(q) B + cos(q) C: Rodrigues with the constant placement in front.
        generator = skew(model.axes)
        square = generator @ generator
        turns = ~np.array(model.prismatic, dtype=bool).reshape(count, 1, 1)
        self._constant = model.rotations @ (np.eye(3) + np.where(turns, square, 0.0))
        self._sine = np.where(turns, model.rotations @ generator, 0.0)
        self._cosine = np.where(turns, -model.rotations @ square, 0.0)
        self.axes = rotate(model.rotations, model.axes)
        self._fixed = np.stack((model.positions, self.axes), axis=-1)
        self.ancestors = np.zeros((count + 1, count))
        for joint, parent in enumerate(model.parents):
            self.ancestors[joint + 1] = self.ancestors[parent]
            self.ancestors[joint + 1, joint] = 1.0
        self.across = _normal_axes(model.axes)

    def configure(self, base_rotation: Array, joint_position: Array) -> Configuration:
        """Return poses and joint twists for base to odometry axes (N, 3, 3) and joints (N, n), rad or m."""
        model = self.model
        count, joints = joint_position.shape
        angle = joint_position[..., None, None]
        # Each joint's rotation, position and axis in the axes of its parent body: turned in one product.
        local = np.empty((count, joints, 3, 5))
        local[..., :3] = self._constant + np.sin(angle) * self._sine + np.cos(angle) * self._cosine
        local[..., 3:] = self._fixed
        frames = np.empty((count, joints + 1, 3, 5))
        frames[:, 0, :, :3] = base_rotation
        for joint, parent in enumerate(model.parents):
            np.matmul(frames[:, parent, :, :3], local[:, joint], out=frames[:, joint + 1])
        rotation, place, axis = frames[..., :3].copy(), frames[:, 1:, :, 3], frames[:, 1:, :, 4]
        if len(self._sliding):
            place += axis * np.where(model.prismatic, joint_position, 0.0)[..., None]
        position = np.zeros((count, joints + 1, 3))
        for joint, parent in enumerate(model.parents):
            np.add(position[:, parent], place[:, joint], out=position[:, joint + 1])
        twist = np.zeros((count, joints, 6))
        twist[..., :3], twist[..., 3:] = cross(position[:, 1:], axis), axis
        if len(self._sliding):
            twist[:, self._sliding, :3], twist[:, self._sliding, 3:] = axis[:, self._sliding], 0.0
        return Configuration(rotation, position, twist)

    def body_twists(self, configuration: Configuration, joint_velocity: Array, base_twist: Array) -> Array:
        """Return the twist (u, w) of every body at the base origin (paper, eq. 1), (N, n + 1, 6).

        Parameters
        ----------
        configuration : of the same N samples
        joint_velocity : (N, n) rad/s or m/s
        base_twist : (N, 6) of the base link's origin, odometry axes
        """
        return base_twist[:, None] + self.ancestors @ (configuration.joint_twist * joint_velocity[..., None])


def _normal_axes(axis: Array) -> Array:
    """Return (n, 3, 2) two orthonormal columns normal to each of (n, 3) unit vectors."""
    across = np.eye(3)[np.argmin(np.abs(axis), axis=1)]
    first = across - np.sum(across * axis, axis=1, keepdims=True) * axis
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack((first, cross(axis, first)), axis=2)


_PARALLEL = 1e-9  # by which the cosine of axes of one direction may differ from 1 (4.5e-5 rad): rounding of URDF angles
# Deviations of a window's mean, of all three axes together, from which the base leaves the plane: no noise does.
_SIGNIFICANT = 6.0
_OUT_OF_PLANE = 0.05  # rad/s, of a gyro alone: no bias is as large


@dataclass(frozen=True)
class Plane:
    """The plane of motion in a link's frame, which it never leaves, since all joints turn about its normal."""

    normal: Array  # (3,) unit vector
    axes: Array  # (2, 3) orthonormal, in the plane; axes of the link where the normal is one of them

    @property
    def basis(self) -> Array:
        """Orthonormal (10, 4): (m, first moment in the plane (2), moment about the normal) in (m, h, I_o)."""
        about = vec(self.normal[:, None] * self.normal)
        basis = np.zeros((10, 4))
        basis[0, 0] = 1.0
        basis[1:4, 1:3] = self.axes.T
        basis[4:10, 3] = about / np.linalg.norm(about)
        return basis


class PlaneDetector:
    """Decides from mechanism and motion whether a robot moves in a plane; once spatial, it stays so.

    Attributes
    ----------
    model : RobotModel
    planar : whether it does, so far
    """

    def __init__(self, model: RobotModel) -> None:
        self.model = model
        self._axis = _common_axis(model)
        self._normal: Array | None = None
        self.planar = self._axis is not None

    @property
    def normal(self) -> Array | None:
        """Of the plane of motion, (3,) in odometry axes; None for a spatial motion."""
        return self._normal if self.planar else None

    def update(self, window: Samples) -> None:
        """Take the next window's samples."""
        if not self.planar or self._axis is None:
            return
        normals = rotate(window.base_rotation, self._axis)
        mean = np.mean(normals, axis=0)
        if self._normal is None:
            self._normal = mean / np.linalg.norm(mean)
        count = len(window)
        rate = np.mean(window.base_angular_velocity, axis=0)
        tilt_std = np.sqrt(np.trace(np.mean(window.pose_covariance[:, 3:, 3:], axis=0)) / count)
        rate_std = np.sqrt(np.trace(np.mean(window.twist_covariance[:, 3:, 3:], axis=0)) / count)
        tilt = np.linalg.norm(np.cross(self._normal, mean))
        out_of_plane = np.linalg.norm(rate - self._normal * (self._normal @ rate))
        # The reference normal has the first window's noise: twice the variance. A rate of NaN is not measured.
        turns_out = out_of_plane > _SIGNIFICANT * rate_std
        # Nor is an orientation with a covariance of NaN, but integrated: then the gyro decides, despite its bias.
        tilts = tilt > _SIGNIFICANT * np.sqrt(2.0) * tilt_std
        if np.isnan(tilt_std) and window.gyro.shape[1] and count > 1:
            turned = (window.gyro[-1] - window.gyro[0]) / (window.time[-1] - window.time[0])
            tilts = np.linalg.norm(turned - self._axis * (self._axis @ turned)) > _OUT_OF_PLANE
        self.planar = not (tilts or turns_out)

    def plane(self, link: Link) -> Plane | None:
        """Return the plane in a link's frame, None for a spatial motion."""
        if self._axis is None or not self.planar:
            return None
        kinematics = Kinematics(self.model)
        configuration = kinematics.configure(np.eye(3)[None], np.zeros((1, self.model.joints)))
        normal = configuration.link_pose(link)[0][0].T @ self._axis
        along = np.argmax(np.abs(normal))
        if abs(normal[along]) > 1.0 - _PARALLEL:
            return Plane(normal, np.delete(np.eye(3), along, axis=0))
        return Plane(normal, np.linalg.svd(normal[None])[2][1:])

    def plane_of_body(self, body: int) -> Plane:
        """Return the plane in a moving body's frame; ValueError for a spatial motion."""
        plane = self.plane(Link('', body, np.eye(3), np.zeros(3), np.zeros(10)))
        if plane is None:
            raise ValueError('a spatial motion has no plane')
        return plane

    def equation_selection(self) -> Array:
        """Return the (k, 6) selection Pi of the equations Pi (P, L) that hold, k = 3 in a plane, else 6."""
        if not self.planar or self._normal is None:
            return np.eye(6)
        first = np.cross(self._normal, np.eye(3)[int(np.argmin(np.abs(self._normal)))])
        first /= np.linalg.norm(first)
        selection = np.zeros((3, 6))
        selection[0, :3] = first
        selection[1, :3] = np.cross(self._normal, first)
        selection[2, 3:] = self._normal
        return selection


def _common_axis(model: RobotModel) -> Array | None:
    """Return the axis, in the base frame, that all joints turn about (or slide at right angles to), if there is one."""
    if not model.joints:
        return None
    kinematics = Kinematics(model)
    # Two postures: axes that happen to be parallel in one are not so in the other.
    angles = np.array([np.zeros(model.joints), np.linspace(0.3, 1.1, model.joints)])
    twists = kinematics.configure(np.broadcast_to(np.eye(3), (2, 3, 3)), angles).joint_twist
    slides = np.array(model.prismatic)
    turning = twists[:, ~slides, 3:].reshape(-1, 3)
    if not len(turning):
        return None
    axis: Array = turning[0]
    parallel = np.all(np.abs(np.abs(turning @ axis) - 1.0) < _PARALLEL)
    across = np.all(np.abs(twists[:, slides, :3] @ axis) < _PARALLEL)
    return axis if parallel and across else None


@dataclass(frozen=True, eq=False)
class Springs:
    """f joints that no JointState reports."""

    joints: tuple[int, ...] = ()  # f indices
    # rate, ratio: (f,) natural angular frequency, rad/s, with all else held; damping ratio
    frequency: Array = field(default_factory=lambda: np.zeros(0))
    damping_ratio: Array = field(default_factory=lambda: np.zeros(0))
    # (2, f) deflection and rate at the first instant, rad or m, and per s
    initial_state: Array = field(default_factory=lambda: np.zeros((2, 0)))

    @property
    def count(self) -> int:
        """Number f."""
        return len(self.joints)

    @property
    def highest_frequency(self) -> float:
        """The highest natural frequency, Hz; 0 without any."""
        return float(np.max(self.frequency, initial=0.0) / (2.0 * np.pi))
