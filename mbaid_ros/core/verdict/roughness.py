"""How noisy the sensors are, whatever the model: by fourth differences of samples, which no motion is left in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.geometry import Array, log
from mbaid_ros.core.samples import Samples

CHANNELS = ('base_orientation', 'base_position', 'base_angular_velocity', 'base_linear_velocity', 'joint_position')
_WEIGHT = 70.0  # variance of a fourth difference of white noise of unit variance
_MEDIAN = 0.6745  # of a normal number's size: what makes a median a standard deviation
_FAR = 6.0  # robust standard deviations, from which a difference has an outlier in it
_FEWEST = 12  # samples of a window: fewer have too few differences of fourth order for a median
_TOUCHED = 5  # differences of fourth order that a sample is in


@dataclass(frozen=True)
class Roughness:
    """What the samples of some windows say.

    Attributes
    ----------
    factor : (5,) of CHANNELS, how many times as noisy as declared; NaN where they cannot say
    outliers : share of the poses that are far off
    """

    factor: Array
    outliers: float


def roughness(windows: Sequence[Samples], joint_position: float) -> Roughness:
    """Return how noisy windows of samples are.

    Parameters
    ----------
    windows : with the noise of the base that is declared
    joint_position : rad, one standard deviation that is declared
    """
    parts = [_differences(window, joint_position) for window in windows if len(window) >= _FEWEST]
    if not parts:
        return Roughness(np.full(len(CHANNELS), np.nan), 0.0)
    size = [np.abs(np.concatenate([part[channel] for part in parts])) for channel in range(len(CHANNELS))]
    factor = np.array([np.nanmedian(each) / _MEDIAN if np.isfinite(each).any() else np.nan for each in size])
    pose = np.maximum(*(np.max(size[channel], axis=1) / max(factor[channel], 1e-9) for channel in range(2)))
    return Roughness(factor, float(np.mean(pose > _FAR)) / _TOUCHED)


def _differences(window: Samples, joint_position: float) -> tuple[Array, ...]:
    """Return the fourth differences of each channel in units of their declared standard deviations."""
    middle = window.base_rotation[len(window) // 2]
    turned = log(window.base_rotation @ middle.T)
    pose, twist = (
        np.sqrt(_WEIGHT * np.mean(np.diagonal(each, axis1=1, axis2=2), axis=0))
        for each in (window.pose_covariance, window.twist_covariance)
    )
    return (
        np.diff(turned, 4, axis=0) / pose[3:],
        np.diff(window.base_position, 4, axis=0) / pose[:3],
        np.diff(window.base_angular_velocity, 4, axis=0) / twist[3:],
        np.diff(window.base_linear_velocity, 4, axis=0) / twist[:3],
        np.diff(window.joint_position, 4, axis=0) / (np.sqrt(_WEIGHT) * joint_position),
    )
