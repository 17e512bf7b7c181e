"""Poses of every moving body and unit twists of every joint, for a batch of samples at once.

All positions are relative to the origin of the base link, all axes are those of the odometry frame, and every twist is
given at the base link's origin: (u, w) with u the velocity of the point of the body (extended) that lies there. Twists
then add along the chain without levers, and nothing here depends on how far the base has drifted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.array_record import ArrayRecord
from mbaid_ros.core.geometry import Array, cross, rotate, skew
from mbaid_ros.core.robot.model import Link, RobotModel


@dataclass(frozen=True)
class Configuration(ArrayRecord):
    """Where everything is.

    Attributes
    ----------
    rotation : (N, n + 1, 3, 3) body to odometry axes
    position : (N, n + 1, 3) m, body origins relative to the base origin
    joint_twist : (N, n, 6) unit twist (u, w) of each joint at the base origin (Jacobian columns)
    """

    rotation: Array
    position: Array
    joint_twist: Array

    def link(self, link: Link) -> tuple[Array, Array]:
        """Return rotation (N, 3, 3) and position (N, 3) of a link's frame."""
        rotation = self.rotation[:, link.body]
        return rotation @ link.rotation, self.position[:, link.body] + rotate(rotation, link.position)


class Kinematics:
    """The vectorised kinematics of one robot.

    Attributes
    ----------
    axes : (n, 3) axis of each joint in its parent body's frame
    ancestors : (n + 1, n) 1 where joint j moves body b, else 0
    axial : (n + 1, 3, 3) an axial frame of each body, in the body's frame: one whose third axis is that of the joint
        that moves the body, as Denavit and Hartenberg have it
    placements : (n, 4, 3) the three axes of body j + 1's axial frame while joint j is at zero, and its origin (m), in
        the axial frame of the parent body
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
        self.axial = np.concatenate((np.eye(3)[None], _with_third_axis(model.axes)))
        at_zero = np.concatenate((model.rotations @ self.axial[1:], model.positions[..., None]), axis=2)
        self.placements = np.swapaxes(at_zero, 1, 2) @ self.axial[list(model.parents)]

    def configure(self, base_rotation: Array, joint_position: Array) -> Configuration:
        """Return poses and joint twists.

        Parameters
        ----------
        base_rotation : (N, 3, 3) base to odometry axes
        joint_position : (N, n) rad or m

        Returns
        -------
        Configuration
        """
        model = self.model
        count, joints = joint_position.shape
        angle = joint_position[..., None, None]
        # Each joint's rotation, where it is, and its axis, in the axes of its parent body: turned in one product.
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
        """Return the twist of every body.

        Parameters
        ----------
        configuration : of the same N samples
        joint_velocity : (N, n) rad/s or m/s
        base_twist : (N, 6) of the base link's origin, odometry axes

        Returns
        -------
        (N, n + 1, 6) array (u, w) at the base origin (paper, eq. 1)
        """
        return base_twist[:, None] + self.ancestors @ (configuration.joint_twist * joint_velocity[..., None])


def _with_third_axis(axis: Array) -> Array:
    """Return rotation matrices (n, 3, 3) whose third columns are the unit vectors (n, 3)."""
    across = np.eye(3)[np.argmin(np.abs(axis), axis=1)]
    first = across - np.sum(across * axis, axis=1, keepdims=True) * axis
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack((first, cross(axis, first), axis), axis=2)
