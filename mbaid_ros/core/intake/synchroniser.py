"""Joint and base measurements brought to common stamps: the base interpolated to the joints' stamps, never held."""

from __future__ import annotations

from collections import Counter
from typing import TypeVar

import numpy as np

from mbaid_ros.core.geometry import Array, cross, exp, log, rotate_back
from mbaid_ros.core.samples import BaseStream, JointStream, Samples, Stamps

LARGEST_BACKLOG = 100_000  # measurements of one stream waiting for the other

OUT_OF_ORDER = 'stamp not after the one before'
NO_ODOMETRY = 'no odometry around the stamp'
ODOMETRY_GAP = 'gap in the odometry'

_BEFORE_ALL = np.iinfo(np.int64).min

Stream = TypeVar('Stream', JointStream, BaseStream)


class Synchroniser:
    """Turns two streams into samples; the result does not depend on how they are cut into pieces.

    Parameters
    ----------
    maximum_gap : float
        Longest time between two odometry stamps that is interpolated, s.
    """

    def __init__(self, maximum_gap: float) -> None:
        self._maximum_gap = round(maximum_gap * 1e9)
        self._joints: JointStream | None = None
        self._base: BaseStream | None = None
        self._origin: int | None = None
        self._previous: int | None = None  # stamp of the last joint measurement that was used
        self._newest: dict[type, int] = {}  # latest stamp of each stream, used up or not
        self.dropped: Counter[str] = Counter()

    @property
    def origin(self) -> int:
        """Stamp of the first sample, ns: time 0 of every sample."""
        return self._origin or 0

    def push(self, joints: JointStream | None, base: BaseStream | None) -> Samples | None:
        """Take measurements and return the samples that they complete, None if there are none.

        A stamp that is not after its predecessor in the same stream is dropped and counted.
        """
        self._joints = self._append(self._joints, joints)
        self._base = self._append(self._base, base)
        if self._joints is None or self._base is None:
            return None
        waiting, known = self._joints.stamp, self._base.stamp
        ready = int(np.searchsorted(waiting, known[-1], side='right'))
        early = int(np.searchsorted(waiting, known[0], side='left'))
        self.dropped[NO_ODOMETRY] += early
        samples = self._interpolate(self._joints[early:ready], self._base) if ready > early else None
        self._joints = self._joints[max(early, ready) :]
        # The last odometry before the next joints is one end of their interval, the one before tells its length.
        pending = self._joints.stamp[0] if len(self._joints.stamp) else self._newest[JointStream] + 1
        first = max(int(np.searchsorted(known, pending, side='right')) - 2, 0)
        self._base = self._base[first:]
        return samples

    def _append(self, buffer: Stream | None, new: Stream | None) -> Stream | None:
        if new is None or not len(new.stamp):
            return buffer
        newest = self._newest.get(type(new), _BEFORE_ALL)
        before = np.maximum.accumulate(np.concatenate(([newest], new.stamp[:-1])))
        fresh = new.stamp > before
        self._newest[type(new)] = max(int(before[-1]), int(new.stamp[-1]))
        if not np.all(fresh):
            self.dropped[OUT_OF_ORDER] += int(np.sum(~fresh))
            new = new[fresh]
        if buffer is not None:
            new = new.concatenate((buffer, new))
        excess = len(new.stamp) - LARGEST_BACKLOG
        if excess > 0:
            self.dropped[NO_ODOMETRY] += excess
            new = new[excess:]
        return new

    def _interpolate(self, joints: JointStream, base: BaseStream) -> Samples | None:
        right = np.searchsorted(base.stamp, joints.stamp, side='left')
        left = np.where(base.stamp[right] == joints.stamp, right, right - 1)
        interval = base.stamp[right] - base.stamp[np.maximum(right - 1, 0)]
        spacing = np.diff(joints.stamp, prepend=joints.stamp[0] if self._previous is None else self._previous)
        self._previous = int(joints.stamp[-1])
        usable = base.stamp[right] - base.stamp[left] <= self._maximum_gap
        self.dropped[ODOMETRY_GAP] += int(np.sum(~usable))
        if not np.any(usable):
            return None
        # Samples that share one odometry interval share its noise, which averages out that much less.
        shared = np.asarray(
            np.where(spacing > 0, np.maximum(interval / np.maximum(spacing, 1), 1.0), 1.0)[usable], dtype=float
        )
        joints, left, right = joints[usable], left[usable], right[usable]
        if self._origin is None:
            self._origin = int(joints.stamp[0])
        time = (joints.stamp - self._origin) * 1e-9
        if np.array_equal(left, right):
            return _at_once(joints, base[left], time, shared)
        return _hermite(joints, base, (left, right), time, shared)


