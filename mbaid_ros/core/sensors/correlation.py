"""Correlation times and levels of a sensor's errors, first-order autoregressions, from variances of differences.

Sixth differences of readings hold no motion. They show the growth of the errors, but hardly its end. Poses less the
integrated twist hold no motion either, however far apart: their differences show the end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, log
from mbaid_ros.core.samples import ArrayRecord, BaseStream, JointStream, SensorNoise
from mbaid_ros.core.sensors.base import block_std
from mbaid_ros.core.sensors.noise import Differences, variances

_STAMP = 1e-9  # s, the unit of stamps: readings that are closer have one stamp
FEWEST = 60  # differences for a level, which is then known to a sixth
_SOME = 12  # of readings further apart, for its growth
# Of sixth and of first differences: share that counts as independent, as neighbours share readings.
_INDEPENDENT, _OF_FIRST = 0.3, 0.45
_NO_FIT = 25.0  # mean normalised square of the residuals of the variances, from which no correlation explains them
_SHORTEST = 3  # strides over which noise has to grow to count as correlated, where motion shows beyond
# Times the variance grows from one stride to the next by motion, not noise, and the standard deviations beside.
_NO_NOISE, _DOUBT = 2.3, 3.0
_TIMES = np.append(0.0, np.geomspace(0.005, 10.0, 62))  # s; a run does not determine longer ones
# Twice the log-likelihood by which white noise, or a declared level, has to be contradicted; that within which a longer
# time of correlation is preferred: two standard deviations.
_CLEAR, _LIKELY = 12.0, 4.0
_NEAR = 2.0 * np.log(1.15)  # logarithm of a variance that is as declared: intervals hardly depend on it
_AUTOCORRELATION = np.array(
    [(-1.0) ** lag * comb(12, 6 + lag) / comb(12, 6) * (2.0 if lag else 1.0) for lag in range(7)]
)


@dataclass(frozen=True)
class Variances:
    """Variances (2, k) of differences of two kinds over the declared ones, their numbers, and the strides (k,) in s."""

    variance: Array
    counts: Array
    strides: Array

    @property
    def weight(self) -> Array:
        """Inverse of the variance of their logarithms, (2, k)."""
        return 0.5 * _INDEPENDENT * np.maximum(self.counts, 1)


@dataclass(frozen=True)
class Candidates(ArrayRecord):
    """Possible error models of a sensor: correlation times (c,) in s, and for each twice the negative log-likelihood.

    Attributes
    ----------
    time, cost : (c,)
    level, estimated : (c, 2) logarithms of the variances of a reading over the declared ones: in use, and of the data
    contradicted : (c, 2) whether the latter are far from the declared ones
    """

    time: Array
    cost: Array
    level: Array
    estimated: Array
    contradicted: Flags


@dataclass(frozen=True)
class Correlation(ArrayRecord):
    """The errors of poses and twists, or of one of the two."""

    time: Array  # (2,) s, over which they are correlated
    variance: Array  # (4,) over the declared ones
    # used, contradicted: (4,) whether these take the declared ones' place; whether the latter cannot be right
    used: Flags
    contradicted: Flags


def candidates(seen: Variances, time: float, declared: str) -> Candidates:
    """Return the error models that explain the variances of sixth differences.

    Parameters
    ----------
    seen : of positions and orientations, or of both velocities
    time : s, if declared; 0 where it is to be estimated
    declared : whether levels are: 'no', 'yes', or 'trusted', of which the data contradict none
    """
    variance, weight = seen.variance, seen.weight
    unclear = Candidates(
        np.zeros(1), np.zeros(1), np.zeros((1, 2)), np.full((1, 2), np.nan), np.zeros((1, 2), dtype=bool)
    )
    if np.any(seen.counts[:, 0] < FEWEST) or np.any(variance[:, 0] <= 0.0) or np.any(seen.strides < _STAMP):
        return unclear
    logarithm = np.log(np.maximum(variance, 1e-300))
    growth, doubt = np.diff(logarithm, axis=1), 1.0 / np.sqrt(weight)
    known = np.all(seen.counts[:, 1:] >= _SOME, axis=0)
    moves = np.any(growth > np.log(_NO_NOISE) + _DOUBT * (doubt[:, :-1] + doubt[:, 1:]), axis=0)
    used = slice(1 + int(np.argmin(np.append(known & ~moves, False))))
    if used.stop <= len(known) and known[used.stop - 1]:  # a trace of motion is in the stride before, too
        used = slice(max(used.stop - 1, 1))
        if used.stop < _SHORTEST:
            if np.mean(growth[:, 0]) > _DOUBT * np.mean(doubt[:, 1]):
                return unclear
            used = slice(1)
    times = np.array([time]) if time else _TIMES if used.stop > 1 else _TIMES[:1]
    decay = -seen.strides[used, None] / np.maximum(times, 1e-9)[:, None, None]
    expected = np.log(np.exp(np.maximum(decay * np.arange(7), -700.0)) @ _AUTOCORRELATION)[:, None]
    weight = weight[:, used]
    left = logarithm[:, used] - expected
    total = np.sum(weight, axis=1)
    found = np.sum(weight * left, axis=2) / total
    least = np.sum(weight * (left - found[..., None]) ** 2, axis=2)
    odd = total * found**2 if declared == 'trusted' else 0.0
    cost = np.sum(least + odd, axis=1) + np.where(times > 0.0, 0.0 if time or declared == 'no' else _CLEAR, 0.0)
    wrong = total * np.maximum(np.abs(found) - _NEAR, 0.0) ** 2 > _CLEAR
    level = np.zeros_like(found) if declared == 'trusted' else np.where(wrong | (times > 0.0)[:, None], found, 0.0)
    every = Candidates(times, cost, level, found, wrong)
    if np.min(cost) > _NO_FIT * 2 * used.stop:
        return unclear if declared == 'yes' else every[:1]
    longest = times[cost <= np.min(cost) + _LIKELY][-1]
    if not time and cost[0] <= np.min(cost) + _CLEAR and longest < 2.0 * seen.strides[0]:
        return every[:1]
    return every[times > 0.0] if np.argmin(cost) or longest else every[:1]


def likeliest(pose: Candidates, twist: Candidates, drift: Variances, ratio: Array) -> Correlation:
    """Return the likeliest errors of poses and twists; of equally likely correlation times, the longest.

    Parameters
    ----------
    pose, twist : their possible models
    drift : first differences of poses less the integrated twist, over the variance declared of poses
    ratio : (2,) 1/s, standard deviations declared of twists over those of poses
    """
    cost, shortest = pose.cost[:, None] + twist.cost, drift.strides[0] / 32.0  # s: half of the time between readings
    known = np.all(drift.counts >= _SOME, axis=0) & np.all(drift.variance > 0.0, axis=0)
    if known.any():
        of_pose = -np.expm1(-drift.strides / np.maximum(pose.time, 1e-9)[:, None])
        share = drift.strides / np.maximum(twist.time, shortest)[:, None]
        of_twist = np.maximum(twist.time, shortest)[:, None] ** 2 * (share + np.expm1(-share))
        expected = np.exp(pose.level)[:, None, :, None] * of_pose[:, None, None]
        expected = expected + (np.exp(twist.level) * ratio**2)[:, :, None] * of_twist[:, None]
        left = (np.log(np.maximum(drift.variance, 1e-300)) - np.log(expected))[..., known]
        more = _OF_FIRST / _INDEPENDENT * np.sum(drift.weight[:, known] * left**2, axis=(2, 3))
        if np.min(more) < _NO_FIT * 2 * np.sum(known):
            cost = cost + more
    likely: Flags = np.asarray(cost <= np.min(cost) + _LIKELY)
    return Correlation.concatenate([_longest(pose, np.any(likely, axis=1)), _longest(twist, np.any(likely, axis=0))])


def _longest(sensor: Candidates, likely: Flags) -> Correlation:
    last = int(np.flatnonzero(likely)[-1])
    used, contradicted = np.abs(sensor.level[last]) > _NEAR, np.all(sensor.contradicted[likely], axis=0)
    return Correlation(sensor.time[last : last + 1], np.exp(sensor.estimated[last]), used, used & contradicted)


# Readings from one that is taken to the next: by octaves, up to where motion shows at a hundred hertz.
_STRIDES = (1, 2, 4, 8, 16, 32)
_LONG_STRIDES = (16, 32, 64, 128, 256, 512)  # of the poses less the integrated twist: no motion shows at any
_OF_A_POSE = 12  # differences that a reading of pose and twist ends at most, of each stride
_GROWS = 1.4  # times the variance grows from one stride to the next, halfway to what errors do that last
_ANEW = 1.25  # times as many differences, at which levels are worked out again: nothing changes before


@dataclass(frozen=True)
class Levels:
    """The noise of all readings until some time.

    Attributes
    ----------
    factor : (6,) of CHANNELS, standard deviation over the declared one; NaN for too few readings
    used, contradicted : (6,) whether it takes the declared one's place; whether the latter cannot be right
    times : (2,) s, over which the errors of poses and of twists are correlated; 0 for white noise
    clear : whether neither motion nor too few readings hide the errors
    """

    factor: Array
    used: Flags
    contradicted: Flags
    times: Array
    clear: bool = True


class NoiseLevels:
    """Estimates noise levels from differences of readings, the same however the streams are cut.

    Parameters
    ----------
    noise : of the joints, as declared; the readings hold that of the base
    joints : number
    passive : those that nothing measures
    trusted : whether declared levels are right
    """

    def __init__(self, noise: SensorNoise, joints: int, passive: Sequence[int] = (), *, trusted: bool = False) -> None:
        measured = [joint for joint in range(joints) if joint not in passive]
        self._measured = slice(None) if not passive else np.array(measured, dtype=np.intp)
        joints = len(measured)
        self._noise = np.array([noise.joint_position, noise.joint_velocity])
        self._time, self._trusted = noise.base_correlation_time, trusted
        self._joints = Differences((slice(0, joints), slice(joints, 2 * joints)), (1,))
        columns = slice(0, 3), slice(3, 12), slice(12, 15), slice(15, 18)
        self._base = Differences(columns, _STRIDES)
        self._drift = Differences((slice(0, 3), slice(3, 6)), _LONG_STRIDES, order=1)
        self._latest: tuple[BaseStream, Array] | None = None  # of the base, and the drift (1, 6) until then
        self._ratio = np.ones(2)  # 1/s, of the noise that the first message declares of twist and pose
        self._counted, self._free = 0, (False, False)
        self._total, self._new = 0, 0  # differences counted so far; those that have come since, at most
        self._levels = Levels(np.full(6, np.nan), np.zeros(6, dtype=bool), np.zeros(6, dtype=bool), np.zeros(2))

    def add_readings(self, joints: JointStream | None, base: BaseStream | None) -> None:
        """Add readings of each kind in the order of their stamps."""
        if joints is not None and len(joints.stamp):
            read = (joints.position[:, self._measured], joints.velocity[:, self._measured])
            values = np.concatenate(read, axis=1)
            self._joints.add(joints.stamp, values, np.repeat(self._noise[None], len(values), axis=0))
            self._new += values.size
        if base is not None and len(base.stamp):
            parts = base.position, base.rotation.reshape(-1, 9), base.linear_velocity, base.angular_velocity
            sizes = np.concatenate((block_std(base.pose_covariance), block_std(base.twist_covariance)), axis=1)
            if self._latest is None:
                self._ratio = sizes[0, 2:] / sizes[0, :2]
            self._base.add(base.stamp, np.concatenate(parts, axis=1), sizes)
            self._drift.add(base.stamp, self._drift_of(base), sizes[:, :2])
            self._new += _OF_A_POSE * len(_STRIDES) * len(base.stamp)

    def _drift_of(self, base: BaseStream) -> Array:
        """Return the change (N, 6) of position and orientation less the integrated twist, since the first reading."""
        both = base if self._latest is None else base.concatenate((self._latest[0], base))
        step = (np.diff(both.stamp) * 1e-9)[:, None]
        turn = log(both.rotation[1:] @ np.swapaxes(both.rotation[:-1], 1, 2))
        twist = np.concatenate((both.linear_velocity, both.angular_velocity), axis=1)
        change = np.concatenate((np.diff(both.position, axis=0), turn), axis=1) - 0.5 * step * (twist[1:] + twist[:-1])
        start = np.zeros((1, 6)) if self._latest is None else self._latest[1]
        drift = np.cumsum(np.concatenate((start, change)), axis=0)
        self._latest = base[-1:], drift[-1:]
        return drift if len(drift) == len(base.stamp) else drift[1:]

    def levels_at(self, stamp: int, spacing: float, *, free: tuple[bool, bool]) -> Levels:
        """Return the levels of the readings until a stamp, no earlier than that of the call before.

        Parameters
        ----------
        stamp : ns
        spacing : s, between poses
        free : whether nothing is declared of the levels of poses, and of twists
        """
        if free == self._free and self._total + self._new <= _ANEW * self._counted:
            return self._levels  # counting takes longer than the rest of a window's intake
        for each in (self._joints, self._base, self._drift):
            each.count(stamp)
        self._total = int(self._joints.counts.sum() + self._base.counts.sum())
        self._new = self._joints.uncounted + self._base.uncounted
        if self._total > _ANEW * self._counted or free != self._free:
            self._counted, self._free = self._total, free
            self._levels = self._estimated(spacing, free)
        return self._levels

    def _estimated(self, spacing: float, free: tuple[bool, bool]) -> Levels:
        """Return the levels by the present counts."""
        joints, base, drift = (variances(each.counts) for each in (self._joints, self._base, self._drift))
        counts = self._base.counts.sum(axis=1).reshape(2, 2, len(_STRIDES))
        base = base.reshape(counts.shape)
        poses, twists = (
            candidates(
                Variances(base[place], counts[place], np.array(_STRIDES) * spacing),
                time,
                'no' if free[place] else 'trusted' if self._trusted else 'yes',
            )
            for place, time in enumerate((self._time, 0.0))
        )
        numbers = self._drift.counts.sum(axis=1).reshape(2, -1)
        long = Variances(drift.reshape(numbers.shape), numbers, np.array(_LONG_STRIDES) * spacing)
        found = likeliest(poses, twists, long, self._ratio)
        enough = np.concatenate((self._joints.counts.sum(axis=1), counts[..., 0].ravel())) >= FEWEST
        factor = np.sqrt(np.where(enough, np.concatenate((joints, found.variance)), np.nan))
        # Those of the joints stay as declared.
        used, contradicted = (np.append([False, False], each) & enough for each in (found.used, found.contradicted))
        times, before = found.time, self._levels
        growth = np.where(counts[..., 1] > 0, base[..., 1] / np.maximum(base[..., 0], 1e-300), 0.0).min(axis=1)
        # What was clear once stays, where motion hides the errors later.
        hidden = np.isnan(factor) & enough & np.isfinite(before.factor)
        few = np.isnan(factor[2:]) & ~hidden[2:] & (counts[..., 0].ravel() > 0)
        return Levels(
            np.where(hidden, before.factor, factor),
            np.where(hidden, before.used, used),
            np.where(hidden, before.contradicted, contradicted),
            np.where(hidden[2::2], before.times, times),
            clear=not (np.any(few) or np.any((times == 0.0) & (growth > _GROWS))),
        )
