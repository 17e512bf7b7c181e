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

from mbaid_ros.core.geometry import Array, Integers
from mbaid_ros.core.samples import BaseStream, JointStream, SensorNoise, Stamps

# Of the differences: they cancel polynomials of fifth degree, which motion resembles over seven readings
# readings.
ORDER = 6
_AT_ONCE = 40  # readings that are looked at together, at least: few cost as much as many
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
_ROUNDS = 8  # of clipping and taking the mean again: each removes a part of the remaining bias
# Readings from one that is taken to the next: by octaves, up to where motion shows at a hundred hertz.
_STRIDES = (1, 2, 4, 8, 16, 32)
_FEWEST = 60  # differences that determine a level, to a sixth of it
_ANEW = 1.25  # times as many differences, at which levels are worked out again: nothing changes before
_SHORTEST = 3  # strides over which noise has to grow to count as correlated, if its size does not decide
# Variance of neighbours' differences over that declared, below which it shows by itself that noise is correlated.
_SMALL = 0.25
_INDEPENDENT = 0.3  # of the differences: share of independent ones with equal information, as neighbours share readings
_NO_FIT = 25.0  # mean normalised square of the variances' residuals, from which no correlation explains them
# Times the variance grows from one stride to the next: by correlated noise, and by more than any noise: motion.
_GROWS, _NO_NOISE = 1.4, 2.3
_TIMES = np.geomspace(0.01, 10.0, 121)  # s, among which that of the correlation is looked for
# Correlations of errors that are (0 ... 6) strides apart make that of the variance of a difference.
_PRODUCTS = np.array(
    [np.sum(BINOMIAL[lag:] * BINOMIAL[: len(BINOMIAL) - lag]) * (2.0 if lag else 1.0) for lag in range(7)]
)


