"""Noise levels from differences of readings, which hold no motion.

A divided difference of seven readings contains no polynomial of fifth degree: it is a combination of their errors. With
weights whose squares add up to one it varies as a single error does, if these are independent. Counts of sizes add up
to the same however the readings are cut into calls.
"""

from __future__ import annotations

from math import comb

import numpy as np

from mbaid_ros.core.geometry import Array, Integers
from mbaid_ros.core.samples import Stamps

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

    @property
    def uncounted(self) -> int:
        """Number of differences after the stamp of the latest `count`."""
        return sum(len(when) for when, _ in self._uncounted)

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
