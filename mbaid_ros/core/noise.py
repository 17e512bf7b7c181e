"""How noisy the sensors are: differences of readings, correlation of their errors, levels declared and found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import comb

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, Integers, log
from mbaid_ros.core.samples import ArrayRecord, BaseStream, JointStream, Samples, SensorNoise, Stamps, block_std
from mbaid_ros.errors import listing

CHANNELS = (
    'joint_position',
    'joint_velocity',
    'base_position',
    'base_orientation',
    'base_linear_velocity',
    'base_angular_velocity',
)
UNITS = ('rad', 'rad/s', 'm', 'rad', 'm/s', 'rad/s')  # m and m/s of a prismatic joint
TYPICAL = np.array([1e-4, 1e-3, 1e-3, 1e-4, 1e-3, 1e-4])  # usual for the sensors of a servicer
# Declared joint noise over found noise, from which the bias correction of the equations biases them itself.
_FAR_TOO_LARGE = 10.0
_MILLIMETRES, _UNIT_LEFT = 1e3, 0.5  # in a metre; decades that the specified noise itself may be wrong by
_WRONG = 1.3  # times too small or too large, from which a specified value is reported as wrong: users know it roughly
# Of the differences: they cancel polynomials of fifth degree, which motion resembles over seven readings.
ORDER = 6
_AT_ONCE = 300  # readings that are looked at together, unless a window ends before: few cost as much as many
_ALL = 2048  # readings, of which all differences are used: later on, a quarter suffices
BINOMIAL = np.array([(-1.0) ** place * comb(ORDER, place) for place in range(ORDER + 1)]) / np.sqrt(comb(12, ORDER))
_LONGEST = 200_000_000  # ns times the stride: of readings further apart it is the motion that shows
# Bins an octave of squared differences (over the specified variance), the lowest octave as a power of 2, how many
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
# Twice the log-likelihood by which white noise, or a specified size, has to be contradicted; that within which a longer
# time of correlation is preferred: two standard deviations.
_CLEAR, _LIKELY = 12.0, 4.0
_NEAR = 2.0 * np.log(1.15)  # logarithm of a variance that is as specified: intervals hardly depend on it
_AUTOCORRELATION = np.array(
    [(-1.0) ** lag * comb(12, 6 + lag) / comb(12, 6) * (2.0 if lag else 1.0) for lag in range(7)]
)
# Readings from one that is taken to the next: by octaves, up to where motion shows at a hundred hertz.
_STRIDES = (1, 2, 4, 8, 16, 32)
_LONG_STRIDES = (16, 32, 64, 128, 256, 512)  # of the poses less the integrated twist: no motion shows at any
_OF_A_POSE = 12  # differences that a reading of pose and twist ends at most, of each stride
_GROWS = 1.4  # times the variance grows from one stride to the next, halfway to what errors do that last
# Times too small or too large, between which a specified noise of the joints is replaced: less hardly matters, and of
# more the readings are no noise.
_WRONG_JOINTS = 1.3, 30.0
_ANEW = 1.25  # times as many differences, at which levels are worked out again: nothing changes before
# Least level, as a part of a servicer's usual sensor noise: models deviate by more than that.
_LEAST = 1.0 / 30.0
# Of poses without a twist, unspecified: spacing (s) up to which differences determine their noise, poses that this
# takes, lost ones included, and how many times as noisy as usual they count until then.
_SLOWEST, _FIRST, _AT_FIRST = 0.2, 40, 100.0
# s, and poses, after which differences separate errors that last from small ones; s, after which no run waits longer.
_SETTLED, _READ, _PATIENCE = 4.0, 80, 10.0
_NEVER = np.iinfo(np.int64).max
_UNEVEN, _SELDOM = 0.02, 0.1  # part of a coarse encoder's step; share of changes that are no multiples of that
_FEWEST_CHANGES = 10  # of a coarse encoder, from which its step is known


@dataclass(frozen=True)
class NoiseLevels:
    """Standard deviations of single readings.

    Attributes
    ----------
    declared, estimated : (6,) of CHANNELS, SI; NaN if undeclared, if not estimated
    assumed : (6,) used for readings that have neither
    correlation_time, twist_correlation_time : s, of the errors of the base's poses and twists; 0 for independent ones
    used : (6,) whether the estimated level is used instead of the declared one
    contradicted : (6,) whether that is because the readings contradict the declared one
    clear : as of `FoundLevels`
    """

    declared: Array
    estimated: Array
    assumed: Array
    correlation_time: float
    used: Flags
    twist_correlation_time: float = 0.0
    contradicted: Flags = field(default_factory=lambda: np.zeros(len(CHANNELS), dtype=bool))
    clear: bool = True

    @property
    def as_declared(self) -> bool:
        """Whether the errors of the base are independent, and as large as declared."""
        return self.clear and not (self.correlation_time or self.twist_correlation_time or np.any(self.contradicted))

    @property
    def warnings(self) -> list[str]:
        """A sentence if a declared level is replaced, and one if joints are far better than declared.

        The filter subtracts the expected bias of their noise in the coefficients; too much of it biases estimates.
        """
        texts = []
        for what, own in (('joints', slice(0, 2)), ('odometry', slice(2, 6))):
            each = zip(CHANNELS, UNITS, self.declared, self.estimated, self.contradicted, strict=True)
            replaced = [
                f'{name.replace("_", " ")} {_wrong(found / declared)}: {found:.2g} {unit} is used, not {declared:.2g}'
                for name, unit, declared, found, wrong in list(each)[own]
                if wrong
            ]
            texts += [f'the noise set for the {what} is wrong: {"; ".join(replaced)}'] if replaced else []
        declared, found = float(self.declared[0]), max(float(self.estimated[0]), float(TYPICAL[0]))
        if self.used[0] or not declared > _FAR_TOO_LARGE * found:
            return texts
        texts.append(
            f'noise.joint_position is {declared:.2g} rad, the readings scatter by {self.estimated[0]:.2g}: estimates '
            'may be biased by more than their intervals; set noise.joint_position, or noise.estimate'
        )
        return texts

    @property
    def in_another_unit(self) -> bool:
        """Whether positions scatter by a thousand times their declared noise, within a factor of three."""
        ratio = float(self.estimated[2] / self.declared[2])
        return bool(self.contradicted[2]) and abs(np.log10(ratio / _MILLIMETRES)) < _UNIT_LEFT

    def rows(self) -> list[tuple[str, str, str]]:
        """Return name and unit of each sensor, and its noise as set and as estimated, the one in use first."""
        each = zip(CHANNELS, UNITS, self.declared, self.estimated, self.assumed, self.used, strict=True)
        rows = []
        for name, unit, declared, found, assumed, used in each:
            both = [(declared, 'set'), (found, 'estimated')]
            every = [*(both[::-1] if used else both), (assumed, 'assumed')]
            known = [f'{value:.2g} {how}' for value, how in every if np.isfinite(value)]
            rows.append((name.replace('_', ' '), unit, ', '.join(known)))
        return rows

    def differences(self) -> list[str]:
        """Return a line for each sensor whose noise is not as declared."""
        lines = []
        each = zip(CHANNELS, UNITS, self.declared, self.estimated, self.used, strict=True)
        for name, unit, declared, found, used in each:
            ratio = found / declared
            if np.isnan(ratio) or 1.0 / _WRONG < ratio < _WRONG:
                continue
            use = '; the data are used' if used else ''
            value = f'your noise value, {declared:.2g} {unit}, is {_wrong(ratio)}'
            lines.append(f'{name.replace("_", " ")}: {value}: {found:.2g} {unit} in the data{use}')
        if found_alone := self._undeclared(self.estimated):
            lines.append(f'no noise is set for {listing(found_alone)}: estimated from the data')
        if assumed := self._undeclared(self.assumed):
            lines.append(f'no noise is set for {listing(assumed)}, and the data do not determine it: assumed')
        for what, time in (('pose', self.correlation_time), ('twist', self.twist_correlation_time)):
            if time > 0.0:
                lines.append(f'the errors of the base {what} are taken to be correlated over {time:.2g} s')
        return lines

    def _undeclared(self, known: Array) -> list[str]:
        """Return known levels (6,) of undeclared sensors in words."""
        return [
            f'{name.replace("_", " ")} ({value:.2g} {unit})'
            for name, unit, declared, value in zip(CHANNELS, UNITS, self.declared, known, strict=True)
            if np.isnan(declared) and not np.isnan(value)
        ]


def _wrong(ratio: float) -> str:
    return f'{ratio:.2g} times too small' if ratio > 1.0 else f'{1.0 / ratio:.2g} times too large'


class Differences:
    """Histograms of one stream's differences, of neighbouring readings and of ones further apart.

    Parameters
    ----------
    columns : of each kind of reading
    strides : readings from one in a difference to the next
    order : of the differences
    rotation : the kind that is a rotation matrix; None of none

    Attributes
    ----------
    counts : (rows, bins) up to the stamp of the latest `count`; the rows of a kind are next to each other, by stride
    """

    def __init__(
        self, columns: tuple[slice, ...], strides: tuple[int, ...], order: int = ORDER, rotation: int | None = None
    ) -> None:
        self._columns = columns
        self._rotation = rotation
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
        values : (N, w) of all kinds, side by side
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
            if kind == self._rotation:
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


class LeastSteps:
    """Follows columns of readings, and finds the step of those that change by its multiples, however these are cut.

    Parameters
    ----------
    columns : number of them
    """

    def __init__(self, columns: int) -> None:
        # By column until now: the least change, the latest one; the number of changes, of those that are no multiples
        # of the least, and of those by another number of steps than the reading before.
        self._least, self._latest = np.full(columns, np.inf), np.full(columns, np.nan)
        self._changes = np.zeros((3, columns))

    def add(self, values: Array, new: int) -> Array:
        """Return the step until each of the latest readings, after the first; 0: they change by anything.

        Parameters
        ----------
        values : (N, k), with those before
        new : number of new ones
        """
        size = np.abs(np.diff(values, axis=0))[-new:]
        changed = size > 0.0
        least = np.minimum.accumulate(np.concatenate((self._least[None], np.where(changed, size, np.inf))))[1:]
        times = np.where(changed, size, 0.0) / least
        uneven = changed & (np.abs(times - np.round(times)) > _UNEVEN)
        before = np.concatenate((self._latest[None], size))[:-1]
        # Readings without noise change by nearly the same each time; a moving encoder now and then by a step more.
        other = np.abs(size - before) > 0.5 * least
        number = self._changes[:, None] + np.cumsum((changed, uneven, other), axis=1)
        if len(size):
            self._least, self._latest, self._changes = least[-1], size[-1], number[:, -1]
        return np.where((number[2] >= _FEWEST_CHANGES) & (number[1] < _SELDOM * number[0]), least, 0.0)


class FoundNoise:
    """Levels of a sensor of which nothing is declared, from differences of its readings, however these are cut.

    Parameters
    ----------
    assumed : (c,) levels, until there are some readings, and of readings so far apart that motion shows
    """

    def __init__(self, assumed: Array) -> None:
        self._assumed, self._levels = assumed, _AT_FIRST * assumed
        self._stamp: Stamps = np.zeros(0, dtype=np.int64)
        self._values: Array = np.zeros((0, 3 * len(assumed)))

    def levels(self, stamp: Stamps, values: Array) -> Array:
        """Return the level (N, c) at each of the next readings.

        Parameters
        ----------
        stamp, values : (N,) ns; (N, 3 c) of c channels, side by side
        """
        found = []
        while len(stamp):
            count = min(_AT_ONCE // 10 - len(self._stamp) % (_AT_ONCE // 10), len(stamp))
            found.append(np.repeat(self._levels[None], count, axis=0))
            self._stamp = np.concatenate((self._stamp, stamp[:count]))
            self._values = np.concatenate((self._values, values[:count]))
            stamp, values = stamp[count:], values[count:]
            if len(self._stamp) % (_AT_ONCE // 10) == 0:
                self._find()
        return np.concatenate(found) if found else np.zeros((0, len(self._assumed)))

    def _find(self) -> None:
        """Take the level of the latest readings."""
        self._stamp, self._values = self._stamp[-_AT_ONCE:], self._values[-_AT_ONCE:]
        if np.median(np.diff(self._stamp)) > _LONGEST:
            self._levels = self._assumed
            return
        each = white_noise(self._values, ORDER).reshape(len(self._assumed), 3)
        self._levels = np.maximum(np.sqrt(np.mean(each**2, axis=1)), _LEAST * self._assumed)


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
class DifferenceVariances:
    """Variances (2, k) of differences of two kinds over the declared ones, their numbers, and the strides (k,) in s."""

    variance: Array
    counts: Array
    strides: Array

    @property
    def weight(self) -> Array:
        """Inverse of the variance of their logarithms, (2, k)."""
        return 0.5 * _INDEPENDENT * np.maximum(self.counts, 1)


@dataclass(frozen=True)
class ErrorModels(ArrayRecord):
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


def candidates(seen: DifferenceVariances, time: float, declared: str) -> ErrorModels:
    """Return the error models that explain the variances of sixth differences.

    Parameters
    ----------
    seen : of positions and orientations, or of both velocities
    time : s, if declared; 0 where it is to be estimated
    declared : whether levels are: 'no', 'yes', or 'trusted', of which the data contradict none
    """
    variance, weight = seen.variance, seen.weight
    unclear = ErrorModels(
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
    every = ErrorModels(times, cost, level, found, wrong)
    if np.min(cost) > _NO_FIT * 2 * used.stop:
        return unclear if declared == 'yes' else every[:1]
    longest = times[cost <= np.min(cost) + _LIKELY][-1]
    if not time and cost[0] <= np.min(cost) + _CLEAR and longest < 2.0 * seen.strides[0]:
        return every[:1]
    return every[times > 0.0]


def likeliest(pose: ErrorModels, twist: ErrorModels, drift: DifferenceVariances, ratio: Array) -> Correlation:
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


def _longest(sensor: ErrorModels, likely: Flags) -> Correlation:
    last = int(np.flatnonzero(likely)[-1])
    used, contradicted = np.abs(sensor.level[last]) > _NEAR, np.all(sensor.contradicted[likely], axis=0)
    return Correlation(sensor.time[last : last + 1], np.exp(sensor.estimated[last]), used, used & contradicted)


@dataclass(frozen=True)
class FoundLevels:
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


class LevelEstimator:
    """Estimates noise levels from differences of readings, the same however the streams are cut.

    Parameters
    ----------
    noise : of the joints, as declared; the readings hold that of the base
    joints : number
    unread : those that nothing measures, and followers, which have readings of their leaders
    trusted : whether declared levels are right
    """

    def __init__(self, noise: SensorNoise, joints: int, unread: Sequence[int] = (), *, trusted: bool = False) -> None:
        measured = [joint for joint in range(joints) if joint not in unread]
        self._measured = slice(None) if not unread else np.array(measured, dtype=np.intp)
        joints = len(measured)
        self._noise = np.array([noise.joint_position, noise.joint_velocity])
        self._time, self._trusted = noise.base_correlation_time, trusted
        kinds = slice(0, joints), slice(joints, 2 * joints)
        self._joints, self._apart = Differences(kinds, (1,)), Differences(kinds, (2,))
        columns = slice(0, 3), slice(3, 12), slice(12, 15), slice(15, 18)
        self._base = Differences(columns, _STRIDES, rotation=1)
        self._drift = Differences((slice(0, 3), slice(3, 6)), _LONG_STRIDES, order=1)
        self._latest: tuple[BaseStream, Array] | None = None  # of the base, and the drift (1, 6) until then
        # 1/s, of the noise declared of twist and pose: of the first message, and its geometric mean; logarithms of all
        # messages over the first, their sum and number, and those that are not counted yet.
        self._first_ratio, self._ratio = np.full(2, np.nan), np.ones(2)
        self._log_ratios, self._ratios = np.zeros((2, 2)), list[tuple[Stamps, Array]]()
        self._counted, self._free = 0, (False, False)
        self._total, self._new = 0, 0  # differences counted so far; those that have come since, at most
        self._levels = FoundLevels(np.full(6, np.nan), np.zeros(6, dtype=bool), np.zeros(6, dtype=bool), np.zeros(2))

    def add_readings(self, joints: JointStream | None, base: BaseStream | None) -> None:
        """Add readings of each kind in the order of their stamps."""
        if joints is not None and len(joints.stamp):
            read = (joints.position[:, self._measured], joints.velocity[:, self._measured])
            values = np.concatenate(read, axis=1)
            sizes = np.repeat(self._noise[None], len(values), axis=0)
            self._joints.add(joints.stamp, values, sizes)
            self._apart.add(joints.stamp, values, sizes)
            self._new += values.size
        if base is not None and len(base.stamp):
            parts = base.position, base.rotation.reshape(-1, 9), base.linear_velocity, base.angular_velocity
            sizes = np.concatenate((block_std(base.pose_covariance), block_std(base.twist_covariance)), axis=1)
            ratio = sizes[:, 2:] / sizes[:, :2]
            known = np.isfinite(ratio)
            first = ratio[np.argmax(known, axis=0), [0, 1]]
            self._first_ratio[:] = np.where(np.isnan(self._first_ratio), first, self._first_ratio)
            self._ratios.append((base.stamp, np.where(known, np.log(ratio / self._first_ratio), np.nan)))
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
        # Where a twist is missing the drift stays.
        drift = np.cumsum(np.concatenate((start, np.nan_to_num(change))), axis=0)
        self._latest = base[-1:], drift[-1:]
        return drift if len(drift) == len(base.stamp) else drift[1:]

    def levels_at(self, stamp: int, spacing: float, *, free: tuple[bool, bool]) -> FoundLevels:
        """Return the levels of the readings until a stamp, no earlier than that of the call before.

        Parameters
        ----------
        stamp : ns
        spacing : s, between poses
        free : whether nothing is declared of the levels of poses, and of twists
        """
        if free == self._free and self._total + self._new <= _ANEW * self._counted:
            return self._levels  # counting takes longer than the rest of a window's intake
        for each in (self._joints, self._apart, self._base, self._drift):
            each.count(stamp)
        self._count_ratios(stamp)
        self._total = int(self._joints.counts.sum() + self._base.counts.sum())
        self._new = self._joints.uncounted + self._base.uncounted
        if self._total > _ANEW * self._counted or free != self._free:
            self._counted, self._free = self._total, free
            self._levels = self._estimated(spacing, free)
        return self._levels

    def _count_ratios(self, stamp: int) -> None:
        while self._ratios:
            stamps, logs = self._ratios[0]
            count = int(np.searchsorted(stamps, stamp, side='right'))
            counted = np.isfinite(logs[:count])
            self._log_ratios += np.where(counted, logs[:count], 0.0).sum(axis=0), counted.sum(axis=0)
            if count < len(stamps):
                self._ratios[0] = stamps[count:], logs[count:]
                break
            del self._ratios[0]
        total, number = self._log_ratios
        self._ratio = self._first_ratio * np.exp(total / np.maximum(number, 1.0))

    def _estimated(self, spacing: float, free: tuple[bool, bool]) -> FoundLevels:
        """Return the levels by the present counts."""
        joints, base, drift = (variances(each.counts) for each in (self._joints, self._base, self._drift))
        counts = self._base.counts.sum(axis=1).reshape(2, 2, len(_STRIDES))
        base = base.reshape(counts.shape)
        poses, twists = (
            candidates(
                DifferenceVariances(base[place], counts[place], np.array(_STRIDES) * spacing),
                time,
                'no' if free[place] else 'trusted' if self._trusted else 'yes',
            )
            for place, time in enumerate((self._time, 0.0))
        )
        numbers = self._drift.counts.sum(axis=1).reshape(2, -1)
        long = DifferenceVariances(drift.reshape(numbers.shape), numbers, np.array(_LONG_STRIDES) * spacing)
        found = likeliest(poses, twists, long, self._ratio)
        enough = np.concatenate((self._joints.counts.sum(axis=1), counts[..., 0].ravel())) >= FEWEST
        factor = np.sqrt(np.where(enough, np.concatenate((joints, found.variance)), np.nan))
        wrong = self._wrong_joints(joints) & (not self._trusted)
        used, contradicted = (np.append(wrong, each) & enough for each in (found.used, found.contradicted))
        times, before = found.time, self._levels
        growth = np.where(counts[..., 1] > 0, base[..., 1] / np.maximum(base[..., 0], 1e-300), 0.0).min(axis=1)
        # What was clear once stays, where motion hides the errors later.
        hidden = np.isnan(factor) & enough & np.isfinite(before.factor)
        few = np.isnan(factor[2:]) & ~hidden[2:] & (counts[..., 0].ravel() > 0)
        return FoundLevels(
            np.where(hidden, before.factor, factor),
            np.where(hidden, before.used, used),
            np.where(hidden, before.contradicted, contradicted),
            np.where(hidden[2::2], before.times, times),
            clear=not (np.any(few) or np.any((times == 0.0) & (growth > _GROWS))),
        )

    def _wrong_joints(self, variance: Array) -> Flags:
        """Return whether the readings contradict the declared noise of joint positions and velocities, (2,).

        They do where their variance (2,), over the declared one, is far from 1, and grows neither by motion nor by
        errors that last when the readings are further apart.
        """
        counts, further = self._joints.counts.sum(axis=1), self._apart.counts.sum(axis=1)
        known = (counts >= FEWEST) & (further >= FEWEST)
        size = np.abs(np.log(np.where(known, variance, 1.0)))
        least, most = 2.0 * np.log(_WRONG_JOINTS)
        growth = np.log(np.where(known, variances(self._apart.counts) / np.maximum(variance, 1e-300), 1.0))
        doubt = np.sqrt(2.0 / (_INDEPENDENT * np.maximum(further, 1)))
        white = np.abs(growth) < np.log(_GROWS) + _DOUBT * doubt
        sure = 0.5 * _INDEPENDENT * counts * np.maximum(size - least, 0.0) ** 2 > _CLEAR
        return known & white & sure & (size < most)


class NoiseEstimator:
    """Estimates the noise levels of the sensors and applies them to windows.

    Parameters
    ----------
    noise : as declared; that of the base serves messages without a covariance
    joints : number
    undeclared : (6,) which CHANNELS are undeclared: their estimated level is used until a message declares one
    estimate : whether estimated levels replace all declared ones
    trusted : whether no readings contradict a declared level
    unread : as of `LevelEstimator`
    of_base : whether the poses are those of an odometry, not made of other sensors' readings
    """

    def __init__(
        self,
        noise: SensorNoise,
        joints: int,
        undeclared: Flags | None = None,
        *,
        estimate: bool = False,
        trusted: bool = False,
        unread: Sequence[int] = (),
        of_base: bool = True,
    ) -> None:
        self._noise, self._of_base = noise, of_base
        self._estimate = estimate
        self._undeclared = np.zeros(len(CHANNELS), dtype=bool) if undeclared is None else undeclared
        self._declared_from: Stamps = np.full(len(CHANNELS), _NEVER)  # by messages, ns
        self._waiting: list[Samples] = []  # the first windows
        self._settled = False
        self._levels = LevelEstimator(noise, joints, unread, trusted=trusted)

    @property
    def joint_position(self) -> float:
        """Declared standard deviation of a joint position, rad or m."""
        return self._noise.joint_position

    def add_readings(self, joints: JointStream | None, base: BaseStream | None) -> None:
        """Add readings in the order of their stamps, without repeated poses and outliers."""
        self._levels.add_readings(joints, base if self._of_base else None)
        if base is not None and len(base.stamp):
            first = np.where(base.declared, base.stamp[:, None], _NEVER).min(axis=0)
            self._declared_from[2:] = np.minimum(self._declared_from[2:], first)

    def windows_with_noise(
        self, windows: list[Samples], origin: int, *, last: bool = False
    ) -> list[tuple[Samples, NoiseLevels]]:
        """Return the next windows with their noise, and the levels until then; `origin` is the stamp at time 0, ns.

        The first seconds wait while their noise is not as declared: how large it is shows later, for all of them; or
        until the `last` ones.
        """
        released = []
        for window in windows:
            end = float(window.time[-1])
            self._waiting.append(window)
            if not self._settled:
                enough = min(max(_SETTLED, _READ * float(median(window.apart))), _PATIENCE)
                self._settled = end > enough or self.with_noise(self._waiting[0], origin, end)[1].as_declared
            if self._settled:
                released += [self.with_noise(each, origin, end) for each in self._waiting]
                self._waiting.clear()
        if last and self._waiting:
            end = float(self._waiting[-1].time[-1])
            released += [self.with_noise(each, origin, end) for each in self._waiting]
            self._waiting.clear()
        return released

    def with_noise(self, window: Samples, origin: int, until: float | None = None) -> tuple[Samples, NoiseLevels]:
        """Return a window with the noise estimated until a time (s), its end by default, and the levels then."""
        until = float(window.time[-1]) if until is None else until
        end = origin + round(until * 1e9)
        undeclared = self._undeclared & (self._declared_from > end)
        free = undeclared | self._estimate
        spacing = float(median(window.apart))
        levels = self._levels.levels_at(end, spacing, free=(bool(free[2:4].all()), bool(free[4:].all())))
        contradicted = levels.contradicted & ~free
        used = free | levels.used
        declared = self._declared(window, spacing)
        found = np.maximum(levels.factor * declared, _LEAST * TYPICAL)
        unknown = undeclared & np.isnan(found)
        factor = np.where(np.isnan(found) | ~used, 1.0, found / declared)
        if window.missing_rates[1] and spacing <= _SLOWEST and window.time[-1] < _FIRST * spacing:
            # With poses alone a window of far too much weight is never made up for; one of hardly any is no loss. A
            # twist informs as much, and poses that stay exact would never count.
            factor[2:4] = np.where(unknown, _AT_FIRST, factor)[2:4]
        time, of_twist = levels.times.tolist()
        time = self._noise.base_correlation_time or time
        noise = np.array([*(factor[:2] * declared[:2]), time])
        return replace(
            window,
            pose_covariance=_scaled(window.pose_covariance, factor[2:4], _correlation_factor(window.apart, time)),
            twist_covariance=_scaled(window.twist_covariance, factor[4:], _correlation_factor(window.apart, of_twist)),
            noise=np.repeat(noise[None], len(window), axis=0),
        ), NoiseLevels(
            declared=np.where(undeclared, np.nan, declared),
            estimated=found,
            assumed=np.where(unknown & _measured(window) if unknown.any() else unknown, factor * declared, np.nan),
            correlation_time=time,
            used=used & ~np.isnan(found),
            twist_correlation_time=of_twist,
            contradicted=contradicted,
            # Before the first difference nothing can contradict what is declared.
            clear=levels.clear and (until > ORDER * spacing or bool(free[2:].all())),
        )

    def _declared(self, window: Samples, apart: float) -> Array:
        """Return the (6,) declared standard deviations of single readings in a window, whose poses are s apart."""
        spacing = float(median(np.diff(window.time))) if len(window) > 1 else 0.0
        # Samples between two poses have the noise that they share as if it were each one's own.
        shared = max(apart / spacing, 1.0) if spacing > 0.0 else 1.0
        base = [
            np.sqrt(np.mean(np.diagonal(each, axis1=1, axis2=2).reshape(-1, 2, 3), axis=(0, 2)) / shared)
            for each in (window.pose_covariance, window.twist_covariance)
        ]
        return np.concatenate(([self._noise.joint_position, self._noise.joint_velocity], *base))


def _measured(window: Samples) -> Flags:
    """Return which of CHANNELS (6,) a window has readings of; poses are read where their covariance is finite."""
    pose = np.split(np.diagonal(window.pose_covariance, axis1=1, axis2=2), 2, axis=1)
    twist = window.base_linear_velocity, window.base_angular_velocity
    return np.array([bool(np.isfinite(x).any()) for x in (window.joint_position, window.joint_velocity, *pose, *twist)])


def _scaled(covariance: Array, factor: Array, weight: Array) -> Array:
    """Return covariances (N, 6, 6) times weights (N,), standard deviations of their two blocks times factors (2,)."""
    if np.all(factor == 1.0) and np.all(weight == 1.0):
        return covariance
    size = np.repeat(factor, 3)
    return weight[:, None, None] * covariance * (size * size[:, None])


def _correlation_factor(apart: Array, time: float) -> Array:
    """Return the variance of slow means of correlated readings over that of independent ones, (N,).

    An autoregression of first order with correlation c between neighbours has (1 + c) / (1 - c). `apart` (N,) s is the
    time between poses, 0 if unknown; `time` (s) that of the correlation.
    """
    if time <= 0.0:
        return np.ones(len(apart))
    return np.where(apart > 0.0, 1.0 / np.tanh(np.where(apart > 0.0, 0.5 * apart / time, 1.0)), 1.0)