class Differences:
    """Histograms of one stream's differences, of neighbouring readings and of ones further apart.

    Parameters
    ----------
    columns : of each kind of reading
    strides : of each kind, readings from one in a difference to the next

    Attributes
    ----------
    kinds : (kind, stride) of each row of the counts
    counts : (rows, bins) up to the stamp of the latest `count`
    """

    def __init__(self, columns: tuple[slice, ...], strides: tuple[tuple[int, ...], ...]) -> None:
        self._columns = columns
        self.kinds = [(kind, stride) for kind, own in enumerate(strides) for stride in own]
        self._kept = ORDER * max(max(own) for own in strides)
        self._stamp: Stamps = np.zeros(0, dtype=np.int64)
        self._values: Array = np.zeros((0, max(each.stop for each in columns)))
        self._sizes: Array = np.zeros((0, len(columns)))
        self._seen = 0  # readings before these
        self._waiting: list[tuple[Stamps, Array, Array]] = []  # readings without differences yet
        self._uncounted: list[tuple[Stamps, Integers]] = []  # stamps of differences, and their rows and bins
        self.counts: Integers = np.zeros((len(self.kinds), _BINS), dtype=np.int64)

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
        found = [self._differences(row, kind, stride, new) for row, (kind, stride) in enumerate(self.kinds)]
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

    def _differences(self, row: int, kind: int, stride: int, new: int) -> tuple[Stamps, Integers]:
        """Return the stamps of differences that end with a new reading, (K,) ns, and where they are counted."""
        last = np.arange(new, len(self._stamp))
        # Differences closer than their stride repeat each other; later on, a quarter is enough.
        number = self._seen + last
        last = last[(last >= ORDER * stride) & (number % stride == 0) & ((number < _ALL) | (number // 16 % 4 == 0))]
        places = last[:, None] - stride * np.arange(ORDER, -1, -1)
        stamp = self._stamp[places]
        near = np.all(np.diff(stamp, axis=1) <= _LONGEST * stride, axis=1)
        places, stamp = places[near], stamp[near]
        weight, values = _weights(stamp), self._values[:, self._columns[kind]]
        # One product after the other: in the same order for few as for many.
        difference = weight[:, :1] * values[places[:, 0]]
        for place in range(1, ORDER + 1):
            difference += weight[:, place, None] * values[places[:, place]]
        if values.shape[1] == 9:
            difference = _turns(difference, values[places[:, ORDER // 2]])
        square = (difference / self._sizes[places[:, ORDER // 2], kind, None]) ** 2
        mantissa, exponent = np.frexp(np.where(np.isfinite(square), square, 0.0))
        octave = exponent - 1 - _LOWEST
        place = np.clip(octave * _PARTS + np.floor((2.0 * mantissa - 1.0) * _PARTS).astype(np.int64), 0, _BINS - 1)
        known = np.isfinite(square) & (square > _SAME)
        when = np.repeat(stamp[:, -1:], square.shape[1], axis=1)
        return when[known], row * _BINS + place[known]


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
    """Return the (M, 7) weights of readings at stamps (M, 7), ns."""
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
    correlation_time : s, over which the errors of poses are correlated; 0 for white noise
    """

    factor: Array
    correlation_time: float


class NoiseLevels:
    """Estimates noise levels from differences of readings, the same however the streams are cut.

    Parameters
    ----------
    noise : of the joints, as declared; the readings hold that of the base
    joints : number
    passive : those that nothing measures
    """

    def __init__(self, noise: SensorNoise, joints: int, passive: Sequence[int] = ()) -> None:
        measured = [joint for joint in range(joints) if joint not in passive]
        self._measured = slice(None) if not passive else np.array(measured, dtype=np.intp)
        joints = len(measured)
        self._noise = np.array([noise.joint_position, noise.joint_velocity])
        self._time = noise.base_correlation_time
        self._joints = Differences((slice(0, joints), slice(joints, 2 * joints)), ((1,), (1,)))
        columns = slice(0, 3), slice(3, 12), slice(12, 15), slice(15, 18)
        self._base = Differences(columns, (_STRIDES, _STRIDES, (1,), (1,)))
        self._counted, self._free = 0, False
        self._levels = Levels(np.full(6, np.nan), 0.0)

    def take(self, joints: JointStream | None, base: BaseStream | None) -> None:
        """Add readings of each kind in the order of their stamps."""
        if joints is not None and len(joints.stamp):
            read = (joints.position[:, self._measured], joints.velocity[:, self._measured])
            values = np.concatenate(read, axis=1)
            self._joints.add(joints.stamp, values, np.repeat(self._noise[None], len(values), axis=0))
        if base is not None and len(base.stamp):
            parts = base.position, base.rotation.reshape(-1, 9), base.linear_velocity, base.angular_velocity
            sizes = [
                np.sqrt(np.mean(np.diagonal(each, axis1=1, axis2=2).reshape(-1, 2, 3), axis=2))
                for each in (base.pose_covariance, base.twist_covariance)
            ]
            self._base.add(base.stamp, np.concatenate(parts, axis=1), np.concatenate(sizes, axis=1))

    def until(self, stamp: int, spacing: float, *, free: bool) -> Levels:
        """Return the levels of the readings until a stamp, no earlier than that of the call before.

        Parameters
        ----------
        stamp : ns
        spacing : s, between poses
        free : whether levels of poses are estimated; else they are as declared, and only their correlation is estimated
        """
        self._joints.count(stamp)
        self._base.count(stamp)
        total = int(self._joints.counts.sum() + self._base.counts.sum())
        if total > _ANEW * self._counted or free is not self._free:
            self._counted, self._free = total, free
            self._levels = self._estimated(spacing, free=free)
        return self._levels

    def _estimated(self, spacing: float, *, free: bool) -> Levels:
        """Return the levels by the present counts."""
        joints, base = variances(self._joints.counts), variances(self._base.counts)
        counts = np.concatenate((self._joints.counts, self._base.counts)).sum(axis=1)
        count = len(_STRIDES)
        poses, numbers = base[: 2 * count].reshape(2, count), counts[2 : 2 + 2 * count].reshape(2, count)
        variance = np.concatenate((joints, poses[:, 0], base[2 * count :]))
        enough = np.concatenate((counts[:2], numbers[:, 0], counts[2 + 2 * count :])) >= _FEWEST
        time, variance[2:4] = _correlated(poses, numbers, spacing, self._time, free=free)
        return Levels(np.sqrt(np.where(enough, variance, np.nan)), time)


def _correlated(variance: Array, counts: Array, spacing: float, time: float, *, free: bool) -> tuple[float, Array]:
    """Return the correlation time (s) of the errors of poses, 0 if none is found, and their (2,) variance.

    The variance is NaN where they are not independent, and no time explains them.

    Parameters
    ----------
    variance, counts : (2, strides) of the differences of positions and orientations
    spacing : s, between poses
    time : s, if declared; 0 where it is to be estimated
    free : whether the variance of a single error is unknown; else it is 1
    """
    white, unclear = (0.0, variance[:, 0]), (0.0, np.full(2, np.nan))
    if np.any(counts[:, 0] < _FEWEST) or np.any(variance[:, 0] <= 0.0):
        return white
    relative = np.sqrt(2.0 / (_INDEPENDENT * np.maximum(counts, 1)))  # standard deviation of each
    growth = np.diff(np.log(np.maximum(variance, 1e-300)), axis=1)
    known = np.all(counts[:, 1:] >= _FEWEST, axis=0)
    # Errors of the declared size that hardly change are correlated, unless those further apart are small, too.
    small = bool(np.all(variance[:, 0] < _SMALL))
    doubt = (-1.0 if small else 3.0) * float(np.mean(relative[:, 1]))
    if not time and not small and not (free and known[0]):
        return white
    if not time and known[0] and np.mean(growth[:, 0]) < np.log(_GROWS) + doubt:
        return white
    # Correlated noise grows by less and less, and motion by more and more.
    fits = known & (growth < np.log(_NO_NOISE))
    fits[:, 1:] &= growth[:, 1:] < growth[:, :-1] + relative[:, 1:-1] + relative[:, 2:]
    used = 1 + int(np.argmin(np.append(np.all(fits, axis=0), False)))
    if not time and not small and used < _SHORTEST:
        return unclear
    times = np.array([time]) if time else _TIMES
    lags = np.arange(len(_PRODUCTS))
    apart = spacing * np.array(_STRIDES[:used])
    expected = np.log(np.exp(-apart[:, None] * lags / times[:, None, None]) @ _PRODUCTS)[:, None]  # (times, 1, used)
    weight = relative[:, :used] ** -2.0
    left = np.log(variance[:, :used]) - expected
    level = np.zeros((len(times), 2)) if small and not time else np.sum(weight * left, axis=2) / np.sum(weight, axis=1)
    cost = np.sum(weight * (left - level[..., None]) ** 2, axis=(1, 2))
    best = int(np.argmin(cost))
    if (not time and best in (0, len(times) - 1)) or cost[best] > _NO_FIT * 2 * used:
        return unclear
    return float(times[best]), np.exp(level[best])
