"""Planar robots: which of the six momentum equations carry information, and along which axes.

All joint axes of a planar robot are parallel, and its base turns about them alone. Whatever keeps it in the plane (an
air-bearing table, say) may exert force out of it, so only three equations hold: two of linear momentum in the plane and
one of angular momentum about its normal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, rotate, vec
from mbaid_ros.core.robot.kinematics import Kinematics
from mbaid_ros.core.robot.model import Link, RobotModel
from mbaid_ros.core.samples import Samples

_PARALLEL = 1e-9  # by which the cosine of axes of one direction may differ from 1 (4.5e-5 rad): rounding of URDF angles
# Deviations of a window's mean, of all three axes together, from which the base leaves the plane: no noise does.
_SIGNIFICANT = 6.0
_OUT_OF_PLANE = 0.05  # rad/s, of a gyro alone: no bias is as large


@dataclass(frozen=True)
class Plane:
    """The plane of motion in a link's frame, which it never leaves, since all joints turn about its normal.

    Attributes
    ----------
    normal : (3,) unit vector
    across : (2, 3) orthonormal, in the plane; axes of the link where the normal is one of them
    """

    normal: Array
    across: Array

    @property
    def basis(self) -> Array:
        """Orthonormal (10, 4): (m, first moment in the plane (2), moment about the normal) in (m, h, I_o)."""
        about = vec(self.normal[:, None] * self.normal)
        basis = np.zeros((10, 4))
        basis[0, 0] = 1.0
        basis[1:4, 1:3] = self.across.T
        basis[4:10, 3] = about / np.linalg.norm(about)
        return basis


class PlaneDetector:
    """Decides from the mechanism and from the motion whether a robot moves in a plane.

    Once the base has turned out of the plane, the motion counts as spatial for good.

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

    @staticmethod
    def decided(model: RobotModel, normal: Array | None) -> PlaneDetector:
        """Return one that has decided: of a motion in the plane with a normal (3,), odometry axes; None in space."""
        detector = PlaneDetector(model)
        detector._normal, detector.planar = normal, normal is not None and detector.planar
        return detector

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
        # The reference normal has the first window's noise: twice the variance.
        # A rate that is not measured (NaN) says nothing.
        turns_out = out_of_plane > _SIGNIFICANT * rate_std
        # Nor does an orientation that is none (NaN), but integrated: then the gyro has to say it, whatever its bias.
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
        normal = configuration.link(link)[0][0].T @ self._axis
        along = np.argmax(np.abs(normal))
        if abs(normal[along]) > 1.0 - _PARALLEL:
            return Plane(normal, np.delete(np.eye(3), along, axis=0))
        return Plane(normal, np.linalg.svd(normal[None])[2][1:])

    def plane_of(self, body: int) -> Plane:
        """Return the plane in a moving body's frame.

        Raises
        ------
        ValueError
            The motion is spatial.
        """
        plane = self.plane(Link('', body, np.eye(3), np.zeros(3), np.zeros(10)))
        if plane is None:
            raise ValueError('a spatial motion has no plane')
        return plane

    def rows(self) -> Array:
        """Return the (k, 6) selection Pi of the equations that hold: Pi (P, L), k = 3 in a plane, else 6."""
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
