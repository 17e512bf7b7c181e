"""How noisy each sensor is, whatever moves, and whether its errors are correlated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array
from mbaid_ros.core.intake.differences import BINOMIAL, Differences, variances
from mbaid_ros.core.samples import BaseStream, JointStream, SensorNoise
from mbaid_ros.core.sensor_levels import CHANNELS

# Readings from one that is taken to the next: by octaves, up to where motion shows at a hundred hertz.
_STRIDES = (1, 2, 4, 8, 16, 32)
_FEWEST = 60  # differences that tell a level, to a sixth of it
_ANEW = 1.25  # times as many differences, at which levels are worked out again: nothing changes before
_SHORTEST = 3  # strides over which noise has to grow to count as correlated, where its size does not tell that
# Variance of neighbours' differences over that declared, below which it tells by itself that noise is correlated.
_SMALL = 0.25
_INDEPENDENT = 0.3  # of the differences: as many independent ones tell as much, as neighbours share readings
_NO_FIT = 25.0  # mean normalised square of what a correlation leaves of the variances, from which none explains them
# Times the variance grows from one stride to the next: by correlated noise, and by more than any noise: motion.
_GROWS, _NO_NOISE = 1.4, 2.3
_TIMES = np.geomspace(0.01, 10.0, 121)  # s, among which that of the correlation is looked for
# Correlations of errors that are (0 ... 6) strides apart make that of the variance of a difference.
_PRODUCTS = np.array(
    [np.sum(BINOMIAL[lag:] * BINOMIAL[: len(BINOMIAL) - lag]) * (2.0 if lag else 1.0) for lag in range(7)]
)


@dataclass(frozen=True)
class Levels:
    """What readings until some time say.

    Attributes
    ----------
    factor : (6,) of CHANNELS, how many times as noisy as declared; NaN where too few readings tell
    correlation_time : s, over which the errors of poses are correlated; 0 where they are not
    """

    factor: Array
    correlation_time: float


class NoiseLevels:
    """Finds levels by differences of readings; the same however the streams are cut.

    Parameters
    ----------
    noise : of the joints, as declared; that of the base is in its readings
    joints : number
    """

    def __init__(self, noise: SensorNoise, joints: int) -> None:
        self._noise = np.array([noise.joint_position, noise.joint_velocity])
        self._time = noise.base_correlation_time
        self._joints = Differences((slice(0, joints), slice(joints, 2 * joints)), ((1,), (1,)))
        columns = slice(0, 3), slice(3, 12), slice(12, 15), slice(15, 18)
        self._base = Differences(columns, (_STRIDES, _STRIDES, (1,), (1,)))
        self._counted, self._free = 0, False
        self._levels = Levels(np.full(len(CHANNELS), np.nan), 0.0)

    def take(self, joints: JointStream | None, base: BaseStream | None) -> None:
        """Take readings of each kind in the order of their stamps."""
        if joints is not None and len(joints.stamp):
            values = np.concatenate((joints.position, joints.velocity), axis=1)
            self._joints.take(joints.stamp, values, np.repeat(self._noise[None], len(values), axis=0))
        if base is not None and len(base.stamp):
            parts = base.position, base.rotation.reshape(-1, 9), base.linear_velocity, base.angular_velocity
            sizes = [
                np.sqrt(np.mean(np.diagonal(each, axis1=1, axis2=2).reshape(-1, 2, 3), axis=2))
                for each in (base.pose_covariance, base.twist_covariance)
            ]
            self._base.take(base.stamp, np.concatenate(parts, axis=1), np.concatenate(sizes, axis=1))

    def until(self, stamp: int, spacing: float, *, free: bool) -> Levels:
        """Return what the readings until a stamp say, no earlier than that of the call before.

        Parameters
        ----------
        stamp : ns
        spacing : s, between poses
        free : whether levels of poses are found; else they are as declared, and only how they are correlated is found
        """
        self._joints.count(stamp)
        self._base.count(stamp)
        total = int(self._joints.counts.sum() + self._base.counts.sum())
        if total > _ANEW * self._counted or free is not self._free:
            self._counted, self._free = total, free
            self._levels = self._found(spacing, free=free)
        return self._levels

    def _found(self, spacing: float, *, free: bool) -> Levels:
        """Return the levels that the counts come to."""
        joints, base = variances(self._joints.counts), variances(self._base.counts)
        counts = np.concatenate((self._joints.counts, self._base.counts)).sum(axis=1)
        count = len(_STRIDES)
        poses, told = base[: 2 * count].reshape(2, count), counts[2 : 2 + 2 * count].reshape(2, count)
        variance = np.concatenate((joints, poses[:, 0], base[2 * count :]))
        enough = np.concatenate((counts[:2], told[:, 0], counts[2 + 2 * count :])) >= _FEWEST
        time, noise = _correlated(poses, told, spacing, self._time, free=free)
        variance[2:4] = noise
        return Levels(np.sqrt(np.where(enough, variance, np.nan)), time)


def _correlated(variance: Array, counts: Array, spacing: float, time: float, *, free: bool) -> tuple[float, Array]:
    """Return over what time (s) the errors of poses are correlated, 0 if none is found, and their (2,) variance.

    The variance is NaN where they are not independent, and no time explains them.

    Parameters
    ----------
    variance, counts : (2, strides) of the differences of positions and orientations
    spacing : s, between poses
    time : s, that is given; 0 where it is to be found
    free : whether the variance of a single error is not known to be 1
    """
    white, unclear = (0.0, variance[:, 0]), (0.0, np.full(2, np.nan))
    if np.any(counts[:, 0] < _FEWEST) or np.any(variance[:, 0] <= 0.0):
        return white
    relative = np.sqrt(2.0 / (_INDEPENDENT * np.maximum(counts, 1)))  # standard deviation of each
    growth = np.diff(np.log(np.maximum(variance, 1e-300)), axis=1)
    known = np.all(counts[:, 1:] >= _FEWEST, axis=0)
    # Errors of the size declared that hardly change are correlated, unless those further apart say that they are small.
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
