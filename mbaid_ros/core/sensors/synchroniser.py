"""Joint and base measurements at common stamps: the base is interpolated to the joints' stamps, never held."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from mbaid_ros.core.geometry import Array, exp, log
from mbaid_ros.core.samples import BaseStream, ImuStream, JointStream, Samples, Stamps
from mbaid_ros.core.sensors.base import hermite
from mbaid_ros.core.sensors.gyro import Gyro
from mbaid_ros.core.sensors.levels import NoiseEstimator
from mbaid_ros.core.sensors.outliers import JOINT_OUTLIER, JOINTS_HELD, POSE, Outliers, Repeats, joint_channels

LARGEST_BACKLOG = 100_000  # measurements of one stream waiting for the other: more are memory without an end

OUT_OF_ORDER = 'stamp not after the one before'
NO_ODOMETRY = 'no odometry around the stamp'
ODOMETRY_GAP = 'gap in the odometry'

# A gyro that is further behind the joints than that (ns) has stopped: samples wait for it no longer.
_PATIENCE = 1_000_000_000
_BEFORE_ALL = np.iinfo(np.int64).min
_TYPICAL_NOISE = 1e-4  # rad or m, of joint positions of which nothing is declared

Stream = TypeVar('Stream', JointStream, BaseStream)


class Synchroniser:
    """Turns two streams into samples; the result does not depend on how they are cut into pieces.

    Parameters
    ----------
    maximum_gap : s, longest time between two odometry stamps that is interpolated
    view : transforms measurements of the base to an inertial frame, if that of the odometry is none
    gyro : integrates an IMU's rate; samples then wait for it
    noise : receives the readings that are used
    """

    def __init__(
        self,
        maximum_gap: float,
        view: Callable[[BaseStream], BaseStream] | None = None,
        gyro: Gyro | None = None,
        noise: NoiseEstimator | None = None,
    ) -> None:
        self._noise = noise
        self._view = view
        self._gyro = gyro
        self._maximum_gap = round(maximum_gap * 1e9)
        self._joints: JointStream | None = None
        self._base: BaseStream | None = None
        self._origin: int | None = None
        self._previous: int | None = None  # stamp of the last joint measurement that was used
        self._newest: dict[type, int] = {}  # latest stamp of each stream, used up or not
        self._repeats = Repeats[BaseStream](POSE)
        self._outliers = Outliers[BaseStream](self._maximum_gap, POSE)
        joints = joint_channels(_TYPICAL_NOISE if noise is None else noise.joint_position)
        self._held = Repeats[JointStream](joints, JOINTS_HELD, together=True)
        self._joint_outliers = Outliers[JointStream](self._maximum_gap, joints, JOINT_OUTLIER)
        self._dropped: Counter[str] = Counter()

    @property
    def dropped(self) -> Counter[str]:
        """Measurements that were not used, by cause."""
        gyro = Counter[str]() if self._gyro is None else self._gyro.dropped
        gates = (self._repeats, self._outliers, self._held, self._joint_outliers)
        return +sum((gate.dropped for gate in gates), self._dropped + gyro)

    @property
    def outlying_joint(self) -> int | None:
        """Index of the joint that most outliers are of; None if there is no outlier."""
        most = self._joint_outliers.by_channel.most_common(1)
        return most[0][0] if most else None

    @property
    def joint_interval(self) -> float:
        """Time between the latest two joint readings that differ, s, where a driver repeats readings."""
        return self._held.interval

    @property
    def origin(self) -> int:
        """Stamp of the first sample, ns: time 0 of every sample."""
        return self._origin or 0

    def push(self, joints: JointStream | None, base: BaseStream | None, imu: ImuStream | None = None) -> Samples | None:
        """Add measurements; return the samples that they complete, None if there are none.

        Stamps not after their predecessor in the stream are dropped and counted; so are repeated poses and outliers.
        """
        joints = self._new_measurements(joints)
        if joints is not None and joints.position.shape[1]:
            joints = self._joint_outliers.push(self._held.push(joints))
        self._joints = self._append(self._joints, joints)
        new = self._repeats.push(self._new_measurements(base))  # a pose is repeated in the frame that it is measured in
        if new is not None and self._view is not None:
            new = self._view(new)
        new = self._outliers.push(new)
        self._base = self._append(self._base, new)
        if self._noise is not None:
            self._noise.add_readings(joints, new)
        if self._gyro is not None:
            self._gyro.push(imu)
        if self._joints is None or self._base is None:
            return None
        waiting, known = self._joints.stamp, self._base.stamp
        ready = int(np.searchsorted(waiting, self._measured_until(known), side='right'))
        early = int(np.searchsorted(waiting, known[0], side='left'))
        early = min(early, ready)
        self._dropped[NO_ODOMETRY] += early
        samples = self._interpolate(self._joints[early:ready], self._base) if ready > early else None
        self._joints = self._joints[max(early, ready) :]
        # The last odometry before the next joints is one end of their interval, the one before gives its length.
        pending = int(self._joints.stamp[0]) if len(self._joints.stamp) else self._newest[JointStream] + 1
        held_back = (self._held.waiting_since, self._joint_outliers.waiting_since)
        pending = min([pending, *(stamp for stamp in held_back if stamp is not None)])
        first = max(int(np.searchsorted(known, pending, side='right')) - 2, 0)
        self._base = self._base[first:]
        if self._gyro is not None:
            self._gyro.forget_before(int(self._base.stamp[0]))
        return samples

    def _measured_until(self, base: Stamps) -> int:
        """Return the last stamp of the base (N,) up to which the gyro is known, too; the least integer if none."""
        if self._gyro is None:
            return int(base[-1])
        silent = self._newest[JointStream] - _PATIENCE
        newest = silent if self._gyro.newest is None else max(self._gyro.newest, silent)
        # Samples between two of the base need the gyro until the second.
        place = int(np.searchsorted(base, newest, side='right'))
        return int(base[place - 1]) if place else _BEFORE_ALL

    def _new_measurements(self, new: Stream | None) -> Stream | None:
        """Return the measurements whose stamps are after all earlier ones of their stream."""
        if new is None or not len(new.stamp):
            return None
        newest = self._newest.get(type(new), _BEFORE_ALL)
        before = np.maximum.accumulate(np.concatenate(([newest], new.stamp[:-1])))
        fresh = new.stamp > before
        self._newest[type(new)] = max(int(before[-1]), int(new.stamp[-1]))
        if not np.all(fresh):
            self._dropped[OUT_OF_ORDER] += int(np.sum(~fresh))
            new = new[fresh]
        return new

    def _append(self, buffer: Stream | None, new: Stream | None) -> Stream | None:
        if new is None:
            return buffer
        if buffer is not None:
            new = new.concatenate((buffer, new))
        excess = len(new.stamp) - LARGEST_BACKLOG
        if excess > 0:
            self._dropped[NO_ODOMETRY] += excess
            new = new[excess:]
        return new

    def _interpolate(self, joints: JointStream, base: BaseStream) -> Samples | None:
        right = np.searchsorted(base.stamp, joints.stamp, side='left')
        left = np.where(base.stamp[right] == joints.stamp, right, right - 1)
        interval = base.stamp[right] - base.stamp[np.maximum(right - 1, 0)]
        spacing = np.diff(joints.stamp, prepend=joints.stamp[0] if self._previous is None else self._previous)
        self._previous = int(joints.stamp[-1])
        usable = base.stamp[right] - base.stamp[left] <= self._maximum_gap
        self._dropped[ODOMETRY_GAP] += int(np.sum(~usable))
        if not np.any(usable):
            return None
        # Samples that share one odometry interval share its noise, which averages out that much less.
        shared = np.asarray(
            np.where(spacing > 0, np.maximum(interval / np.maximum(spacing, 1), 1.0), 1.0)[usable], dtype=float
        )
        apart = 1e-9 * np.maximum(interval, spacing)[usable]
        joints, left, right = joints[usable], left[usable], right[usable]
        if self._origin is None:
            self._origin = int(joints.stamp[0])
        time = (joints.stamp - self._origin) * 1e-9
        samples = replace(hermite(joints, base, (left, right), self._maximum_gap, time, shared), apart=apart)
        if self._gyro is None:
            return samples
        samples = replace(samples, gyro=self._gyro.integral_at_samples(joints.stamp))
        if not self._gyro.on_base:
            return samples
        return replace(samples, base_rotation=self._by_gyro(samples, joints.stamp, base, (left, right)))

    def _by_gyro(self, samples: Samples, stamp: Stamps, base: BaseStream, ends: tuple[Stamps, Stamps]) -> Array:
        """Return the orientations (N, 3, 3) between two of the base by the gyro, its error spread evenly in between."""
        assert self._gyro is not None, 'there is an IMU'
        left, right = ends
        (now, at), (begin, first), (end, last) = (
            self._gyro.integral_at(each) for each in (stamp, base.stamp[left], base.stamp[right])
        )
        length = base.stamp[right] - base.stamp[left]
        part = ((stamp - base.stamp[left]) / np.where(length > 0, length, 1))[:, None]
        rotation = base.rotation[left]
        turn = log(np.swapaxes(rotation, -1, -2) @ base.rotation[right])
        turned = rotation @ exp(now - begin + part * (turn - (end - begin)))
        known = (at == first) & (at == last) & (at >= 0) & (length > 0)
        return np.where(known[:, None, None], turned, samples.base_rotation)
