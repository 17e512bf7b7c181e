"""Noise that is correlated over a time, a first-order autoregression, as it shows in windows."""

from __future__ import annotations

import math

import numpy as np

from mbaid_ros.core.samples import Samples

# Variance of second differences over that of white noise as declared, below which noise is correlated, and
# correlation of neighbouring ones, above which it is not: noise has -2/3 to -1/2, interpolated poses, also small,
# positive ones.
_SMALL, _SMOOTH = 0.25, -0.25
_FEWEST = 20  # samples: the variance of second differences of fewer is uncertain to a quarter


def cause(time: float) -> str:
    """Return the cause: over what time (s) the odometry's noise is correlated, and what to set."""
    shown = f'{time:.2g}'
    return f'the noise of the odometry is correlated over about {shown} s: set noise.base_correlation_time to {shown}'


def seen_in(window: Samples) -> tuple[float, float]:
    """Return over what time (s) the positions' errors are correlated, by how little they change, and what tells it.

    With correlation c from one sample to the next, second differences have (1 - c)(3 - c) / 3 of the variance they have
    without. 0 where they are about as large as declared; the second number is a log-likelihood.

    Parameters
    ----------
    window : of samples with the noise that is declared
    """
    if len(window) < _FEWEST:
        return 0.0, 0.0
    deviation = np.sqrt(6.0 * np.mean(np.diagonal(window.pose_covariance, axis1=1, axis2=2)[:, :3], axis=0))
    changes = np.diff(window.base_position, 2, axis=0) / deviation
    ratio = float(np.mean(changes**2))
    if not 0.0 < ratio < _SMALL or np.mean(changes[1:] * changes[:-1]) > _SMOOTH * ratio:
        return 0.0, 0.0
    correlation = 2.0 - math.sqrt(1.0 + 3.0 * ratio)
    step = float(np.median(np.diff(window.time)))
    return -step / math.log(correlation), 0.5 * changes.size * (ratio - 1.0 - math.log(ratio))