def _at_once(joints: JointStream, base: BaseStream, time: Array, shared: Array) -> Samples:
    """Return the samples of joints and base that were measured at the same stamps."""
    weight = shared[:, None, None]
    return Samples(
        time=time,
        joint_position=joints.position,
        joint_velocity=joints.velocity,
        base_position=base.position,
        base_rotation=base.rotation,
        base_linear_velocity=base.linear_velocity,
        base_angular_velocity=base.angular_velocity,
        pose_covariance=weight * base.pose_covariance,
        twist_covariance=weight * base.twist_covariance,
        stored=joints.stored,
    )


def _hermite(joints: JointStream, base: BaseStream, ends: tuple[Stamps, Stamps], time: Array, shared: Array) -> Samples:
    """Interpolate pose by cubics that use the velocities at both ends, and velocities linearly.

    The derivative of the pose's cubic would be smoother, but turns position noise into velocity noise. Where a velocity
    is not given, the pose changes evenly.
    """
    left, right = ends
    length = (base.stamp[right] - base.stamp[left]) * 1e-9
    fraction = (joints.stamp - base.stamp[left]) * 1e-9 / np.where(length > 0.0, length, 1.0)
    s, h = fraction[:, None], length[:, None]
    to_end = s * s * (3.0 - 2.0 * s)
    from_start = s * (1.0 - s) ** 2 * h
    from_end = -s * s * (1.0 - s) * h
    start, end = base.position[left], base.position[right]
    velocity = base.linear_velocity[left], base.linear_velocity[right]
    even = 1.0 / np.where(h > 0.0, h, np.inf)
    slopes = [np.where(np.isfinite(slope), slope, (end - start) * even) for slope in velocity]
    position = start + to_end * (end - start) + from_start * slopes[0] + from_end * slopes[1]
    # Orientation: the same cubic in the rotation vector from the left sample, in its axes.
    rotation = base.rotation[left]
    turn = log(np.swapaxes(rotation, -1, -2) @ base.rotation[right])
    rate = rotate_back(rotation, base.angular_velocity[left]), rotate_back(rotation, base.angular_velocity[right])
    rate_end = rate[1] - 0.5 * cross(turn, rate[1])  # derivative of the rotation vector, to first order in the turn
    exact = length == 0.0
    slopes = [np.where(np.isfinite(slope), slope, turn * even) for slope in (rate[0], rate_end)]
    cubic = to_end * turn + from_start * slopes[0] + from_end * slopes[1]
    turned = rotation @ exp(cubic)
    return Samples(
        time=time,
        joint_position=joints.position,
        joint_velocity=joints.velocity,
        base_position=position,
        base_rotation=np.where(exact[:, None, None], rotation, turned),
        base_linear_velocity=velocity[0] + s * (velocity[1] - velocity[0]),
        base_angular_velocity=base.angular_velocity[left]
        + s * (base.angular_velocity[right] - base.angular_velocity[left]),
        pose_covariance=_blended(base.pose_covariance, ends, s, shared),
        twist_covariance=_blended(base.twist_covariance, ends, s, shared),
        stored=joints.stored,
    )


def _blended(covariance: Array, ends: tuple[Stamps, Stamps], fraction: Array, weight: Array) -> Array:
    """Return (N, 6, 6) covariances so far (N, 1) between two of the base's, weighted (N,); in place, they are large."""
    blend = fraction[..., None]
    start, end = (np.take(covariance, places, axis=0) for places in ends)
    start *= 1.0 - blend
    end *= blend
    start += end
    start *= weight[:, None, None]
    return start
