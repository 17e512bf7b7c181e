"""A base of which the orientation alone is known, measured or integrated, and no position."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import BaseStream, ImuStream, Stamps


def orientation_only(stamp: Stamps, rotation: Array, covariance: Array | None = None) -> BaseStream:
    """Return N orientations as those of a base in a frame that stays with the common centre of mass.

    Parameters
    ----------
    stamp : (N,) ns
    rotation : (N, 3, 3) base link to odometry axes
    covariance : (N, 3, 3) rad^2, odometry axes; None where the orientation is no measurement either
    """
    count = len(stamp)
    unknown, pose = np.full((count, 3), np.nan), np.full((count, 6, 6), np.nan)
    if covariance is not None:
        pose[:, 3:, 3:] = covariance
    return BaseStream(stamp, np.zeros((count, 3)), rotation, unknown, unknown, pose, np.tile(np.eye(6), (count, 1, 1)))


def measured_orientation(imu: ImuStream | None) -> BaseStream | None:
    """Return what an IMU tells of the base's orientation, where it does; None where it does not."""
    if imu is None:
        return None
    told = np.isfinite(imu.rotation).all(axis=(1, 2))
    if not np.any(told):
        return None
    base = orientation_only(imu.stamp[told], imu.rotation[told], imu.rotation_covariance[told])
    declared = base.declared.copy()
    declared[:, 1] = imu.declared[told]
    return replace(base, declared=declared)
