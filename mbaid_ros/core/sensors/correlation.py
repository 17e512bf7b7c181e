"""Correlation times and levels of a sensor's errors, first-order autoregressions, from variances of differences.

Sixth differences of readings hold no motion. They show the growth of the errors, but hardly its end. Poses less the
integrated twist hold no motion either, however far apart: their differences show the end.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from mbaid_ros.core.geometry import Array, Flags

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
    apart: Array

    @property
    def weight(self) -> Array:
        """Inverse of the variance of their logarithms, (2, k)."""
        return 0.5 * _INDEPENDENT * np.maximum(self.counts, 1)


@dataclass(frozen=True)
class Candidates:
    """What the errors of a sensor may be: correlation times (c,) in s, and for each twice the negative log-likelihood.

    Attributes
    ----------
    time, cost : (c,)
    level, found : (c, 2) logarithms of the variances of a reading over the declared ones: in use, and of the data
    wrong : (c, 2) whether the latter are far from the declared ones
    """

    time: Array
    cost: Array
    level: Array
    found: Array
    wrong: Flags

    def __getitem__(self, index: slice | Flags) -> Candidates:
        """Return some of them."""
        return Candidates(*(part[index] for part in vars(self).values()))


@dataclass(frozen=True)
class Correlation:
    """The correlation time (s) of a sensor's errors, their (2,) variances, and whether these are used, and must be."""

    time: float
    variance: Array
    used: Flags
    contradicted: Flags


def candidates(seen: Variances, time: float, declared: str) -> Candidates:
    """Return what explains the variances of sixth differences.

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
    if np.any(seen.counts[:, 0] < FEWEST) or np.any(variance[:, 0] <= 0.0) or np.any(seen.apart < _STAMP):
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
    decay = -seen.apart[used, None] / np.maximum(times, 1e-9)[:, None, None]
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
    if not time and cost[0] <= np.min(cost) + _CLEAR and longest < 2.0 * seen.apart[0]:
        return every[:1]
    return every[times > 0.0] if np.argmin(cost) or longest else every[:1]


def chosen(pose: Candidates, twist: Candidates, drift: Variances, ratio: Array) -> tuple[Correlation, Correlation]:
    """Return the errors of poses and twists; of correlation times that explain the data as well, the longest.

    Parameters
    ----------
    pose, twist : what they may be
    drift : first differences of poses less the integrated twist, over the variance declared of poses
    ratio : (2,) 1/s, standard deviations declared of twists over those of poses
    """
    cost, shortest = pose.cost[:, None] + twist.cost, drift.apart[0] / 32.0  # s: half of the time between readings
    known = np.all(drift.counts >= _SOME, axis=0) & np.all(drift.variance > 0.0, axis=0)
    if known.any():
        of_pose = -np.expm1(-drift.apart / np.maximum(pose.time, 1e-9)[:, None])
        share = drift.apart / np.maximum(twist.time, shortest)[:, None]
        of_twist = np.maximum(twist.time, shortest)[:, None] ** 2 * (share + np.expm1(-share))
        expected = np.exp(pose.level)[:, None, :, None] * of_pose[:, None, None]
        expected = expected + (np.exp(twist.level) * ratio**2)[:, :, None] * of_twist[:, None]
        left = (np.log(np.maximum(drift.variance, 1e-300)) - np.log(expected))[..., known]
        more = _OF_FIRST / _INDEPENDENT * np.sum(drift.weight[:, known] * left**2, axis=(2, 3))
        if np.min(more) < _NO_FIT * 2 * np.sum(known):
            cost = cost + more
    likely: Flags = np.asarray(cost <= np.min(cost) + _LIKELY)
    return _longest(pose, np.any(likely, axis=1)), _longest(twist, np.any(likely, axis=0))


def _longest(sensor: Candidates, likely: Flags) -> Correlation:
    last = int(np.flatnonzero(likely)[-1])
    used, contradicted = np.abs(sensor.level[last]) > _NEAR, np.all(sensor.wrong[likely], axis=0)
    return Correlation(float(sensor.time[last]), np.exp(sensor.found[last]), used, used & contradicted)
