"""Measurements of a frame that is rigidly attached to the base, as those of the base link."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mbaid_ros.core.geometry import Array, cross, rotate, skew
from mbaid_ros.core.samples import BaseStream


@dataclass(frozen=True, eq=False)
class AttachedFrame:
    """A frame on the base: a tracking marker, a sensor.

    Attributes
    ----------
    rotation : (3, 3), its axes to those of the base link
    position : (3,) m, its origin in the base link's frame
    """

    rotation: Array
    position: Array

    @property
    def is_base(self) -> bool:
        """Whether it is the base link's own frame."""
        return bool(np.array_equal(self.rotation, np.eye(3)) and not np.any(self.position))

    def to_base(self, measured: BaseStream) -> BaseStream:
        """Return the pose, twist and covariances of the base link, from those of this frame.

        Parameters
        ----------
        measured : pose and twist of this frame's origin; the twist's covariance in this frame's axes
        """
        # In products of matrices, batch sizes show in the last bit: here sums over axes do the work.
        rotation = np.einsum('nij,kj->nik', measured.rotation, self.rotation)
        lever = rotate(rotation, self.position)  # from the base's origin to the frame's, odometry axes
        pose = np.zeros((len(rotation), 6, 6))
        pose[:] = np.eye(6)
        pose[:, :3, 3:] = skew(lever)  # p = p_frame - lever: an error of orientation turns the lever
        twist = np.zeros((6, 6))
        twist[:3, :3] = twist[3:, 3:] = self.rotation
        twist[:3, 3:] = skew(self.position) @ self.rotation  # v = v_frame - w x lever
        return replace(
            measured,
            position=measured.position - lever,
            rotation=rotation,
            linear_velocity=measured.linear_velocity - cross(measured.angular_velocity, lever),
            pose_covariance=pose @ measured.pose_covariance @ np.swapaxes(pose, -1, -2),
            twist_covariance=twist @ measured.twist_covariance @ twist.T,
        )
