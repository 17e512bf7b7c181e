"""The preintegrated angular velocity of an IMU: its mean between any two instants.

The integral of a rate in body axes is no rotation, but it is linear in the reading of the gyro: bias and scale stay
bias and scale. Its differences are exact means of the rate at any rates of gyro and joints.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, cross, exp
from mbaid_ros.core.samples import ArrayRecord, BaseStream, ImuStream, Stamps
from mbaid_ros.core.sensors.base import orientation_only

SATURATED = 'IMU: angular velocity at the end of its range, or stuck'

LARGEST_BACKLOG = 1_000_000  # measurements that wait for joints: more are memory without an end
# Readings in a row that are the same to the last bit, and how fast (rad/s): a gyro whose range is not known is at its
# end.
_STUCK, _FAST = 8, 0.5
_NOWHERE = -1  # index of an entry not found


@dataclass(frozen=True)
class _Integrated(ArrayRecord):
    """N readings of a gyro and the integral of its rate."""

    stamp: Stamps  # ns
    rate: Array  # (N, 3) rad/s
    angle: Array  # (N, 3) rad
    segment: Stamps  # number of the gap-free segment


class Gyro:
    """Integrates the rate of a gyro; the result does not depend on how the stream is cut into pieces.

    Parameters
    ----------
    maximum_gap : ns, longest time between two measurements that is interpolated
    largest : rad/s, range of the gyro; 0 if unknown
    on_base : whether it is fixed to the base; else joints are between

    Attributes
    ----------
    newest : ns, stamp of the latest measurement; None before the first
    dropped : measurements that were not used, by cause
    """

    def __init__(self, maximum_gap: int, largest: float = 0.0, *, on_base: bool = True) -> None:
        self.on_base = on_base
        self._maximum_gap = maximum_gap
        self._largest = largest
        none = np.zeros(0, dtype=np.int64)
        self._kept = _Integrated(none, np.zeros((0, 3)), np.zeros((0, 3)), none)
        self._segments = 0  # so far
        self._sampled = _NOWHERE  # in which of them the last sample was
        self._last: Array = np.full(3, np.nan)  # reading
        self._alike = np.zeros(3, dtype=np.int64)  # readings in a row that were the same as this, by axis
        self.newest: int | None = None
        self.dropped: Counter[str] = Counter()

    def push(self, stream: ImuStream | None) -> None:
        """Add measurements in the order of their stamps."""
        if stream is None or not len(stream.stamp):
            return
        self.newest = int(stream.stamp[-1])
        lost = self._saturated(stream.angular_velocity)
        self.dropped[SATURATED] += int(np.sum(lost))
        self._integrate(stream, lost)
        self.forget_before(np.iinfo(np.int64).min)

    def integral_at_samples(self, stamps: Stamps) -> Array:
        """Return the integral at samples, in order, (N, 3) rad: NaN in a gap, or else at the first sample after it."""
        turned, part = self.integral_at(stamps)
        if not len(stamps):
            return turned
        earlier = np.concatenate(([self._sampled], part[:-1]))
        self._sampled = int(part[-1])
        across = (part != earlier) & (earlier != _NOWHERE)
        return np.where(across[:, None], np.nan, turned)

    def integral_at(self, stamps: Stamps) -> tuple[Array, Stamps]:
        """Return the integral at instants (N, 3), rad, and the number of their gap-free segment; NaN, -1 in a gap."""
        known, rate, turned, parts = vars(self._kept).values()
        if not len(known):
            return np.full((len(stamps), 3), np.nan), np.full(len(stamps), _NOWHERE)
        right = np.minimum(np.searchsorted(known, stamps, side='left'), len(known) - 1)
        left = np.where(known[right] == stamps, right, np.maximum(right - 1, 0))
        length, since = (known[right] - known[left]) * 1e-9, (stamps - known[left]) * 1e-9
        slope = (rate[right] - rate[left]) / np.where(length > 0.0, length, 1.0)[:, None]
        value = turned[left] + since[:, None] * (rate[left] + 0.5 * since[:, None] * slope)
        inside = (stamps >= known[0]) & (stamps <= known[-1]) & (parts[left] == parts[right])
        return np.where(inside[:, None], value, np.nan), np.where(inside, parts[left], _NOWHERE)

    def forget_before(self, stamp: int) -> None:
        """Drop readings that no instant after a stamp needs."""
        count, surplus = len(self._kept), int(np.searchsorted(self._kept.stamp, stamp, side='right')) - 1
        surplus = min(max(surplus, count - LARGEST_BACKLOG), count - 1)  # new readings are added to the last
        if surplus > 0:
            self._kept = self._kept[surplus:]

    def _integrate(self, stream: ImuStream, lost: Flags) -> None:
        """Integrate measurements (trapezoid); lost ones make a gap."""
        good = ~lost
        if not np.any(good):
            self._segments += 1
            return
        stamp, rate = stream.stamp[good], stream.angular_velocity[good]
        breaks = np.cumsum(lost)[good]
        gap = np.diff(breaks, prepend=0) > 0
        last = self._kept[-1:]
        # Without a reading before, the integral begins at the first one.
        before = last if len(last) else _Integrated(stamp[:1], rate[:1], np.zeros((1, 3)), last.segment)
        apart = np.diff(stamp, prepend=before.stamp)
        steps = 0.5e-9 * apart[:, None] * (np.concatenate((before.rate, rate[:-1])) + rate)
        gap |= apart > self._maximum_gap
        # One after the other, from the last sum: the same sums however the stream is cut.
        turned = np.cumsum(np.concatenate((before.angle, steps)), axis=0)[1:]
        part = self._segments + np.cumsum(gap)
        self._segments = int(part[-1]) + int(bool(lost[-1]))  # lost ones at the end part it from the next ones
        self._kept = _Integrated.concatenate([self._kept, _Integrated(stamp, rate, turned, part)])

    def _saturated(self, rate: Array) -> Flags:
        """Return which readings are at the end of the gyro's range, or stuck, (N,)."""
        if self._largest > 0.0:
            return np.asarray(np.any(np.abs(rate) >= self._largest * (1.0 - 1e-6), axis=1))
        same = rate == np.concatenate((self._last[None], rate[:-1]))
        place = np.arange(len(rate))[:, None]
        # Readings since the last change, those of earlier calls among them.
        changed = np.maximum.accumulate(np.where(same, -1, place), axis=0)
        alike = np.where(changed < 0, self._alike + place + 1, place - changed)
        if len(rate):
            self._last, self._alike = rate[-1], alike[-1]
        return np.asarray(np.any((alike >= _STUCK - 1) & (np.abs(rate) > _FAST), axis=1))


