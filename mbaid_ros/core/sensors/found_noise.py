"""Windows with the noise that their sensors have turned out to have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbaid_ros.core.geometry import Array, Flags
from mbaid_ros.core.samples import BaseStream, JointStream, Samples, SensorNoise, Stamps
from mbaid_ros.core.sensors.levels import CHANNELS, TYPICAL, SensorLevels
from mbaid_ros.core.sensors.noise import NoiseLevels

# Part of a servicer's usual sensor noise, below which no level counts: a model is off by more than by that.
_LEAST = 1.0 / 30.0
# Of poses without a twist, undeclared: spacing (s) up to which differences tell their noise, poses that takes, lost
# ones included, and how many times as noisy as usual they count until then.
_SLOWEST, _FIRST, _AT_FIRST = 0.2, 40, 100.0
_NEVER = np.iinfo(np.int64).max


class FoundNoise:
    """Follows how noisy the sensors are, and says it of each window.

    Parameters
    ----------
    noise : as declared; what it has of the base counts where messages have no covariance
    joints : number
    undeclared : (6,) of which CHANNELS nobody has declared anything: what is found of them is used until a message
        declares it; none where not given
    estimate : whether what is found is used of all, and not what is declared
    """

    def __init__(
        self, noise: SensorNoise, joints: int, undeclared: Flags | None = None, *, estimate: bool = False
    ) -> None:
        self._noise = noise
        self._estimate = estimate
        self._undeclared = np.zeros(len(CHANNELS), dtype=bool) if undeclared is None else undeclared
        self._declared_from: Stamps = np.full(len(CHANNELS), _NEVER)  # by messages, ns
        self._levels = NoiseLevels(noise, joints)

    def take(self, joints: JointStream | None, base: BaseStream | None) -> None:
        """Take readings as they arrived, in the order of their stamps, without repeated poses and outliers."""
        self._levels.take(joints, base)
        if base is not None and len(base.stamp):
            first = np.where(base.declared, base.stamp[:, None], _NEVER).min(axis=0)
            self._declared_from[2:] = np.minimum(self._declared_from[2:], first)

    def applied(self, window: Samples, origin: int) -> tuple[Samples, SensorLevels]:
        """Return a window with its noise, and what is known of that by then.

        Parameters
        ----------
        window : the next one
        origin : ns, stamp at time 0
        """
        end = origin + round(float(window.time[-1]) * 1e9)
        undeclared = self._undeclared & (self._declared_from > end)
        used = undeclared | self._estimate
        spacing = float(np.median(window.apart))
        levels = self._levels.until(end, spacing, free=bool(used[2:4].all()))
        declared = self._declared(window)
        found = np.maximum(levels.factor * declared, _LEAST * TYPICAL)
        factor = np.where(np.isnan(found) | ~used, 1.0, found / declared)
        if window.missing_rates[1] and spacing <= _SLOWEST and window.time[-1] < _FIRST * spacing:
            # Of poses alone a window that is weighted far too much is never made up for; one that hardly counts is no
            # loss. Where there is a twist it tells as much, and what stays exact would never count.
            factor[2:4] = np.where(np.isnan(found) & undeclared, _AT_FIRST, factor)[2:4]
        time = self._noise.base_correlation_time or levels.correlation_time
        noise = np.array([*(factor[:2] * declared[:2]), time])
        return replace(
            window,
            pose_covariance=_scaled(window.pose_covariance, factor[2:4], _slower(window.apart, time)),
            twist_covariance=_scaled(window.twist_covariance, factor[4:], np.ones(len(window))),
            noise=np.repeat(noise[None], len(window), axis=0),
        ), SensorLevels(
            declared=np.where(undeclared, np.nan, declared),
            found=found,
            assumed=np.where(undeclared & np.isnan(found) & _read(window), factor * declared, np.nan),
            correlation_time=time,
            used=used & ~np.isnan(found),
        )

    def _declared(self, window: Samples) -> Array:
        """Return the (6,) standard deviations of single readings that are declared of a window."""
        spacing = float(np.median(np.diff(window.time))) if len(window) > 1 else 0.0
        # Samples between two poses have the noise that they share as if it were each one's own.
        shared = max(float(np.median(window.apart)) / spacing, 1.0) if spacing > 0.0 else 1.0
        base = [
            np.sqrt(np.mean(np.diagonal(each, axis1=1, axis2=2).reshape(-1, 2, 3), axis=(0, 2)) / shared)
            for each in (window.pose_covariance, window.twist_covariance)
        ]
        return np.concatenate(([self._noise.joint_position, self._noise.joint_velocity], *base))


def _read(window: Samples) -> Flags:
    """Return which of CHANNELS (6,) a window has readings of; of poses the covariance tells."""
    values = (
        window.joint_position,
        window.joint_velocity,
        np.diagonal(window.pose_covariance, axis1=1, axis2=2)[:, :3],
        np.diagonal(window.pose_covariance, axis1=1, axis2=2)[:, 3:],
        window.base_linear_velocity,
        window.base_angular_velocity,
    )
    return np.array([bool(np.any(np.isfinite(each))) for each in values])


def _scaled(covariance: Array, factor: Array, weight: Array) -> Array:
    """Return covariances (N, 6, 6), weighted (N,), their two parts (2,) times as large as standard deviations."""
    if np.all(factor == 1.0) and np.all(weight == 1.0):
        return covariance
    size = np.repeat(factor, 3)
    return weight[:, None, None] * covariance * (size * size[:, None])


def _slower(apart: Array, time: float) -> Array:
    """Return how many times as large slow means of poses are as those of independent ones, as a variance, (N,).

    Of an autoregression of first order with correlation c from one to the next that is (1 + c) / (1 - c).

    Parameters
    ----------
    apart : (N,) s, between poses; 0 where not known
    time : s, over which their errors are correlated
    """
    if time <= 0.0:
        return np.ones(len(apart))
    return np.where(apart > 0.0, 1.0 / np.tanh(np.where(apart > 0.0, 0.5 * apart / time, 1.0)), 1.0)
