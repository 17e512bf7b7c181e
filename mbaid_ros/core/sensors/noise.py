"""Noise levels from differences of readings, which hold no motion.

A divided difference of seven readings contains no polynomial of fifth degree: it is a combination of their errors. With
weights whose squares add up to one it varies as a single error does, if these are independent. Counts of sizes add up
to the same however the readings are cut into calls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, Integers, log
from mbaid_ros.core.samples import BaseStream, JointStream, SensorNoise, Stamps
from mbaid_ros.core.sensors.base import block_std
from mbaid_ros.core.sensors.correlation import FEWEST, Variances, candidates, chosen

# Of the differences: they cancel polynomials of fifth degree, which motion resembles over seven readings.
ORDER = 6
_AT_ONCE = 300  # readings that are looked at together, unless a window ends before: few cost as much as many
_ALL = 2048  # readings, of which all differences are used: later on, a quarter suffices
BINOMIAL = np.array([(-1.0) ** place * comb(ORDER, place) for place in range(ORDER + 1)]) / np.sqrt(comb(12, ORDER))
_LONGEST = 200_000_000  # ns times the stride: of readings further apart it is the motion that shows
# Bins an octave of squared differences (over the declared variance), the lowest octave as a power of 2, how many
# octaves.
_PARTS, _LOWEST, _OCTAVES = 8, -40, 80
_BINS = _PARTS * _OCTAVES
_SAME = 2.0**_LOWEST  # square, below which readings are the same: an encoder between two steps adds no information
_PLACE = np.arange(_BINS)
# Squared difference in the middle of each bin.
_SQUARES = np.exp2(_LOWEST + _PLACE // _PARTS) * (1.0 + (_PLACE % _PARTS + 0.5) / _PARTS)
# Times the variance, as which a larger square counts: outliers, and where a motion begins. The mean of unit normal
# ones clipped so.
_CLIPPED, _OF_NORMAL = 4.0, 0.920542
_OF_NORMAL_SIZE = 0.6745  # median of a normal number's size over its standard deviation
_ROUNDS = 8  # of clipping and taking the mean again: each removes a part of the remaining bias
# Readings from one that is taken to the next: by octaves, up to where motion shows at a hundred hertz.
_STRIDES = (1, 2, 4, 8, 16, 32)
_LONG_STRIDES = (16, 32, 64, 128, 256, 512)  # of the poses less the integrated twist: no motion shows at any
_GROWS = 1.4  # times the variance grows from one stride to the next, halfway to what errors do that last
_ANEW = 1.25  # times as many differences, at which levels are worked out again: nothing changes before


class Differences:
    """Histograms of one stream's differences, of neighbouring readings and of ones further apart.

    Parameters
    ----------
    columns : of each kind of reading
    strides : readings from one in a difference to the next
    order : of the differences

    Attributes
    ----------
    counts : (rows, bins) up to the stamp of the latest `count`; the rows of a kind are next to each other, by stride
    """

    def __init__(self, columns: tuple[slice, ...], strides: tuple[int, ...], order: int = ORDER) -> None:
        self._columns = columns
        self._strides = strides
        self._order = order
        self._kept = order * max(strides)
        self._stamp: Stamps = np.zeros(0, dtype=np.int64)
        self._values: Array = np.zeros((0, max(each.stop for each in columns)))
        self._sizes: Array = np.zeros((0, len(columns)))
        self._seen = 0  # readings before these
        self._waiting: list[tuple[Stamps, Array, Array]] = []  # readings without differences yet
        self._uncounted: list[tuple[Stamps, Integers]] = []  # stamps of differences, and their rows and bins
        self.counts: Integers = np.zeros((len(columns) * len(strides), _BINS), dtype=np.int64)

    def add(self, stamp: Stamps, values: Array, sizes: Array) -> None:
        """Add readings in the order of their stamps.

        Parameters
        ----------
        stamp : (N,) ns
        values : (N, w) of all kinds, side by side; nine columns are a rotation matrix
        sizes : (N, kinds) declared standard deviations
        """
        self._waiting.append((stamp, values, sizes))
        if sum(len(each) for each, _, _ in self._waiting) >= _AT_ONCE:
            self._take_differences()

    def _take_differences(self) -> None:
        if not self._waiting:
            return
        new, kept = len(self._stamp), (self._stamp, self._values, self._sizes)
        self._stamp, self._values, self._sizes = map(np.concatenate, zip(kept, *self._waiting, strict=True))
        self._waiting.clear()
        found = [self._differences(row, stride, new) for row, stride in enumerate(self._strides)]
        when, code = (np.concatenate(parts) for parts in zip(*found, strict=True))
        order = np.argsort(when, kind='stable')
        self._uncounted.append((when[order], code[order]))
        first = max(len(self._stamp) - self._kept, 0)
        self._stamp, self._values, self._sizes = self._stamp[first:], self._values[first:], self._sizes[first:]
        self._seen += first

    def count(self, stamp: int) -> None:
        """Count the differences up to a stamp, ns."""
        self._take_differences()
        while self._uncounted:
            when, code = self._uncounted[0]
            end = int(np.searchsorted(when, stamp, side='right'))
            self.counts += np.bincount(code[:end], minlength=self.counts.size).reshape(self.counts.shape)
            if end < len(when):
                self._uncounted[0] = when[end:], code[end:]
                return
            del self._uncounted[0]

    def _differences(self, row: int, stride: int, new: int) -> tuple[Stamps, Integers]:
        """Return the stamps of differences that end with a new reading, (K,) ns, and where they are counted.

        `row` is that of the first kind.
        """
        last, order = np.arange(new, len(self._stamp)), self._order
        # Differences closer than their stride repeat each other; later on, a quarter is enough.
        number = self._seen + last
        last = last[(last >= order * stride) & (number % stride == 0) & ((number < _ALL) | (number // 16 % 4 == 0))]
        places = last[:, None] - stride * np.arange(order, -1, -1)
        stamp = self._stamp[places]
        near = np.all(np.diff(stamp, axis=1) <= _LONGEST * stride, axis=1)
        places, stamp = places[near], stamp[near]
        weight, middle = _weights(stamp), places[:, order // 2]
        # One product after the other: in the same order for few as for many.
        difference = weight[:, :1] * self._values[places[:, 0]]
        for place in range(1, order + 1):
            difference += weight[:, place, None] * self._values[places[:, place]]
        errors, rows = [], []
        for kind, columns in enumerate(self._columns):
            error = difference[:, columns]
            if error.shape[1] == 9:
                error = _turns(error, self._values[middle, columns])
            errors.append(error / self._sizes[middle, kind, None])
            rows += [row + kind * len(self._strides)] * error.shape[1]
        square = np.concatenate(errors, axis=1) ** 2
        mantissa, exponent = np.frexp(np.where(np.isfinite(square), square, 0.0))
        octave = exponent - 1 - _LOWEST
        place = np.clip(octave * _PARTS + np.floor((2.0 * mantissa - 1.0) * _PARTS).astype(np.int64), 0, _BINS - 1)
        known = np.isfinite(square) & (square > _SAME)
        when = np.repeat(stamp[:, -1:], square.shape[1], axis=1)
        return when[known], (np.array(rows, dtype=int) * _BINS + place)[known]


def median(values: Array) -> Array:
    """Return the median along the first axis, without NaN: of few numbers NumPy's own takes several times as long."""
    ordered, middle = np.sort(values, axis=0), len(values) // 2
    return np.asarray(0.5 * (ordered[middle] + ordered[(len(values) - 1) // 2]))


def white_noise(values: Array, order: int) -> Array:
    """Return the standard deviations (n,) of white noise in the columns of (N, n), by differences of an order."""
    return median(np.abs(np.diff(values, order, axis=0))) / (_OF_NORMAL_SIZE * np.sqrt(comb(2 * order, order)))


def variances(counts: Integers) -> Array:
    """Return the variance (rows,) of the errors behind counted differences (rows, bins); 0 without any."""
    total = counts.sum(axis=1)
    half = np.argmax(np.cumsum(counts, axis=1) >= 0.5 * total[:, None], axis=1)
    variance = _SQUARES[half] / 0.4549  # the median of the square of a unit normal number
    for _ in range(_ROUNDS):
        clipped = np.minimum(_SQUARES, _CLIPPED * variance[:, None])
        variance = np.add.reduce(counts * clipped, axis=1) / np.maximum(total, 1) / _OF_NORMAL
    return np.asarray(variance)


def _weights(stamp: Stamps) -> Array:
    """Return the (M, 7) weights of readings at stamps (M, 7), ns; (M, 2) of two."""
    if stamp.shape[1] == 2:
        return np.repeat(np.sqrt([[0.5, 0.5]]) * [-1.0, 1.0], len(stamp), axis=0)
    weight = np.repeat(BINOMIAL[None], len(stamp), axis=0)
    step = np.diff(stamp, axis=1)
    uneven = np.any(step != step[:, :1], axis=1)
    if np.any(uneven):
        time = (stamp[uneven] - stamp[uneven, :1]) * (ORDER / (stamp[uneven, -1:] - stamp[uneven, :1]))
        inverse = np.ones(time.shape)
        for other in range(ORDER + 1):
            apart = time - time[:, other : other + 1]
            apart[:, other] = 1.0
            inverse *= apart
        square = np.zeros(len(time))
        for place in range(ORDER + 1):
            square += inverse[:, place] ** -2.0
        weight[uneven] = 1.0 / inverse / np.sqrt(square)[:, None]
    return weight


def _turns(difference: Array, rotation: Array) -> Array:
    """Return the (K, 3) small rotations in differences (K, 9) of matrices near rotations (K, 9)."""
    matrix = difference.reshape(-1, 3, 3) @ np.swapaxes(rotation.reshape(-1, 3, 3), -1, -2)
    return 0.5 * (matrix - np.swapaxes(matrix, -1, -2))[:, [2, 0, 1], [1, 2, 0]]


@dataclass(frozen=True)
class Levels:
    """The noise of all readings until some time.

    Attributes
    ----------
    factor : (6,) of CHANNELS, standard deviation over the declared one; NaN for too few readings
    used, contradicted : (6,) whether it takes the declared one's place; whether the latter cannot be right
    times : (2,) s, over which the errors of poses and of twists are correlated; 0 for white noise
    clear : whether neither motion nor too few readings hide what the errors are
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
        self._levels = Levels(np.full(6, np.nan), np.zeros(6, dtype=bool), np.zeros(6, dtype=bool), np.zeros(2))

    def take(self, joints: JointStream | None, base: BaseStream | None) -> None:
        """Add readings of each kind in the order of their stamps."""
        if joints is not None and len(joints.stamp):
            read = (joints.position[:, self._measured], joints.velocity[:, self._measured])
            values = np.concatenate(read, axis=1)
            self._joints.add(joints.stamp, values, np.repeat(self._noise[None], len(values), axis=0))
        if base is not None and len(base.stamp):
            parts = base.position, base.rotation.reshape(-1, 9), base.linear_velocity, base.angular_velocity
            sizes = np.concatenate((block_std(base.pose_covariance), block_std(base.twist_covariance)), axis=1)
            if self._latest is None:
                self._ratio = sizes[0, 2:] / sizes[0, :2]
            self._base.add(base.stamp, np.concatenate(parts, axis=1), sizes)
            self._drift.add(base.stamp, self._drifted(base), sizes[:, :2])

    def _drifted(self, base: BaseStream) -> Array:
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

    def until(self, stamp: int, spacing: float, *, free: tuple[bool, bool]) -> Levels:
        """Return the levels of the readings until a stamp, no earlier than that of the call before.

        Parameters
        ----------
        stamp : ns
        spacing : s, between poses
        free : whether nothing is declared of the levels of poses, and of twists
        """
        for each in (self._joints, self._base, self._drift):
            each.count(stamp)
        total = int(self._joints.counts.sum() + self._base.counts.sum())
        if total > _ANEW * self._counted or free != self._free:
            self._counted, self._free = total, free
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
        pose, twist = chosen(poses, twists, long, self._ratio)
        enough = np.concatenate((self._joints.counts.sum(axis=1), counts[..., 0].ravel())) >= FEWEST
        factor = np.sqrt(np.where(enough, np.concatenate((joints, pose.variance, twist.variance)), np.nan))
        joints_as_declared = np.zeros(2, dtype=bool)
        used = np.concatenate((joints_as_declared, pose.used, twist.used)) & enough
        contradicted = np.concatenate((joints_as_declared, pose.contradicted, twist.contradicted)) & enough
        times, before = np.array([pose.time, twist.time]), self._levels
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