_ONCE_MORE = 256  # rotations, after which rounding is taken off: it has grown to some 1e-14 by then


class DeadReckoning:
    """Integrates an orientation; the result does not depend on how the stream is cut into pieces."""

    def __init__(self) -> None:
        self._last: tuple[int, Array, Array] | None = None  # stamp, rate, orientation
        self._count = 0

    def push(self, imu: ImuStream | None) -> BaseStream | None:
        """Add measurements in the order of their stamps; return the orientation of the base at each."""
        if imu is None or not len(imu.stamp):
            return None
        readings = zip(imu.stamp.tolist(), imu.angular_velocity, strict=True)
        return orientation_only(imu.stamp, np.array([self._integrated(*reading) for reading in readings]))

    def _integrated(self, stamp: int, rate: Array) -> Array:
        """Return the orientation at the next measurement: with a rate that changes evenly, to fourth order."""
        if self._last is None:
            rotation: Array = np.eye(3)
        else:
            before, first, start = self._last
            step = 1e-9 * (stamp - before)
            turn = 0.5 * step * (first + rate) + step**2 / 12.0 * cross(first, rate)
            rotation = start @ exp(turn)
            self._count += 1
            if self._count % _ONCE_MORE == 0:
                left, _, right = np.linalg.svd(rotation)
                rotation = left @ right
        self._last = stamp, rate, rotation
        return rotation
