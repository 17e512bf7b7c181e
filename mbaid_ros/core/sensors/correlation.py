"""Correlation times and levels of a sensor's errors, first-order autoregressions, from variances of differences.

Sixth differences of readings hold no motion. They show the growth of the errors, but hardly its end: of all times that
explain them, the longest is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from mbaid_ros.core.geometry import Array, Flags, Integers

_STAMP = 1e-9  # s, the unit of stamps: readings that are closer have one stamp
FEWEST = 60  # differences for a level, which is then known to a sixth
_SOME = 12  # of readings further apart, for its growth
_INDEPENDENT = 0.3  # share of the differences that counts as independent, as neighbours share readings
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
class Correlation:
    """The correlation time (s) of a sensor's errors, their (2,) variances, and whether these are used, and must be."""

    time: float
    variance: Array  # of a reading over the declared one; NaN where not known
    used: Flags
    contradicted: Flags


_UNCLEAR = Correlation(0.0, np.full(2, np.nan), np.zeros(2, dtype=bool), np.zeros(2, dtype=bool))


def correlation(variance: Array, counts: Integers, apart: Array, time: float, declared: str) -> Correlation:
    """Return what explains the variances of sixth differences; of times that explain them as well, the longest.

    Parameters
    ----------
    variance : (2, k) of positions and orientations, or of both velocities, over the declared ones
    counts : (2, k) their numbers
    apart : (k,) s, from one reading of a difference to the next
    time : s, if declared; 0 where it is to be estimated
    declared : whether levels are: 'no', 'yes', or 'trusted', of which the data contradict none
    """
    weight = 0.5 * _INDEPENDENT * np.maximum(counts, 1)  # inverse of the variance of the logarithms
    if np.any(counts[:, 0] < FEWEST) or np.any(variance[:, 0] <= 0.0) or np.any(apart < _STAMP):
        return _UNCLEAR
    logarithm = np.log(np.maximum(variance, 1e-300))
    used = _without_motion(logarithm, counts, 1.0 / np.sqrt(weight))
    if not used:
        return _UNCLEAR
    times = np.array([time]) if time else _TIMES if used > 1 else _TIMES[:1]
    decay = -apart[:used, None] / np.maximum(times, 1e-9)[:, None, None]
    expected = np.log(np.exp(np.maximum(decay * np.arange(7), -700.0)) @ _AUTOCORRELATION)[:, None]
    weight = weight[:, :used]
    left = logarithm[:, :used] - expected
    total = np.sum(weight, axis=1)
    found = np.sum(weight * left, axis=2) / total  # (times, 2) logarithms of the levels over the declared ones
    cost = np.sum(weight * (left - found[..., None]) ** 2, axis=(1, 2))  # twice the negative log-likelihood
    if declared == 'trusted':
        cost += np.sum(total * found**2, axis=1)
    if not time and declared != 'no':
        cost += np.where(times > 0.0, _CLEAR, 0.0)
    if np.min(cost) > _NO_FIT * 2 * used and declared == 'yes':
        return _UNCLEAR
    likely: Flags = np.asarray(_likely(times, cost, used, apart[0], given=time > 0.0))
    last = int(np.flatnonzero(likely)[-1])
    wrong = total * np.maximum(np.abs(found) - _NEAR, 0.0) ** 2 > _CLEAR
    level_used = (wrong[last] | (times[last] > 0.0)) & (np.abs(found[last]) > _NEAR) & (declared != 'trusted')
    contradicted = level_used & np.all(wrong[likely], axis=0)
    return Correlation(float(times[last]), np.exp(found[last]), level_used, contradicted)


def _without_motion(logarithm: Array, counts: Integers, doubt: Array) -> int:
    """Return at how many of the strides, from the first on, no motion shows; 0 if it shows at the first, too.

    Parameters
    ----------
    logarithm, counts, doubt : (2, k) of the variances, their numbers, and standard deviations of the logarithms
    """
    growth = np.diff(logarithm, axis=1)
    known = np.all(counts[:, 1:] >= _SOME, axis=0)
    moves = np.any(growth > np.log(_NO_NOISE) + _DOUBT * (doubt[:, :-1] + doubt[:, 1:]), axis=0)
    used = 1 + int(np.argmin(np.append(known & ~moves, False)))
    if used > len(known) or not known[used - 1]:
        return used
    used = max(used - 1, 1)  # a trace of motion is in the stride before, too
    if used >= _SHORTEST:
        return used
    return 0 if np.mean(growth[:, 0]) > _DOUBT * np.mean(doubt[:, 1]) else 1


def _likely(times: Array, cost: Array, used: int, apart: float, *, given: bool) -> Flags:
    """Return which times (c,) explain the variances as well as the best one, by their cost (c,)."""
    likely = cost <= np.min(cost) + _LIKELY
    longest = times[likely][-1]
    short = not given and cost[0] <= np.min(cost) + _CLEAR and longest < 2.0 * apart
    if np.min(cost) > _NO_FIT * 2 * used or short or longest == 0.0:
        return np.arange(len(times)) == 0
    return (times > 0.0) & (cost <= np.min(cost[times > 0.0]) + _LIKELY)
