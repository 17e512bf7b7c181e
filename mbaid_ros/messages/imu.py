"""Imu messages to arrays."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, rotation_from_quaternion
from mbaid_ros.core.samples import ImuStream
from mbaid_ros.core.sensors.base import usable_covariance
from mbaid_ros.messages.fields import stamps_of

IMU_FRAME = 'IMU: frame_id is no link on the base'
IMU_NOT_FINITE = 'IMU: NaN or infinite value'
IMU_NOT_REAL = 'IMU: angular velocity beyond anything real'
IMU_WITHOUT_RATE = 'IMU: the angular velocity is marked as not measured (covariance -1)'

IMU_BAD_QUATERNION = 'IMU: orientation is no unit quaternion'

_LARGEST = 1e4  # rad/s: no gyro measures as much
_QUATERNION_TOLERANCE = 0.1


class ImuReader:
    """Reads Imu messages: the angular velocity in base axes, and the orientation where that is asked for.

    Of an IMU on a link that joints move, the angular velocity is in the axes of that link.

    Parameters
    ----------
    axes : (3, 3) of each frame that is accepted, by name: to those of the base link, or of the link that it moves with
    frame : name of the one it is in, which overrides the messages; empty leaves it to these
    orientation_std : rad, of an orientation whose covariance is not set; None does not read orientations
    """

    def __init__(self, axes: Mapping[str, Array], frame: str, orientation_std: float | None = None) -> None:
        self._axes = axes
        self._frame = frame
        self._orientation_std = orientation_std
        self.other_frame = ''

    def read(self, messages: Sequence[Any]) -> tuple[ImuStream | None, Counter[str]]:
        """Return the measurements, and the numbers of dropped messages by cause."""
        dropped: Counter[str] = Counter()
        frames = [self._frame or message.header.frame_id.lstrip('/') for message in messages]
        kept = []
        for message, frame in zip(messages, frames, strict=True):
            if frame not in self._axes:
                self.other_frame = frame
                dropped[IMU_FRAME] += 1
            elif message.angular_velocity_covariance[0] == -1.0:  # REP 145
                dropped[IMU_WITHOUT_RATE] += 1
            else:
                kept.append((message, frame))
        if not kept:
            return None, dropped
        rates = (message.angular_velocity for message, _ in kept)
        rate = np.array([(each.x, each.y, each.z) for each in rates], dtype=float)
        finite = np.all(np.isfinite(rate), axis=1)
        real = np.all(np.abs(rate) < _LARGEST, axis=1)
        dropped[IMU_NOT_FINITE] += int(np.sum(~finite))
        dropped[IMU_NOT_REAL] += int(np.sum(finite & ~real))
        turned = np.empty_like(rate)
        names = np.array([frame for _, frame in kept])
        for name in dict.fromkeys(names.tolist()):
            # A sum over axes: products of matrices show the size of the batch in the last bit.
            turned[names == name] = np.einsum('ij,nj->ni', self._axes[name], rate[names == name])
        stamps = stamps_of([message for message, _ in kept])
        if self._orientation_std is None:
            return ImuStream(stamps, turned)[finite & real], +dropped
        stream = ImuStream(stamps, turned, *self._orientations(kept, self._orientation_std, dropped))
        return stream[finite & real], +dropped

    def _orientations(
        self, kept: Sequence[tuple[Any, str]], deviation: float, dropped: Counter[str]
    ) -> tuple[Array, Array, Flags]:
        """Return orientations and covariances (N, 3, 3) each, NaN where none is given, and which messages give them."""
        given = [(message.orientation, message.orientation_covariance) for message, _ in kept]
        quaternion = np.array([(each.x, each.y, each.z, each.w) for each, _ in given], dtype=float)
        covariance = np.array([each for _, each in given], dtype=float).reshape(-1, 3, 3)
        present: Flags = covariance[:, 0, 0] != -1.0  # REP 145
        with np.errstate(over='ignore', invalid='ignore'):
            unit = np.abs(np.sqrt(np.sum(quaternion**2, axis=1)) - 1.0) < _QUATERNION_TOLERANCE
        dropped[IMU_BAD_QUATERNION] += int(np.sum(present & ~unit))
        good = present & unit
        rotation: Array = np.full((len(kept), 3, 3), np.nan)
        measured = rotation_from_quaternion(quaternion[good])
        # That of the sensor's frame in the world: the base's is turned back by where the sensor is on it.
        back = np.array([self._axes[frame] for _, frame in kept])[good]
        rotation[good] = np.einsum('nij,nkj->nik', measured, back)
        default = deviation**2 * np.eye(6)
        declared: Flags = good.copy()
        for index in np.flatnonzero(good).tolist():
            whole = default.copy()
            whole[3:, 3:] = covariance[index]
            used = usable_covariance(whole, default)
            covariance[index], declared[index] = used.matrix[3:, 3:], used.is_given[1]
        return rotation, np.where(good[:, None, None], covariance, np.nan), declared
