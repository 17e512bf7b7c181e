"""Imu messages to arrays."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.samples import ImuStream
from mbaid_ros.messages.fields import stamps_of

IMU_FRAME = 'IMU: frame_id is no link on the base'
IMU_NOT_FINITE = 'IMU: NaN or infinite value'
IMU_NOT_REAL = 'IMU: angular velocity beyond anything real'
IMU_WITHOUT_RATE = 'IMU: says that it does not measure the angular velocity (covariance -1)'

_LARGEST = 1e4  # rad/s: no gyro measures as much


class ImuReader:
    """Reads Imu messages: the angular velocity in base axes.

    Parameters
    ----------
    axes : (3, 3) of each frame that is accepted, by name: to those of the base link
    frame : name of the one it is in, whatever messages say; empty leaves it to these
    """

    def __init__(self, axes: Mapping[str, Array], frame: str) -> None:
        self._axes = axes
        self._frame = frame
        self.other_frame = ''

    def read(self, messages: Sequence[Any]) -> tuple[ImuStream | None, Counter[str]]:
        """Return the measurements, and how many messages were dropped for what."""
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
        stream = ImuStream(stamps_of([message for message, _ in kept]), turned)
        return stream[finite & real], +dropped
